"""Assemble a robot: bodies, solids, cover, tested pairs, and notes for the user."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from roadmap.geometry.self_collision import with_pairs
from roadmap.geometry.solids import Solid
from roadmap.loading.body_tree import BodyTree
from roadmap.loading.finger_chain import carried_links
from roadmap.loading.travel import swept_solids
from roadmap.robot.description import Description, Link
from roadmap.robot.robot import Robot

LEFT_OUT = "base links with visual geometry only, left out"  # a note of the robot
_NAMED = 6  # links of a note, at most


@dataclass(frozen=True, eq=False)
class Parts:
    """What a robot is made from.

    Attributes:
        description: The URDF.
        tree: Its bodies.
        tip: Link of the tool.
        locked: Joints that stand still at a value that was chosen.
        disabled: Pairs of links that are not tested, and why.
        lookup: Path of the URDF and the package folders.
        source: Where it came from.
    """

    description: Description
    tree: BodyTree
    tip: str
    locked: Mapping[str, float]
    disabled: dict[frozenset[str], str]
    lookup: tuple
    source: str

    @cached_property
    def owners(self) -> list[Link]:
        """The links with geometry, body by body.

        What is only drawn counts on moving links, and on the base where the base has
        nothing else: the arm of a URDF that is drawn alone must not meet its own base.
        """
        body, links = self.tree.link_body, self.description.links.values()
        drawn = not any(link.collisions for link in links if body[link.name] == 0)
        owners = [
            link
            for link in links
            if link.collisions or (link.visuals and (body[link.name] > 0 or drawn))
        ]
        return sorted(owners, key=lambda link: body[link.name])

    @cached_property
    def solids(self) -> tuple[list[Solid], list[str]]:
        """The solids of all links, and notes about them."""
        from roadmap.loading.sizes import check_sizes

        found = _solids(self.owners, self.tree, self.lookup)
        check_sizes(self.description, self.owners, found[0])
        return found


def assemble(
    parts: Parts,
    excess: float,
    travel: tuple[str, ...],
    why_not: Mapping[str, str] | None = None,
) -> Robot:
    """Make the robot from its parts, with cover and pairs.

    No cover sphere sticks out of its link by more than `excess` [m]. `travel` are
    joints held over their whole travel; `why_not` says of other fingers why they are
    not.
    """
    description, tree, owners = parts.description, parts.tree, parts.owners
    solids, notes = parts.solids
    links = carried_links(description, tree, travel)
    solids = swept_solids(solids, owners, tree, links)
    geometry = _geometry(owners, tree, solids, excess)
    arrays: dict[str, Any] = {**tree.limits, **geometry}
    robot = Robot(
        name=description.name,
        joint_names=tree.joint_names,
        tree_i=tree.tree_i,
        tree_f=tree.tree_f,
        tip_name=parts.tip,
        tip_body=tree.link_body[parts.tip],
        T_body_tip=tree.T_body_link[parts.tip],
        **arrays,
        self_pairs=np.empty((0, 2)),
        notes=(
            *_standing(parts, travel, why_not or {}),
            *tree.notes,
            *notes,
            *_coarse(owners, tree, geometry, solids, excess),
            *_bare(description, owners),
            *_unknown(description, parts.disabled),
        ),
        source=parts.source,
    )
    return with_pairs(robot, description.adjacent(), parts.disabled)


def _standing(
    parts: Parts, travel: tuple[str, ...], why_not: Mapping[str, str]
) -> list[str]:
    """Return notes on the locked joints, and on those whose whole range is covered."""
    still = {k: v for k, v in parts.tree.fixed_values.items() if k not in travel}
    texts = [
        f"{name} = {value:.4g}{'' if name in parts.locked else ' (default)'}"
        for name, value in still.items()
    ]
    notes = [f"locked joints: {', '.join(texts)}"] if texts else []
    if travel:
        notes.append(f"held over the whole travel of {', '.join(travel)}")
    for name, why in why_not.items():
        notes.append(
            f"{name} behind the tool stands at {still[name]:.4g}, not held over its "
            f"travel: {why}; put it elsewhere with locked, or list all joints to hold "
            "in travel"
        )
    return notes


def _bare(description: Description, owners: list[Link]) -> list[str]:
    links, there = description.links.values(), {link.name for link in owners}
    none = [k.name for k in links if not k.collisions and not k.visuals]
    seen = [k.name for k in links if k.visuals and k.name not in there]
    notes = [f"links without geometry: {', '.join(none)}"] if none else []
    if seen:
        names = ", ".join(seen)
        notes.append(f"{LEFT_OUT}: {names}")
    return notes


def _unknown(description: Description, disabled: Collection[frozenset[str]]) -> list:
    """Say which links of the SRDF's pairs are none of the URDF's: no test is off."""
    unknown = sorted(frozenset().union(*disabled) - set(description.links))
    if not unknown:
        return []
    more = f" and {len(unknown) - _NAMED} more" if len(unknown) > _NAMED else ""
    names = ", ".join(repr(name) for name in unknown[:_NAMED])
    return [
        f"SRDF: its disable_collisions name {names}{more}, which the URDF does not "
        "have; their pairs change nothing: check the names, or that it is of this robot"
    ]


def _solids(owners: list[Link], tree: BodyTree, lookup: tuple):
    from roadmap.geometry.solids import solid_of

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
    from roadmap.geometry.kept_covers import kept_shells
    from roadmap.kinematics.axis_reach import group_reach, joint_span, point_reach

    link_body = np.array([tree.link_body[link.name] for link in owners], np.int32)
    covers = _covers(link_body, solids, excess)
    spheres = np.vstack([np.empty((0, 4)), *covers])
    sphere_link = np.repeat(np.arange(len(owners)), [len(c) for c in covers])
    shells = kept_shells(solids)
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
    from roadmap.geometry.kept_covers import kept_cover

    own = [[s for s in solids if s.link == i] for i in range(len(link_body))]
    fits = np.where(link_body > 0, excess, min(2 * excess, 1.0))
    return [kept_cover(s, float(fit)) for s, fit in zip(own, fits, strict=True)]


def _coarse(owners, tree: BodyTree, geometry: dict, solids, excess: float) -> list[str]:
    """Say which moving links got a coarser cover than asked for."""
    from roadmap.geometry.kept_covers import kept_excess

    notes = []
    for index, link in enumerate(owners):
        if tree.link_body[link.name] == 0:
            continue
        spheres = geometry["spheres"][geometry["sphere_link"] == index]
        over = kept_excess(spheres, [s for s in solids if s.link == index])
        if over > 1.3 * excess:
            notes.append(f"{link.name}: cover excess {over:.3f} m, to save spheres")
    return notes
