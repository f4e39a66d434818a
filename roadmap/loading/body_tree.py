"""From a robot description to bodies: which joints move, what is fixed to what."""

import sys
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from roadmap.errors import BadRobot
from roadmap.kinematics.joint_tree import FIXED, PRISMATIC, REVOLUTE
from roadmap.loading.sizes import check_travel_limits
from roadmap.ranges import is_between
from roadmap.robot.description import MOVABLE, NO_STOP, Description, Joint
from roadmap.robot.joint_values import DEGREES, TURN, looks_like_degrees
from roadmap.transforms import joint_motion

# Used where the URDF has no velocity, zero or infinity [rad/s, m/s].
DEFAULT_VELOCITY = {"revolute": 1.0, "continuous": 1.0, "prismatic": 0.1}
QUICK = 12.0  # [rad/s] twice what the wrists of common arms do
FASTER = "faster than arms beside people do"
# A URDF has no acceleration or jerk: full speed in 0.25 s, full acceleration in 0.1 s.
ACCELERATION_PER_VELOCITY = 4.0
JERK_PER_ACCELERATION = 10.0
_ROUNDING = 1e-9  # [rad or m] by which a follower's stop may be nearer


@dataclass(frozen=True, eq=False)
class BodyTree:
    """Bodies and where each link sits; see `Robot` for the arrays.

    `fixed_values` are those of the joints that stand still, drivers only [rad or m].
    """

    joint_names: tuple[str, ...]
    limits: dict[str, np.ndarray]
    tree_i: np.ndarray
    tree_f: np.ndarray
    link_body: dict[str, int]
    T_body_link: dict[str, np.ndarray]
    fixed_values: dict[str, float]
    notes: tuple[str, ...]


def build_tree(
    description: Description,
    tip: str,
    locked: Mapping[str, float],
    given: Mapping[str, Mapping[str, float] | None] | None = None,
) -> BodyTree:
    """Fold everything into bodies; only the joints between the root and `tip` move.

    Any other joint is locked at its value in `locked`, else at 0 clipped into its
    limits. A mimic joint moves with the joint it follows, wherever both are. `given`
    holds limits of "velocity", "acceleration" and "jerk" by joint.

    Raises:
        BadRobot: No joint moves, `locked` names a joint or value that cannot be, or a
            given limit is none.
    """
    drives = _drives(description)
    _check_locked(description, drives, locked)
    limits = {name: _limits(description.joints[name]) for name, _, _ in drives.values()}
    moving = _moving(description, tip, drives, locked, limits)
    for name in moving:
        check_travel_limits(description.joints[name], *limits[name])
    values = standing_values(description, moving, locked)
    if not moving:
        still = [n for n, (low, high) in limits.items() if low == high]
        still = [n for n in still if n in {j.name for j in description.path(tip)}]
        hint = f", or give {still[0]!r} a <limit> that is a range" if still else ""
        raise BadRobot(
            f"no joint moves between {description.root!r} and the tip {tip!r}; choose "
            "a tip behind a revolute, continuous or prismatic joint, or lock fewer"
            f"{hint}"
        )
    tree = _tree(description, drives, moving, limits, values)
    _take_limits(tree.limits, moving, drives, given or {})
    return replace(tree, notes=(*tree.notes, *_quick_joints(description, tree)))


def bodies_of(
    description: Description, moving: Collection[str], locked: Mapping[str, float]
) -> BodyTree:
    """Fold everything into bodies, as `build_tree`, but any joints may move.

    Args:
        description: The robot.
        moving: The driving joints that move, in the order of `q`; also those of
            several branches, as the fingers of a hand.
        locked: Where other joints stand; those not named at 0 clipped into their
            limits.

    Raises:
        BadRobot: `locked` names a joint or value that cannot be, or one that moves is
            no driving joint.
    """
    drives, moving = _drives(description), list(moving)
    _check_locked(description, drives, locked)
    drivers = {name for name, _, _ in drives.values()}
    for name in moving:
        if name not in drivers:
            raise BadRobot(
                f"{description.name} has no joint {name!r} that can be driven; its "
                f"joints are {sorted(drivers)}"
            )
    limits = {name: _limits(description.joints[name]) for name in drivers}
    values = standing_values(description, moving, locked)
    return _tree(description, drives, moving, limits, values)


