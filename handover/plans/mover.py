"""One arm ready to move in a scene: what it keeps clear of, and proofs that it does.

All else stands: its own body, the other agent, furniture, and the object, unless the
arm holds it. The other agent's arm and the object are bodies of their own, so that they
are put elsewhere by writing a pose.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from handover.grasps.objects import GraspObject
from handover.plans import _space as kernels
from handover.plans.limb import Limb, balls_of, box_corners, prism
from handover.plans.settings import SOLVE, ProofSettings, SolveSettings
from handover.scenes.scene import PlacedAgent, Scene
from odm.obstacles.mesh_surface import volume
from odm.obstacles.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from roadmap.geometry.solids import hull_corners, hull_facets
from roadmap.kinematics._forward import body_frames
from roadmap.kinematics._seven import MOST
from roadmap.kinematics.joint_tree import PRISMATIC
from roadmap.kinematics.seven import free_angles, room
from roadmap.transforms import flat_pose, moved_points, pose_of_flat

_OFF = -1e6  # margin of a pair that is not looked at [m]
_DEPTH = 40


class Mover:
    """An arm in a scene; the other arm of interest is `other`.

    Args:
        scene: The scene.
        placed: The agent whose arm it is.
        limb: The arm.
        other_placed, other: The other agent and its arm, which may be put anywhere.
        proof: What is proved.

    Attributes:
        space: For the kernels.
        T_mount: (4, 4) what the arm hangs on, world frame [m].
        T_world_object: (4, 4) where the object is; None: the arm holds it.
        stamp: Another number whenever something was put elsewhere.
        scratch: Working memory of one thread.
    """

    def __init__(
        self,
        scene: Scene,
        placed: PlacedAgent,
        limb: Limb,
        other_placed: PlacedAgent,
        other: Limb,
        proof: ProofSettings = ProofSettings(),
    ) -> None:
        self.limb, self.other, self.proof = limb, other, proof
        self.T_mount = mount_pose(placed, limb)
        self._T_other = mount_pose(other_placed, other)
        self._layout(scene, placed, other_placed)
        self.scratch = _scratch(self.space, limb.dof)
        self.T_world_object: np.ndarray | None = None
        self.stamp = 0
        self._q_other = self._held = b""  # the numbers of the last ones
        self._T_mount_world = np.linalg.inv(self.T_mount)
        self.put_object(scene.T_world_start)
        self.put_other(other_placed.values(other.joints))

    # --- layout -----------------------------------------------------------------

    def _layout(self, scene, placed, other_placed) -> None:
        limb, other = self.limb, self.other
        n = len(limb.tree_i)
        self._object = n  # the last body that moves
        self._world = n + 1
        self._first_other = n + 2
        total = self._first_other + len(other.tree_i)
        tree_i = np.full((total, 3), (-1, -1, 0), np.int32)
        tree_f = np.tile(
            np.r_[np.eye(3).ravel(), np.zeros(3), 0, 0, 1, 1, 0], (total, 1)
        )
        tree_i[:n], tree_f[:n] = limb.tree_i, limb.tree_f
        tree_f[0, :12] = flat_pose(self.T_mount)
        groups, by_hand = self._groups(scene, placed, other_placed)
        self.names = tuple(g[0] for g in groups)
        parts = [p for g in groups for p in g[2]]
        ends = np.cumsum([0, *(len(p[1]) for p in parts)])
        spans = np.cumsum([0, *(len(g[2]) for g in groups)])
        points = np.ascontiguousarray(np.concatenate([p[1] for p in parts]))
        radius = np.array([p[2] for p in parts], float)
        most = np.maximum.reduceat(radius, spans[:-1])
        balls = balls_of(points, ends[spans[:-1]], most)
        self._put_hand_balls(groups, balls)
        self._object_ball = balls[self.object_group].copy()
        pairs, reach, margin, first = self._pairs(groups, balls, placed, by_hand)
        counts = np.diff(spans)[pairs].prod(axis=1)  # of the axes of a pair's parts
        self.space = kernels.Space(
            tree_i=tree_i,
            tree_f=tree_f,
            part_body=np.array([p[0] for p in parts]),
            part_span=np.stack([ends[:-1], ends[1:]], axis=1),
            part_ball=balls_of(points, ends[:-1], radius),
            radius=radius,
            points=points,
            group_body=np.array([g[1] for g in groups]),
            group_ball=balls,
            group_span=np.stack([spans[:-1], spans[1:]], axis=1),
            pairs=pairs,
            reach=reach,
            margin=margin.copy(),
            first=first,
            thing=self.object_group,
            axis_row=np.cumsum(counts) - counts,
            turn_body=_turn_bodies(limb),
        )
        self._margin = margin
        self._rows = _object_rows(
            pairs, self.hand_group, self.object_group, limb, other
        )

    def _groups(self, scene, placed, other_placed) -> tuple[list, list]:
        """Return groups (name, body of the ball, parts), and links fingers shun."""
        limb, other = self.limb, self.other
        groups = _limb_groups(limb, 0)
        self.hand_group = len(groups) - 1
        fingers = _fingers(groups, limb, placed.body.neighbours)
        groups += [fingers[a] for a in fingers]
        self.object_group = len(groups)
        thing = [(self._object, points, 0.0) for points in _hulls(scene.obj)]
        groups.append(("object", self._object, thing))
        groups += [
            *_limb_groups(other, self._first_other),
            *_rest(placed, limb, self._world, "own "),
            *_rest(other_placed, other, self._world, "other "),
            *(
                (f.name, self._world, [(self._world, *shape_points(f.shape))])
                for f in scene.scenery
            ),
        ]
        return groups, list(fingers)

    def _put_hand_balls(self, groups: list, balls: np.ndarray) -> None:
        for ball, (name, body, _) in zip(balls, groups, strict=True):
            if name == "hand":  # for all joints of its fingers
                mine = body < self._first_other
                ball[:] = hand_ball(self.limb if mine else self.other)

    def _pairs(self, groups, balls, placed, by_hand) -> tuple:
        """Return pairs, reach, margins, and how many depend on the hand alone.

        by_hand: Links that only the fingers are tested against, in the order of these
        groups, which follow the hand.
        """
        limb, hand, thing = self.limb, self.hand_group, self.object_group
        near, proof = placed.body.neighbours, self.proof
        margin, self_margin = proof.margin, proof.self_margin
        extent, origin = _extent(limb), self.T_mount[:3, :3] @ limb.tree_f[1, 9:12]
        origin = origin + self.T_mount[:3, 3]
        rows_hand, rows_arm = [], []
        for k in range(thing + 1, len(groups)):
            name, body, _ = groups[k]
            center, radius = np.array(balls[k][:3]), balls[k][3]
            away = np.linalg.norm(center - origin) if body == self._world else 0.0
            for a in (*range(hand + 1), thing):
                far = extent[min(a, hand)] + (
                    2.0 * balls[thing][3] if a == thing else 0.0
                )
                if away - radius > far + 0.01:
                    continue
                if a < hand and name.startswith("own "):
                    links = (limb.groups[a][0], name[4:])
                    if links in near:
                        continue
                (rows_hand if a >= hand else rows_arm).append((a, k, margin))
        first = len(rows_hand) + 1
        rows_hand.append((hand, thing, margin))
        for a in range(hand):
            rows_arm.append((a, thing, margin))
            for b in range(a + 1, hand + 1):
                other = limb.spec.root if b == hand else limb.groups[b][0]
                if (limb.groups[a][0], other) not in near:
                    rows_arm.append((a, b, self_margin))
        rows_arm += [(a, hand + 1 + k, self_margin) for k, a in enumerate(by_hand)]
        rows = [*rows_hand, *rows_arm]
        pairs = np.array([r[:2] for r in rows])
        margins = np.array([r[2] for r in rows])
        reach, reaches = np.zeros((len(rows), limb.dof)), group_reaches(limb)
        for p, (a, b) in enumerate(pairs):
            if a == thing:
                continue  # when it is held
            reach[p] = reaches[a]
            if b < thing:  # joints below a carry both
                body = limb.parts[limb.groups[a][1]].body
                reach[p] = reaches[min(b, hand)] * (np.arange(limb.dof) >= body)
        return pairs, reach, margins, first

    # --- where things are ---------------------------------------------------------

    def put_other(self, q: np.ndarray) -> None:
        """Let the other arm stand at joints (dof,), its hand included."""
        q = np.ascontiguousarray(q, float)
        if q.tobytes() == self._q_other:
            return
        self._q_other = q.tobytes()
        frames = limb_frames(self.other, self._T_other, q)
        n = len(self.other.tree_i)
        rows = slice(self._first_other, self._first_other + n)
        self.space.tree_f[rows, :12] = frames
        self._moved()

    def put_object(self, T_world_object: np.ndarray) -> None:
        """Let the object stand somewhere; the arm does not hold it."""
        self.T_world_object, self._held = np.asarray(T_world_object, float), b""
        space, rows = self.space, self._rows
        space.tree_i[self._object] = -1, -1, 0
        space.tree_f[self._object, :12] = flat_pose(self.T_world_object)
        space.margin[:] = self._margin
        space.margin[rows.still] = _OFF  # neither moves
        space.reach[rows.limb] = group_reaches(self.limb)[rows.group]
        self._moved()

    def stand(
        self, q_other: np.ndarray, T_world_object: np.ndarray, touching: bool = False
    ) -> None:
        """Let the other arm and the object stand; may hands be `touching` it?"""
        self.put_other(q_other)
        self.put_object(T_world_object)
        if touching:
            self.let_touch()

    def carry(self, q_other: np.ndarray, T_palm_object: np.ndarray) -> None:
        """Let the other arm stand, and the hand hold the object."""
        self.put_other(q_other)
        self.hold(T_palm_object)

    def hold(self, T_palm_object: np.ndarray) -> None:
        """Let the hand hold the object: it goes with the palm, and touches the hand."""
        held = np.ascontiguousarray(T_palm_object, float).tobytes()
        if held == self._held:
            return
        self.T_world_object, self._held = None, held
        space, rows, limb = self.space, self._rows, self.limb
        T = limb.T_body_palm @ T_palm_object
        space.tree_i[self._object] = limb.palm, -1, 0
        space.tree_f[self._object, :12] = flat_pose(T)
        space.margin[:] = self._margin
        center = T[:3, :3] @ self._object_ball[:3] + T[:3, 3] - limb.T_body_palm[:3, 3]
        far = np.linalg.norm(center) + self._object_ball[3]
        reach = np.where(limb.palm_reach > 0.0, limb.palm_reach + far, 0.0)
        space.reach[rows.still] = reach
        space.reach[rows.limb] = reach * rows.beyond
        space.margin[rows.hand] = _OFF
        self._moved()

    def object_blocked(self, T_world_object: np.ndarray) -> str | None:
        """Return what the object would touch of all that stands, held by no hand."""
        self.put_object(T_world_object)
        self.space.margin[:] = _OFF
        tested = np.setdiff1d(self._rows.still, self._rows.touching)
        self.space.margin[tested] = self.proof.margin
        q = np.clip(np.zeros(self.limb.dof), self.limb.lower, self.limb.upper)
        trouble = self.why(q)[1]
        self.put_object(T_world_object)
        return trouble

    def let_touch(self) -> None:
        """Let both hands touch the object: they grasp it, or have just let go."""
        self.space.margin[self._rows.touching] = _OFF
        self._held = b""
        self.stamp += 1

    def _moved(self) -> None:
        self.scratch.stale[0] = True
        self.stamp += 1

    # --- questions ------------------------------------------------------------------

    def target(self, T_world_palm: np.ndarray) -> np.ndarray:
        """Return a palm's pose in the frame of the arm's mount, (..., 12)."""
        T = self._T_mount_world @ T_world_palm
        return np.concatenate(
            [T[..., :3, :3].reshape(*T.shape[:-2], 9), T[..., :3, 3]], axis=-1
        )

    def palm(self, q: np.ndarray) -> np.ndarray:
        """Return T_world_palm, (4, 4) [m]."""
        return self.T_mount @ self.limb.palm_pose(q)

    def why(self, q: np.ndarray) -> tuple[int, str | None]:
        """Return (pair, what is too near at joints (dof,)); (-1, None): nothing."""
        q = np.ascontiguousarray(q, float)
        out = self._outside(q)
        if out:
            return -1, out
        p = kernels.stands_clear(self.space, q, 0, len(self.space.pairs), self.scratch)
        return p, None if p < 0 else self._told(p)

    def path_blocked(self, path: np.ndarray) -> tuple[int, str | None, int]:
        """Return (pair, what a path (n, dof) is not proved clear of, first such leg).

        Nothing: (-1, None, number of legs).
        """
        path = np.ascontiguousarray(path, float)
        out = self._outside(path)
        if out:
            return -1, out, 0
        p, leg = kernels.path_clear(
            self.space, path, self.proof.tolerance, self.scratch
        )
        return p, None if p < 0 else self._told(p), len(path) - 1 if p < 0 else leg

    def _outside(self, q: np.ndarray) -> str:
        """Name a joint of q (..., dof) that is outside its limits, "" for none."""
        out = (q < self.limb.lower - 1e-6) | (q > self.limb.upper + 1e-6)
        if not out.any():
            return ""
        joint = out.reshape(-1, len(self.limb.joints)).any(axis=0).argmax()
        return f"{self.limb.joints[int(joint)]} is outside its limits"

    def _told(self, p: int) -> str:
        a, b = self.space.pairs[p]
        return f"{self.names[a]} would touch {self.names[b].removeprefix('other ')}"


def _scratch(space: kernels.Space, dof: int) -> kernels.Scratch:
    n_pairs = len(space.pairs)
    sizes = np.diff(space.group_span, axis=1)[:, 0]
    rows = int((sizes[space.pairs[:, 0]] * sizes[space.pairs[:, 1]]).sum())
    return kernels.Scratch(
        frames=np.zeros((len(space.tree_i), 12)),
        moves=np.zeros(n_pairs),
        lists=np.zeros((_DEPTH, n_pairs), np.int32),
        stack=np.zeros((_DEPTH + 1, max(4, dof))),
        simplex=np.zeros((16, 3)),
        group_at=np.zeros((len(space.group_ball), 3)),
        part_at=np.zeros((len(space.part_ball), 3)),
        axes=np.zeros((rows, 3)),
        arms=np.zeros((space.thing + 1, dof)),
        leg=np.zeros(dof),
        stale=np.ones(1, bool),
    )


def _turn_bodies(limb: Limb) -> np.ndarray:
    """Return the body that each joint of the arm turns by its own angle, else -1."""
    found = np.full(limb.dof, -1)
    for j in range(limb.n_arm):
        bodies = np.flatnonzero(limb.tree_i[:, 1] == j)
        if len(bodies) == 1 and limb.tree_i[bodies[0], 2] == 1:
            if abs(limb.tree_f[bodies[0], 15]) == 1.0:
                found[j] = bodies[0]
    return found


def solver_of(limb: Limb, solve: SolveSettings = SOLVE) -> kernels.Solver:
    """Return an arm's closed form with working memory for one thread."""
    free = free_angles(limb.seven, solve.free_angles)
    found = np.zeros((MOST * len(free), 7))
    return kernels.Solver(seven=limb.seven, room=room(), free=free, found=found)


