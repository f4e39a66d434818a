"""Load a robot from its URDF: bodies, solids, sphere cover and what they may touch."""

import os
from collections.abc import Mapping, Sequence

import numpy as np

from roadmap.body_tree import BodyTree, build_tree
from roadmap.description import MOVABLE, Description, Link, read_description
from roadmap.errors import BadRobot
from roadmap.known import known_robot, own_file, robot_file
from roadmap.robot import Robot
from roadmap.self_collision import with_pairs
from roadmap.srdf import read_disabled_pairs
from roadmap.travel import swept_solids, travelling_links


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
    travel: Sequence[str] = (),
) -> Robot:
    """Read a URDF and prepare everything the planner needs; seconds, done once.

    Collision geometry is the convex hull of each collision mesh and the primitives;
    a moving link that has only visual geometry uses the hull of that. Soft limits of
    a <safety_controller> are not used, only <limit>.

    Args:
        source: Path of a URDF, or a known name: one of `roadmap.robot_names()`.
        tip: Link of the tool; the joints between the root link and it move. Default:
            the end of the longest chain, where there is only one.
        locked: Joint name -> value [rad or m]; such a joint becomes rigid. Joints off
            the chain that are not named stand at 0 clipped into their limits.
        srdf: File whose <disable_collisions> pairs are not tested.
        cover_excess: How far a cover sphere may stick out of its link [m]; smaller
            means more spheres and a slower planner, but more free space.
        package_dirs: Folders in which `package://` paths are looked up first.
        velocity: Joint name -> limit [rad/s or m/s], in place of the file's.
        acceleration: Joint name -> limit [rad/s2 or m/s2], in place of what is known
            of the robot, or of the default.
        jerk: The same [rad/s3 or m/s3].
        travel: Joints off the chain, such as a gripper's, that may stand anywhere
            within their limits: their links are held over the whole travel.

    Raises:
        BadRobot: The description or the choice of joints cannot be used; says why.
    """
    path, known = robot_file(source), known_robot(source)
    description = read_description(path)
    both = sorted(set(travel) & set(locked or {}))
    if both:
        raise BadRobot(f"joint {both[0]!r} is locked and travels; choose one of both")
    if known is not None:
        locked = {**known.locked, **(locked or {})}
        tip = tip or known.tip
        srdf = srdf or (own_file(known.srdf) if known.srdf else None)
        acceleration = {**known.acceleration, **(acceleration or {})}
        jerk = {**known.jerk, **(jerk or {})}
    locked = locked or {}
    tip = _tip(description, tip, locked)
    given = {"velocity": velocity, "acceleration": acceleration, "jerk": jerk}
    tree = build_tree(description, tip, locked, given)
    owners = _owners(description, tree)
    lookup = (path, tuple(package_dirs))
    solids, notes = _solids(owners, tree, lookup)
    if travel:
        links = travelling_links(description, tree, travel)
        if tip in links:
            raise BadRobot(
                f"the tip {tip!r} would travel with {links[tip]!r}; choose a tip on "
                "the hand itself"
            )
        solids = swept_solids(
            solids, owners, description, tree, links,
            lambda joint, v: build_tree(description, tip, {**locked, joint: v}, given),
        )
        notes.append(f"held over the whole travel of {', '.join(travel)}")
    geometry = _geometry(owners, tree, solids, cover_excess)
    coarse = _coarse(owners, tree, geometry, solids, cover_excess)
    disabled = {} if srdf is None else read_disabled_pairs(srdf)
    robot = Robot(
        name=description.name,
        joint_names=tree.joint_names,
        **tree.limits,
        tree_i=tree.tree_i,
        tree_f=tree.tree_f,
        tip_name=tip,
        tip_body=tree.link_body[tip],
        T_body_tip=tree.T_body_link[tip],
        **geometry,
        self_pairs=np.empty((0, 2)),
        notes=(*tree.notes, *notes, *coarse, *_bare(description, tree)),
        source=str(source),
    )
    return with_pairs(robot, _adjacent(description), disabled)


def _tip(description: Description, tip: str | None, locked: Mapping) -> str:
    if tip is not None:
        if tip in description.links:
            return tip
        raise BadRobot(
            f"there is no link {tip!r} to be the tip; the links are "
            f"{list(description.links)}"
        )
    parents = {joint.parent for joint in description.joints.values()}
    lengths = {}
    for leaf in [name for name in description.links if name not in parents]:
        chain = [j for j in description.path(leaf) if j.kind in MOVABLE]
        lengths[leaf] = len([j for j in chain if j.name not in locked])
    longest = max(lengths.values())
    candidates = [leaf for leaf, length in lengths.items() if length == longest]
    if len(candidates) > 1:
        raise BadRobot(
            f"the tool is not clear: choose tip= one of {candidates} (or any other "
            "link; the joints between the root and it will move)"
        )
    return candidates[0]


