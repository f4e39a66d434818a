"""A planner's arrays, laid out once: nothing in a frame allocates after that."""

from typing import NoReturn

import numpy as np

from odm._groups import block_type, check, declared, named_in, new
from odm.cell_map.cell_map import CellLists, CellMap
from odm.checks import MAX_GOALS
from odm.close_test._arm import Arm, make_work
from odm.obstacles.grid import WorkspaceGrid
from odm.owner import Owner, refuse_copy
from odm.search import _invalidation as invalidation
from odm.search._items import sign_items
from odm.search._state import (
    KINDS,
    LOST,
    PIECES,
    SHOWN,
    Certificates,
    Direct,
    Graph,
    Groups,
    Pool,
    Reach,
    RobotState,
    Stats,
    Terms,
    first_word,
    words_of,
)
from roadmap.errors import BadInput
from roadmap.graph.roadmap import Roadmap
from roadmap.kinematics._forward import body_frames
from roadmap.kinematics.forward import motion_per_joint

MAX_ATTACHMENTS = 48
# [m] a robot whose joints slide may be so much beside its limits and reach farther
BEYOND_LIMITS = 0.01
# lengths of arrays by the names in `odm/search/_state.py`; shortcuts: a power of two
_SIZES = {
    "goals": MAX_GOALS,
    "joins": MAX_ATTACHMENTS,
    "corners": 64,
    "items": 8192,
    "item_entries": 1_000_000,
    "shortcuts": 8192,
    "earlier": 8,
    "proof": 16384,
    "branches": 2048,
    "route": 256,
    "found": 4,
    "shapes": 32,
    "faces": 256,
    "patterns": 2048,
    "samples": 1024,
    "slacks": 24,
    "chords": 64,
    "snapshots": 48,
    "slack_shapes": 24,
    "places_kept": 16,
    "seen": 1,  # before there is a frame
}


class Memory(Groups):
    """The named groups of a planner, and the table that points at their arrays.

    No name can be bound to something else, since the table would not follow.

    Attributes:
        table: What the compiled frame takes.
        owner: The thread that may use it.
        counted: (12,) the numbers of `stats`, as one; quicker to copy than an array.
        sizes: How long each axis is, by its name.
    """

    table: np.ndarray
    owner: Owner
    counted: memoryview
    sizes: dict[str, int]

    def __init__(self, groups: dict[str, tuple]) -> None:
        """Keep the groups and write the table; it belongs to this thread."""
        object.__setattr__(self, "owner", Owner())
        object.__setattr__(self, "counted", groups["stats"].popped.base.data)
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

    def arrays(self, *lives: str) -> dict[str, np.ndarray]:
        """Return the arrays that live so long (LIFE, GOAL, FRAME), as "group.name"."""
        return {
            f"{name}.{key}": getattr(getattr(self, name), key)
            for name, kind in KINDS.items()
            for key, field in declared(kind).items()
            if field.life in lives and field.axes
        }


def exchange(memory: Memory, groups: dict[str, tuple]) -> None:
    """Let a planner's table point at other groups, by name; the others stay.

    For a payload and for larger clouds. No axis of the groups that stay may change.
    """
    stay = [name for name in KINDS if name not in groups]
    axes = set().union(*(named_in(KINDS[name]) for name in stay))
    begun = bool(stay)
    known = memory.sizes if begun else {}
    kept = {axis: n for axis, n in known.items() if axis in axes}
    block = (groups if "pool" in groups else vars(memory))["pool"].block.dtype
    sizes = check({name: (KINDS[name], groups[name]) for name in groups}, block, kept)
    table = memory.table.copy() if begun else _new_table(block)
    for name, group in groups.items():
        if not (begun and name in SHOWN):  # arrays that are not the memory's own stay
            _write(table, name, group)
    for name, value in {**groups, "table": table, "sizes": sizes}.items():
        object.__setattr__(memory, name, value)


def _write(table: np.ndarray, name: str, group: tuple) -> None:
    """Write where a group's arrays are into the table; it must have been checked.

    The words are what numba knows of each array, in numba's order, so that a group lies
    there as compiled loops hand it on; or the bits of a single float.
    """
    words: list[int] = []
    for value in group:
        if isinstance(value, float):
            words.append(int(np.float64(value).view(np.int64)))
            continue
        at = value.__array_interface__["data"][0]  # fast
        words += (0, 0, value.size, value.itemsize, at, *value.shape, *value.strides)
    first = first_word(name)
    table.view(np.int64)[first : first + len(words)] = words


