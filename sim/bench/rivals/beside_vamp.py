"""VAMP on the planner's frames, in turn on one core, where `import vamp` works.

Everyone has a pair's frames one after the other, as a loop would, then the next one
has. Of each frame the least of some passes counts, so that what else the machine did
meanwhile does not.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from odm import ReactivePlanner
from odm.cell_map.cell_map import CellMap
from odm.exact.distances import ExactRobot
from sim.bench.clock import Clock, time_row
from sim.bench.frames import Pair, all_keep
from sim.bench.rivals.lengths import first_and_improved
from sim.bench.rivals.ompl import length
from sim.bench.rivals.peer_cases import Case, Frame
from sim.bench.rivals.peer_vamp import Vamp, VampMissing
from sim.tables.table import value_row

PASSES = 3
LENGTHS_EVERY = 50  # frames between two whose paths' lengths are compared
_PLACES = 40  # of each leg of VAMP's paths that are looked at
# times faster than VAMP simplified; than VAMP raw and its check, at each share
FASTER, AHEAD = {50: 5.0, 99: 2.5}, 1.0
_OURS, _OURS_KEPT = "every frame replanned", "path kept while it is free"
_SIMPLIFIED, _RAW = "VAMP simplified", "VAMP raw"
_CHECK = "VAMP's path kept"  # checked, and planned anew where that fails


def beside_vamp(cell_map: CellMap, drawn: list[Pair], across: list[Pair]) -> list:
    """Time our planner and VAMP on the same frames.

    Args:
        cell_map: The map of the robot.
        drawn: Pairs of which is asked what is asked.
        across: Pairs in most of whose frames the straight motion is blocked.

    Returns:
        Rows; a single one that says so where VAMP is not installed or knows no such
        robot.
    """
    source = cell_map.recipe.robot.source
    try:
        raw, simplified = Vamp(source, False), Vamp(source, True)
    except VampMissing as error:
        return [value_row(f"beside VAMP: {error}", np.nan, "", "see docs/peers.md")]
    planners = [ReactivePlanner(cell_map, always) for always in (True, False)]
    runners = {
        _OURS: lambda pair, clock: _ours(planners[0], pair, clock),
        _SIMPLIFIED: lambda pair, clock: _theirs(simplified, pair, clock),
        _RAW: lambda pair, clock: _theirs(raw, pair, clock),
        _OURS_KEPT: lambda pair, clock: _ours(planners[1], pair, clock),
        _CHECK: lambda pair, clock: _theirs(simplified, pair, clock, keeps=True),
    }
    these, others = _least(runners, drawn), _least(runners, across)
    rows = _rows("these frames", these, asks=True) + _lengths(
        planners[1], simplified, drawn, asks=True
    )
    rows += _rows("straight motion blocked", others, asks=False)
    return rows + _lengths(planners[1], simplified, across, asks=False)


def _lengths(
    planner: ReactivePlanner, vamp: Vamp, pairs: list[Pair], asks: bool
) -> list:
    """Return rows of the lengths of paths: the first, the improved, VAMP's [rad]."""
    cell_map, found = planner.cell_map, []
    exact, m = ExactRobot(cell_map.robot), cell_map.safety.m
    for pair in pairs:
        for k in range(0, len(pair.capsules), LENGTHS_EVERY):
            rods = pair.capsules[k]
            vamp.begin(Case("", pair.q_start, pair.q_goal, (Frame(rods),), ()))
            path = vamp.path(Frame(rods))
            if path is None:
                continue
            places = np.concatenate([
                a + np.linspace(0.0, 1.0, _PLACES)[:, None] * (b - a)
                for a, b in pairwise(path)
            ])  # fmt: skip
            ours = first_and_improved(planner, pair, k)
            keeps = all_keep(exact, places, rods, m)
            found.append((*ours, length(path), keeps))
    lengths = np.array([row for row in found if row[0] > 0.0]).reshape(-1, 4)
    first, improved, its = np.median(lengths[:, :3], axis=0)
    ratio = round(float(np.median(lengths[:, 1] / lengths[:, 2])), 6)
    note = f"medians of {len(lengths)} frames, rad; improve until 200 us are spent"
    name = "... path length"
    return [
        value_row(f"{name}: first answer", first, "", note),
        value_row(f"{name}: improved", improved, ""),
        value_row(f"{name}: {_SIMPLIFIED}", its, ""),
        value_row(f"{name}: improved, median ratio to {_SIMPLIFIED}", ratio, "",
                  most=1.0 if asks else None),
        value_row(f"... frames in which {_SIMPLIFIED} keeps m by exact geometry",
                  100.0 * lengths[:, 3].mean(), "%"),
    ]  # fmt: skip