def _tree(description, drives, moving, limits, values) -> BodyTree:
    """Return the bodies that some joints move, with the limits of these joints."""
    tree_i, tree_f, link_body, poses = _bodies(description, drives, moving, values)
    joint_limits, notes = _joint_limits(description, moving, limits)
    return BodyTree(
        joint_names=tuple(moving),
        limits=joint_limits,
        tree_i=tree_i,
        tree_f=tree_f,
        link_body=link_body,
        T_body_link=poses,
        fixed_values=values,
        notes=tuple(notes),
    )


def drive(description: Description, joint: Joint) -> tuple[str, float, float]:
    """Return (driving joint, factor, offset); a joint without <mimic> drives itself.

    Raises:
        BadRobot: It follows itself, or a joint that is not there.
    """
    factor, offset, seen = 1.0, 0.0, {joint.name}
    while joint.mimic is not None:
        name, f, o = joint.mimic
        if name in seen or name not in description.joints:
            raise BadRobot(
                f"joint {joint.name!r} mimics {name!r}, which is "
                f"{'itself a follower of it' if name in seen else 'not in the file'}; "
                "correct or remove its <mimic>"
            )
        # value = factor * (f * q + o) + offset
        factor, offset = factor * f, factor * o + offset
        seen.add(name)
        joint = description.joints[name]
    return joint.name, factor, offset


def _limits(joint: Joint) -> tuple[float, float]:
    if joint.kind == "continuous":
        return -np.pi, np.pi
    lower, upper = joint.lower, joint.upper
    if lower is None and upper is None and joint.kind == "revolute":
        return -np.pi, np.pi
    if lower is None or upper is None or not np.isfinite([lower, upper]).all():
        raise BadRobot(
            f"joint {joint.name!r} has the limits {lower} to {upper}; give it a finite "
            "<limit lower=... upper=...>"
        )
    if lower > upper:
        raise BadRobot(
            f"joint {joint.name!r} has lower {lower} above upper {upper}; swap them"
        )
    return float(lower), float(upper)


def standing_values(
    description: Description, moving: Collection[str], locked: Mapping[str, float]
) -> dict[str, float]:
    """Return where the drivers that are not `moving` stand [rad or m].

    Where they are locked, else at 0 clipped into their limits.
    """
    values = {}
    for name, _, _ in _drives(description).values():
        if name not in moving and name not in values:
            rest = np.clip(0.0, *_limits(description.joints[name]))
            values[name] = float(locked.get(name, rest))
    return values


def driven_by(description: Description, name: str) -> list[tuple[str, float, float]]:
    """Return (joint, factor, offset) of `name` and of all that follow it."""
    rows = _drives(description).items()
    return [(joint, f, o) for joint, (driver, f, o) in rows if driver == name]


def _drives(description: Description) -> dict[str, tuple[str, float, float]]:
    """Return by joint that can move what drives it; see `drive`."""
    joints = description.joints
    movable = [joint for joint in joints.values() if joint.kind in MOVABLE]
    found = {joint.name: drive(description, joint) for joint in movable}
    for name, (driver, _, _) in found.items():
        if joints[driver].kind not in MOVABLE:
            raise BadRobot(
                f"joint {name!r} mimics the fixed joint {driver!r}; remove its <mimic>"
            )
    return found


