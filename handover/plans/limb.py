"""An arm with its hand, read from any URDF: bodies, convex parts, kinematics."""

from dataclasses import dataclass
from functools import lru_cache
from types import SimpleNamespace

import numpy as np

from handover.chain import Chain
from handover.grasps.agents import Agent
from handover.grasps.hand import capsules_in
from handover.grasps.hands import HandSpec
from roadmap.errors import BadInput
from roadmap.geometry.solids import Solid, solid_of
from roadmap.kinematics import _seven
from roadmap.kinematics._forward import body_frames
from roadmap.kinematics.axis_reach import group_reach, joint_span
from roadmap.kinematics.seven import seven_of
from roadmap.kinematics.tool_chain import tool_chain
from roadmap.loading.body_tree import BodyTree, bodies_of, drive
from roadmap.robot.description import MOVABLE, Description, read_description
from roadmap.robot.known import known_robot, robot_file
from roadmap.robot.robot import BOX, CYLINDER, SPHERE
from roadmap.transforms import moved_points

_SIDES = 12  # of the prism round a cylinder without round ends


@dataclass(frozen=True, eq=False)
class Part:
    """A convex part of a link: points, thickened by a radius."""

    link: str
    body: int  # the body that it is on
    points: np.ndarray  # (n, 3) in the body's frame [m]
    radius: float  # round each point [m]


@dataclass(frozen=True, eq=False)
class AgentModel:
    """A whole agent: every joint moves."""

    description: Description  # its URDF
    tree: BodyTree  # its bodies, for all driving joints
    parts: tuple[Part, ...]  # all its convex parts

    def frames(self, values: dict[str, float]) -> np.ndarray:
        """Return (n_bodies, 12) poses in the base frame, joints at `values`."""
        q = np.array([values[name] for name in self.tree.joint_names])
        frames = np.empty((len(self.tree.tree_i), 12))
        body_frames(self.tree.tree_i, self.tree.tree_f, q, frames)
        return frames


@dataclass(frozen=True, eq=False)
class Limb:
    """One arm of an agent with its hand; body 0 is what it is mounted on."""

    side: str  # "left" or "right"
    model: AgentModel  # the agent
    # (dof,) names, those of the arm first, then those of the hand
    joints: tuple[str, ...]
    n_arm: int  # how many are the arm's
    # (dof,) limits [rad or m]
    lower: np.ndarray
    upper: np.ndarray
    # (dof,)
    max_velocity: np.ndarray
    max_acceleration: np.ndarray
    max_jerk: np.ndarray
    # its bodies, frame of body 0
    tree_i: np.ndarray
    tree_f: np.ndarray
    mount: int  # body of the agent that it hangs on
    parts: tuple[Part, ...]  # its convex parts, those of the arm first
    # (link or "hand", first part, end) of each group, the hand last
    groups: tuple[tuple[str, int, int], ...]
    reach: np.ndarray  # (n parts, dof) how far a unit of each joint moves a part [m]
    palm_reach: np.ndarray  # (dof,) the same of the palm's origin
    palm: int  # body of the palm
    T_body_palm: np.ndarray  # (4, 4)
    chain: Chain  # the arm, from body 0 to the palm
    seven: _seven.Seven | None  # the same in closed form, or None
    spec: HandSpec  # the hand
    own: frozenset[int]  # the agent's bodies that it is made of

    @property
    def dof(self) -> int:
        """Number of joints of arm and hand."""
        return len(self.joints)

    def palm_pose(self, q: np.ndarray) -> np.ndarray:
        """Return the palm's pose (4, 4) in the frame of body 0."""
        return self.chain.tool_pose(np.ascontiguousarray(q[: self.n_arm]))


