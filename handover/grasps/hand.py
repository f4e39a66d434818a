"""A hand ready to grasp: its links and solids as arrays, read from its robot's URDF."""

import hashlib
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations

import numpy as np

from handover.grasps import _closing as kernels
from handover.grasps.hands import HandSpec, hand_spec
from odm.exact.distances import gather, solid_part
from roadmap.errors import BadRobot
from roadmap.geometry.solids import Solid, solid_of
from roadmap.loading.body_tree import drive
from roadmap.robot.description import MOVABLE, Description, Joint, read_description
from roadmap.robot.known import robot_file
from roadmap.robot.robot import CYLINDER, SPHERE
from roadmap.transforms import flat_pose, moved_points

_KINDS = {
    "revolute": kernels.TURNS,
    "continuous": kernels.TURNS,
    "prismatic": kernels.SLIDES,
}


@dataclass(frozen=True, eq=False)
class Hand:
    """A hand, with frames relative to its palm frame.

    Attributes:
        spec: What it was made from.
        joints: (k,) its driving joints: what a grasp gives values to.
        links: (n,) names of its links, parents first.
        arrays: For the kernels.
        closed: (k,) values towards which the joints close.
        preshapes: (p, k) values of the open hands to begin from.
        fingers: Indices of each finger's joints, in the order in which they close.
        pairs: (r, 2) links that must not touch each other.
        reach: Farthest point before the palm of the first open hand [m].
        longest: The same of all open hands [m].
    """

    spec: HandSpec
    joints: tuple[str, ...]
    links: tuple[str, ...]
    arrays: kernels.HandArrays
    closed: np.ndarray
    preshapes: np.ndarray
    fingers: tuple[tuple[int, ...], ...]
    pairs: np.ndarray
    reach: float
    longest: float

    def state(self, T_object_palm: np.ndarray, values: np.ndarray) -> kernels.HandState:
        """Return the hand with its palm at a pose (4, 4), joints at values (k,)."""
        n, m = len(self.links), len(self.arrays.local)
        state = kernels.HandState(
            palm=flat_pose(np.asarray(T_object_palm, float)),
            values=np.array(values, float),
            links=np.empty((n, 12)),
            frames=np.empty((m, 12)),
            touched=np.full(len(self.joints), -1),
        )
        kernels.place(self.arrays, state)
        return state

    def fingerprint(self) -> str:
        """Return a SHA-256 over all that its grasps depend on, to a nanometre."""
        arrays, digest = self.arrays, hashlib.sha256(repr(self.fingers).encode())
        for array in (
            *(self.closed, self.preshapes, arrays.parent, arrays.fixed, arrays.axis),
            *(arrays.kind, arrays.driver, arrays.scale, arrays.local, *arrays.solids),
        ):
            digest.update(str(array.shape).encode())
            digest.update((np.round(array.astype(float), 9) + 0.0).tobytes())
        return digest.hexdigest()


def load_hand(name: str) -> Hand:
    """Return the hand of that name, read from the URDF of its robot.

    Raises:
        BadInput: No hand has that name.
        BadRobot: Its URDF lacks a link or joint that the hand names.
    """
    return make_hand(hand_spec(name))


@cache
def make_hand(spec: HandSpec) -> Hand:
    """Return a hand from what is known of it; see `load_hand`."""
    path = robot_file(spec.robot)
    description = read_description(path)
    for link in (spec.root, spec.palm):
        if link not in description.links:
            raise BadRobot(
                f"the hand {spec.name!r} names the link {link!r}, which {path.name} "
                f"lacks; its links are {list(description.links)}"
            )
    links = [spec.root, *(joint.child for joint in description.below(spec.root))]
    arrays = _arrays(spec, description, links, path)
    index = {name: k for k, name in enumerate(spec.joints)}
    closed = np.array([spec.closed.get(name, 0.0) for name in spec.joints])
    shapes = np.array([[s.get(n, 0.0) for n in spec.joints] for s in spec.preshapes])
    fingers = tuple(tuple(index[n] for n in finger) for finger in spec.fingers)
    hand = Hand(
        spec, spec.joints, tuple(links), arrays, closed, shapes, fingers,
        np.empty((0, 2), np.int64), 0.0, 0.0,
    )  # fmt: skip
    return _finished(hand, description)


