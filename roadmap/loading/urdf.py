"""Load a robot from its URDF: bodies, solids, sphere cover and what they may touch."""

import difflib
import os
from collections.abc import Collection, Mapping, Sequence

from roadmap.errors import BadRobot
from roadmap.geometry.self_collision import always_touching_pairs, crowded_pairs
from roadmap.loading.assembly import Parts, assemble
from roadmap.loading.body_tree import build_tree
from roadmap.loading.finger_chain import Carried, carried_links
from roadmap.loading.fingers import finger_joints
from roadmap.loading.srdf import read_disabled_pairs
from roadmap.loading.travel import check_travel, check_width, radii_of
from roadmap.ranges import check_kind, check_number
from roadmap.robot.description import MOVABLE, Description, read_description
from roadmap.robot.known import known_robot, own_file, robot_file
from roadmap.robot.robot import Robot

_COARSEST = 1.0  # [m] excess of a cover that nobody uses
_MANY = 24  # links that are not all listed in a message
_AN_ARM = 3  # moving joints of what may be meant to carry a hand, at least


def load_robot(
    source: str | os.PathLike,
    *,
    tip: str | None = None,
    locked: Mapping[str, float] | None = None,
    srdf: str | os.PathLike | None = None,
    cover_excess: float = 0.015,
    package_dirs: Sequence[str | os.PathLike] = (),
    velocity: Mapping[str, float] | None = None,
    acceleration: Mapping[str, float] | None = None,
    jerk: Mapping[str, float] | None = None,
    travel: Sequence[str] | None = None,
) -> Robot:
    """Read a URDF and prepare everything the planner needs; seconds, done once.

    Collision geometry is the convex hull of each collision mesh and the primitives;
    a moving link that has only visual geometry uses the hull of that. Soft limits of
    a <safety_controller> are not used, only <limit>; that of a continuous joint is
    kept, too, where it is a range.

    Args:
        source: Path of a URDF, or a known name: one of `roadmap.robot_names()`.
        tip: Link of the tool; the joints between the root link and it move. Default:
            the end of the longest chain, where there is only one.
        locked: Joint name -> value [rad or m]; such a joint becomes rigid. Joints off
            the chain that are not named, and do not travel, stand where a known robot
            has them, else at 0 clipped into their limits.
        srdf: File whose <disable_collisions> pairs are not tested.
        cover_excess: How far a cover sphere may stick out of its link [m]; smaller
            means more spheres and a slower planner, but more free space.
        package_dirs: Folders in which `package://` paths are looked up first.
        velocity: Joint name -> limit [rad/s or m/s], in place of the file's.
        acceleration: Joint name -> limit [rad/s2 or m/s2], in place of what is known
            of the robot, or of the default.
        jerk: The same [rad/s3 or m/s3].
        travel: Joints off the chain that may stand anywhere within their limits: their
            links are held over the whole travel. None: those of the gripper, what
            hangs on the tool's body, as far as that can be done; `notes` say which.
            Those of a known robot's hand stand still where it says so.

    Raises:
        BadRobot: The description or the choice of joints cannot be used; says why.
    """
    path, known = robot_file(source), known_robot(source)
    check_number("cover_excess [m]", cover_excess, 1e-3, 1.0)
    if tip is not None:
        check_kind("tip", tip, str, "give the name of a link")
    description = read_description(path, known.endless if known else ())
    both = sorted(set(travel or ()) & set(locked or {}))
    if both:
        raise BadRobot(f"joint {both[0]!r} is locked and travels; choose one of both")
    given = {"velocity": velocity, "acceleration": acceleration, "jerk": jerk}
    _check_kinds({"locked": locked, **given}, package_dirs)
    user_locked = frozenset(locked or {})
    if known is not None:
        locked = {**known.locked, **(locked or {})}
        tip = tip or known.tip
        srdf = srdf or (own_file(known.srdf) if known.srdf else None)
        acceleration = {**known.acceleration, **(acceleration or {})}
        jerk = {**known.jerk, **(jerk or {})}
        travel = known.travel if travel is None else travel
    locked = locked or {}
    tip = _tip(description, tip, locked)
    given |= {"acceleration": acceleration, "jerk": jerk}
    tree = build_tree(description, tip, locked, given)
    disabled = {} if srdf is None else read_disabled_pairs(srdf)
    lookup = (path, tuple(package_dirs))
    parts = Parts(description, tree, tip, locked, disabled, lookup, str(source))
    if travel is None:
        return _with_fingers(parts, cover_excess, user_locked)
    for name in travel:
        check_travel(description, tree, name)
    links = carried_links(description, tree, travel)
    radii = radii_of(parts.solids[0], parts.owners, tree) if links else {}
    check_width(links, radii, tip)
    return assemble(parts, cover_excess, tuple(travel))