def _new_table(block: np.dtype) -> np.ndarray:
    """Return a table in which no group was written yet."""
    whole = sum(words_of(kind) for kind in KINDS.values())
    return np.zeros(whole, np.uint64 if block == np.uint32 else np.int64)


def lay_out(cell_map: CellMap, point_capacity: int) -> Memory:
    """Return all arrays for a planner on this map, for so many points at first."""
    robot, roadmap, arm = cell_map.robot, cell_map.roadmap, cell_map.arm
    n, m, dof = roadmap.n_nodes, roadmap.n_edges, robot.dof
    cells, grid, safety = cell_map.arm_cells, cell_map.grid, cell_map.safety
    joins, goals = _SIZES["joins"], _SIZES["goals"]
    sizes = {**_SIZES, "n": n, "m": m, "dof": dof, "spheres": len(arm.spheres)}
    sizes["bodies"] = len(robot.tree_i)
    # of the bodies but the base, which processors take by eight
    sizes["lanes"] = -(-(sizes["bodies"] - 1) // 8) * 8
    sizes["places"] = sizes["slacks"] * (sizes["chords"] + 1)
    sizes["spares"] = sizes["chords"] + PIECES
    sizes["heap"] = 2 * m + joins + goals * (joins + 1)
    sizes["blocks"] = cells.n_blocks
    graph, direct = graph_on(roadmap, cells, regions(cell_map))
    robot_state = new(
        RobotState,
        sizes,
        radii=cell_map.swept_radii(),
        motion_bound=center_motion_bounds(arm, dof),
        weights=roadmap.weights,
        continuous=robot.continuous,
        lower=robot.lower,
        upper=robot.upper,
    )
    terms = new(Terms, sizes)
    terms.tolerance[0] = cell_map.motion_tolerance
    # a robot off its path by no more than this follows it. That spends nothing of m:
    # from there its first leg is tested with all of m, which the executor then spends
    terms.path_tolerance[0] = safety.tracking + safety.blending
    block = np.zeros(sizes["item_entries"], block_type(cells.n_blocks))
    bounds = point_motion_bounds(arm, dof)
    groups = {
        "arm": arm,
        "work": make_work(arm, dof),
        "cloud": grid.new_cloud(point_capacity),
        "picked": grid.new_cloud(point_capacity),
        "reached": grid.new_cloud(point_capacity),
        "reach": reach_on(arm, grid),
        "graph": graph,
        "direct": direct,
        "pool": new(Pool, sizes, block=block),
        "certificates": new(Certificates, sizes, motion_bound=bounds),
        "candidate_certificates": new(Certificates, sizes, motion_bound=bounds.copy()),
        "robot_state": robot_state,
        "terms": terms,
        # rows of one array, which is read at once
        "stats": Stats(*np.zeros((len(Stats._fields), 1), np.int64)),
    }
    rest = {name: new(KINDS[name], sizes) for name in KINDS if name not in groups}
    return Memory({**groups, **rest})


def graph_on(
    roadmap: Roadmap, cells: CellLists, region: np.ndarray
) -> tuple[Graph, Direct]:
    """Return the roadmap with its cell lists, and their block-major view."""
    n, m, by_block = roadmap.n_nodes, roadmap.n_edges, cells.by_block
    sizes = {
        "n": n,
        "m": m,
        "blocks": cells.n_blocks,
        "bits": (n + m) // 64 + 1,
        "longest_list": int(np.diff(by_block.t_ptr).max(initial=0)) + 1,
    }
    item = by_block.t_item.view(np.int32)
    direct = new(Direct, sizes, ptr=by_block.t_ptr, item=item, mask=by_block.t_mask)
    signature = np.zeros(4 * (n + m), np.uint64)
    sign_items(cells.start, cells.step, region, signature)
    graph = new(
        Graph,
        sizes,
        adj_ptr=roadmap.adj_ptr,
        adj_node=roadmap.adj_node,
        adj_edge=roadmap.adj_edge,
        adj_length=roadmap.adj_length,
        edges=roadmap.edges,
        nodes=roadmap.nodes,
        **cells.arrays(),
        region=region,
        signature=signature,
        hit_bits=direct.bits,
    )
    return graph, direct


def regions(cell_map: CellMap) -> np.ndarray:
    """Return the signature bit (n_blocks,) of each block, 0 to 255."""
    nx, ny, nz = (int(v) for v in cell_map.grid.blocks)
    at = np.indices((nx, ny, nz)) // 2
    coarse = (at[0] * ny + at[1]) * nz + at[2]
    swept = np.diff(cell_map.arm_cells.by_block.t_ptr) > 0
    used = np.unique(coarse.ravel()[swept])
    return (np.searchsorted(used, coarse.ravel()) % 256).astype(np.int32)


def center_motion_bounds(arm: Arm, dof: int) -> np.ndarray:
    """Return (dof,) how far a joint moves any sphere centre at most, per rad or m."""
    return motion_per_joint(arm.tree_i, arm.tree_f, arm.reach, dof)


def point_motion_bounds(arm: Arm, dof: int) -> np.ndarray:
    """Return (dof,) how far a joint moves any point of any sphere, per rad or m.

    A joint whose axis goes through all its spheres' centres moves none of these, but
    turns what the spheres cover.
    """
    turning = arm.tree_i[:, 2] == 1
    reach = arm.reach + arm.spheres[:, 3:] * turning
    return center_motion_bounds(arm._replace(reach=reach), dof)


def reach_on(arm: Arm, grid: WorkspaceGrid) -> Reach:
    """Return how far the blocks of a grid are from the axis that the robot turns about.

    It is that of the first joint, if that turns and all that has spheres turns with it.
    """
    n, parents = len(arm.tree_i), arm.tree_i[:, 0]
    away = np.zeros(grid.n_blocks)
    turning = [b for b in range(1, n) if arm.tree_i[b, 2] == 1 and parents[b] == 0]
    if arm.tree_i[0, 2] != 0 or len(turning) != 1:
        return Reach(np.array([-1]), away)
    b = turning[0]
    with_it = np.zeros(n, np.bool_)
    with_it[b] = True
    for k in range(b + 1, n):
        with_it[k] = with_it[parents[k]]
    if not with_it[arm.body].all():
        return Reach(np.array([-1]), away)
    frames = np.empty((n, 12))
    body_frames(arm.tree_i, arm.tree_f, np.zeros(1 + arm.tree_i[:, 1].max()), frames)
    along = frames[b, :9].reshape(3, 3) @ arm.tree_f[b, 12:15]
    along /= np.linalg.norm(along)
    side = 4.0 * grid.h
    middle = grid.origin + side * (0.5 + np.indices(grid.blocks).reshape(3, -1).T)
    beside = middle - frames[b, 9:]
    beside -= (beside @ along)[:, None] * along
    far = np.linalg.norm(beside, axis=1)
    # a plane across the way from the axis to the middle has the whole block behind it
    lean = np.abs(beside).sum(axis=1) / np.maximum(far, 1e-9)
    away[:] = far - 0.5 * side * lean - BEYOND_LIMITS
    return Reach(np.array([b]), away)


class DirectMap:
    """Counts of occupied blocks per item, kept up to date by what changed."""

    def __init__(self, memory: Memory, n_nodes: int, n_edges: int) -> None:
        self.memory = memory
        self.n_nodes, self.n_edges = n_nodes, n_edges
        self.nodes_out = np.zeros(n_nodes, np.int64)
        self.edges_out = np.zeros(n_edges, np.int64)

    def clear(self) -> None:
        """Forget what was occupied: the next answer comes from scratch."""
        self.memory.owner.check()
        counted = self.memory.direct
        for array in (counted.hits, counted.seen, counted.bits):
            array[:] = 0
        counted.listed[-1] = 0
        counted.frame[0] = LOST

    def nodes(self) -> np.ndarray:
        """Return the ids of the invalid nodes, ascending: a view of own memory."""
        return self._list(0, self.nodes_out)

    def edges(self) -> np.ndarray:
        """Return the ids of the invalid edges, ascending: a view of own memory."""
        return self._list(self.n_nodes, self.edges_out)

    def _list(self, first: int, out: np.ndarray) -> np.ndarray:
        self.memory.owner.check()
        invalidation.refresh(self.memory.table)
        bits = self.memory.direct.bits
        return out[: invalidation.list_bits(bits, first, len(out), out)]
