"""Starts of a robot that is passing through: what of them is of use in this frame."""

from numba import njit

from odm.close_test._close import displacement
from odm.search._items import item_free
from odm.search._judge import close_free
from odm.search._state import cloud_of, graph_of, own_of, search_of
from odm.search._types import N_FRAME


@njit(cache=True, nogil=True)
def clear_starts(state, points, q, ids, most, kept):
    """Write to `kept` the nodes of `ids` that q can go to in this frame, in order.

    At most `most` of them. A node counts where its cells are free and the close test
    finds the motion to it free. Returns how many.
    """
    words = cloud_of(state).words
    graph = graph_of(state)
    search = search_of(state)
    own = own_of(state)
    frame = own.numbers[N_FRAME]
    n = 0
    for k in range(ids.shape[0]):
        if n == most:
            break
        if not item_free(graph, words, search, frame, ids[k]):
            continue
        displacement(q, graph.nodes[ids[k]], own.continuous, own.dq)
        if close_free(state, points, q, own.dq):
            kept[n] = ids[k]
            n += 1
    return n