def _check_kinds(tables: Mapping[str, object], package_dirs: object) -> None:
    for name, table in tables.items():
        if table is not None:
            check_kind(name, table, Mapping, "give {joint name: value}")
    if isinstance(package_dirs, str | os.PathLike):
        raise BadRobot(
            f"package_dirs is {str(package_dirs)!r}; give a list of folders, such as "
            f"[{str(package_dirs)!r}]"
        )


def _with_fingers(parts: Parts, excess: float, locked: Collection[str]) -> Robot:
    """Return the robot with its fingers over their travel, but for the `locked`."""
    description, tree = parts.description, parts.tree

    def radii() -> Mapping[str, float]:
        return radii_of(parts.solids[0], parts.owners, tree)

    travel, why_not = finger_joints(description, tree, parts.tip, locked, radii)
    robot = assemble(parts, excess, travel, why_not)
    if not travel:
        return robot
    links = carried_links(description, tree, travel)
    if not any(pair & set(links) for pair in crowded_pairs(robot)):
        return robot
    # fingers that touch the arm wherever they are, and do not where they stand
    still = assemble(parts, _COARSEST, ())
    crowded = crowded_pairs(robot) - crowded_pairs(still)
    crowded |= always_touching_pairs(robot) - always_touching_pairs(still)
    for a, b in sorted(map(sorted, crowded)):
        for name in (*_drivers(links, a), *_drivers(links, b)):
            why_not[name] = f"over its travel {a} and {b} touch in most poses"
    if not set(travel) & set(why_not):
        return robot
    travel = tuple(name for name in travel if name not in why_not)
    return assemble(parts, excess, travel, why_not)


def _drivers(links: Mapping[str, Carried], link: str) -> tuple[str, ...]:
    return links[link].drivers if link in links else ()


def _tip(description: Description, tip: str | None, locked: Mapping) -> str:
    if tip is not None:
        if tip in description.links:
            return tip
        raise BadRobot(
            f"there is no link {tip!r} to be the tip; {_links(description, tip)}"
        )
    parents = {joint.parent for joint in description.joints.values()}
    lengths = {}
    for leaf in [name for name in description.links if name not in parents]:
        chain = [j for j in description.path(leaf) if j.kind in MOVABLE]
        lengths[leaf] = len([j for j in chain if j.name not in locked])
    longest = max(lengths.values())
    candidates = [leaf for leaf, length in lengths.items() if length == longest]
    if len(candidates) > 1:
        hand = _hand_of(description, candidates)
        shared = "" if hand is None else f"{hand}, which carries all of these: "
        raise BadRobot(
            f"the tool is not clear: {len(candidates)} chains are equally long; name "
            f"the tool's link, tip (--tip): {shared}{', '.join(candidates)}, or any "
            "other; the joints between the root and it will move"
        )
    return candidates[0]


def _links(description: Description, tip: str) -> str:
    """Return the links for a message: all, or of many those of similar names."""
    links = list(description.links)
    if len(links) <= _MANY:
        return f"the links are {links}"
    small = {link.lower(): link for link in links}
    near = difflib.get_close_matches(tip.lower(), small, 5, 0.5)
    hint = f"did you mean {', '.join(small[n] for n in near)}? " if near else ""
    return f"{hint}choose one of the {len(links)} links of its URDF"


def _hand_of(description: Description, fingers: Sequence[str]) -> str | None:
    """Return the last link that carries all of some links that move on it.

    None: they do not, as tool frames, or it hardly moves, as the trunk of two arms.
    """
    paths = [description.path(finger) for finger in fingers]
    same = zip(*paths, strict=False)  # joint by joint from the root, till one ends
    shared = [joints[0] for joints in same if len({j.name for j in joints}) == 1]
    moving = [joint for joint in shared if joint.kind in MOVABLE]
    behind = [[j for j in p[len(shared) :] if j.kind in MOVABLE] for p in paths]
    more = max(map(len, behind))
    return shared[-1].child if 0 < more <= len(moving) >= _AN_ARM else None