def _finished(hand: Hand, description: Description) -> Hand:
    """Return the hand with its reach, and the pairs of links that can be apart."""
    states = [hand.state(np.eye(4), values) for values in hand.preshapes]
    solids, found = hand.arrays.solids, np.empty(2, np.int64)
    reaches = [_farthest(state.frames, solids.ball) for state in states]
    pairs = []
    for a, b in combinations(np.unique(solids.owner).tolist(), 2):
        one = np.array([[a, b]])
        joined = any(
            joint is not None and joint.parent == hand.links[up]
            for up, low in ((a, b), (b, a))
            for joint in [description.parent_joint(hand.links[low])]
        )
        if joined or any(
            kernels.meets_itself(hand.arrays, state, one, found) for state in states
        ):
            continue
        pairs.append((a, b))
    rows = np.array(pairs, np.int64).reshape(-1, 2)
    return replace(hand, pairs=rows, reach=reaches[0], longest=max(reaches))


def _farthest(frames: np.ndarray, balls: np.ndarray) -> float:
    """Return the farthest place before the palm of balls on frames (n, 12) [m]."""
    tops = frames[:, 11] + np.einsum("mk,mk->m", frames[:, 6:9], balls[:, :3])
    return float((tops + balls[:, 3]).max())


def _arrays(
    spec: HandSpec, description: Description, links: list[str], path: object
) -> kernels.HandArrays:
    joints = [description.parent_joint(link) for link in links[1:]]
    index, names = {link: k for k, link in enumerate(links)}, spec.joints
    driven = [_driven(description, joint, names) for joint in joints]
    for name in names:
        if name not in description.joints:
            raise BadRobot(
                f"the hand {spec.name!r} names the joint {name!r}, which its URDF "
                f"lacks; its joints are {list(description.joints)}"
            )
    T_palm_root = np.linalg.inv(
        _pose_beside(description, links[0], spec.palm) @ spec.T_link_palm
    )
    fixed = flat_pose(np.array([T_palm_root, *(j.T_parent_joint for j in joints)]))
    axes = [np.array([0.0, 0.0, 1.0]), *(j.axis for j in joints)]
    kinds = [0, *(_KINDS.get(j.kind, 0) for j in joints)]
    solids, parts = _merged(_solids(description, links, path))
    owner = np.array([s.link for s in solids])
    base = np.array([-1, *(index[j.parent] for j in joints)])
    drivers = np.array([-1, *(d[0] for d in driven)])
    moves = _moves(base, drivers, owner, len(names))
    gathered = gather(parts, owner)
    return kernels.HandArrays(
        parent=base,
        fixed=fixed,
        axis=np.array(axes, float),
        kind=np.array(kinds),
        driver=drivers,
        scale=np.array([(1.0, 0.0), *(d[1:] for d in driven)]),
        solids=gathered,
        local=flat_pose(np.array([s.T_body_solid for s in solids])),
        bounds=np.array([_bounds(*part) for part in parts]),
        lever=_levers(
            *(base, fixed, kinds, driven, gathered, solids),
            [_travel(description, joint) for joint in joints],
            len(names),
        ),
        moves=moves,
    )


def _pose_beside(description: Description, root: str, link: str) -> np.ndarray:
    """Return T_root_link, (4, 4) [m], of two links that nothing moves apart."""
    ways = description.path(root), description.path(link)
    same = sum(one is other for one, other in zip(*ways, strict=False))
    poses = []
    for way in ways:
        T = np.eye(4)
        for joint in way[same:][::-1]:
            if joint.kind in MOVABLE:
                raise BadRobot(
                    f"the joint {joint.name!r} moves the palm {link!r} and the hand's "
                    f"root {root!r} apart; name a palm that is fixed to the root"
                )
            T = joint.T_parent_joint @ T
        poses.append(T)
    return np.linalg.inv(poses[0]) @ poses[1]


def _driven(
    description: Description, joint: Joint, names: tuple[str, ...]
) -> tuple[int, float, float]:
    """Return driver, factor and offset of a joint; a fixed one has the driver -1."""
    if joint.kind not in MOVABLE:
        return -1, 0.0, 0.0
    name, factor, offset = drive(description, joint)
    if name not in names:
        raise BadRobot(
            f"the joint {name!r} belongs to the hand, but no finger of it; name it in "
            "its fingers or preshapes"
        )
    return names.index(name), factor, offset


