"""The planner's state, declared once: groups of arrays, and a table of addresses.

Handing a hundred arrays to a compiled function costs 5 us a call, and taking them out
of a numba struct as much again, in counted references. So compiled loops take one
argument: a table with address and shape of every array. `view(state, "goals")` makes
the arrays of a group from it, without a count. `odm.search.state.Memory` owns the
arrays, so they live as long as the planner.

The type of the table tells the type of the block ids: int64 for uint16, uint64 for
uint32 (grids of more than 65535 blocks).
"""

import time
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array
from numba.np.numpy_support import from_dtype

from odm._groups import BLOCK, FRAME, GOAL, array, declared
from odm.close_test._arm import Arm, Work
from odm.obstacles._cloud import Cloud
from odm.obstacles._solid_samples import Patterns
from odm.obstacles._solids import Solids
from roadmap.compiling.lowering import value_at

NO_ITEM, IS_GOAL, NO_MOTION = -1, -3, -4  # instead of a pool item
TO_END, TO_BEGIN = 0, 1  # entries of OffPath.free
# what they say: all of the clearance is kept, or but for the share of rounding; else 0
WHOLE, ROUNDED = 1, 2
# what a candidate is: the path in use, changed in part; another path; one free only now
EDITED, BETTER_PATH, PRESENT_ONLY_PATH = 1, 2, 3
EDGE_BASE = -1024  # ref EDGE_BASE - e is roadmap edge e; below every -2 - attachment
# macOS counts what `perf_counter` does by a clock of its own
_CLOCK = getattr(time, "CLOCK_UPTIME_RAW", time.CLOCK_MONOTONIC)
PIECES = 8  # of a motion, which are looked at as a whole first
LOST = -100  # number of a frame that is long over


class Seen(NamedTuple):
    """What the frame shows, as it came: the frame owns this array, not the memory.

    Its row of the table is written anew by each frame; see `show`.
    """

    # the points that were given, then the samples of shapes
    points: np.ndarray = array("f8", "seen 3", FRAME)


class Lent(NamedTuple):
    """The arrays by which a frame with shapes came; see `step_again`.

    They are the caller's and the frame's own, which `odm.frame.Frame` keeps alive.
    """

    given: np.ndarray = array("f8", "seen 3", FRAME)
    data: np.ndarray = array("f8", "seen", FRAME)
    counts: np.ndarray = array("i8", "seen", FRAME)
    room: np.ndarray = array("f8", "seen 3", FRAME)


class Graph(NamedTuple):
    """The roadmap's neighbours and what never changes about its items."""

    adj_ptr: np.ndarray = array("i8", "n+1")
    adj_node: np.ndarray = array("i4", "2*m")
    adj_edge: np.ndarray = array("i4", "2*m")
    adj_length: np.ndarray = array("f8", "2*m")
    edges: np.ndarray = array("i4", "m 2")
    nodes: np.ndarray = array("f8", "n dof")
    # cell lists of nodes, then edges, packed; see `odm/cell_map/_packed.py`
    start: np.ndarray = array("u4", "n+m+1 2")
    step: np.ndarray = array("u1", "steps")
    code: np.ndarray = array("u4", "entries")
    half: np.ndarray = array("u4", "halves")
    full: np.ndarray = array("u8", "words")
    closed: np.ndarray = array("b1", "n+m")  # True: blocked by scenery for good
    # bit of a block in signatures, 0 to 255
    region: np.ndarray = array("i4", "blocks")
    # signature of an item: regions of its blocks
    signature: np.ndarray = array("u8", "4*n+4*m")
    # Direct.bits: which items are hit by the frame
    hit_bits: np.ndarray = array("u8", "bits", GOAL)


