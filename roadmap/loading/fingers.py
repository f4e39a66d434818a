"""Which joints beyond the tool are fingers: held over their whole travel by default.

A finger hangs on the last body that moves the tool, has two limits and does not move
the tool itself. What the user locks stands still, as does what cannot be held.
"""

from collections.abc import Callable, Collection, Mapping

from roadmap.loading.body_tree import BodyTree, drive
from roadmap.loading.finger_chain import carried_links, has_limits
from roadmap.loading.travel import WIDEST
from roadmap.robot.description import MOVABLE, Description

_FARTHEST = 0.5  # [m] what moves something farther is an arm, not a finger


def finger_joints(
    description: Description,
    tree: BodyTree,
    tip: str,
    locked: Collection[str],
    radii_of_links: Callable[[], Mapping[str, float]],
) -> tuple[tuple[str, ...], dict[str, str]]:
    """Choose the joints that travel where nothing is said.

    Returns their names, and of those of the gripper that do not, why. How far the
    solids of each link reach from its origin [m] is asked only where something may
    travel, since it takes seconds.
    """
    chosen, not_chosen = [], {}
    for name in _beyond(description, tree, tip):
        joint = description.joints[name]
        if name in locked or (has_limits(joint) and joint.lower == joint.upper):
            continue
        if has_limits(joint):
            chosen.append(name)
        else:
            not_chosen[name] = "it has no two limits"
    if not chosen:
        return (), not_chosen
    radii = radii_of_links()
    while True:
        worst = _too_wide(description, tree, chosen, radii)
        if worst is None:
            return tuple(chosen), not_chosen
        chosen.remove(worst[0])
        not_chosen[worst[0]] = worst[1]


def _beyond(description: Description, tree: BodyTree, tip: str) -> list[str]:
    """Return the drivers that move links of the tool's body, but not the tip."""
    body = tree.link_body[tip]
    moves = [
        (drive(description, joint)[0], joint.child)
        for joint in description.joints.values()
        if joint.kind in MOVABLE
    ]
    to_tip = {joint.child for joint in description.path(tip)}
    fixed = {name for name, child in moves if child in to_tip}
    names = [name for name, child in moves if tree.link_body[child] == body]
    still = [n for n in names if n not in fixed and n not in tree.joint_names]
    return list(dict.fromkeys(still))


def _too_wide(
    description: Description,
    tree: BodyTree,
    chosen: list[str],
    radii: Mapping[str, float],
) -> tuple[str, str] | None:
    """Return the joint that moves a link too far, and why it cannot travel."""
    worst, why, farthest = None, "", 0.0
    for link, carried in carried_links(description, tree, chosen).items():
        if link not in radii:
            continue
        bounds = carried.motion_bounds(radii[link])
        name, moved = carried.drivers[bounds.argmax()], float(bounds.max())
        several = carried.cells(radii[link])[2] > WIDEST
        if (moved > _FARTHEST or several) and moved > farthest:
            worst, farthest = name, moved
            why = f"it would move {link} by up to {moved:.2f} m"
            if moved <= _FARTHEST and len(carried.drivers) > 1:
                why = f"{link} hangs on {' and '.join(carried.drivers)}"
    return None if worst is None else (worst, why)