class _Rows(NamedTuple):
    """Which pairs have to do with the object."""

    still: np.ndarray  # it and what stands
    limb: np.ndarray  # a group of the arm and it
    group: np.ndarray  # that group
    beyond: np.ndarray  # (n, dof) joints that do not carry both
    hand: np.ndarray  # the hand and it
    touching: np.ndarray  # it and either hand


def _object_rows(
    pairs: np.ndarray, hand: int, thing: int, limb: Limb, other: Limb
) -> _Rows:
    rows = np.flatnonzero(pairs[:, 1] == thing)
    group = pairs[rows, 0]
    body = np.array([limb.parts[limb.groups[a][1]].body for a in group])
    hands = {hand, thing + len(other.groups)}
    either = [set(pair) & hands and thing in pair for pair in pairs.tolist()]
    return _Rows(
        still=np.flatnonzero(pairs[:, 0] == thing),
        limb=rows,
        group=group,
        beyond=np.arange(limb.dof) >= body[:, None],
        hand=rows[group == hand],
        touching=np.flatnonzero(np.array([bool(e) for e in either])),
    )


@lru_cache(maxsize=16)
def group_reaches(limb: Limb) -> np.ndarray:
    """Return (n groups, dof) how far a unit of each joint moves a group [m]."""
    return np.array([limb.reach[a:b].max(axis=0) for _, a, b in limb.groups])


