"""A hand of the user's own: a table of a scene's file, checked by its URDF."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from handover.grasps.agents import AgentArm
from handover.grasps.hand import make_hand
from handover.grasps.hands import HandSpec, hand_names
from roadmap.errors import BadInput, did_you_mean
from roadmap.loading.body_tree import bodies_of, drive
from roadmap.ranges import told
from roadmap.robot.description import MOVABLE, Description, read_description
from roadmap.robot.known import robot_file

KEYS = {
    *("name", "root", "palm", "fingers", "closed", "preshapes"),
    *("palm_position", "palm_rpy"),
}
_FAR = 1.0  # [m] of a palm's frame from its link
_NAME = re.compile(r"[A-Za-z0-9_.-]{1,64}")  # it is part of a folder's name


def own_hand(
    table: Mapping, urdf: str, T_link_palm: np.ndarray, whose: str, path: Path
) -> HandSpec:
    """Return what a table says of a hand; `check_hand` compares it with the URDF.

    Args:
        table: Its keys are some of `KEYS`, its numbers were checked.
        urdf: Path of the URDF of the robot that carries it.
        T_link_palm: (4, 4) what `palm_position` and `palm_rpy` say [m].
        whose: Whose arm it is, for messages.
        path: The scene's file, for messages.

    Raises:
        BadInput: A key that is missing, or of another kind.
    """
    for key in ("root", "palm", "fingers", "closed", "preshapes"):
        if key not in table:
            raise BadInput(f"{path}: the hand of {whose} has no {key}; add it")
    if np.abs(T_link_palm[:3, 3]).max() > _FAR:
        raise BadInput(
            f"{path}: palm_position of {whose} is {table['palm_position']!r}, farther "
            f"than {_FAR:g} m from its link; give metres"
        )
    name = table.get("name", f"{Path(urdf).stem}_hand")
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise BadInput(
            f"{path}: the hand of {whose} has the name {told(name)}; give letters, "
            "digits, '_', '-' and '.', 64 at most"
        )
    if name in hand_names():
        raise BadInput(
            f"{path}: the hand of {whose} has the name {name!r}, which is a known "
            "hand's; give another name, or that name in place of the table"
        )
    return HandSpec(
        name,
        urdf,
        str(table["root"]),
        str(table["palm"]),
        tuple(tuple(finger) for finger in table["fingers"]),
        table["closed"],
        tuple(table["preshapes"]),
        T_link_palm,
    )


def check_hand(arm: AgentArm, own: bool, whose: str, path: Path) -> None:
    """Refuse an arm whose hand, or tip, is not as its URDF says.

    Args:
        arm: The arm; its hand is read from its URDF.
        own: Whether the hand is the user's own, and not a known one.
        whose: Whose arm it is, for messages.
        path: The scene's file, for messages.

    Raises:
        BadInput: A link or joint that is not there, cannot be driven or belongs to two
            fingers, a value outside its limits, or no open hand.
        BadRobot: The palm moves against the root, or a joint is left out.
    """
    spec, file = arm.spec, robot_file(arm.robot)
    description = read_description(file)
    fingers = [name for finger in spec.fingers for name in finger]
    missing = [name for name in fingers if name not in description.joints]
    if missing:
        give = "give the hand of the URDF as a table, see docs/plans.md"
        if own:
            meant = did_you_mean(missing[0], description.joints)
            give = f"{meant} joints of it: {', '.join(description.joints)}"
        raise BadInput(
            f"{path}: {whose} has the hand {spec.name!r}, but {file.name} has no joint "
            f"{missing[0]!r}, which moves that hand; {give}"
        )
    for key, link in (("tip", arm.tip), ("root", spec.root), ("palm", spec.palm)):
        if link not in description.links:
            raise BadInput(
                f"{path}: {key} of {whose} is {link!r}, but {file.name} has no such "
                f"link; {did_you_mean(link, description.links)} one of "
                f"{', '.join(description.links)}"
            )
    if own:
        _check_joints(spec, fingers, description, f"{path}: the hand of {whose}")
    make_hand(spec)


def _check_joints(
    spec: HandSpec, fingers: Sequence[str], description: Description, what: str
) -> None:
    """Refuse fingers, `closed` and preshapes that the hand's joints cannot be at."""
    below = [j for j in description.below(spec.root) if j.kind in MOVABLE]
    driving = list(dict.fromkeys(drive(description, j)[0] for j in below))
    if not fingers or not all(spec.fingers) or len(set(fingers)) < len(fingers):
        raise BadInput(
            f"{what} has fingers {[list(f) for f in spec.fingers]}; give each finger "
            f"joints of its own, of {', '.join(driving)}"
        )
    if not spec.preshapes:
        raise BadInput(f"{what} has no preshapes; give how it stands open")
    tree = bodies_of(description, driving, {})
    ends = np.stack([tree.limits["lower"], tree.limits["upper"]], axis=1)
    values = {"fingers": dict.fromkeys(fingers), "closed": spec.closed}
    values |= {f"preshape {k}": shape for k, shape in enumerate(spec.preshapes)}
    for key, named in values.items():
        some = fingers if key == "closed" else driving
        for name, value in named.items():
            if name not in some:
                raise BadInput(
                    f"{what}: {key} has {name!r}, which moves none of it; "
                    f"{did_you_mean(name, some)} joints of {', '.join(some)}"
                )
            low, high = ends[driving.index(name)]
            if value is not None and not low - 1e-9 <= value <= high + 1e-9:
                raise BadInput(
                    f"{what}: {key} has {name} at {value:g}, outside its limits "
                    f"{low:g} to {high:g}; give rad or m within them"
                )
    without = [name for name in fingers if name not in spec.closed]
    if without:
        raise BadInput(f"{what}: closed lacks {without[0]!r}; say where it closes to")
