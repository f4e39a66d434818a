"""Groups of arrays that the compiled loops take, so that calls stay readable."""

from typing import NamedTuple

import numpy as np


class Graph(NamedTuple):
    """The roadmap's neighbours and what never changes about its items."""

    adj_ptr: np.ndarray  # (n + 1,)
    adj_node: np.ndarray  # (2 m,)
    adj_edge: np.ndarray  # (2 m,)
    adj_length: np.ndarray  # (2 m,)
    edges: np.ndarray  # (m, 2)
    nodes: np.ndarray  # (n, dof)
    ptr: np.ndarray  # (n + m + 1,) cell lists of nodes, then edges
    block: np.ndarray
    mask: np.ndarray
    closed: np.ndarray  # (n + m,) True: blocked by scenery for good
    region: np.ndarray  # (n_blocks,) bit of a block in signatures, 0 to 255
    sign: np.ndarray  # (4 (n + m),) signature of an item: regions of its blocks
    taken: np.ndarray  # the bits of Direct, once a frame made use of them


class Pool(NamedTuple):
    """Cell lists of motions that are not roadmap edges."""

    begin: np.ndarray  # (items,) first entry of an item
    end: np.ndarray  # (items,)
    block: np.ndarray  # (entries,)
    mask: np.ndarray  # (entries,)
    sign: np.ndarray  # (4 items,) signature of an item
    used: np.ndarray  # (2,) items, entries


class Direct(NamedTuple):
    """The block-major view and what it counts; see direct.py."""

    ptr: np.ndarray  # (n_blocks + 1,) items of a block
    item: np.ndarray  # (entries,)
    mask: np.ndarray  # (entries,)
    seen: np.ndarray  # (n_blocks,) words that the counts stand for
    hits: np.ndarray  # (n + m,) occupied blocks of an item; an edge's end nodes too
    listed: np.ndarray  # (n_blocks + 1,) blocks with seen cells, their number last
    bits: np.ndarray  # (words,) one bit for each item: its count is not 0
    turned: np.ndarray  # (longest list + 1,) scratch
    frame: np.ndarray  # (1,) frame that the counts stand for


class Starts(NamedTuple):
    """Motions from the present configuration to nodes."""

    node: np.ndarray  # (k,)
    length: np.ndarray  # (k,)
    ref: np.ndarray  # (k,) >= 0 pool item, -1 none, -2 - e part of edge e
    static: np.ndarray  # (k,) 0 not tested, 1 free, 2 not free of what stands still
    memo: np.ndarray  # (k,) 4 * frame + verdict of the frame
    stuck: np.ndarray  # (k,) share of the motion where it was blocked last, or -1
    count: np.ndarray  # (2,) number, next to be tested


class Goals(NamedTuple):
    """Motions from nodes to goals, goal by goal."""

    q: np.ndarray  # (g, dof)
    cost: np.ndarray  # (g,)
    h: np.ndarray  # (g, n) cost to go
    at: np.ndarray  # (g, n) attachment of a node, or -1
    node: np.ndarray  # (g, k)
    length: np.ndarray  # (g, k)
    ref: np.ndarray  # (g, k) >= 0 pool item, -3 the node is the goal
    memo: np.ndarray  # (g, k)
    stuck: np.ndarray  # (g, k) as in Starts
    number: np.ndarray  # (g,) attachments
    vertex: np.ndarray  # (g,) unique number of the goal as a vertex
    direct_ref: np.ndarray  # (g,) >= 0 pool item of start -> goal, -1 none, -4 no way
    direct_length: np.ndarray  # (g,)
    fresh_ref: np.ndarray  # (g,) direct_ref at the attached configuration
    direct_memo: np.ndarray  # (g,)
    direct_stuck: np.ndarray  # (g,) t at which it was blocked last, or -1
    count: np.ndarray  # (3,) goals, vertex of the fresh start, of a start on the way