class Pool(NamedTuple):
    """Cell lists of motions that are not roadmap edges."""

    begin: np.ndarray = array("i8", "items", GOAL)  # first entry of an item
    end: np.ndarray = array("i8", "items", GOAL)
    block: np.ndarray = array(BLOCK, "item_entries", GOAL)
    mask: np.ndarray = array("u8", "item_entries", GOAL)
    signature: np.ndarray = array("u8", "4*items", GOAL)  # signature of an item
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
    # one bit for each item: it is hit, its count is not 0
    bits: np.ndarray = array("u8", "bits", GOAL)
    changed: np.ndarray = array("i4", "longest_list", FRAME)
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
    # share t of the motion at which it was blocked last, or -1
    blocked_at: np.ndarray = array("f8", "joins", GOAL, -1)
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
    blocked_at: np.ndarray = array("f8", "goals joins", GOAL, -1)  # as in Starts
    number: np.ndarray = array("i8", "goals", GOAL)  # attachments
    # unique number of the goal as a vertex
    vertex: np.ndarray = array("i8", "goals", GOAL)
    # >= 0 pool item of start -> goal, NO_ITEM or NO_MOTION
    direct_ref: np.ndarray = array("i8", "goals", FRAME, NO_MOTION)
    direct_length: np.ndarray = array("f8", "goals", FRAME)
    # direct_ref at the attached configuration
    attached_ref: np.ndarray = array("i8", "goals", GOAL, NO_MOTION)
    direct_memo: np.ndarray = array("i8", "goals", FRAME)
    # t at which it was blocked last, or -1
    direct_blocked_at: np.ndarray = array("f8", "goals", GOAL, -1)
    # goals, vertex of the attached start, of a start on the path
    count: np.ndarray = array("i8", "3", GOAL)


class Search(NamedTuple):
    """Scratch of the search."""

    # 2 * frame + hit of a roadmap item
    memo: np.ndarray = array("i8", "n+m", FRAME, -1)
    # where a roadmap item was hit last: a block, counted from 1 (0: never), and all
    # cells of the item there
    hit_at: np.ndarray = array("u8", "n+m 2", FRAME)
    # run in which a vertex was closed
    done: np.ndarray = array("i8", "n+goals", GOAL)
    # length of the path by which a node was closed, infinite: it is blocked
    g: np.ndarray = array("f8", "n", GOAL)
    # entry by which a node was closed
    entry: np.ndarray = array("i4", "n", FRAME)
    # run in which the goal's side reached a node
    flood: np.ndarray = array("i8", "n", GOAL)
    # 1: it took a path that need not be the shortest
    hasty: np.ndarray = array("i8", "1", FRAME)
    queue: np.ndarray = array("i8", "n", FRAME)
    # run in which a node was reached by what is free, and the least length there
    near_run: np.ndarray = array("i8", "n", FRAME)
    near_g: np.ndarray = array("f8", "n", FRAME)
    e_node: np.ndarray = array("i4", "heap", FRAME)
    e_ref: np.ndarray = array("i4", "heap", FRAME)
    e_from: np.ndarray = array("i4", "heap", FRAME)  # entry of the parent, -1 start
    e_g: np.ndarray = array("f8", "heap", FRAME)
    # 1: its length has the toll for where obstacles have lately been
    e_paid: np.ndarray = array("u1", "heap", FRAME)
    heap_f: np.ndarray = array("f8", "heap", FRAME)
    heap_e: np.ndarray = array("i4", "heap", FRAME)
    made: np.ndarray = array("i8", "1", FRAME)  # entries, and those on the heap
    waiting: np.ndarray = array("i8", "1", FRAME)
    head: np.ndarray = array("i8", "1", FRAME)  # of the flood's queue, and its tail
    tail: np.ndarray = array("i8", "1", FRAME)
    signature: np.ndarray = array("u8", "4", FRAME)  # of the frame's occupied blocks
    # roadmap items that were found hit in this frame, and how many: see `Proof`
    hit: np.ndarray = array("i4", "proof", FRAME)
    hits: np.ndarray = array("i8", "1", FRAME)


