"""The planner's state, declared once: groups of arrays, and a table of addresses.

Handing a hundred arrays to a compiled function costs 5 us a call, and taking them out
of a numba struct as much again, in counted references. So compiled loops take one
argument: a table with address and shape of every array. `view(state, "goals")` makes
the arrays of a group from it, without a count. `odm.search.state.Memory` owns the
arrays, so they live as long as the planner.

The type of the table tells the type of the block ids: int64 for uint16, uint64 for
uint32 (grids of more than 65535 blocks).
"""

from typing import NamedTuple

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import get_itemsize, make_array, populate_array
from numba.np.numpy_support import from_dtype

from odm._groups import BLOCK, FRAME, GOAL, array, declared
from odm.close_test._arm import Arm, Work
from odm.obstacles._cloud import Cloud
from odm.obstacles._solid_samples import Patterns
from odm.obstacles._solids import Solids

NO_ITEM, IS_GOAL, NO_WAY = -1, -3, -4  # instead of a pool item
TO_END, TO_BEGIN = 0, 1  # entries of Beside.free
EDGE_BASE = -1024  # ref EDGE_BASE - e is roadmap edge e; below every -2 - attachment
LOST = -100  # number of a frame that is long over


class Graph(NamedTuple):
    """The roadmap's neighbours and what never changes about its items."""

    adj_ptr: np.ndarray = array("i8", "n+1")
    adj_node: np.ndarray = array("i4", "2*m")
    adj_edge: np.ndarray = array("i4", "2*m")
    adj_length: np.ndarray = array("f8", "2*m")
    edges: np.ndarray = array("i4", "m 2")
    nodes: np.ndarray = array("f8", "n dof")
    ptr: np.ndarray = array("i8", "n+m+1")  # cell lists of nodes, then edges
    block: np.ndarray = array(BLOCK, "entries")
    mask: np.ndarray = array("u8", "entries")
    closed: np.ndarray = array("b1", "n+m")  # True: blocked by scenery for good
    # bit of a block in signatures, 0 to 255
    region: np.ndarray = array("i4", "blocks")
    # signature of an item: regions of its blocks
    sign: np.ndarray = array("u8", "4*n+4*m")
    # the bits of Direct, once a frame made use of them
    taken: np.ndarray = array("u8", "bits", GOAL)


class Pool(NamedTuple):
    """Cell lists of motions that are not roadmap edges."""

    begin: np.ndarray = array("i8", "items", GOAL)  # first entry of an item
    end: np.ndarray = array("i8", "items", GOAL)
    block: np.ndarray = array(BLOCK, "item_entries", GOAL)
    mask: np.ndarray = array("u8", "item_entries", GOAL)
    sign: np.ndarray = array("u8", "4*items", GOAL)  # signature of an item
    used: np.ndarray = array("i8", "2", GOAL)  # items, entries


class Direct(NamedTuple):
    """The block-major view and what it counts; see `_invalidation.py`."""

    ptr: np.ndarray = array("i8", "blocks+1")  # items of a block
    item: np.ndarray = array("i4", "entries")
    mask: np.ndarray = array("u8", "entries")
    # words that the counts stand for
    seen: np.ndarray = array("u8", "blocks", GOAL)
    # occupied blocks of an item; an edge's end nodes too
    hits: np.ndarray = array("i4", "n+m", GOAL)
    # blocks with seen cells, their number last
    listed: np.ndarray = array("i4", "blocks+1", GOAL)
    # one bit for each item: its count is not 0
    bits: np.ndarray = array("u8", "bits", GOAL)
    turned: np.ndarray = array("i4", "longest_list", FRAME)
    # frame that the counts stand for
    frame: np.ndarray = array("i8", "1", GOAL, LOST)


class Starts(NamedTuple):
    """Motions from the present configuration to nodes."""

    node: np.ndarray = array("i8", "joins", GOAL)
    length: np.ndarray = array("f8", "joins", GOAL)
    # >= 0 pool item, -1 none, <= EDGE_BASE part of a roadmap edge
    ref: np.ndarray = array("i8", "joins", GOAL)
    # 0 not tested, 1 free, 2 not free of what stands still
    static: np.ndarray = array("i8", "joins", GOAL)
    memo: np.ndarray = array("i8", "joins", FRAME)  # 4 * frame + verdict of the frame
    # share of the motion where it was blocked last, or -1
    stuck: np.ndarray = array("f8", "joins", GOAL, -1)
    count: np.ndarray = array("i8", "2", GOAL)  # number, next to be tested


