"""The planner's state: what is declared is what compiled loops see, or is refused."""

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError
from small import HOME

from odm._groups import FRAME, GOAL, LIFE, declared
from odm.search._state import KINDS, Stats, show, view
from odm.search.state import Memory, exchange, lay_out
from roadmap.compiling.jit_options import LEAN
from roadmap.errors import BadInput


@pytest.fixture
def memory(small_map):
    """Return a memory whose arrays all belong to it alone."""
    laid_out = lay_out(small_map, 7)
    copies = {
        name: kind(*(a if isinstance(a, float) else a.copy() for a in group))
        for name, kind in KINDS.items()
        for group in [getattr(laid_out, name)]
    }
    copies["stats"] = laid_out.stats
    # all words of so small a map are two common halves
    copies["graph"] = copies["graph"]._replace(full=np.zeros(2, np.uint64))
    return Memory(copies)


def writer(name):
    """Return a compiled loop that marks first and last of all arrays of a group."""
    lines = [f"def write(table, k):\n    group = view(table, {name!r})"]
    for key, field in declared(KINDS[name]).items():
        rank = len(field.axes)
        for at in (0, -1) if rank else ():
            place = ", ".join([str(at)] * rank)
            lines.append(f"    k += 1\n    group.{key}[{place}] = k % 2 + k * {rank}")
    single = [k for k, field in declared(KINDS[name]).items() if not field.axes]
    lines.append(f"    return group.{single[0]}" if single else "    return 0.0")
    space = {"view": view}
    exec("\n".join(lines), space)
    return njit(**LEAN | {"cache": False})(space["write"])


@pytest.mark.parametrize("name", KINDS)
def test_each_row_is_written_where_it_is_declared(memory, name):
    before = {k: a.copy() for k, a in memory.arrays(LIFE, GOAL, FRAME).items()}
    single = writer(name)(memory.table, 10)
    group, k, changed = getattr(memory, name), 10, set()
    for key, field in declared(KINDS[name]).items():
        array = getattr(group, key)
        if not field.axes:
            assert single == array
            continue
        changed.add(f"{name}.{key}")
        rank = array.ndim
        for at in (0, -1):
            k += 1
            value = array.dtype.type(k % 2 + k * rank)
            if array.size > 1 or at == -1:
                assert array[(at,) * rank] == value
    if name == "graph":
        changed.add("direct.bits")  # the same array
    if name == "direct":
        changed.add("graph.hit_bits")
    for key, array in memory.arrays(LIFE, GOAL, FRAME).items():
        if key not in changed:
            assert np.array_equal(array, before[key], equal_nan=array.dtype.kind == "f")


def test_wide_ids_of_blocks_have_another_type_of_table(memory):
    groups = {name: getattr(memory, name) for name in KINDS}
    ids = groups["pool"].block.astype(np.uint32)
    wide = Memory(groups | {"pool": groups["pool"]._replace(block=ids)})
    assert (memory.table.dtype, wide.table.dtype) == (np.int64, np.uint64)
    writer("pool")(wide.table, 10)
    assert wide.pool.block[-1] == 16


@pytest.mark.parametrize(
    ("field", "change", "text"),
    [
        ("cost", lambda a: a.astype(np.float32), "goals.cost is float32 of rank 1"),
        ("number", lambda a: a.astype(np.int32), "but int64 of rank 1 is declared"),
        ("q", lambda a: a.ravel(), "but float64 of rank 2 is declared"),
        ("q", lambda a: a[:, :1].copy(), r"goals.q has shape \(32, 1\)"),
        ("h", lambda a: np.asfortranarray(a), "goals.h is not contiguous"),
        ("q", lambda a: a.tolist(), "goals.q is list"),
    ],
)
def test_an_array_of_another_kind_is_refused(memory, field, change, text):
    goals = memory.goals
    wrong = goals._replace(**{field: change(getattr(goals, field))})
    with pytest.raises(BadInput, match=text):
        exchange(memory, {"goals": wrong})
    assert memory.goals is goals


