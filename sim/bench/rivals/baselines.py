"""The competitors, on the same frames and the same roadmap, in the same run.

Both are lazy A* over the roadmap with the planner's own attachments of start and goal
and its exact cost-to-go; both try the straight motion first and remember verdicts
within a frame. They get the arm as two capsules; the planner gets its points.
"""

import numpy as np

from odm import ReactivePlanner
from odm.cell_map.cell_map import CellMap
from sim.bench.clock import Clock
from sim.bench.frames import ROUND, Pair
from sim.bench.rivals.compiled_search import CompiledSearch
from sim.bench.rivals.fcl_search import FclSearch
from sim.bench.rivals.query import Query, query_of
from sim.tables.table import value_row

FASTER_THAN_FCL, FASTER_THAN_COMPILED = 300.0, 10.0
WARM = 10  # frames before those that are timed


def compare(
    cell_map: CellMap, pairs: list[Pair], fcl_frames: int, compiled_frames: int
) -> dict:
    """Run the planner and both competitors on the same frames, spread over all pairs.

    Returns:
        "rows", and for each competitor what it does, frames found by either, and
        contacts that FCL finds on the planner's paths.
    """
    fcl = FclSearch(cell_map)
    slow = _race(cell_map, pairs, fcl_frames, fcl)
    fast = _race(cell_map, pairs, compiled_frames, CompiledSearch(cell_map))
    rows = []
    for race, name, least in (
        (slow, "lazy A* with python-fcl", FASTER_THAN_FCL),
        (fast, "lazy A* with compiled spheres", FASTER_THAN_COMPILED),
    ):
        rows.append(race["theirs"].row(name, race["what"]))
        rows.append(race["ours"].row("... the planner on the same frames"))
        for share in (50, 99):
            ratio = _ratio(race, share)
            asked = {"least": least} if share == 50 else {}
            rows.append(value_row(f"... times faster at p{share}", ratio, "", **asked))
    return {"rows": rows, "fcl": _counts(slow), "compiled": _counts(fast)}


def _race(cell_map: CellMap, pairs: list[Pair], n_frames: int, other) -> dict:  # noqa: ANN001
    planner = ReactivePlanner(cell_map, always_replan=True)
    fcl = FclSearch(cell_map)
    ours, theirs = Clock(), Clock()
    found, lengths, contacts = np.zeros((2, 2), int), [], 0
    for pair, part in _spread(pairs, n_frames):
        query = _prepare(planner, pair, other)
        # each has its frames one after the other, as a loop would, some to warm up
        warm = pair.part(slice(max(0, part.start - WARM), part.start))
        timed = pair.part(part)
        for p in warm.points():
            planner.step(p, q=pair.q_start, rounding=ROUND)
        answers = [
            ours(planner.step, p, q=pair.q_start, rounding=ROUND)
            for p in timed.points()
        ]
        for rods in warm.capsules:
            other.search(rods)
        paths = [theirs(other.search, rods) for rods in timed.capsules]
        for rods, answer, path in zip(timed.capsules, answers, paths, strict=True):
            mine, its = len(answer.path) > 0, path is not None
            found[int(mine), int(its)] += 1
            if mine and its:
                lengths.append((query.length(answer.path), query.length(path)))
            contacts += mine and not fcl.path_free(answer.path, rods)
    return {
        "ours": ours, "theirs": theirs, "found": found, "lengths": np.array(lengths),
        "contacts": contacts, "what": other.what,
    }  # fmt: skip


def _prepare(planner: ReactivePlanner, pair: Pair, other) -> Query:  # noqa: ANN001
    planner.reset()
    planner.set_goals([pair.q_goal])
    planner.step(np.zeros((0, 3)), q=pair.q_start)
    query = query_of(planner, pair)
    other.set_query(query)
    return query


def _spread(pairs: list[Pair], n_frames: int) -> list[tuple[Pair, slice]]:
    """Return (pair, frames): runs of frames spread over all pairs and their length."""
    if n_frames < len(pairs):
        pairs = [pairs[k * len(pairs) // n_frames] for k in range(n_frames)]
    run, found = max(1, n_frames // len(pairs)), []
    for k, pair in enumerate(pairs):
        first = max(0, len(pair.capsules) - WARM - run) * k // max(1, len(pairs) - 1)
        first = min(first + WARM, max(0, len(pair.capsules) - run))
        found.append((pair, slice(first, first + run)))
    return found


def _ratio(race: dict, share: int) -> float:
    """Return how many times faster the planner is, by CPU time of the thread."""
    theirs = np.percentile(race["theirs"].cpu, share)
    return float(theirs / np.percentile(race["ours"].cpu, share))


def _counts(race: dict) -> dict:
    found, lengths = race["found"], race["lengths"].reshape(-1, 2)
    ratio = float(np.median(lengths[:, 0] / lengths[:, 1])) if len(lengths) else None
    return {
        "what": race["what"],
        "frames": int(found.sum()),
        "found_by_both": int(found[1, 1]),
        "found_by_planner_only": int(found[1, 0]),
        "found_by_competitor_only": int(found[0, 1]),
        "found_by_none": int(found[0, 0]),
        "median_of_ratios_by_frame": float(
            np.median(np.array(race["theirs"].cpu) / np.array(race["ours"].cpu))
        ),
        "median_length_ratio": ratio,
        "fcl_contacts_on_our_paths": int(race["contacts"]),
    }