class Looks(NamedTuple):
    """Where motions to nodes that wait to be joined were blocked last, node by node."""

    vertex: np.ndarray = array("i8", "n", GOAL, -1)  # of the start or the goal
    at: np.ndarray = array("f4", "n", GOAL)  # share of the motion from there


class Stats(NamedTuple):
    """What a frame's answer tells: of its searches, and of its obstacles."""

    popped: np.ndarray = array("i8", "1", FRAME)  # vertices closed
    edge_tests: np.ndarray = array("i8", "1", FRAME)  # cell lists compared
    flooded: np.ndarray = array("i8", "1", FRAME)  # nodes of the goal's side
    close: np.ndarray = array("i8", "1", FRAME)  # close tests
    runs: np.ndarray = array("i8", "1", FRAME)
    counted: np.ndarray = array("i8", "1", FRAME)  # 1: the direct map decides
    step: np.ndarray = array("i8", "1", FRAME)  # number of the frame
    # when its obstacles were marked [ns], by the clock of `time.perf_counter_ns`
    marked: np.ndarray = array("i8", "1", FRAME)
    blocks: np.ndarray = array("i8", "1", FRAME)  # occupied ones
    inside: np.ndarray = array("i8", "1", FRAME)  # points in the grid
    outside: np.ndarray = array("i8", "1", FRAME)
    bad: np.ndarray = array("i8", "1", FRAME)  # points that are not finite


class EarlierPaths(NamedTuple):
    """Paths that earlier long searches found; see `_bound.py`."""

    vertex: np.ndarray = array("i8", "earlier", GOAL, -1)  # of the goal, -1 none
    # from the goal's side
    node: np.ndarray = array("i4", "earlier corners", GOAL)
    # attachment of the goal, then edge to the node before, and the length of that
    via: np.ndarray = array("i4", "earlier corners", GOAL)
    length: np.ndarray = array("f8", "earlier corners", GOAL)
    # nodes of each; next to be replaced; found last
    count: np.ndarray = array("i8", "earlier+2", GOAL)


class Proof(NamedTuple):
    """What the search that was asked last showed; see `_bound.py`.

    Every shorter path, or every path where there was none, leads over something that
    was blocked in that frame: one of these items or of these motions.
    """

    item: np.ndarray = array("i4", "proof", GOAL)
    # BY_CELLS or BY_CLOSE_TEST: a motion from the start, or into the goal, was blocked
    start_out: np.ndarray = array("u1", "joins", GOAL)
    goal_out: np.ndarray = array("u1", "joins", GOAL)
    # nodes of the path from the start's side, and the edge to the next one
    node: np.ndarray = array("i4", "corners", GOAL)
    edge: np.ndarray = array("i4", "corners", GOAL)
    # motion from the start and into the goal that it goes by
    by: np.ndarray = array("i8", "2", GOAL)
    length: np.ndarray = array("f8", "1", GOAL)  # of it, costs included
    # vertices of start (-1: nothing is shown) and goal, numbers of their motions
    of: np.ndarray = array("i8", "4", GOAL, -1)
    # items; nodes of the path, 0: there is none; search whose closed nodes count, -1:
    # none; side that was exhausted; searches for what is shorter
    count: np.ndarray = array("i8", "5", GOAL)


class Path(NamedTuple):
    """A path as vertices and the items between them; see Certificates, too."""

    # node, or unique number of start or goal
    vertex: np.ndarray = array("i8", "corners", GOAL)
    ref: np.ndarray = array("i8", "corners", GOAL)  # item from vertex k to k + 1
    q: np.ndarray = array("f8", "corners dof", GOAL)
    count: np.ndarray = array("i8", "2", GOAL)  # vertices, goal index


class Ahead(NamedTuple):
    """What is left of the path in use: from q itself to the goal."""

    q: np.ndarray = array("f8", "corners dof", FRAME)


