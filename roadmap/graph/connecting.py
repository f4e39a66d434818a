"""Sample and connect: from a robot and settings to a Roadmap."""

import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from roadmap.builds.chunks import Progress, Threads, Workers
from roadmap.errors import BadInput, BuildRefused, NothingFree
from roadmap.geometry.self_collision import contact_shares
from roadmap.graph.near import NearSpec, near_nodes
from roadmap.graph.roadmap import N_LANDMARKS, Roadmap, choose_landmarks
from roadmap.graph.sampling import draw
from roadmap.kinematics.forward import difference
from roadmap.ranges import check_number
from roadmap.robot.robot import Robot

Parts = Iterable[tuple[np.ndarray, np.ndarray]]
Stream = Callable[[str, Parts], Iterator[np.ndarray]]
_TESTED = 2048  # motions tested as one chunk; the bytes do not depend on it
_MAX_REJECTED = 400  # drawn per node kept before the build gives up


@dataclass(frozen=True)
class RoadmapSettings:
    """How a roadmap is sampled and connected.

    Attributes:
        nodes: Number of valid nodes to draw.
        neighbors: Each node is joined with this many nearest ones.
        sampling: "uniform", "halton" or "grid".
        seed: Same seed, same roadmap.
        weights: Weight of each joint in distances; all 1 when None.
        max_step: No edge moves a joint by more than this [rad or m]; None: no bound.
        region: (2, 3) box [m] the tool is drawn to; None: everywhere.
    """

    nodes: int = 10000
    neighbors: int = 12
    sampling: str = "halton"
    seed: int = 1
    weights: tuple[float, ...] | None = None
    max_step: float | None = None
    region: tuple[tuple[float, ...], tuple[float, ...]] | None = None

    def __post_init__(self) -> None:
        """Check every value but the sampler's name, which `draw` knows."""
        whole = {"nodes": (2, 10_000_000), "neighbors": (1, 500), "seed": (0, 2**63)}
        for name, (low, high) in whole.items():
            value = getattr(self, name)
            check_number(f"roadmap.{name}", value, low, high, True, "the recipe")
        if self.max_step is not None:
            where = "roadmap.max_step in rad or m"
            check_number(where, self.max_step, 1e-3, 1e3, where="the recipe")
        if self.weights is not None:
            many = len(self.weights) if hasattr(self.weights, "__len__") else 1
            _check_rows("weights", self.weights, (many,), 1e-6)
        if self.region is not None:
            _check_rows("region", self.region, (2, 3), -1e3)


def _check_rows(name: str, rows: object, shape: tuple, low: float) -> None:
    """Refuse what is no array of that shape with numbers from `low` to 1000."""
    try:
        array = np.asarray(rows, float)
    except (TypeError, ValueError, OverflowError):
        array = np.full(0, np.nan)
    sound = array.shape == shape and ((low <= array) & (array <= 1e3)).all()
    if not sound or (name == "region" and not (array[0] < array[1]).all()):
        raise BadInput(
            f"roadmap.{name} is {rows!r}, but must be "
            + ("a lower and an upper corner [m]" if name == "region" else "numbers")
            + f" from {low:g} to 1000; change it in the recipe"
        )


@dataclass(frozen=True)
class BuildReport:
    """What came of a build.

    Attributes:
        drawn: Configurations drawn for the nodes.
        candidates: Edges tried.
        edges: Edges found free.
        components: Sizes of the connected components, largest first; only the
            first was kept.
    """

    drawn: int
    candidates: int
    edges: int
    components: tuple[int, ...]


def build_roadmap(
    robot: Robot,
    settings: RoadmapSettings,
    stream: Stream,
    progress: Progress | None = None,
    workers: Workers | None = None,
) -> tuple[Roadmap, BuildReport]:
    """Sample nodes, join near ones, keep the largest component.

    Args:
        robot: The robot.
        settings: See RoadmapSettings.
        stream: Test of motions q + t dq: (stage, chunks of (q, dq), (k, dof) each) ->
            a (k,) bool for each chunk, in order: self-collision and scenery, along the
            whole motion. dq = 0 tests a node. It may look a few chunks ahead.
        progress: Called with (stage, done, total).
        workers: Who looks for near nodes; threads of this process when None. The
            bytes stay the same.

    Raises:
        BuildRefused: Next to no configuration is valid.
    """
    tell = progress or (lambda stage, done, total: None)
    nodes, drawn = _sample(robot, settings, stream, tell)
    weights = _weights(robot, settings)
    nodes = nodes[_spatial_order(nodes * weights)]
    pairs = _near_pairs(robot, nodes, weights, settings, workers or Threads())
    dq = difference(robot, nodes[pairs[:, 0]], nodes[pairs[:, 1]])
    starts = range(0, len(pairs), _TESTED)
    parts = ((nodes[pairs[k : k + _TESTED, 0]], dq[k : k + _TESTED]) for k in starts)
    free = np.zeros(len(pairs), bool)
    for k, found in zip(starts, stream("edge", parts), strict=True):
        free[k : k + _TESTED] = found
        tell("edges", min(k + _TESTED, len(pairs)), len(pairs))
    if not free.any():
        raise NothingFree(no_edges(settings, len(pairs)))
    edges, lengths = pairs[free], np.linalg.norm(dq[free] * weights, axis=1)
    roadmap, sizes = _largest_component(nodes, edges, lengths, weights)
    return roadmap, BuildReport(drawn, len(pairs), int(free.sum()), sizes)