class Goals(NamedTuple):
    """Motions from nodes to goals, goal by goal."""

    q: np.ndarray = array("f8", "goals dof", GOAL)
    cost: np.ndarray = array("f8", "goals", GOAL)
    h: np.ndarray = array("f8", "goals n", GOAL, np.inf)  # cost to go
    at: np.ndarray = array("i4", "goals n", GOAL, -1)  # attachment of a node, or -1
    node: np.ndarray = array("i8", "goals joins", GOAL)
    length: np.ndarray = array("f8", "goals joins", GOAL)
    # >= 0 pool item, IS_GOAL the node is the goal
    ref: np.ndarray = array("i8", "goals joins", GOAL)
    memo: np.ndarray = array("i8", "goals joins", FRAME)
    stuck: np.ndarray = array("f8", "goals joins", GOAL, -1)  # as in Starts
    number: np.ndarray = array("i8", "goals", GOAL)  # attachments
    # unique number of the goal as a vertex
    vertex: np.ndarray = array("i8", "goals", GOAL)
    # >= 0 pool item of start -> goal, NO_ITEM or NO_WAY
    direct_ref: np.ndarray = array("i8", "goals", FRAME, NO_WAY)
    direct_length: np.ndarray = array("f8", "goals", FRAME)
    # direct_ref at the attached configuration
    fresh_ref: np.ndarray = array("i8", "goals", GOAL, NO_WAY)
    direct_memo: np.ndarray = array("i8", "goals", FRAME)
    # t at which it was blocked last, or -1
    direct_stuck: np.ndarray = array("f8", "goals", GOAL, -1)
    # goals, vertex of the attached start, of a start on the way
    count: np.ndarray = array("i8", "3", GOAL)


class Search(NamedTuple):
    """Scratch of the search."""

    # 2 * frame + hit of a roadmap item
    memo: np.ndarray = array("i8", "n+m", FRAME, -1)
    # run in which a vertex was closed
    done: np.ndarray = array("i8", "n+goals", FRAME)
    # run in which the goal's side reached a node
    flood: np.ndarray = array("i8", "n", FRAME)
    queue: np.ndarray = array("i8", "n", FRAME)
    # run in which a node was reached by what is free, and the least length there
    near_run: np.ndarray = array("i8", "n", FRAME)
    near_g: np.ndarray = array("f8", "n", FRAME)
    e_node: np.ndarray = array("i4", "heap", FRAME)
    e_ref: np.ndarray = array("i4", "heap", FRAME)
    e_from: np.ndarray = array("i4", "heap", FRAME)  # entry of the parent, -1 start
    e_g: np.ndarray = array("f8", "heap", FRAME)
    heap_f: np.ndarray = array("f8", "heap", FRAME)
    heap_e: np.ndarray = array("i4", "heap", FRAME)
    made: np.ndarray = array("i8", "1", FRAME)  # entries, and those on the heap
    waiting: np.ndarray = array("i8", "1", FRAME)
    head: np.ndarray = array("i8", "1", FRAME)  # of the flood's queue, and its tail
    tail: np.ndarray = array("i8", "1", FRAME)
    sign: np.ndarray = array("u8", "4", FRAME)  # of the frame's occupied blocks


class Stats(NamedTuple):
    """What the searches of a frame did."""

    popped: np.ndarray = array("i8", "1", FRAME)  # vertices closed
    edge_tests: np.ndarray = array("i8", "1", FRAME)  # lists looked at
    flooded: np.ndarray = array("i8", "1", FRAME)  # nodes of the goal's side
    close: np.ndarray = array("i8", "1", FRAME)  # close tests
    runs: np.ndarray = array("i8", "1", FRAME)
    counted: np.ndarray = array("i8", "1", FRAME)  # 1: the direct map decides


class Past(NamedTuple):
    """Ways that long searches found lately; see `_bound.py`."""

    vertex: np.ndarray = array("i8", "past", GOAL, -1)  # of the goal, -1 none
    node: np.ndarray = array("i4", "past corners", GOAL)  # from the goal's side
    # attachment of the goal, then edge to the node before, and the length of that
    via: np.ndarray = array("i4", "past corners", GOAL)
    length: np.ndarray = array("f8", "past corners", GOAL)
    # nodes of each; next to be replaced; found last
    count: np.ndarray = array("i8", "past+2", GOAL)


class Way(NamedTuple):
    """A path as vertices and the items between them; see Proof, too."""

    # node, or unique number of start or goal
    vertex: np.ndarray = array("i8", "corners", GOAL)
    ref: np.ndarray = array("i8", "corners", GOAL)  # item from vertex k to k + 1
    q: np.ndarray = array("f8", "corners dof", GOAL)
    count: np.ndarray = array("i8", "2", GOAL)  # vertices, goal index