class Certificates(NamedTuple):
    """The motions that were tested for the segments of a path.

    Segment k leads from q[k] to q[k + 1] of the path. It is all or a part of the motion
    from begin[k] to end[k], to which the cells of its item belong.
    """

    begin: np.ndarray = array("f8", "corners dof", GOAL)
    end: np.ndarray = array("f8", "corners dof", GOAL)
    # most that joint j moves any point per unit [m]
    motion_bound: np.ndarray = array("f8", "dof")


class OffPath(NamedTuple):
    """What is known of the motions of a robot that is off its path, back to it."""

    # where it is; the segment's end; its begin
    q: np.ndarray = array("f8", "3 dof", GOAL, np.nan)
    # what is kept from what stands still, to the end, to the begin: WHOLE, ROUNDED
    free: np.ndarray = array("i8", "2", GOAL)


class Recent(NamedTuple):
    """Which cells were occupied lately, block by block; see `_recent.py`."""

    when: np.ndarray = array("f8", "blocks", GOAL, -np.inf)  # last occupied [s]
    # quarter of the memory's ring that was written last
    period: np.ndarray = array("i8", "blocks", GOAL)
    cells: np.ndarray = array("u8", "4*blocks", GOAL)  # occupied, by period modulo 4
    # blocks that were occupied lately, their number last
    listed: np.ndarray = array("i4", "blocks+1", GOAL)
    clock: np.ndarray = array("f8", "1", GOAL)  # time of the frame [s]
    occupied: np.ndarray = array("u8", "blocks", FRAME)  # all cells occupied lately
    # these, and the frame's grown: what new paths keep clear of
    avoided: np.ndarray = array("u8", "blocks", FRAME)
    grown: np.ndarray = array("u8", "blocks", FRAME)
    # blocks with such cells, their number last
    marked: np.ndarray = array("i4", "blocks+1", FRAME)
    sign: np.ndarray = array("u8", "4", FRAME)  # of these blocks
    laid: np.ndarray = array("i8", "1", FRAME, -1)  # frame whose these are
    # 2 * frame + whether a roadmap item has such cells
    memo: np.ndarray = array("i8", "n+m", FRAME, -1)


class Rules(NamedTuple):
    """What the user set; see `PlannerSettings`."""

    always: np.ndarray = array("i8")  # 1: search from scratch in every frame
    hysteresis: np.ndarray = array("f8")
    close_test_connections: np.ndarray = array("i8")
    confirmations: np.ndarray = array("i8")
    history_s: np.ndarray = array("f8")  # [s]
    rings: np.ndarray = array("i8")  # of cells by which the frame's grow
    persistence_frames: np.ndarray = array("i8")
    large: np.ndarray = array("i8")  # items beyond which long searches are greedy


class Shortcuts(NamedTuple):
    """Motions between vertices that were tested once and are remembered."""

    # from << 31 | to, -1 empty; the size is a power of 2
    key: np.ndarray = array("i8", "shortcuts", GOAL, -1)
    item: np.ndarray = array("i8", "shortcuts", GOAL)  # pool item, or NO_MOTION
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
    """Paths that the trees made, each a `Path`."""

    vertex: np.ndarray = array("i8", "found corners", GOAL)
    ref: np.ndarray = array("i8", "found corners", GOAL, NO_ITEM)
    q: np.ndarray = array("f8", "found corners dof", GOAL)
    count: np.ndarray = array("i8", "found", GOAL)  # corners of each, 0 none
    next: np.ndarray = array("i8", "1", GOAL)  # that is replaced


class Terms(NamedTuple):
    """Lengths that the tests keep [m]."""

    tolerance: np.ndarray = array("f8")  # mu / 2: inflation of a piece of a motion
    path_tolerance: np.ndarray = array("f8")  # share of tracking and blending
    extra: np.ndarray = array("f8")  # clearance beyond the map's
    widest: np.ndarray = array("f8")  # radius of the robot's largest sphere


class Reach(NamedTuple):
    """How far blocks are from the axis that all of the robot turns about."""

    # that of the joint of this body; -1: there is none
    body: np.ndarray = array("i8", "1")
    # least distance of any place in a block from it [m]
    away: np.ndarray = array("f8", "blocks")


