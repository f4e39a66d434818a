"""Sizes that no robot has: mostly a wrong unit, reported before hours of work begin."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from roadmap.errors import BadRobot
from roadmap.geometry.solids import Solid
from roadmap.robot.description import Description, Joint, Link, Shape
from roadmap.robot.robot import BOX, CYLINDER, HULL

# The longest links are rails and booms of some 20 m; a hand's breadth drawn in
# millimetres and read in metres is 80 m [m].
LARGEST = 30.0
# Most CAD programs draw in millimetres, where 5 m is a screw; links of the largest
# arms are 3 m long. Longer ones say by a scale that they mean it [m].
LARGEST_UNSCALED = 5.0
SMALLEST_MESH = 1e-3  # [m] no part of a robot: metres that were scaled, too
SMALLEST_ROBOT = 1e-2  # [m] its largest part
FARTHEST_JOINT = 100.0  # [m] from the joint before
FARTHEST_SHAPE = 30.0  # [m] from its link's frame
# No cable allows more than a dozen turns; many programs write 1e4 for "endless" [rad].
LARGEST_TURN = 100.0
LARGEST_SLIDE = 100.0  # [m]


def check_sizes(
    description: Description, owners: Sequence[Link], solids: Sequence[Solid]
) -> None:
    """Refuse sizes that no robot has: name link, size, limit and scale.

    `owners` are the links with geometry, in the order of the solids, one for each
    shape.
    """
    shapes = [(link, s) for link in owners for s in link.collisions or link.visuals]
    for (link, shape), solid in zip(shapes, solids, strict=True):
        _check_solid(link, shape, extent(solid))
        _check_place(link, shape, solid)
    largest = max(map(extent, solids), default=1.0)
    if largest < SMALLEST_ROBOT:
        raise BadRobot(
            f"the largest part of {description.name} is {_length(largest)} long, but "
            f"at least {_length(SMALLEST_ROBOT)} are expected; give lengths in metres"
        )
    for joint in description.joints.values():
        far = float(np.linalg.norm(joint.T_parent_joint[:3, 3]))
        if far > FARTHEST_JOINT:
            raise BadRobot(
                f"joint {joint.name!r} sits {_length(far)} from the joint before, but "
                f"at most {_length(FARTHEST_JOINT)} are expected; give all lengths in "
                "metres, not in millimetres"
            )


def check_travel_limits(joint: Joint, lower: float, upper: float) -> None:
    """Refuse limits that no joint has [rad or m]."""
    slides = joint.kind == "prismatic"
    most, unit = (LARGEST_SLIDE, "m") if slides else (LARGEST_TURN, "rad")
    far = max(lower, upper, key=abs)
    if abs(far) <= most:
        return
    remedy = (
        "give it in metres, not in millimetres"
        if slides
        else 'write type="continuous" and no <limit> if it turns without end'
    )
    raise BadRobot(
        f"joint {joint.name!r} has the limit {far:g} {unit}, but at most {most:g} "
        f"{unit} either way are expected; {remedy}"
    )


def extent(solid: Solid) -> float:
    """Return the largest edge of a solid's box, in its own frame [m]."""
    if solid.kind == HULL:
        return float(np.ptp(solid.points, axis=0).max())
    if solid.kind == BOX:
        return float(max(solid.size))
    if solid.kind == CYLINDER:
        return float(max(2 * solid.size[0], solid.size[1]))
    return float(2 * solid.size[0])


def _check_place(link: Link, shape: Shape, solid: Solid) -> None:
    middle = solid.points.mean(axis=0) if solid.kind == HULL else np.zeros(3)
    T = shape.T_link_shape
    far = float(np.linalg.norm(T[:3, :3] @ middle + T[:3, 3]))
    if far > FARTHEST_SHAPE:
        raise BadRobot(
            f"the {shape.kind} of link {link.name!r} sits {_length(far)} from the "
            f"link's frame, but at most {_length(FARTHEST_SHAPE)} are expected; give "
            "its <origin> in metres, or move the mesh in its file"
        )


def _check_solid(link: Link, shape: Shape, size: float) -> None:
    mesh = shape.kind == "mesh"
    most = LARGEST_UNSCALED if mesh and not shape.scaled else LARGEST
    if size <= most and not (mesh and size < SMALLEST_MESH):
        return
    what = f"mesh {Path(shape.filename).name!r}" if mesh else shape.kind
    text = f"the {what} of link {link.name!r} is {_length(size)} long"
    if size < SMALLEST_MESH:
        raise BadRobot(
            f"{text}, but at least {_length(SMALLEST_MESH)} are expected of a mesh; if "
            'it is drawn in metres, write scale="1 1 1"'
        )
    text += f", but at most {_length(most)} are expected"
    if not mesh:
        raise BadRobot(f"{text}; give all lengths in metres, not in millimetres")
    less = " ".join(f"{1e-3 * s:g}" for s in shape.size)
    text += f'; if it is drawn in millimetres, write scale="{less}"'
    if size <= LARGEST:
        text += ', and scale="1 1 1" if it is really so large'
    raise BadRobot(text)


def _length(size: float) -> str:
    return f"{size:.4g} m" if size >= 0.1 else f"{1e3 * size:.3g} mm"