def _sample(
    robot: Robot, settings: RoadmapSettings, stream: Stream, tell: Progress
) -> tuple[np.ndarray, int]:
    kept: list[np.ndarray] = []
    n_kept = drawn = 0
    region = None if settings.region is None else np.asarray(settings.region, float)
    chunks = draw(robot, settings.sampling, settings.seed, settings.nodes, region)
    parts, looked_at = itertools.tee(chunks)
    verdicts = stream("drawn configuration", ((q, np.zeros_like(q)) for q in parts))
    while n_kept < settings.nodes:
        q, free = next(looked_at), next(verdicts)
        q = q[free]
        drawn += 1024
        kept.append(q)
        n_kept += len(q)
        tell("nodes", min(n_kept, settings.nodes), settings.nodes)
        if drawn > _MAX_REJECTED * max(n_kept, 100):
            raise NothingFree(
                f"only {n_kept} of {drawn} drawn configurations are valid, which is "
                f"too few for {settings.nodes} nodes; {_how_to_be_free(robot)}"
            )
    return np.concatenate(kept)[: settings.nodes], drawn


def no_edges(settings: RoadmapSettings, tried: int) -> str:
    """Return why there is no roadmap where none of the motions tried is free."""
    why = f"none of {tried} motions between {settings.nodes} nodes is free"
    if tried == 0:
        why = f"no two of {settings.nodes} nodes lie within max_step of each other"
    return (
        f"{why}, so the roadmap would have no edges; give more nodes or neighbors, or "
        "check the scenery, the joints' limits and what the locked joints are locked at"
    )


def _how_to_be_free(robot: Robot) -> str:
    """Return what would make more configurations valid, and which links touch most."""
    shares = contact_shares(robot).items()
    often = sorted(((share, pair) for pair, share in shares if share > 0.1))[:-4:-1]
    if not often:
        return "check the scenery, and what the locked joints are locked at"
    pairs = ", ".join(f"{a} and {b} touch in {share:.0%}" for share, (a, b) in often)
    return (
        f"{pairs} of all poses: lock joints elsewhere (--lock), leave out pairs that "
        "cannot touch (--srdf), or check the scenery"
    )


def _weights(robot: Robot, settings: RoadmapSettings) -> np.ndarray:
    if settings.weights is None:
        return np.ones(robot.dof)
    if len(settings.weights) != robot.dof:
        raise BuildRefused(
            f"{len(settings.weights)} joint weights were given for {robot.dof} "
            "joints; give one weight for each moving joint"
        )
    return np.asarray(settings.weights, float)


def _wrapped(
    robot: Robot, points: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return points with continuous joints in one turn, and the length of turns."""
    period = np.where(robot.continuous, 2 * np.pi * weights, 0.0)
    wrapped = np.where(robot.continuous, np.mod(points, period + 1e-300), points)
    wrapped = np.where(robot.continuous & (wrapped >= period), 0.0, wrapped)
    return wrapped, period


def _spatial_order(points: np.ndarray) -> np.ndarray:
    """Return an order in which near nodes have near numbers (leaves of a k-d tree)."""
    from scipy.spatial import cKDTree

    return cKDTree(points, leafsize=4).indices


def _near_pairs(
    robot: Robot,
    nodes: np.ndarray,
    weights: np.ndarray,
    settings: RoadmapSettings,
    workers: Workers,
) -> np.ndarray:
    k = min(settings.neighbors + 1, len(nodes))
    near = near_nodes(NearSpec(*_wrapped(robot, nodes * weights, weights), k), workers)
    a = np.repeat(np.arange(len(nodes)), k - 1)
    # a node is its own nearest one, but for twins: drop it by its number
    others = near != np.arange(len(nodes))[:, None]
    others[others.all(axis=1), -1] = False
    pairs = np.sort(np.stack([a, near[others]], axis=1), axis=1)
    pairs = np.unique(pairs, axis=0)
    if settings.max_step is not None:
        dq = difference(robot, nodes[pairs[:, 0]], nodes[pairs[:, 1]])
        pairs = pairs[np.abs(dq).max(axis=1) <= settings.max_step]
    return pairs


def _largest_component(
    nodes: np.ndarray, edges: np.ndarray, lengths: np.ndarray, weights: np.ndarray
) -> tuple[Roadmap, tuple[int, ...]]:
    from scipy.sparse.csgraph import connected_components

    raw = Roadmap(nodes, edges, lengths, weights, np.zeros((len(nodes), 0)))
    _, label = connected_components(raw.to_sparse(), directed=False)
    sizes = np.bincount(label)
    keep = label == np.argmax(sizes)
    number = np.cumsum(keep) - 1
    inside = keep[edges[:, 0]]
    edges, lengths = number[edges[inside]], lengths[inside]
    part = Roadmap(nodes[keep], edges, lengths, weights, np.zeros((keep.sum(), 0)))
    landmarks = choose_landmarks(part.to_sparse(), N_LANDMARKS)
    whole = Roadmap(part.nodes, part.edges, part.lengths, weights, landmarks)
    return whole, tuple(sorted(sizes.tolist(), reverse=True))