class Search(NamedTuple):
    """Scratch of the search."""

    memo: np.ndarray  # (n + m,) 2 * frame + hit of a roadmap item
    done: np.ndarray  # (n + g,) run in which a vertex was closed
    flood: np.ndarray  # (n,) run in which the goal's side reached a node
    queue: np.ndarray  # (n,)
    near_run: np.ndarray  # (n,) run in which a node was reached by what is free
    near_g: np.ndarray  # (n,) length of the shortest way there in that run
    e_node: np.ndarray  # (entries,)
    e_ref: np.ndarray  # (entries,)
    e_from: np.ndarray  # (entries,) entry of the parent, -1 start
    e_g: np.ndarray  # (entries,)
    heap_f: np.ndarray  # (entries,)
    heap_e: np.ndarray  # (entries,)
    sign: np.ndarray  # (4,) signature of the frame's occupied blocks
    stats: np.ndarray  # (8,) see N_* below


class Past(NamedTuple):
    """Ways that long searches found lately; see bound.py."""

    vertex: np.ndarray  # (k,) number of the goal, -1 none
    node: np.ndarray  # (k, 64) nodes from the goal's side
    via: np.ndarray  # (k, 64) attachment of the goal, then edge to the node before
    length: np.ndarray  # (k, 64) length of that
    count: np.ndarray  # (k + 2,) nodes of each; next to be replaced; found last


class Way(NamedTuple):
    """A path as vertices and the items between them; see Proof, too."""

    vertex: np.ndarray  # (64,) node, or unique number of start or goal
    ref: np.ndarray  # (64,) item from vertex k to k + 1
    q: np.ndarray  # (64, dof)
    count: np.ndarray  # (2,) vertices, goal index


class Proof(NamedTuple):
    """The motions that were tested for the segments of a path.

    Segment k leads from q[k] to q[k + 1] of the path. It is all or a part of the motion
    from begin[k] to end[k], to which the cells of its item belong.
    """

    begin: np.ndarray  # (64, dof)
    end: np.ndarray  # (64, dof)
    motion: np.ndarray  # (dof,) most that joint j moves any point per unit [m]


class Beside(NamedTuple):
    """What is known of a robot beside its segment."""

    q: np.ndarray  # (3, dof) where it is; the segment's end; its begin
    free: np.ndarray  # (2,) 1: free of what stands still, to the end, to the begin


class Shortcuts(NamedTuple):
    """Motions between vertices that were tested once and are remembered."""

    key: np.ndarray  # (size,) from << 31 | to, -1 empty; the size is a power of 2
    item: np.ndarray  # (size,) pool item, or NO_WAY
    count: np.ndarray  # (1,)
    best: np.ndarray  # (64,) scratch
    back: np.ndarray  # (128,) scratch
    ref: np.ndarray  # (64,) scratch


class Own(NamedTuple):
    """What belongs to no other group."""

    radii: np.ndarray  # (n,) sphere radius + rho + m
    terms: np.ndarray  # (4,) mu / 2, h, tracking and blending share, extra clearance
    sway: np.ndarray  # (dof,) most that joint j moves any sphere per unit
    weights: np.ndarray  # (dof,)
    continuous: np.ndarray  # (dof,)
    h_any: np.ndarray  # (n,) cost to go to the best goal, costs included
    numbers: np.ndarray  # (12,) see N_FRAME and after
    dq: np.ndarray  # (dof,) scratch
    spot: np.ndarray  # (dof,) scratch
    still: np.ndarray  # (dof,) zeros
    q: np.ndarray  # (dof,) present configuration
    q_fresh: np.ndarray  # (dof,) configuration that was attached last
    lower: np.ndarray  # (dof,)
    upper: np.ndarray  # (dof,)
    out: np.ndarray  # (2,) share of the segment that q is on


N_POPPED, N_EDGE_TESTS, N_FLOODED, N_CLOSE, N_RUNS, N_COUNTED = range(6)
N_FRAME, N_RUN, N_JOINT_COSTS, N_SEGMENT, N_SAME = range(5)
N_JOINT, N_LOOK, N_BETTER, N_WHERE, N_REST, N_STEP, N_BESIDE = range(5, 12)
NO_ITEM, IS_GOAL, NO_WAY = -1, -3, -4
TO_END, TO_BEGIN = 0, 1  # entries of Beside.free
EDGE_BASE = -1024  # ref EDGE_BASE - e is roadmap edge e; below every -2 - attachment
