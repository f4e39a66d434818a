"""The competitors, on the same frames and the same roadmap, in the same run.

Both are lazy A* over the roadmap with the planner's own attachments of start and goal
and its exact cost-to-go; both try the straight motion first and remember verdicts
within a frame. All get the arm as capsules; the planner gets samples of their surface,
too, in calls of their own.
"""

import numpy as np

from odm import Answer, ReactivePlanner
from odm.cell_map.cell_map import CellMap
from sim.bench.clock import Clock
from sim.bench.frames import Pair
from sim.bench.rivals.compiled_search import CompiledSearch
from sim.bench.rivals.fcl_search import FclSearch
from sim.bench.rivals.query import query_of
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
        rows.append(race["sampled"].row("... the planner, given samples of them"))
        mine, its = race["mine"], race["its"]
        solved = ("it", its), ("the planner", mine)
        rows += [
            value_row(f"... frames with a path, {who}", 100.0 * got.mean(), "%")
            for who, got in solved
        ]
        for share in (50, 99):
            ratio = _ratio(race, share)
            asked = {"least": least} if share == 50 else {}
            note = "where both have a path" if share == 50 else ""
            rows.append(
                value_row(f"... times faster at p{share}", ratio, "", note, **asked)
            )
    return {"rows": rows, "fcl": _counts(slow), "compiled": _counts(fast)}


def _race(cell_map: CellMap, pairs: list[Pair], n_frames: int, other) -> dict:  # noqa: ANN001
    planner = ReactivePlanner(cell_map, always_replan=True)
    attaching, fcl = ReactivePlanner(cell_map), FclSearch(cell_map)
    ours, sampled, theirs = Clock(), Clock(), Clock()
    found, lengths, contacts = [], [], 0
    for pair, part in _spread(pairs, n_frames):
        query = query_of(attaching, pair)
        other.set_query(query)
        # each has its frames one after the other, as a loop would, some to warm up
        warm = pair.part(slice(max(0, part.start - WARM), part.start))
        timed = pair.part(part)
        _answers(planner, sampled, warm, timed, shapes=False)
        answers = _answers(planner, ours, warm, timed, shapes=True)
        for rods in warm.capsules:
            other.search(rods)
        paths = [theirs(other.search, rods) for rods in timed.capsules]
        for rods, answer, path in zip(timed.capsules, answers, paths, strict=True):
            mine, its = len(answer.path) > 0, path is not None
            found.append((mine, its))
            if mine and its:
                lengths.append((query.length(answer.path), query.length(path)))
            contacts += mine and not fcl.path_free(answer.path, rods)
    mine, its = np.array(found, bool).T
    return {
        "ours": ours, "sampled": sampled, "theirs": theirs, "mine": mine, "its": its,
        "lengths": np.array(lengths), "contacts": contacts, "what": other.what,
    }  # fmt: skip


def _answers(
    planner: ReactivePlanner, clock: Clock, warm: Pair, timed: Pair, shapes: bool
) -> list[Answer]:
    """Ask a planner in all frames; time those of `timed`, and return their answers."""
    timed.begin(planner, _ask_of_nobody)
    for ask in warm.asked(shapes):
        ask(planner, warm.q_start)
    return [clock(ask, planner, timed.q_start) for ask in timed.asked(shapes)]


def _ask_of_nobody(planner: ReactivePlanner, q: np.ndarray) -> Answer:
    return planner.step(np.zeros((0, 3)), q=q)


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
    """Return how many times faster the planner is, given the same capsules.

    In the frames in which both have a path: who has none may be quick to say so, or
    slow. NaN where there are no such frames.
    """
    both = race["mine"] & race["its"]
    if not both.any():
        return float("nan")
    theirs, ours = (np.array(race[who].wall)[both] for who in ("theirs", "ours"))
    return float(np.percentile(theirs, share) / np.percentile(ours, share))


def _counts(race: dict) -> dict:
    lengths = race["lengths"].reshape(-1, 2)
    mine, its = race["mine"], race["its"]
    ratio = float(np.median(lengths[:, 0] / lengths[:, 1])) if len(lengths) else None
    return {
        "what": race["what"],
        "frames": len(mine),
        "found_by_both": int((mine & its).sum()),
        "found_by_planner_only": int((mine & ~its).sum()),
        "found_by_competitor_only": int((its & ~mine).sum()),
        "found_by_none": int((~mine & ~its).sum()),
        "median_of_ratios_by_frame": float(
            np.median(np.array(race["theirs"].wall) / np.array(race["ours"].wall))
        ),
        "median_length_ratio": ratio,
        "fcl_contacts_on_our_paths": int(race["contacts"]),
    }