class Slacks(NamedTuple):
    """Motions that were measured, and what they had to spare; see `_slack.py`."""

    begin: np.ndarray = array("f8", "slacks dof", GOAL)
    end: np.ndarray = array("f8", "slacks dof", GOAL)
    chords: np.ndarray = array("i8", "slacks", GOAL)  # equal parts; 0: no motion
    asked: np.ndarray = array("i8", "slacks", GOAL)  # frame that last asked for it
    # of each body but the base: SPEED, BEND [m] and WIDE [m]; lanes beyond have none
    bound: np.ndarray = array("f8", "slacks 3 lanes", GOAL)
    # of a chord, and after all chords of the pieces that they make up: what it had to
    # spare [m], in which frame, and the place of its shapes
    spare: np.ndarray = array("f8", "slacks spares", GOAL)
    since: np.ndarray = array("i8", "slacks spares", GOAL)
    at: np.ndarray = array("i8", "slacks spares", GOAL)
    nearest: np.ndarray = array("i8", "slacks chords", GOAL)  # sphere, or -1
    # of a motion's configurations between chords: frames of the bodies, if known
    frames: np.ndarray = array("f8", "places bodies 12", FRAME)
    placed: np.ndarray = array("b1", "places", FRAME)
    # where the balls around the bodies are there [m], and what they have to spare
    balls: np.ndarray = array("f8", "places 3 lanes", FRAME)
    near: np.ndarray = array("f8", "lanes", FRAME)
    # shapes of a few frames: the frame, rows, kinds and number
    frame: np.ndarray = array("i8", "snapshots", GOAL, LOST)
    rows: np.ndarray = array("f8", "snapshots slack_shapes 19", GOAL)
    kind: np.ndarray = array("i8", "snapshots slack_shapes", GOAL)
    count: np.ndarray = array("i8", "snapshots", GOAL)
    # how far the shapes are from those now [m], and the frame of "now"
    moved: np.ndarray = array("f8", "snapshots", FRAME)
    moved_in: np.ndarray = array("i8", "snapshots", FRAME, LOST)
    next: np.ndarray = array("i8", "1", GOAL)  # snapshot that is replaced
    piece: np.ndarray = array("f8", "2 dof", FRAME)  # begin and displacement
    delta: np.ndarray = array("f8", "dof", FRAME)  # of the whole motion


class BlockedPlaces(NamedTuple):
    """Configurations that a shape was too near to, and a sphere; see `_judge.py`."""

    q: np.ndarray = array("f8", "places_kept dof", FRAME, np.nan)
    sphere: np.ndarray = array("i8", "places_kept", FRAME)
    center: np.ndarray = array("f8", "places_kept 3", FRAME)  # of that sphere [m]
    next: np.ndarray = array("i8", "1", FRAME)  # row that is written next