def _owners(description: Description, tree: BodyTree) -> list[Link]:
    """Return the links with geometry, body by body."""
    links = [
        link
        for link in description.links.values()
        if link.collisions or (link.visuals and tree.link_body[link.name] > 0)
    ]
    return sorted(links, key=lambda link: tree.link_body[link.name])


def _adjacent(description: Description) -> set[frozenset[str]]:
    """Return pairs of links joined by a joint, or through links without geometry."""
    pairs = set()
    for link in description.links.values():
        joint = description.parent_joint(link.name)
        while joint is not None:
            pairs.add(frozenset((joint.parent, link.name)))
            parent = description.links[joint.parent]
            if parent.collisions or parent.visuals:
                break
            joint = description.parent_joint(parent.name)
    return pairs


def _bare(description: Description, tree: BodyTree) -> list[str]:
    links = description.links.values()
    none = [k.name for k in links if not k.collisions and not k.visuals]
    seen = [
        k.name
        for k in links
        if not k.collisions and k.visuals and tree.link_body[k.name] == 0
    ]
    notes = [f"links without geometry: {', '.join(none)}"] if none else []
    if seen:
        names = ", ".join(seen)
        notes.append(f"base links with visual geometry only, left out: {names}")
    return notes


def _solids(owners: list[Link], tree: BodyTree, lookup: tuple):
    from roadmap.solids import solid_of

    solids, notes = [], []
    for index, link in enumerate(owners):
        if not link.collisions:
            notes.append(f"{link.name}: no collision geometry, visual hull used")
        for shape in link.collisions or link.visuals:
            T_body_link = tree.T_body_link[link.name]
            solid, note = solid_of(shape, link, index, T_body_link, lookup)
            solids.append(solid)
            notes += [note] if note else []
    return solids, notes


def _geometry(owners, tree: BodyTree, solids, excess: float) -> dict:
    """Return the geometry arrays of `Robot`: solids, cover, shells, reaches."""
    from roadmap.polytope import shell
    from roadmap.reach import group_reach, joint_span, point_reach

    link_body = np.array([tree.link_body[link.name] for link in owners], np.int32)
    covers = _covers(link_body, solids, excess)
    spheres = np.vstack([np.empty((0, 4)), *covers])
    sphere_link = np.repeat(np.arange(len(owners)), [len(c) for c in covers])
    shells = [shell(s) for s in solids]
    shell_link = np.array([s.link for s in solids], np.int32)
    limits = tree.limits["lower"], tree.limits["upper"]
    chain = (tree.tree_i, tree.tree_f, joint_span(tree.tree_i, tree.tree_f, *limits))
    hulls = [s.points for s in solids]
    return {
        "link_names": tuple(link.name for link in owners),
        "link_body": link_body,
        "spheres": spheres,
        "sphere_body": link_body[sphere_link],
        "sphere_link": sphere_link,
        "sphere_reach": point_reach(*chain, link_body[sphere_link], spheres[:, :3]),
        "solid_kind": np.array([s.kind for s in solids]),
        "solid_link": shell_link,
        "solid_pose": np.array([s.T_body_solid for s in solids]).reshape(-1, 4, 4),
        "solid_size": np.array([s.size for s in solids]).reshape(-1, 3),
        "solid_ptr": np.cumsum([0, *map(len, hulls)]),
        "solid_points": np.vstack([np.empty((0, 3)), *hulls]),
        "shell_ptr": np.cumsum([0, *map(len, shells)]),
        "shell_points": np.vstack([np.empty((0, 3)), *shells]),
        "shell_link": shell_link,
        "shell_reach": group_reach(*chain, link_body[shell_link], shells),
    }


def _covers(link_body: np.ndarray, solids, excess: float) -> list[np.ndarray]:
    """Return the spheres of each link; base links sweep no cells, so twice the excess.

    They serve the self filter only.
    """
    from roadmap.spheres import cover_solids

    own = [[s for s in solids if s.link == i] for i in range(len(link_body))]
    fits = np.where(link_body > 0, excess, min(2 * excess, 1.0))
    return [cover_solids(s, float(fit)) for s, fit in zip(own, fits, strict=True)]


def _coarse(owners, tree: BodyTree, geometry: dict, solids, excess: float) -> list[str]:
    """Say which moving links got a coarser cover than asked for."""
    from roadmap.spheres import cover_excess

    notes = []
    for index, link in enumerate(owners):
        spheres = geometry["spheres"][geometry["sphere_link"] == index]
        over = cover_excess(spheres, [s for s in solids if s.link == index])
        if tree.link_body[link.name] > 0 and over > 1.3 * excess:
            notes.append(f"{link.name}: cover excess {over:.3f} m, to save spheres")
    return notes