def link_poses(
    description: Description, values: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Return T_root_link (4, 4) [m] of every link, its drivers at `values`."""
    poses = {description.root: np.eye(4)}
    for joint in description.below(description.root):
        T = poses[joint.parent] @ joint.T_parent_joint
        if joint.kind in MOVABLE:
            driver, factor, offset = drive(description, joint)
            value = factor * values[driver] + offset
            T = T @ joint_motion(joint.kind, joint.axis, value)
        poses[joint.child] = T
    return poses


def _check_locked(description, drives, locked) -> None:
    for name, value in locked.items():
        if name not in drives:
            raise BadRobot(
                f"cannot lock {name!r}: the joints that can be locked are "
                f"{sorted(drives)}"
            )
        driver = drives[name][0]
        if driver != name:
            raise BadRobot(f"joint {name!r} mimics {driver!r}; lock {driver!r} instead")
        lower, upper = _limits(description.joints[name])
        if description.joints[name].kind == "continuous":
            lower, upper = -TURN, TURN  # nobody writes more than a turn
        if not is_between(value, lower - 1e-9, upper + 1e-9):
            prismatic = description.joints[name].kind == "prismatic"
            number = is_between(value, -np.inf, np.inf)
            degrees = number and looks_like_degrees(value, prismatic)
            hint = f"; {DEGREES}" if degrees else "" if number else "; give a number"
            raise BadRobot(
                f"joint {name!r} cannot be locked at {value}: its limits are "
                f"{lower:.6g} to {upper:.6g}{hint}"
            )


def _moving(description, tip, drives, locked, limits) -> list[str]:
    """Return the driving joints between the root and the tip, base first."""
    on_chain = [j.name for j in description.path(tip) if j.kind in MOVABLE]
    drivers = dict.fromkeys(drives[name][0] for name in on_chain)
    return [d for d in drivers if d not in locked and limits[d][0] < limits[d][1]]


def _bodies(description, drives, moving, values):
    rows_i, rows_f = [(-1, -1, FIXED)], [_row(np.eye(4))]
    link_body, T_body_link = {description.root: 0}, {description.root: np.eye(4)}
    queue = [description.root]
    while queue:
        link = queue.pop()
        # the first joint of the file is followed first
        for joint in description.children(link)[::-1]:
            queue.append(joint.child)
        for joint in description.children(link):
            pose = T_body_link[link] @ joint.T_parent_joint
            driver, factor, offset = drives.get(joint.name, ("", 0.0, 0.0))
            if driver in moving:
                link_body[joint.child] = len(rows_i)
                T_body_link[joint.child] = np.eye(4)
                kind = PRISMATIC if joint.kind == "prismatic" else REVOLUTE
                rows_i.append((link_body[link], moving.index(driver), kind))
                rows_f.append(_row(pose, joint.axis, factor, offset))
                continue
            link_body[joint.child] = link_body[link]
            value = factor * values[driver] + offset if driver else 0.0
            T_body_link[joint.child] = pose @ joint_motion(
                joint.kind, joint.axis, value
            )
    return np.array(rows_i), np.array(rows_f), link_body, T_body_link


def _row(pose, axis=(0.0, 0.0, 1.0), factor=1.0, offset=0.0) -> np.ndarray:
    return np.concatenate([pose[:3, :3].ravel(), pose[:3, 3], axis, [factor, offset]])


def _take_limits(
    joint_limits: dict[str, np.ndarray],
    moving: list[str],
    drives: Mapping,
    given: Mapping[str, Mapping[str, float] | None],
) -> None:
    """Put the given limits in place of those of the file or the defaults."""
    for kind, values in given.items():
        for name, value in (values or {}).items():
            if name not in drives:
                raise BadRobot(
                    f"there is no joint {name!r} to have a limit of {kind}; the "
                    f"joints are {list(drives)}"
                )
            if not (is_between(value, 0.0, sys.float_info.max) and value > 0.0):
                raise BadRobot(
                    f"joint {name!r} has a limit of {kind} of {value}; give a number "
                    "above 0"
                )
            if name in moving:
                joint_limits[f"max_{kind}"][moving.index(name)] = value


def _quick_joints(description: Description, tree: BodyTree) -> list[str]:
    """Return a note for each joint that may turn faster than arms beside people do."""
    fastest = zip(tree.joint_names, tree.limits["max_velocity"], strict=True)
    return [
        f"{name}: may turn at {v:g} rad/s, {FASTER}; if that stands for no limit, give "
        "its own (velocity)"
        for name, v in fastest
        if v > QUICK and description.joints[name].kind != "prismatic"
    ]


def _stops(follower: Joint) -> tuple[float, float]:
    """Return between which values a follower stays, infinite where none are given.

    0 to 0 is what exporters write for nothing.
    """
    low, high = follower.lower, follower.upper
    if follower.kind == "continuous" or not (low or high):
        low = high = None
    return -np.inf if low is None else low, np.inf if high is None else high


def _breaks_turn(follower: Joint, factor: float) -> bool:
    """Return whether a follower ends elsewhere, or is stopped, by its driver's turn."""
    stops = any(abs(stop) < NO_STOP for stop in _stops(follower))
    straight = follower.kind == "prismatic" or stops
    return factor != 0.0 if straight else factor != round(factor)


def _kept_range(
    name: str, full: tuple[float, float], followers: list[tuple[Joint, float, float]]
) -> tuple[tuple[float, float], list[str]]:
    """Return the range of a driving joint in which its followers keep theirs.

    And a note where that is not all of it (`full`). `followers` are (joint, factor,
    offset).

    Raises:
        BadRobot: A follower leaves no range.
    """
    (low, high), held = full, []
    for follower, factor, offset in followers:
        if follower.name == name or factor == 0.0:
            continue
        stops = _stops(follower)
        first, last = sorted((stop - offset) / factor for stop in stops)
        if first <= low + _ROUNDING and last >= high - _ROUNDING:
            continue
        low, high = max(low, first), min(high, last)
        held.append(follower.name)
        if not low < high:
            raise BadRobot(
                f"joint {name!r} has the limits {full[0]:.6g} to {full[1]:.6g}, but "
                f"{follower.name!r}, which follows it, keeps {stops[0]:.6g} to "
                f"{stops[1]:.6g} from {first:.6g} to {last:.6g} alone; correct one "
                f"<limit>, or lock {name!r}"
            )
    note = (
        f"{name}: kept within {low:.6g} to {high:.6g}, where {' and '.join(held)}, "
        f"which follows it, keeps its limits"
    )
    return (low, high), [note] if held else []


def _joint_limits(description, moving, limits):
    joints = [description.joints[name] for name in moving]
    notes, velocity, endless, bounds = [], [], [], []
    for joint in joints:
        fastest = joint.velocity
        if fastest is None or not np.isfinite(fastest) or fastest <= 0:
            fastest = DEFAULT_VELOCITY[joint.kind]
            unit = "m/s" if joint.kind == "prismatic" else "rad/s"
            given = "none" if joint.velocity is None else f"{joint.velocity:g}"
            notes.append(
                f"{joint.name}: velocity limit taken as {fastest} {unit} ({given} in "
                "the file)"
            )
        velocity.append(fastest)
        driven = driven_by(description, joint.name)
        followers = [(description.joints[n], f, o) for n, f, o in driven]
        turns = joint.kind == "continuous"
        if turns and any(_breaks_turn(f, factor) for f, factor, _ in followers):
            notes.append(f"{joint.name}: kept in (-pi, pi), a follower breaks the turn")
            turns = False
        endless.append(turns)
        if joint.name in description.remarks:
            notes.append(description.remarks[joint.name])
        if joint.kind == "revolute" and joint.lower is None and joint.upper is None:
            notes.append(f"{joint.name}: no position limits, taken as (-pi, pi)")
        kept, note = _kept_range(joint.name, limits[joint.name], followers)
        bounds.append(kept)
        notes += note
    velocity = np.array(velocity)
    acceleration = ACCELERATION_PER_VELOCITY * velocity
    notes.append(
        f"where none is given, limits of acceleration are "
        f"{ACCELERATION_PER_VELOCITY:g}/s x velocity, of jerk "
        f"{JERK_PER_ACCELERATION:g}/s x acceleration (a URDF has none)"
    )
    bounds = np.array(bounds)
    table = {
        "lower": bounds[:, 0],
        "upper": bounds[:, 1],
        "continuous": np.array(endless),
        "max_velocity": velocity,
        "max_acceleration": acceleration,
        "max_jerk": JERK_PER_ACCELERATION * acceleration,
    }
    return table, notes
