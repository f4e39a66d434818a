"""Lay out a planner's arrays, once; nothing in a frame allocates after that."""

from typing import NoReturn

import numpy as np

from odm.cell_map.cell_map import CellLists, CellMap
from odm.close_test._arm import Arm, Work, make_work
from odm.obstacles._cloud import Cloud
from odm.owner import Owner, refuse_copy
from odm.search import _signature as signature
from odm.search import _state as layout
from odm.search import _types as kinds
from roadmap.errors import BadInput
from roadmap.graph.roadmap import Roadmap

MAX_GOALS = 32
MAX_ATTACHMENTS = 48
WAY_LENGTH = 64
POOL_ITEMS = 8192
POOL_ENTRIES = 1_000_000
SHORTCUTS = 8192  # a power of two
PAST_WAYS = 8  # remembered to bound a long search


class Memory:
    """The named arrays of a planner, and the table that points at them.

    No name can be bound to something else, since the table would not follow.

    Attributes:
        table: What the compiled frame takes.
        owner: The thread that may use it.
        arm, cloud, work, graph, pool, goals, search, direct, short, fresh, along, way,
        spare, own, pick, past, proof, beside: The groups; see `odm/search/_types.py`.
    """

    table: np.ndarray
    owner: Owner
    arm: Arm
    cloud: Cloud
    work: Work
    graph: kinds.Graph
    pool: kinds.Pool
    goals: kinds.Goals
    search: kinds.Search
    direct: kinds.Direct
    short: kinds.Shortcuts
    fresh: kinds.Starts
    along: kinds.Starts
    way: kinds.Way
    spare: kinds.Way
    own: kinds.Own
    pick: Cloud
    past: kinds.Past
    proof: kinds.Proof
    beside: kinds.Beside

    def __init__(self, groups: dict[str, tuple]) -> None:
        """Keep the groups and write the table; it belongs to this thread."""
        object.__setattr__(self, "owner", Owner())
        exchange(self, groups)

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse: the table points at the arrays that are there."""
        raise BadInput(
            f"{name} of a planner's memory cannot be replaced, since the table points "
            "at the arrays that are there; write into the array, or make another "
            "planner"
        )

    def __reduce_ex__(self, protocol: object) -> NoReturn:
        """Refuse to be copied or pickled: the table holds addresses."""
        refuse_copy()


def exchange(memory: Memory, groups: dict[str, tuple]) -> None:
    """Let a planner's table point at other groups, by name; the others stay.

    For what carries and what makes room; it costs a walk over all arrays.
    """
    named = {n: groups[n] if n in groups else getattr(memory, n) for n in _ORDER}
    rows = [
        array
        for group in named.values()
        for array in group
        if isinstance(array, np.ndarray)
    ]
    table = _table_of(rows, named["graph"].block.dtype)
    # what the table points at lives as long as it
    for name, value in {**groups, "table": table, "_rows": rows}.items():
        object.__setattr__(memory, name, value)


def _table_of(rows: list[np.ndarray], block_type: np.dtype) -> np.ndarray:
    """Return addresses and shapes of arrays; see `odm/search/_state.py`."""
    if len(rows) != layout.ROWS:
        raise AssertionError(f"{len(rows)} arrays for {layout.ROWS} rows")
    wide = block_type == np.uint32
    table = np.zeros((len(rows), 4), np.uint64 if wide else np.int64)
    for k, array in enumerate(rows):
        if not array.flags.c_contiguous:
            raise AssertionError(f"row {k} is not contiguous")
        table[k, 0] = array.__array_interface__["data"][0]  # fast
        table[k, 1 : 1 + array.ndim] = array.shape
    return table


_ORDER = (
    "arm",
    "cloud",
    "work",
    "graph",
    "pool",
    "goals",
    "search",
    "direct",
    "short",
    "fresh",
    "along",
    "way",
    "spare",
    "own",
    "pick",
    "past",
    "proof",
    "beside",
)


def lay_out(cell_map: CellMap, max_points: int) -> Memory:
    """Return all arrays for a planner on this map, for up to `max_points` points."""
    robot, roadmap, arm = cell_map.robot, cell_map.roadmap, cell_map.arm
    n, m, dof = roadmap.n_nodes, roadmap.n_edges, robot.dof
    cells = cell_map.arm_cells
    graph, direct = graph_on(roadmap, cells, regions(cell_map))
    pool = kinds.Pool(
        np.zeros(POOL_ITEMS, np.int64),
        np.zeros(POOL_ITEMS, np.int64),
        np.zeros(POOL_ENTRIES, cells.block.dtype),
        np.zeros(POOL_ENTRIES, np.uint64),
        np.zeros(4 * POOL_ITEMS, np.uint64),
        np.zeros(2, np.int64),
    )
    short = kinds.Shortcuts(
        np.full(SHORTCUTS, -1, np.int64),
        np.zeros(SHORTCUTS, np.int64),
        np.zeros(1, np.int64),
        np.zeros(WAY_LENGTH),
        np.zeros(2 * WAY_LENGTH + 2, np.int64),
        np.zeros(WAY_LENGTH, np.int64),
    )
    safety = cell_map.safety
    # a robot so far beside its path is on its way. That spends nothing of m: from
    # there its first leg is tested with all of m, which the executor then spends
    share = safety.tracking + safety.blending
    terms = np.array([cell_map.motion_tolerance, safety.h, share, 0.0])
    own = kinds.Own(
        cell_map.swept_radii(),
        terms,
        joint_sway(arm, dof),
        roadmap.weights,
        robot.continuous,
        np.zeros(n),
        np.zeros(12, np.int64),
        np.zeros(dof),
        np.zeros(dof),
        np.zeros(dof),
        np.full(dof, np.nan),
        np.full(dof, np.nan),
        robot.lower,
        robot.upper,
        np.zeros(2),
    )
    return Memory(
        {
            "arm": arm,
            "cloud": cell_map.grid.new_cloud(max_points),
            "work": make_work(len(arm.spheres), len(robot.tree_i), dof),
            "graph": graph,
            "pool": pool,
            "goals": _goals(n, dof),
            "search": _search(n, m),
            "direct": direct,
            "short": short,
            "fresh": _starts(),
            "along": _starts(),
            "way": new_way(dof),
            "spare": new_way(dof),
            "own": own,
            "pick": cell_map.grid.new_cloud(max_points),
            "past": _past(),
            "proof": kinds.Proof(
                np.zeros((WAY_LENGTH, dof)),
                np.zeros((WAY_LENGTH, dof)),
                point_motion(arm, dof),
            ),
            "beside": kinds.Beside(np.full((3, dof), np.nan), np.zeros(2, np.int64)),
        }
    )


def graph_on(
    roadmap: Roadmap, cells: CellLists, region: np.ndarray
) -> tuple[kinds.Graph, kinds.Direct]:
    """Return the roadmap with its cell lists, and their block-major view."""
    n_items = roadmap.n_nodes + roadmap.n_edges
    direct = _direct(cells, n_items)
    sign = np.zeros(4 * n_items, np.uint64)
    signature.sign_items(cells.ptr, cells.block, region, sign)
    graph = kinds.Graph(
        roadmap.adj_ptr,
        roadmap.adj_node,
        roadmap.adj_edge,
        roadmap.adj_length,
        roadmap.edges,
        roadmap.nodes,
        cells.ptr,
        cells.block,
        cells.mask,
        np.zeros(n_items, np.bool_),
        region,
        sign,
        direct.bits,
    )
    return graph, direct


def regions(cell_map: CellMap) -> np.ndarray:
    """Return the signature bit (n_blocks,) of each block, 0 to 255."""
    nx, ny, nz = (int(v) for v in cell_map.grid.blocks)
    at = np.indices((nx, ny, nz)) // 2
    coarse = (at[0] * ny + at[1]) * nz + at[2]
    used = np.unique(coarse.ravel()[np.unique(cell_map.arm_cells.block)])
    return (np.searchsorted(used, coarse.ravel()) % 256).astype(np.int32)


def _direct(cells: CellLists, n_items: int) -> kinds.Direct:
    n_blocks = len(cells.t_ptr) - 1
    longest = int(np.diff(cells.t_ptr).max(initial=0))
    return kinds.Direct(
        cells.t_ptr,
        cells.t_item.view(np.int32),
        cells.t_mask,
        np.zeros(n_blocks, np.uint64),
        np.zeros(n_items, np.int32),
        np.zeros(n_blocks + 1, np.int32),
        np.zeros(n_items // 64 + 1, np.uint64),
        np.zeros(longest + 1, np.int32),
        np.full(1, -100, np.int64),
    )


def joint_sway(arm: Arm, dof: int) -> np.ndarray:
    """Return (dof,) how far a joint moves any sphere, per rad or m, at most."""
    sway = np.zeros(dof)
    for joint in range(dof):
        bodies = arm.tree_i[:, 1] == joint
        factor = np.abs(arm.tree_f[bodies, 15])
        sway[joint] = (arm.reach[:, bodies] * factor).sum(axis=1).max(initial=0.0)
    return sway


def point_motion(arm: Arm, dof: int) -> np.ndarray:
    """Return (dof,) how far a joint moves any point of any sphere, per rad or m.

    A joint whose axis goes through all its spheres' centres moves none of these, but
    turns what the spheres cover.
    """
    turning = arm.tree_i[:, 2] == 1
    reach = arm.reach + arm.spheres[:, 3:] * turning
    return joint_sway(arm._replace(reach=reach), dof)


def new_way(dof: int) -> kinds.Way:
    """Return an empty way."""
    return kinds.Way(
        np.zeros(WAY_LENGTH, np.int64),
        np.zeros(WAY_LENGTH, np.int64),
        np.zeros((WAY_LENGTH, dof)),
        np.zeros(2, np.int64),
    )


def _past() -> kinds.Past:
    k = PAST_WAYS
    return kinds.Past(
        np.full(k, -1, np.int64),
        np.zeros((k, WAY_LENGTH), np.int32),
        np.zeros((k, WAY_LENGTH), np.int32),
        np.zeros((k, WAY_LENGTH)),
        np.zeros(k + 2, np.int64),
    )


def _starts() -> kinds.Starts:
    k = MAX_ATTACHMENTS
    return kinds.Starts(
        np.zeros(k, np.int64),
        np.zeros(k),
        np.zeros(k, np.int64),
        np.zeros(k, np.int64),
        np.zeros(k, np.int64),
        np.full(k, -1.0),
        np.zeros(2, np.int64),
    )


def _goals(n: int, dof: int) -> kinds.Goals:
    g, k = MAX_GOALS, MAX_ATTACHMENTS
    return kinds.Goals(
        np.zeros((g, dof)),
        np.zeros(g),
        np.full((g, n), np.inf),
        np.full((g, n), -1, np.int32),
        np.zeros((g, k), np.int64),
        np.zeros((g, k)),
        np.zeros((g, k), np.int64),
        np.zeros((g, k), np.int64),
        np.full((g, k), -1.0),
        np.zeros(g, np.int64),
        np.zeros(g, np.int64),
        np.full(g, kinds.NO_WAY, np.int64),
        np.zeros(g),
        np.full(g, kinds.NO_WAY, np.int64),
        np.zeros(g, np.int64),
        np.full(g, -1.0),
        np.zeros(3, np.int64),
    )


def _search(n: int, m: int) -> kinds.Search:
    room = 2 * m + MAX_ATTACHMENTS + MAX_GOALS * (MAX_ATTACHMENTS + 1)
    return kinds.Search(
        np.full(n + m, -1, np.int64),
        np.zeros(n + MAX_GOALS, np.int64),
        np.zeros(n, np.int64),
        np.zeros(n, np.int64),
        np.zeros(n, np.int64),
        np.zeros(n),
        np.zeros(room, np.int32),
        np.zeros(room, np.int32),
        np.zeros(room, np.int32),
        np.zeros(room),
        np.zeros(room),
        np.zeros(room, np.int32),
        np.zeros(4, np.uint64),
        np.zeros(8, np.int64),
    )
