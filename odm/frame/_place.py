"""What a thing in the scene closes: its cells first, then the close test, item by item.

An item that shares no cell with the thing is free of it. Of the others, nodes and then
edges pass the close test; an edge whose node is closed at once is closed with it.
"""

from numba import njit

from odm.close_test._close import displacement, motion_clear, place_clear
from odm.obstacles._cloud import N_OCCUPIED
from roadmap.compiling.jit_options import LEAN

NEAR, SHUT = 1, 2  # marks of an item: it shares a cell; it is closed for good


@njit(**LEAN)
def items_near(direct, graph, cloud, mark, found):
    """List the items that share a cell with a cloud, nodes with all their edges.

    An edge's cells are those of its list and of its two nodes. `mark` (n + m,) is 0
    before, NEAR for what was found; `found` gets the items in no order. Returns their
    number.
    """
    n_nodes = graph.adj_ptr.shape[0] - 1
    count = 0
    for i in range(cloud.counts[N_OCCUPIED]):
        b = cloud.occupied[i]
        word = cloud.words[b]
        for k in range(direct.ptr[b], direct.ptr[b + 1]):
            item = direct.item[k]
            if direct.mask[k] & word != 0 and mark[item] == 0:
                mark[item] = NEAR
                found[count] = item
                count += 1
    for i in range(count):
        v = found[i]
        if v >= n_nodes:
            continue
        for j in range(graph.adj_ptr[v], graph.adj_ptr[v + 1]):
            item = n_nodes + graph.adj_edge[j]
            if mark[item] == 0:
                mark[item] = NEAR
                found[count] = item
                count += 1
    return count


@njit(**LEAN)
def shut_nodes(clearance, graph, cloud, solids, items, mark):
    """Mark the nodes of `items` that the close test finds too near as SHUT."""
    n_nodes = graph.adj_ptr.shape[0] - 1
    for v in items:
        if v < n_nodes and not place_clear(clearance, graph.nodes[v], cloud, solids):
            mark[v] = SHUT


@njit(**LEAN)
def split_edges(graph, items, mark, open_):
    """Mark the edges of `items` with a shut node as SHUT, list the others in `open_`.

    Returns how many were listed: they are to be tested.
    """
    n_nodes = graph.adj_ptr.shape[0] - 1
    count = 0
    for k in range(items.shape[0]):
        item = items[k]
        if item < n_nodes:
            continue
        a, b = graph.edges[item - n_nodes, 0], graph.edges[item - n_nodes, 1]
        if mark[a] == SHUT or mark[b] == SHUT:
            mark[item] = SHUT
        else:
            open_[count] = item
            count += 1
    return count


@njit(**LEAN)
def items_clear(clearance, graph, cloud, solids, items, continuous, dq, clear):
    """Write to `clear` (k,) which of these items the close test finds free."""
    n_nodes = graph.adj_ptr.shape[0] - 1
    for k in range(items.shape[0]):
        e = items[k] - n_nodes
        a = b = items[k]  # a node is a motion that stands still
        if e >= 0:
            a, b = graph.edges[e, 0], graph.edges[e, 1]
        q = graph.nodes[a]
        displacement(q, graph.nodes[b], continuous, dq)
        clear[k] = motion_clear(clearance, q, dq, cloud, solids, False)


@njit(**LEAN)
def motions_clear(clearance, cloud, solids, q, dq, clear):
    """Write to `clear` (k,) which motions q[k] + t dq[k] the close test finds free."""
    for k in range(q.shape[0]):
        clear[k] = motion_clear(clearance, q[k], dq[k], cloud, solids, False)