def test_an_axis_is_as_long_in_the_groups_that_stay(memory):
    """Of the arm, its scratch and the robot's state: the hand holds something else."""
    table, known = memory.table, dict(memory.sizes)
    radii = np.zeros(known["spheres"] + 3)
    wrong = memory.robot_state._replace(radii=radii, bare=radii.copy())
    with pytest.raises(BadInput, match=r"robot_state\.\w+ has shape .* is declared"):
        exchange(memory, {"robot_state": wrong})
    assert memory.table is table and memory.sizes == known
    exchange(memory, {"cloud": memory.cloud})
    assert memory.sizes == known and np.array_equal(memory.table, table)


def test_another_order_is_refused(memory):
    with pytest.raises(
        BadInput, match="start_connections is a Path, but the table holds a Starts"
    ):
        exchange(memory, {"start_connections": memory.path})
    goals = memory.goals
    swapped = goals._replace(q=goals.h, h=goals.q)
    with pytest.raises(BadInput, match="is declared"):
        exchange(memory, {"goals": swapped})
    cloud = memory.cloud._replace(h=1)
    with pytest.raises(BadInput, match="cloud.h is 1, but a float is declared"):
        exchange(memory, {"cloud": cloud})


def test_every_array_says_how_long_it_lives(memory):
    lives = [memory.arrays(life) for life in (LIFE, GOAL, FRAME)]
    names = [name for arrays in lives for name in arrays]
    assert len(names) == len(set(names)) and all(lives)
    n_arrays = sum(len(kind._fields) for kind in KINDS.values())
    assert len(names) == n_arrays - 3  # the cell size of the three clouds is a number


def test_a_frames_points_are_in_the_table_where_they_are(planner, rng):
    """Not copied once more, and still there when other groups were exchanged."""
    seen = njit(lambda table: view(table, "seen").points.sum())
    for n in (5, 90, 7, 40_000):  # the last needs more room than there was
        points = rng.uniform(0.2, 0.6, (n, 3))
        planner.step(points, q=HOME)
        assert seen(planner.memory.table) == pytest.approx(points.sum())
    exchange(planner.memory, {"goals": planner.memory.goals})
    assert seen(planner.memory.table) == pytest.approx(points.sum())
    planner.points[0, 0] += 100.0  # the frame's own array, not a copy
    assert seen(planner.memory.table) == pytest.approx(points.sum() + 100.0)


def test_only_an_array_as_it_is_declared_is_shown(memory):
    shows = njit(lambda table, array: show(table, "seen", 0, array))
    shows(memory.table, np.zeros((4, 3)))
    for wrong in (np.zeros((4, 3), np.float32), np.zeros(12), np.zeros((3, 4)).T):
        with pytest.raises(TypingError):
            shows(memory.table, wrong)


def test_an_answer_reads_the_counts_in_their_order():
    assert Stats._fields[:5] == ("popped", "edge_tests", "flooded", "close", "runs")
    rest = ("step", "marked", "blocks", "inside", "outside", "bad")
    assert Stats._fields[6:] == rest


def test_a_group_that_was_viewed_keeps_its_arrays_where_others_are_shown(planner):
    @njit(**LEAN | {"cache": False})
    def begins(lent):
        return lent.given[0, 0] + lent.room.shape[0]

    @njit(**LEAN | {"cache": False})
    def before_and_after(table, old, new):
        show(table, "lent", 0, old)
        lent = view(table, "lent")
        show(table, "lent", 0, new)
        return begins(lent), begins(view(table, "lent")), lent.given[0, 1]

    table = planner.memory.table.copy()
    old, new = np.full((2, 3), 1.0), np.full((2, 3), 5.0)
    first, second, number = before_and_after(table, old, new)
    assert (second - first, number) == (4.0, 1.0)
