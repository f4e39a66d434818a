"""Which motions and goals are free of everything, and what they are not free of."""

import numpy as np

from odm.answer import Freedom
from odm.checks import check_numbers, outside_limits
from odm.close_test.static import StaticTest
from odm.frame.frame import Frame
from odm.frame.last_phase import LastPhase
from roadmap.errors import BadConfiguration


def check_valid(static: StaticTest, q: np.ndarray, name: str) -> None:
    """Raise BadConfiguration, by `name`, where q (dof,) can never be a goal."""
    if not np.isfinite(q).all():
        raise BadConfiguration(f"{name} holds NaN or infinity: {q}; give numbers")
    trouble = outside_limits(static.robot, q, 0.0)
    if trouble is not None:
        raise BadConfiguration(f"{name} is out of limits: {trouble}; move it inside")
    still = np.zeros_like(q)
    if static.motion_free(q, still):
        return
    why = static.why(q, still)
    if why is not None:
        raise BadConfiguration(f"{name} is not free: {why}; choose another one")


def is_valid(static: StaticTest, q: np.ndarray) -> bool:
    """Whether q (dof,) can be a goal: what `check_valid` refuses cannot."""
    within = np.isfinite(q).all() and outside_limits(static.robot, q, 0.0) is None
    return bool(within) and static.motion_free(q, np.zeros_like(q))


def is_free(
    frame: Frame,
    q_a: np.ndarray,
    q_b: np.ndarray,
    phase: str | None = None,
    last_phase: LastPhase | None = None,
) -> Freedom:
    """Test a straight motion; see `ReactivePlanner.is_free`.

    Scenery and last points are the frame's; a phase is tested by `last_phase`.
    """
    if phase is not None:
        last_phase.links_that_may(phase)
    ends = []
    for name, q in (("q_a", q_a), ("q_b", q_b)):
        q = check_numbers(frame.robot, q, name)
        trouble = outside_limits(frame.robot, q, 0.0)
        if trouble is not None:
            return Freedom(False, "limits", f"{name}: {trouble}")
        ends.append(q)
    dq = frame.difference(ends[0], ends[1])
    why = frame.static.why(ends[0], dq)
    if why is not None:
        itself = frame.static.touches_itself(ends[0], dq) is not None
        return Freedom(False, "self-collision" if itself else "scenery", why)
    if frame.trouble is not None:
        text = f"the last frame could not be used: {frame.trouble}"
        return Freedom(False, "frame", text)
    if phase is not None:
        points = frame.points[: frame.n_given]
        last_phase.look(phase, points, frame.classes, frame.solids, frame.solid_classes)
        hit = last_phase.hit(frame.cover(), ends[0], dq)
        if hit is None:
            return Freedom(True)
        link, what = frame.static.link_of(hit[0]), frame.name_of(hit[1])
        text = f"{link} would come too near to {what} by {in_cm(hit[2])}"
        return Freedom(False, "frame", text)
    if frame.motion_clear(ends[0], dq):
        return Freedom(True)
    test = frame.close_test
    sphere, point = test.blocked_by
    text = (
        f"{frame.static.link_of(sphere)} would come within "
        f"{in_cm(frame.kept_from(point))} of {frame.name_of(point)} at "
        f"{test.blocked_at:.0%} of the motion"
    )
    return Freedom(False, "frame", text)


def in_cm(length: float) -> str:
    """Return a length [m] as people read it."""
    return f"{100 * length:.1f} cm"