def mount_pose(placed: PlacedAgent, limb: Limb) -> np.ndarray:
    """Return what an arm hangs on, world frame, (4, 4) [m]."""
    frame = limb.model.frames(placed.joints)[limb.mount]
    return placed.T_world_base @ pose_of_flat(frame)


def limb_frames(limb: Limb, T_mount: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return (n_bodies, 12) world poses of an arm's bodies at joints (dof,)."""
    tree_f = limb.tree_f.copy()
    tree_f[0, :12] = flat_pose(T_mount)
    frames = np.empty((len(tree_f), 12))
    body_frames(limb.tree_i, tree_f, np.ascontiguousarray(q, float), frames)
    return frames


def _limb_groups(limb: Limb, first: int) -> list[tuple]:
    """Return groups of a limb whose bodies begin at row `first`."""
    found = []
    for name, begin, end in limb.groups:
        members = limb.parts[begin:end]
        body = limb.palm if name == "hand" else members[0].body
        parts = [(first + p.body, p.points, p.radius) for p in members]
        found.append((name, first + body, parts))
    return found


@lru_cache(maxsize=16)
def hand_ball(limb: Limb) -> tuple:
    """Return a ball round a hand for all joints of its fingers, frame of its body."""
    _, begin, end = limb.groups[-1]
    center = np.zeros(3)
    members = [p for p in limb.parts[begin:end] if p.body == limb.palm]
    if members:
        points = np.concatenate([p.points for p in members])
        center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    far = 0.0
    for part in limb.parts[begin:end]:
        reach, body = np.linalg.norm(part.points, axis=1).max() + part.radius, part.body
        if body == limb.palm:
            reach = np.linalg.norm(part.points - center, axis=1).max() + part.radius
        while body != limb.palm:
            row = limb.tree_f[body]
            at = row[9:12] - (center if limb.tree_i[body, 0] == limb.palm else 0.0)
            reach += np.linalg.norm(at)
            reach += _travel(limb, body)
            body = limb.tree_i[body, 0]
        far = max(far, reach)
    return (*center.tolist(), far + 1e-9)


@lru_cache(maxsize=16)
def _extent(limb: Limb) -> list[float]:
    """Bound how far each group gets from where the arm's first joint is at 0 [m]."""
    far, first = np.zeros(len(limb.tree_i)), limb.tree_f[1, 9:12]
    for b in range(1, len(limb.tree_i)):
        parent, at = limb.tree_i[b, 0], limb.tree_f[b, 9:12]
        way = np.linalg.norm(at - first if parent == 0 else at)
        far[b] = far[parent] + way + _travel(limb, b)
    return [
        max(
            far[p.body] + np.linalg.norm(p.points, axis=1).max() + p.radius
            for p in limb.parts[begin:end]
        )
        for _, begin, end in limb.groups
    ]


def _travel(limb: Limb, body: int) -> float:
    """Bound how far a body's own slide moves it from where it is at 0 [m]."""
    if limb.tree_i[body, 2] != PRISMATIC:
        return 0.0
    joint, (factor, offset) = limb.tree_i[body, 1], limb.tree_f[body, 15:17]
    most = max(abs(limb.lower[joint]), abs(limb.upper[joint]))
    return float(abs(factor) * most + abs(offset))


def _fingers(groups: list, limb: Limb, near: frozenset) -> dict[int, tuple]:
    """Return, for each link that meets the palm, what of the hand must not touch it.

    The palm may: it is joined to that link. The fingers are not, and a bent wrist
    brings them to it. A link welded to the palm is as near to them as the hand is made.
    """
    name, body, parts = groups[-1]
    links = [p.link for p in limb.parts[limb.groups[-1][1] :]]
    found = {}
    for a, (link, begin, _) in enumerate(limb.groups[:-1]):
        if limb.parts[begin].body == limb.palm or (link, limb.spec.root) not in near:
            continue  # in the latter case the whole hand is tested against it
        apart = [
            p for p, tip in zip(parts, links, strict=True) if (link, tip) not in near
        ]
        if apart:
            found[a] = name, body, apart
    return found


def _rest(placed: PlacedAgent, limb: Limb, body: int, prefix: str) -> list[tuple]:
    """Return the links of an agent that are no part of its arm, world frame."""
    frames, T = limb.model.frames(placed.joints), placed.T_world_base
    links: dict[str, list] = {}
    for part in limb.model.parts:
        if part.body in limb.own:
            continue
        f = frames[part.body]
        points = part.points @ f[:9].reshape(3, 3).T + f[9:]
        points = moved_points(points, T)
        links.setdefault(part.link, []).append((body, points, part.radius))
    return [(prefix + name, body, parts) for name, parts in links.items()]


@lru_cache(maxsize=16)
def _hulls(thing: GraspObject) -> tuple[np.ndarray, ...]:
    """Return the corners of the hulls of an object's parts, its frame [m]."""
    moved = [(part.vertices, part.T_base_shape) for part in thing.parts]
    return tuple(hull_corners(moved_points(v, T)) for v, T in moved)


def has_hollows(shape: Shape) -> bool:
    """Return whether a shape is a mesh with less than 0.99 of its hull's volume."""
    if not isinstance(shape, Mesh):
        return False
    corners, faces = shape.vertices, hull_facets(shape.vertices)
    return volume(corners, shape.faces) < 0.99 * volume(corners, faces)


def shape_points(shape: Shape) -> tuple[np.ndarray, float]:
    """Return a shape as points with a radius, world frame; a mesh as its hull [m]."""
    T, radius = shape.T_base_shape, 0.0
    if isinstance(shape, Sphere):
        points, radius = np.zeros((1, 3)), shape.radius
    elif isinstance(shape, Capsule):
        points = np.array([[0, 0, -0.5], [0, 0, 0.5]]) * shape.length
        radius = shape.radius
    elif isinstance(shape, Cylinder):
        points = prism(shape.radius, shape.length)
    elif isinstance(shape, Box):
        points = box_corners(shape.size)
    else:
        assert isinstance(shape, Mesh)
        points = hull_corners(shape.vertices)
    return moved_points(points, T), radius