class Told(NamedTuple):
    """What came of everyone's frames, by name.

    Attributes:
        times: (n,) the least time of each frame [us].
        solved: (n,) whether it had a path in every pass.
    """

    times: dict[str, np.ndarray]
    solved: dict[str, np.ndarray]


def _least(runners: dict[str, Callable], pairs: list[Pair]) -> Told:
    """Ask everyone for all frames, in turn, PASSES times."""
    best: dict[str, np.ndarray] = {}
    solved: dict[str, np.ndarray] = {}
    for _ in range(PASSES):
        clocks = {name: Clock() for name in runners}
        found: dict[str, list[bool]] = {name: [] for name in runners}
        for pair in pairs:
            for name, run in runners.items():
                found[name] += run(pair, clocks[name])
        for name, clock in clocks.items():
            times, got = 1e-3 * np.array(clock.wall, float), np.array(found[name], bool)
            best[name] = np.minimum(times, best.get(name, times))
            solved[name] = got & solved.get(name, got)
    return Told(best, solved)


def _rows(what: str, told: Told, asks: bool) -> list:
    times, solved = told
    head, note = f"beside VAMP, {what}", f"in turn, the least of {PASSES} passes"
    rows = [time_row(f"{head}: {_OURS}", note, times[_OURS], None)]
    rows += [time_row(f"... {name}", "", times[name], None) for name in times
             if name != _OURS]  # fmt: skip
    rows += [
        value_row(f"... frames with a path: {name}", 100.0 * got.mean(), "%")
        for name, got in solved.items()
    ]
    note = "in the frames in which both have a path"
    # at p95, too, where a path is kept
    faster = [(_OURS, _SIMPLIFIED, share, least) for share, least in FASTER.items()]
    faster += [(_OURS, _RAW, share, AHEAD) for share in FASTER]
    faster += [(_OURS_KEPT, _CHECK, share, AHEAD) for share in (50, 95, 99)]
    for ours, theirs, share, least in faster:
        both, ratio = solved[ours] & solved[theirs], np.nan
        if both.any():
            it, mine = (
                np.percentile(times[who][both], share) for who in (theirs, ours)
            )
            ratio = it / mine
        name = f"... {ours}: times faster than {theirs}, p{share}"
        rows.append(value_row(name, ratio, "", note, least=least if asks else None))
        note = ""
    return rows


def _ours(planner: ReactivePlanner, pair: Pair, clock: Clock) -> list[bool]:
    """Time the frames of a pair; return in which of them there was a path."""
    frames = pair.asked()
    pair.begin(planner, frames[0])
    return [len(clock(ask, planner, pair.q_start).path) > 0 for ask in frames]


def _theirs(vamp: Vamp, pair: Pair, clock: Clock, keeps: bool = False) -> list[bool]:
    """Time the frames of a pair; return in which of them there was a path."""
    frames = [Frame(rods) for rods in pair.capsules]
    vamp.begin(Case("", pair.q_start, pair.q_goal, tuple(frames), ()))
    path, found = vamp.planned(vamp.world(frames[0])), []
    for frame in frames:
        path = clock(_answer, vamp, frame, path if keeps else None)
        found.append(path is not None)
    return found


def _answer(vamp: Vamp, frame: Frame, path: object | None) -> object | None:
    """Return a path in this frame: the one before, if that is still free."""
    world = vamp.world(frame)
    if path is not None and path.validate(world):
        return path
    return vamp.planned(world)