class Proof(NamedTuple):
    """The motions that were tested for the segments of a path.

    Segment k leads from q[k] to q[k + 1] of the path. It is all or a part of the motion
    from begin[k] to end[k], to which the cells of its item belong.
    """

    begin: np.ndarray = array("f8", "corners dof", GOAL)
    end: np.ndarray = array("f8", "corners dof", GOAL)
    # most that joint j moves any point per unit [m]
    motion: np.ndarray = array("f8", "dof")


class Beside(NamedTuple):
    """What is known of a robot beside its segment."""

    # where it is; the segment's end; its begin
    q: np.ndarray = array("f8", "3 dof", GOAL, np.nan)
    # 1: free of what stands still, to the end, to the begin
    free: np.ndarray = array("i8", "2", GOAL)


class Shortcuts(NamedTuple):
    """Motions between vertices that were tested once and are remembered."""

    # from << 31 | to, -1 empty; the size is a power of 2
    key: np.ndarray = array("i8", "shortcuts", GOAL, -1)
    item: np.ndarray = array("i8", "shortcuts", GOAL)  # pool item, or NO_WAY
    count: np.ndarray = array("i8", "1", GOAL)
    best: np.ndarray = array("f8", "corners", FRAME)
    back: np.ndarray = array("i8", "2*corners+2", FRAME)
    ref: np.ndarray = array("i8", "corners", FRAME)


class Trees(NamedTuple):
    """Tested motions from the start, and from the goals; see `_connect.py`."""

    q: np.ndarray = array("f8", "2 branches dof", GOAL)
    parent: np.ndarray = array("i4", "2 branches", GOAL)
    # frame in which the motion from the parent was found free
    seen: np.ndarray = array("i8", "2 branches", GOAL)
    count: np.ndarray = array("i8", "2", GOAL)
    drawn: np.ndarray = array("i8", "1", GOAL)  # samples
    sample: np.ndarray = array("f8", "dof", FRAME)
    ends: np.ndarray = array("f8", "2 dof", FRAME)  # of a motion that is tried
    dq: np.ndarray = array("f8", "dof", FRAME)
    moved: np.ndarray = array("i4", "branches", FRAME)  # where branches went
    route: np.ndarray = array("f8", "route dof", FRAME)  # the path that was found
    until: np.ndarray = array("f8", "route", FRAME)  # its length up to a corner
    # corners of it; goal that it leads to; 1: the last branch came to its end
    corners: np.ndarray = array("i8", "1", FRAME)
    goal: np.ndarray = array("i8", "1", FRAME)
    reached: np.ndarray = array("i8", "1", FRAME)
    # tests against what stands still; branches looked at
    static: np.ndarray = array("i8", "1", FRAME)
    looked: np.ndarray = array("i8", "1", FRAME)
    tests: np.ndarray = array("i8", "1", FRAME)  # evaluations when they began


class Found(NamedTuple):
    """Paths that the trees made, each a `Way`."""

    vertex: np.ndarray = array("i8", "found corners", GOAL)
    ref: np.ndarray = array("i8", "found corners", GOAL, NO_ITEM)
    q: np.ndarray = array("f8", "found corners dof", GOAL)
    count: np.ndarray = array("i8", "found", GOAL)  # corners of each, 0 none
    next: np.ndarray = array("i8", "1", GOAL)  # that is replaced


class Terms(NamedTuple):
    """Lengths that the tests keep [m]."""

    tolerance: np.ndarray = array("f8")  # mu / 2: inflation of a piece of a motion
    beside: np.ndarray = array("f8")  # share of tracking and blending
    extra: np.ndarray = array("f8")  # clearance beyond the map's


class Numbers(NamedTuple):
    """Single numbers of the frame and of what is decided in it."""

    frame: np.ndarray = array("i8", "1", GOAL)  # sets of points taken
    step: np.ndarray = array("i8", "1", GOAL)  # steps of the planner
    run: np.ndarray = array("i8", "1", GOAL)  # searches begun
    joint_costs: np.ndarray = array("i8", "1", GOAL)  # 1: goals compete by their costs
    segment: np.ndarray = array("i8", "1", GOAL)  # of the answer's way that q is on
    same: np.ndarray = array("i8", "1", FRAME)  # 1: the way found is the one in use
    joint: np.ndarray = array("i8", "1", FRAME)  # that is out of its limits
    look: np.ndarray = array("i8", "1", GOAL)  # 1: look for a better way at once
    better: np.ndarray = array("i8", "1", GOAL)  # looks in a row that found one
    where: np.ndarray = array("i8", "1", FRAME)  # segment that q is on, -1: none
    rest: np.ndarray = array("i8", "1", FRAME)  # 1: the rest of the way is free
    beside: np.ndarray = array("i8", "1", FRAME)  # 1: q is beside its segment


