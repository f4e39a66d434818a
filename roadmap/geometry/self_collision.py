"""Self-collision: which pairs of links are tested, and proofs that they stay apart.

Links are tested by their shells, convex polytopes that contain the solids. A pair is
clear at a configuration when a separating direction proves it; a whole motion is
clear when that distance outweighs all the two links can move relative to each other.
Joints that carry both links do not count.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from roadmap.arrays import frozen
from roadmap.geometry import _self_collision as kernels
from roadmap.geometry._self_chords import MAX_DEPTH, Chords
from roadmap.kinematics.forward import checked
from roadmap.robot.robot import Robot

# Shells are proved this far apart [m].
MARGIN = 1e-4
# A motion is given up where a pair is nearer than its displacement over this [m].
TOLERANCE = 1e-3
# Near its ends it is given up there [m]: links that are close may move apart.
FINEST = 1e-5
_MAX_DEPTH = 40
_SAMPLES = 500
ALWAYS = "always in contact"
OFTEN = "are in contact in"  # ... so much of all poses: a note of the robot


@dataclass(frozen=True, eq=False)
class SelfCollision:
    """Pairs of shells for the kernels, and the two links (n, 2) of each."""

    links: np.ndarray
    model: kernels.SelfModel

    def scratch(self) -> kernels.SelfWork:
        """Return working memory for the kernels; one per thread."""
        n, dof = self.model.reach.shape
        n_bodies, n_shells = len(self.model.tree_i), len(self.model.rods)
        chords = Chords(
            frames=np.zeros((MAX_DEPTH + 2, n_bodies, 12)),
            rods=np.zeros((MAX_DEPTH + 2, n_shells, 6)),
            axes=np.zeros((n, 3)),
            sags=np.zeros(n),
            lists=np.zeros((MAX_DEPTH + 1, n), np.int32),
            levels=np.zeros((MAX_DEPTH + 1, 4), np.int64),
            way=np.zeros(3),
            after=np.zeros(3),
            at=np.zeros(dof),
            simplex=np.zeros((16, 3)),
        )
        return kernels.SelfWork(
            frames=np.zeros((n_bodies, 12)),
            axes=np.zeros((n, 3)),
            moves=np.zeros(n),
            lists=np.zeros((_MAX_DEPTH, n), np.int32),
            stack=np.zeros((_MAX_DEPTH + 1, max(4, dof))),
            simplex=np.zeros((16, 3)),
            chords=chords,
        )


@lru_cache(maxsize=8)
def self_collision(robot: Robot) -> SelfCollision:
    """Return the self-collision model of a robot (made once for each robot)."""
    tested = set(map(tuple, np.sort(robot.self_pairs, axis=1).tolist()))
    n = len(robot.shell_link)
    body = robot.link_body[robot.shell_link]
    rows, reach = [], []
    for a in range(n):
        for b in range(a + 1, n):
            links = sorted((int(robot.shell_link[a]), int(robot.shell_link[b])))
            if tuple(links) not in tested:
                continue
            span = [*robot.shell_ptr[a : a + 2], *robot.shell_ptr[b : b + 2]]
            rows.append((a, b, body[a], body[b], *span))
            reach.append(relative_reach(robot, a, b))
    pair_i = frozen(np.array(rows).reshape(-1, 8), np.int32)
    links = robot.shell_link[pair_i[:, :2]]
    ends = pairwise(robot.shell_ptr)
    shells = [robot.shell_points[a:b].tobytes() for a, b in ends]
    model = kernels.SelfModel(
        robot.tree_i,
        robot.tree_f,
        pair_i,
        frozen(np.array(reach).reshape(-1, robot.dof), np.float64),
        frozen(np.array([_ball(s) for s in shells]).reshape(-1, 4), np.float64),
        robot.shell_points,
        frozen(body, np.int32),
        frozen(np.array([_rod(s) for s in shells]).reshape(-1, 7), np.float64),
        frozen(np.array([carrier(robot, *row[2:4]) for row in rows]), np.int32),
        frozen(robot.shell_reach, np.float64),
    )
    return SelfCollision(frozen(links, np.int32), model)


def configuration_free(
    robot: Robot, q: np.ndarray, margin: float = MARGIN
) -> tuple[bool, str]:
    """Say if q (dof,) is within limits and free of self-collision.

    Links must keep `margin` [m], above 0.

    Returns:
        (True, "") or (False, sentence that names the joint or the links).

    Raises:
        BadConfiguration: `q` has the wrong length or is not finite.
    """
    q = checked(robot, q)
    out = (q < robot.lower) | (q > robot.upper)
    out &= ~robot.continuous
    if out.any():
        j = int(out.argmax())
        return False, (
            f"joint {robot.joint_names[j]!r} at {q[j]:.4f} is outside its limits "
            f"{robot.lower[j]:.4f} to {robot.upper[j]:.4f}"
        )
    tested = self_collision(robot)
    pair = kernels.configuration_clear(tested.model, q, margin, tested.scratch())
    if pair < 0:
        return True, ""
    a, b = (robot.link_names[i] for i in tested.links[pair])
    return False, f"{a} and {b} collide or are nearer than {margin:g} m"


def with_pairs(
    robot: Robot, adjacent: set[frozenset[str]], disabled: dict[frozenset[str], str]
) -> Robot:
    """Return the robot with its pairs chosen; whatever is dropped has a reason.

    Dropped are links of one body, links joined by a joint, pairs that the SRDF
    disables, and pairs in contact in *every* sampled configuration. A pair that was
    never seen in contact stays: samples prove nothing.
    """
    names, kept, dropped = robot.link_names, [], []
    for i in range(len(names)):
        for j in range(i + 1, len(names)):
            key = frozenset((names[i], names[j]))
            if robot.link_body[i] == robot.link_body[j]:
                dropped.append((names[i], names[j], "fixed to each other"))
            elif key in adjacent:
                dropped.append((names[i], names[j], "joined by a joint"))
            elif key in disabled:
                dropped.append((names[i], names[j], f"SRDF: {disabled[key]}"))
            else:
                kept.append((i, j))
    robot = replace(robot, self_pairs=np.array(kept).reshape(-1, 2))
    share = _contact_share(robot)
    always = [pair for pair in kept if share[pair] == 1.0]
    reason = f"{ALWAYS} ({_SAMPLES + 2} configurations)"
    dropped += [(names[i], names[j], reason) for i, j in always]
    often = [
        f"{names[i]} and {names[j]} {OFTEN} {share[i, j]:.0%} of all poses"
        for i, j in kept
        if 0.5 < share[i, j] < 1.0
    ]
    kept = [pair for pair in kept if pair not in always]
    return replace(
        robot,
        self_pairs=np.array(kept).reshape(-1, 2),
        dropped_pairs=tuple(dropped),
        notes=(*robot.notes, *often),
    )


def crowded_pairs(robot: Robot) -> set[frozenset[str]]:
    """Return the pairs of links that touch in more than half of all sampled poses."""
    often = (pair for pair, share in contact_shares(robot).items() if share > 0.5)
    return always_touching_pairs(robot) | set(map(frozenset, often))


def contact_shares(robot: Robot) -> dict[tuple[str, str], float]:
    """Return in which share of the poses the links of each tested pair touch."""
    names, shares = robot.link_names, _contact_share(robot)
    return {(names[i], names[j]): share for (i, j), share in shares.items()}


def always_touching_pairs(robot: Robot) -> set[frozenset[str]]:
    """Return the pairs of links that are not tested since they always touch."""
    return {frozenset(pair[:2]) for pair in robot.dropped_pairs if ALWAYS in pair[2]}


def _contact_share(robot: Robot) -> dict[tuple[int, int], float]:
    """Return how often each pair of links is in contact, over fixed samples."""
    tested = self_collision.__wrapped__(robot)
    rng = np.random.default_rng(0)
    samples = rng.uniform(robot.lower, robot.upper, (_SAMPLES, robot.dof))
    middle = (robot.lower + robot.upper) / 2
    home = np.clip(0.0, robot.lower, robot.upper)
    contacts = np.zeros((_SAMPLES + 2, len(tested.links)), np.bool_)
    work = tested.scratch()
    for k, q in enumerate([middle, home, *samples]):
        work.axes[:] = 0.0  # no sample begins where another ended
        kernels.contacts(tested.model, q, work, contacts[k])
    share = {}
    for pair in map(tuple, robot.self_pairs.tolist()):
        rows = (tested.links == pair).all(axis=1) | (tested.links[:, ::-1] == pair).all(
            axis=1
        )
        share[pair] = float(contacts[:, rows].any(axis=1).mean())
    return share


def relative_reach(robot: Robot, a: int, b: int) -> np.ndarray:
    """Bound how far two shells move against each other per unit of each joint."""
    weights = np.zeros(robot.dof)
    body_a, body_b = robot.link_body[robot.shell_link[[a, b]]]
    common = set(_ancestors(robot, body_a)) & set(_ancestors(robot, body_b))
    for shell, body in ((a, body_a), (b, body_b)):
        for k in _ancestors(robot, body):
            if k not in common and robot.tree_i[k, 1] >= 0:
                factor = abs(robot.tree_f[k, 15])
                weights[robot.tree_i[k, 1]] += factor * robot.shell_reach[shell, k]
    return weights


def carrier(robot: Robot, a: int, b: int) -> int:
    """Return the last body that carries both bodies."""
    return max(set(_ancestors(robot, a)) & set(_ancestors(robot, b)))


def _ancestors(robot: Robot, body: int) -> list[int]:
    chain = []
    while body >= 0:
        chain.append(int(body))
        body = robot.tree_i[body, 0]
    return chain


@lru_cache(maxsize=256)  # a robot's shells stay where its pairs change
def _rod(shell: bytes) -> tuple[float, ...]:
    """Return a rod around a shell, ends of its axis and radius: the least of three.

    Its axis goes along one of the points' principal axes. `shell` are (n, 3) floats.
    """
    points = np.frombuffer(shell).reshape(-1, 3)
    off = points - points.mean(axis=0)
    turned = np.linalg.eigh(off.T @ off)[1].T
    best: tuple[float, ...] = ()
    least = np.inf
    for k in range(3):
        frame = np.roll(turned, -k, axis=0)  # the axis, then what is across it
        seen = points @ frame.T
        middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
        beside2 = ((seen[:, 1:] - middle[1:]) ** 2).sum(axis=1)
        more = np.sqrt(beside2.max() - beside2)  # that a round end reaches farther here
        low, high = (seen[:, 0] + more).min(), (seen[:, 0] - more).max()
        if low > high:
            low = high = middle[0]
        ends = [(at, *middle[1:]) @ frame for at in (low, high)]
        over = seen[:, 0] - np.clip(seen[:, 0], low, high)
        radius = np.sqrt((over**2 + beside2).max()) + 1e-9
        size = radius**2 * (high - low + 4.0 / 3.0 * radius)
        if size < least:
            best, least = (*ends[0], *ends[1], radius), size
    return best


@lru_cache(maxsize=256)
def _ball(shell: bytes) -> tuple[float, ...]:
    """Return a small ball around a shell, as `_rod`, by the walk of [Badoiu2003]."""
    points = np.frombuffer(shell).reshape(-1, 3)
    center = points.mean(axis=0)
    for k in range(1, 200):
        far = points[((points - center) ** 2).sum(axis=1).argmax()]
        center = center + (far - center) / (k + 1)
    return (*center, np.linalg.norm(points - center, axis=1).max() + 1e-9)