def _solids(description: Description, links: list[str], path: object) -> list[Solid]:
    lookup = (path, ())
    return [
        solid_of(shape, link, k, np.eye(4), lookup)[0]
        for k, link in enumerate(description.links[name] for name in links)
        for shape in link.collisions or link.visuals
    ]


def _merged(solids: list[Solid]) -> tuple[list[Solid], list[tuple]]:
    """Return solids and their parts, capsules as one: ten times as fast to measure."""
    rods, balls = capsules_in(solids)
    kept = [k for k in range(len(solids)) if k not in balls]
    merged = [solids[k] for k in kept]
    parts = [
        (rods[k], s.size[0], 0.0, 0.0)
        if k in rods
        else solid_part(s.kind, s.size, s.points)
        for k, s in zip(kept, merged, strict=True)
    ]
    return merged, parts


def capsules_in(solids: list[Solid]) -> tuple[dict[int, np.ndarray], set[int]]:
    """Return cylinders with a ball of their link and radius at both ends: capsules.

    By the cylinder's index, its ends (2, 3) in its own frame [m]; and the balls.
    """
    rods, dropped = {}, set()
    for k, rod in enumerate(solids):
        if rod.kind != CYLINDER:
            continue
        radius, length = rod.size[:2]
        ends = np.array([[0.0, 0.0, -0.5], [0.0, 0.0, 0.5]]) * length
        at_ends = [
            [
                i
                for i, ball in enumerate(solids)
                if (ball.kind, ball.link) == (SPHERE, rod.link)
                and abs(ball.size[0] - radius) < 1e-9
                and np.abs(ball.T_body_solid[:3, 3] - end).max() < 1e-9
            ]
            for end in moved_points(ends, rod.T_body_solid)
        ]
        if all(at_ends):
            rods[k] = ends
            dropped.update(*at_ends)
    return rods, dropped


def _bounds(points: np.ndarray, margin: float, radius: float, half: float) -> tuple:
    """Return the box (6,) around a part, low and high."""
    low, high = np.array([-radius, -radius, -half]), np.array([radius, radius, half])
    if len(points):
        low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    return (*(low - 1e-12), *(high + 1e-12))


def _moves(
    parent: np.ndarray, drivers: np.ndarray, owner: np.ndarray, n: int
) -> np.ndarray:
    """Return (n, solids) bool: which drivers move a solid."""
    by_link = np.zeros((len(parent), n), bool)
    for link in range(len(parent)):
        if parent[link] >= 0:
            by_link[link] = by_link[parent[link]]
        if drivers[link] >= 0:
            by_link[link, drivers[link]] = True
    return np.ascontiguousarray(by_link[owner].T)


def _travel(description: Description, joint: Joint) -> float:
    """Bound how far a slide is from where it is at 0 [m]; 0 of any other joint."""
    if joint.kind != "prismatic":
        return 0.0
    name, factor, offset = drive(description, joint)
    driver = description.joints[name]
    most = max(abs(driver.lower or 0.0), abs(driver.upper or 0.0))
    return abs(factor) * most + abs(offset)


def _levers(parent, fixed, kinds, driven, solids, owners, travel, n) -> np.ndarray:
    """Bound how far a unit of each driver moves any point of a solid, (n,) [m].

    Each joint on the way to a solid turns it by its factor times the longest way from
    the joint to the solid's farthest point. A slide moves it by its factor, and brings
    it farther from the turns that carry the slide: by its `travel` (of each joint).
    """
    lever = np.zeros(n)
    for k, solid in enumerate(owners):
        far = np.linalg.norm(solid.T_body_solid[:3, 3]) + solids.ball[k, 3]
        far += np.linalg.norm(solids.ball[k, :3])
        moved, link = np.zeros(n), solid.link
        while link > 0:
            d, factor, _ = driven[link - 1]
            if kinds[link] == kernels.TURNS:
                moved[d] += abs(factor) * far
            elif kinds[link] == kernels.SLIDES:
                moved[d] += abs(factor)
                far += travel[link - 1]
            far += np.linalg.norm(fixed[link, 9:])
            link = parent[link]
        lever = np.maximum(lever, moved)
    return np.maximum(lever, 1e-6)