class Numbers(NamedTuple):
    """Single numbers of the frame and of what is decided in it."""

    frame: np.ndarray = array("i8", "1", GOAL)  # sets of points taken
    step: np.ndarray = array("i8", "1", GOAL)  # steps of the planner
    # what came of a frame's shapes, see `begin_shapes`
    taken: np.ndarray = array("i8", "1", FRAME)
    run: np.ndarray = array("i8", "1", GOAL)  # searches begun
    joint_costs: np.ndarray = array("i8", "1", GOAL)  # 1: goals compete by their costs
    segment: np.ndarray = array("i8", "1", GOAL)  # of the path in use that q is on
    same: np.ndarray = array("i8", "1", FRAME)  # 1: the path found is the one in use
    joint: np.ndarray = array("i8", "1", FRAME)  # that is out of its limits
    # consecutive searches that found a better path
    better: np.ndarray = array("i8", "1", GOAL)
    # 0 none; else a candidate waits for the next frame: EDITED, BETTER_PATH or
    # PRESENT_ONLY_PATH
    candidate: np.ndarray = array("i8", "1", GOAL)
    start: np.ndarray = array("i8", "1", GOAL)  # its segment that q was on
    present_only: np.ndarray = array("i8", "1", GOAL)  # 1: the way was free only now
    # frames such a path must be there yet
    frames_to_persist: np.ndarray = array("i8", "1", GOAL)
    wish: np.ndarray = array("i8", "1", FRAME)  # 1: look for a better goal now
    seen: np.ndarray = array("i8", "1", GOAL)  # step whose q and time were noted
    stood: np.ndarray = array("i8", "1", GOAL)  # frames without a move
    # 1: this search avoids recent cells, 2: no more
    avoid_history: np.ndarray = array("i8", "1", FRAME)
    where: np.ndarray = array("i8", "1", FRAME)  # segment that q is on, -1: none
    # START_SIDE, GOAL_SIDE: all that it leads to is known to the last search; else 0
    exhausted: np.ndarray = array("i8", "1", FRAME)
    rest: np.ndarray = array("i8", "1", GOAL)  # 1: the rest of the path is free
    off_path: np.ndarray = array("i8", "1", GOAL)  # 1: q is off its segment


class RobotState(NamedTuple):
    """The robot: limits, weights and motion bounds, where it is, and scratch."""

    radii: np.ndarray = array("f8", "spheres")  # sphere radius + rho + m
    bare: np.ndarray = array("f8", "spheres")  # sphere radius + m
    # most that joint j moves any sphere's centre per unit
    motion_bound: np.ndarray = array("f8", "dof")
    weights: np.ndarray = array("f8", "dof")
    continuous: np.ndarray = array("b1", "dof")
    lower: np.ndarray = array("f8", "dof")
    upper: np.ndarray = array("f8", "dof")
    # cost to go to the best goal, costs included
    h_any: np.ndarray = array("f8", "n", GOAL)
    # configuration that was attached last
    q_attached: np.ndarray = array("f8", "dof", GOAL, np.nan)
    # weighted length of the straight motion from there to each node
    from_attached: np.ndarray = array("f8", "n", FRAME)
    q: np.ndarray = array("f8", "dof", FRAME, np.nan)  # present configuration
    # that of the frame before
    before: np.ndarray = array("f8", "dof", GOAL, np.nan)
    dq: np.ndarray = array("f8", "dof", FRAME)
    scratch_q: np.ndarray = array("f8", "dof", FRAME)
    still: np.ndarray = array("f8", "dof")  # no motion
    fraction: np.ndarray = array("f8", "2", FRAME)  # share of the segment that q is on


class Groups:
    """All groups, in the order of their rows in the table."""

    arm: Arm
    work: Work
    seen: Seen  # the frame's points as they came
    lent: Lent  # the arrays by which they and the shapes came
    cloud: Cloud  # the same by block
    solids: Solids  # the frame's shapes
    patterns: Patterns  # what their samples are made from
    picked: Cloud  # those of them inside the cells of one motion
    reached: Cloud  # those of them that the robot can come near
    reach: Reach
    graph: Graph
    direct: Direct
    pool: Pool
    goals: Goals
    start_connections: Starts  # of the configuration that was attached last
    path_ends: Starts  # of a robot on its path: the ends of its segment
    search: Search
    looks: Looks
    stats: Stats
    earlier_paths: EarlierPaths
    proof: Proof
    shortcuts: Shortcuts
    path: Path  # in use
    ahead: Ahead  # its rest, as it was answered
    found_path: Path  # found last
    better: Path  # the candidate
    certificates: Certificates
    candidate_certificates: Certificates
    off_path: OffPath
    robot_state: RobotState
    recent: Recent
    rules: Rules
    terms: Terms
    numbers: Numbers
    trees: Trees  # where the roadmap has no path
    found: Found
    slacks: Slacks
    blocked_places: BlockedPlaces


KINDS: dict[str, type] = Groups.__annotations__
# groups whose arrays `show` may exchange in the middle of a frame
SHOWN = ("seen", "lent")