class Own(NamedTuple):
    """What belongs to no other group."""

    radii: np.ndarray = array("f8", "spheres")  # sphere radius + rho + m
    bare: np.ndarray = array("f8", "spheres")  # sphere radius + m
    # most that joint j moves any sphere's centre per unit
    sway: np.ndarray = array("f8", "dof")
    weights: np.ndarray = array("f8", "dof")
    continuous: np.ndarray = array("b1", "dof")
    lower: np.ndarray = array("f8", "dof")
    upper: np.ndarray = array("f8", "dof")
    # cost to go to the best goal, costs included
    h_any: np.ndarray = array("f8", "n", GOAL)
    # configuration that was attached last
    q_fresh: np.ndarray = array("f8", "dof", GOAL, np.nan)
    q: np.ndarray = array("f8", "dof", FRAME, np.nan)  # present configuration
    dq: np.ndarray = array("f8", "dof", FRAME)
    spot: np.ndarray = array("f8", "dof", FRAME)
    still: np.ndarray = array("f8", "dof", FRAME)  # zeros
    out: np.ndarray = array("f8", "2", FRAME)  # share of the segment that q is on


class Groups:
    """All groups, in the order of their rows in the table."""

    arm: Arm
    work: Work
    cloud: Cloud  # the frame's points
    solids: Solids  # the frame's shapes
    patterns: Patterns  # what their samples are made from
    pick: Cloud  # those inside the cells of one motion
    graph: Graph
    direct: Direct
    pool: Pool
    goals: Goals
    fresh: Starts  # of the configuration that was attached last
    along: Starts  # of a robot on its way: the ends of its segment
    search: Search
    stats: Stats
    past: Past
    short: Shortcuts
    way: Way  # in use
    spare: Way  # found last
    proof: Proof
    beside: Beside
    own: Own
    terms: Terms
    numbers: Numbers
    trees: Trees  # where the roadmap has no path
    found: Found


KINDS: dict[str, type] = Groups.__annotations__
_WIDTH = 4  # numbers of a row: address and shape; or the bits of a single float


def first_row(name: str) -> int:
    """Return the row at which a group begins."""
    before = list(KINDS)[: list(KINDS).index(name)]
    return sum(len(declared(KINDS[other])) for other in before)


def table_of(groups: dict[str, tuple], block: np.dtype) -> np.ndarray:
    """Return the table of all groups, which must have been checked."""
    rows = [value for name in KINDS for value in groups[name]]
    table = np.zeros((len(rows), _WIDTH), np.int64)
    for row, value in zip(table, rows, strict=True):
        if isinstance(value, float):
            row[:1].view(np.float64)[0] = value
            continue
        row[0] = value.__array_interface__["data"][0]  # fast
        row[1 : 1 + value.ndim] = value.shape
    return table.view(np.uint64) if block == np.uint32 else table


@intrinsic
def view(typingctx, table, name):  # noqa: ANN001, ANN201
    """Return a group of the table by its name, which must be written out."""
    if not isinstance(name, types.StringLiteral):
        return None
    kind, first = KINDS[name.literal_value], first_row(name.literal_value)
    block = types.uint16 if table.dtype.signed else types.uint32
    members = [_member(field, block) for field in declared(kind).values()]
    result = types.BaseTuple.from_types(members, kind)

    def codegen(context, builder, signature, args):  # noqa: ANN001, ANN202
        rows = make_array(signature.args[0])(context, builder, args[0]).data

        def entry(k):  # noqa: ANN001, ANN202
            return builder.load(builder.gep(rows, [cgutils.intp_t(k)]))

        values = []
        for k, member in enumerate(members, first):
            at = entry(_WIDTH * k)
            to = context.get_data_type(getattr(member, "dtype", member))
            if not isinstance(member, types.Array):
                values.append(builder.bitcast(at, to))
                continue
            shape = [entry(_WIDTH * k + 1 + axis) for axis in range(member.ndim)]
            size = cgutils.intp_t(get_itemsize(context, member))
            strides = [size]
            for length in shape[:0:-1]:
                strides.insert(0, builder.mul(strides[0], length))
            made = make_array(member)(context, builder)
            data = builder.inttoptr(at, to.as_pointer())
            # without meminfo nothing is counted
            populate_array(made, data, shape, strides, size, meminfo=None)
            values.append(made._getvalue())
        return context.make_tuple(builder, result, values)

    return result(table, name), codegen


def _member(field, block):  # noqa: ANN001, ANN202
    """Return the numba type of an array that is declared."""
    dtype = block if field.dtype == BLOCK else from_dtype(np.dtype(field.dtype))
    return types.Array(dtype, len(field.axes), "C") if field.axes else dtype