def balls_of(points: np.ndarray, first: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Return balls (k, 4) around runs of points (n, 3) that begin at rows first (k,).

    radius: (k,) that the points of a run have [m].
    """
    low, high = (m.reduceat(points, first) for m in (np.minimum, np.maximum))
    center = 0.5 * (low + high)
    counts = np.diff(np.append(first, len(points)))
    away = points - np.repeat(center, counts, axis=0)
    far = np.sqrt(np.maximum.reduceat((away * away).sum(axis=1), first))
    return np.column_stack([center, far + radius + 1e-9])


@lru_cache(maxsize=8)
def agent_model(source: str) -> AgentModel:
    """Return an agent's whole model; `source` is a known robot or a URDF's path."""
    path = robot_file(source)
    description = read_description(path)
    drivers = dict.fromkeys(
        drive(description, j)[0]
        for j in description.joints.values()
        if j.kind in MOVABLE
    )
    tree = bodies_of(description, list(drivers), {})
    parts = []
    for name, link in description.links.items():
        shapes = link.collisions or link.visuals
        T = tree.T_body_link[name]
        solids = [solid_of(s, link, 0, T, (path, ()))[0] for s in shapes]
        parts += [
            Part(name, tree.link_body[name], points, radius)
            for points, radius in _convex(solids)
        ]
    return AgentModel(description, tree, tuple(parts))


def _convex(solids: list[Solid]) -> list[tuple[np.ndarray, float]]:
    """Return solids as points with a radius, capsules first."""
    rods, balls = capsules_in(solids)
    own = [(solids[k], ends, float(solids[k].size[0])) for k, ends in rods.items()]
    own += [
        (solid, *_own_points(solid))
        for k, solid in enumerate(solids)
        if k not in rods and k not in balls
    ]
    return [(moved_points(points, s.T_body_solid), radius) for s, points, radius in own]


def _own_points(solid: Solid) -> tuple[np.ndarray, float]:
    """Return a solid as points with a radius, its own frame [m]."""
    if solid.kind == SPHERE:
        return np.zeros((1, 3)), float(solid.size[0])
    if solid.kind == BOX:
        return box_corners(solid.size), 0.0
    if solid.kind == CYLINDER:
        return prism(*solid.size[:2]), 0.0
    return solid.points, 0.0


def box_corners(size: np.ndarray | tuple[float, float, float]) -> np.ndarray:
    """Return the (8, 3) corners of a box about its own middle [m]."""
    return np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T * size


def prism(radius: float, length: float) -> np.ndarray:
    """Return corners of a prism around a cylinder along z [m]."""
    angles = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ring *= radius / np.cos(np.pi / _SIDES)
    half = np.full((_SIDES, 1), 0.5 * length)
    return np.concatenate([np.hstack([ring, -half]), np.hstack([ring, half])])


@lru_cache(maxsize=16)
def _limb(source: str, side: str, spec: HandSpec) -> Limb:
    model = agent_model(source)
    description, whole = model.description, model.tree
    path = description.path(spec.palm)
    known = known_robot(source)
    held = known.locked if known else {}  # joints that a known robot holds still
    drivers = dict.fromkeys(
        drive(description, j)[0]
        for j in path
        if j.kind in MOVABLE and j.name not in spec.joints
    )
    arm = [name for name in drivers if name not in held]
    arm = _alone(whole, arm, spec, f"the {side} arm of {description.name}")
    joints = (*arm, *spec.joints)
    rows = [whole.joint_names.index(name) for name in joints]
    # bodies that these joints move, and what the first hangs on
    moved = np.zeros(len(whole.tree_i), bool)
    for b, (parent, joint, _) in enumerate(whole.tree_i):
        moved[b] = (parent >= 0 and moved[parent]) or joint in rows
    order = np.flatnonzero(moved)
    mount = int(whole.tree_i[order[0], 0])
    index = {mount: 0} | {int(b): k + 1 for k, b in enumerate(order)}
    if any(int(whole.tree_i[b, 0]) not in index for b in order):
        raise BadInput(
            f"the {side} arm of {description.name} hangs on two bodies; its joints "
            "must be one chain"
        )
    tree_i = [(-1, -1, 0)]
    tree_f = [np.r_[np.eye(3).ravel(), np.zeros(3), 0, 0, 1, 1, 0]]
    for b in order:
        parent, joint, kind = whole.tree_i[b]
        tree_i.append((index[int(parent)], rows.index(joint), kind))
        tree_f.append(whole.tree_f[b])
    tree_i, tree_f = np.array(tree_i, np.int32), np.array(tree_f, float)
    limits = {k: np.asarray(v)[rows] for k, v in whole.limits.items()}
    parts, groups = _parts_of(model, spec, index)
    span = joint_span(tree_i, tree_f, limits["lower"], limits["upper"])
    palm = index[whole.link_body[spec.palm]]
    T_palm = whole.T_body_link[spec.palm] @ spec.T_link_palm
    bodies = np.array([p.body for p in parts] + [palm], np.int32)
    clouds = [np.concatenate([p.points]) for p in parts] + [T_palm[None, :3, 3]]
    far = group_reach(tree_i, tree_f, span, bodies, clouds)
    far[:-1] += np.array([p.radius for p in parts])[:, None] * (far[:-1] > 0)
    reach = np.zeros((len(far), len(joints)))
    for b in range(1, len(tree_i)):
        reach[:, tree_i[b, 1]] += abs(tree_f[b, 15]) * far[:, b]
    chain = _chain_of(source, side, arm, tree_i, tree_f, limits, palm, T_palm)
    acceleration, jerk = limits["max_acceleration"], limits["max_jerk"]
    for k, name in enumerate(joints if known else ()):
        acceleration[k] = known.acceleration.get(name, acceleration[k])
        jerk[k] = known.jerk.get(name, jerk[k])
    return Limb(
        side=side, model=model, joints=joints, n_arm=len(arm),
        lower=limits["lower"], upper=limits["upper"],
        max_velocity=limits["max_velocity"], max_acceleration=acceleration,
        max_jerk=jerk, tree_i=tree_i, tree_f=tree_f, mount=mount,
        parts=parts, groups=groups, reach=reach[:-1], palm_reach=reach[-1],
        palm=palm, T_body_palm=T_palm, chain=chain, seven=seven_of(chain.arrays),
        spec=spec, own=frozenset(order.tolist()),
    )  # fmt: skip


def _alone(whole: BodyTree, arm: list[str], spec: HandSpec, what: str) -> list[str]:
    """Return the joints of an arm that carry nothing but arm and hand.

    A lift, or a waist, that carries another arm or a head as well stays where it waits.

    Raises:
        BadInput: Fewer than three are left.
    """
    names, mine = whole.joint_names, {*arm, *spec.joints}
    shared: dict[str, str] = {}  # joint of the arm -> one that it carries besides
    for parent, joint, _ in whole.tree_i[1:]:
        if names[joint] in mine:
            continue
        while parent > 0:
            shared.setdefault(names[whole.tree_i[parent, 1]], names[joint])
            parent = whole.tree_i[parent, 0]
    left = [name for name in arm if name not in shared]
    if not arm:
        raise BadInput(
            f"no joint of {what} moves its palm {spec.palm!r}; name a link at its end"
        )
    if len(left) < min(3, len(arm)):
        besides = next(shared[name] for name in arm[::-1] if name in shared)
        raise BadInput(
            f"{what} has {len(left)} joints that carry nothing but arm and hand; make "
            f"{besides!r} fixed in the URDF, or name it in a preshape of the hand"
        )
    return left


def limb_of(agent: Agent, side: str) -> Limb:
    """Return an arm of an agent with its hand, made once; BadInput: no such arm."""
    if side not in agent.arms:
        raise BadInput(
            f"{agent.name} has no {side} arm; give one of {', '.join(agent.arms)}"
        )
    arm = agent.arms[side]
    return _limb(arm.robot, side, arm.spec)


def _parts_of(model: AgentModel, spec: HandSpec, index: dict[int, int]) -> tuple:
    """Return the parts on the limb's bodies by link, those of the hand last."""
    hand, links = [], {}
    below = {spec.root} | {j.child for j in model.description.below(spec.root)}
    for part in model.parts:
        if part.body not in index or index[part.body] == 0:
            continue
        moved = Part(part.link, index[part.body], part.points, part.radius)
        if part.link in below:
            hand.append(moved)
        else:
            links.setdefault(part.link, []).append(moved)
    parts, groups = [], []
    for name, members in [*links.items(), ("hand", hand)]:
        groups.append((name, len(parts), len(parts) + len(members)))
        parts += members
    return tuple(parts), tuple(groups)


def _chain_of(source, side, arm, tree_i, tree_f, limits, palm, T_palm) -> Chain:
    """Return the arm from body 0 to the palm."""
    name = f"{source} {side}"
    tree = SimpleNamespace(  # what `tool_chain` reads of a robot
        name=name, joint_names=tuple(arm), lower=limits["lower"], upper=limits["upper"],
        continuous=np.zeros(len(limits["lower"]), bool), tree_i=tree_i, tree_f=tree_f,
        tip_body=palm, T_body_tip=T_palm,
    )  # fmt: skip
    arrays, rows = tool_chain(tree)
    if rows != list(range(len(arm))):
        raise BadInput(f"{name}: joints of the hand move its palm; name another palm")
    return Chain(
        name=name, joint_names=tuple(arm), fixed=arrays.fixed, kind=arrays.kind,
        scale=arrays.scale, limits=arrays.limits, endless=arrays.endless,
    )  # fmt: skip
