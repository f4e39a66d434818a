"""Where the spheres are: shared by the escape and by drawings."""

from numba import njit

from roadmap.kinematics._forward import body_frames, place_points


@njit(cache=True, nogil=True)
def place_anchor(arm, q, work):
    """Write the sphere centres at q to work.anchor."""
    body_frames(arm.tree_i, arm.tree_f, q, work.frames[0])
    place_points(work.frames[0], arm.body, arm.spheres, work.anchor)