@lru_cache
def words_of(kind: type) -> int:
    """Return how many words of the table a group takes."""
    return sum(5 + 2 * len(f.axes) if f.axes else 1 for f in declared(kind).values())


@lru_cache
def first_word(name: str) -> int:
    """Return the word of the table at which a group begins."""
    before = list(KINDS)[: list(KINDS).index(name)]
    return sum(words_of(KINDS[other]) for other in before)


@intrinsic
def clock_ns(typingctx):  # noqa: ANN001, ANN201
    """Return the time of `time.perf_counter_ns` [ns], by C's `clock_gettime`."""

    def codegen(context, builder, signature, args):  # noqa: ANN001, ANN202
        number, whole = ir.IntType(32), ir.IntType(64)
        spec = cgutils.alloca_once(builder, ir.ArrayType(whole, 2))
        kind = ir.FunctionType(number, [number, spec.type])
        read = cgutils.get_or_insert_function(builder.module, kind, "clock_gettime")
        builder.call(read, [number(_CLOCK), spec])
        seconds, rest = (
            builder.load(cgutils.gep_inbounds(builder, spec, 0, k)) for k in (0, 1)
        )
        return builder.add(builder.mul(seconds, whole(10**9)), rest)

    return types.int64(), codegen


@intrinsic
def view(typingctx, table, name):  # noqa: ANN001, ANN201
    """Return a group of the table by its name, which must be written out."""
    if not isinstance(name, types.StringLiteral):
        return None
    result = _type_of(name.literal_value, table)

    def codegen(context, builder, signature, args):  # noqa: ANN001, ANN202
        place = _place(context, builder, name.literal_value, signature.args[0], args[0])
        if name.literal_value in SHOWN:
            return builder.load(place)
        return value_at(builder, place)

    return result(table, name), codegen


def _type_of(name: str, table: types.Array) -> types.BaseTuple:
    """Return the numba type of a group in a table of this type."""
    block = types.uint16 if table.dtype.signed else types.uint32
    members = [_member(field, block) for field in declared(KINDS[name]).values()]
    return types.BaseTuple.from_types(members, KINDS[name])


def _place(context, builder, name, typ, table):  # noqa: ANN001, ANN202
    """Return where in a table, of type `typ`, a group lies."""
    words = make_array(typ)(context, builder, table).data
    place = builder.gep(words, [cgutils.intp_t(first_word(name))])
    kind = context.get_value_type(_type_of(name, typ))
    return builder.bitcast(place, kind.as_pointer())


@intrinsic
def show(typingctx, table, name, field, array):  # noqa: ANN001, ANN201
    """Let an array of a group be this array, which the caller keeps alive.

    Its place in the group is written out, as the group's name is.
    """
    literal = types.StringLiteral, types.IntegerLiteral
    if not (isinstance(name, literal[0]) and isinstance(field, literal[1])):
        return None
    if name.literal_value not in SHOWN:
        return None
    if array != _type_of(name.literal_value, table)[field.literal_value]:
        return None

    def codegen(context, builder, signature, args):  # noqa: ANN001, ANN202
        typ, _, _, kind = signature.args
        given = make_array(kind)(context, builder, args[3])
        given.meminfo = cgutils.get_null_value(given.meminfo.type)  # not counted
        given.parent = cgutils.get_null_value(given.parent.type)
        group = _place(context, builder, name.literal_value, typ, args[0])
        place = cgutils.gep_inbounds(builder, group, 0, field.literal_value)
        builder.store(given._getvalue(), place)
        return context.get_dummy_value()

    return types.void(table, name, field, array), codegen


def _member(field, block):  # noqa: ANN001, ANN202
    """Return the numba type of an array that is declared."""
    dtype = block if field.dtype == BLOCK else from_dtype(np.dtype(field.dtype))
    return types.Array(dtype, len(field.axes), "C") if field.axes else dtype
