"""`odm bench odm-paper`: the experiment of the obstacle direct mapping paper, again.

Source: K. Liu et al., "Obstacle Direct Mapping" (2005), sections II to V. Its tables
are lost to us, so the sweep is our own: random and deterministic roadmaps of the three
gross-motion joints of a Kawasaki FS003N in the whole configuration space, a human arm
of two cylinders in motion, cells of 2 to 5 cm.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from odm import build_map, load_recipe
from odm.build import robot_of
from odm.cell_map import CellMap
from odm.recipe import Recipe
from sim.bench.clock import value_row
from sim.bench.frames import RATE_HZ, Pair, make_pairs
from sim.bench.header import header
from sim.bench.paper_arm import CylinderPair, Region, cells_of
from sim.bench.paper_edges import EdgeRule, edge_rule, words_of
from sim.bench.paper_rows import (
    SHORT,
    Audit,
    Race,
    Sizes,
    audit,
    race,
    seconds,
    update_times,
)
from sim.bench.paper_tables import tables

RECIPE = "kawasaki_fs003n_gross"
NODES, CELLS_CM = (1000, 2000, 4000, 8000), (2, 3, 4, 5)
SAMPLINGS = {"uniform": "random", "grid": "grid"}  # ours: the paper's word
FIGURE = (4000, "uniform", 3)  # nodes, sampling, cells [cm]: the row of the figures
FRAME_US, FASTER = 10.0, 300.0  # asked of it
SPACINGS = (0.02, 0.03, 0.04, 0.05, 0.08, 0.12, 0.17, 0.24, 0.34)  # [m]
FIGURE_SIZES = Sizes(pairs=60, frames=100, fcl_frames=120)


def run(
    *,
    nodes: Sequence[int] | None = None,
    cells: Sequence[int] | None = None,
    seed: int = 1,
    short: bool = False,
    plot: str | Path | None = None,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Build every map of the sweep, measure it and forget it.

    Args:
        nodes: Sizes of the roadmaps; None: 1 000, 2 000, 4 000, 8 000.
        cells: Sides of the cells [cm]; None: 2, 3, 4, 5.
        seed: Of roadmaps, queries and the arm's motion.
        short: Two small maps and few frames: to see that it runs, not to measure.
        plot: PNG file to draw the figures to.
        tell: Called with the name of each map before it is built.

    Returns:
        Plain data for JSON: "header", "setup", "rows" (the figures), "sweep" (a row
        for each map), "uninflated", "edge_rule" and "tables" (as they are printed).
    """
    nodes, cells = tuple(nodes or NODES), tuple(cells or CELLS_CM)
    sizes, figure_sizes = Sizes(), FIGURE_SIZES
    if short:
        nodes, cells, sizes = (150,), (5,), SHORT
        figure_sizes = SHORT
    figure = FIGURE if FIGURE[0] in nodes and FIGURE[2] in cells else None
    figure = figure or (nodes[-1], "uniform", cells[0])
    tell = tell or (lambda text: None)
    bench = _Bench(seed, sizes, figure, figure_sizes)
    for h_cm in cells:
        for n in nodes:
            for sampling in SAMPLINGS:
                tell(f"{n} nodes, {SAMPLINGS[sampling]}, {h_cm} cm")
                bench.measure(n, sampling, h_cm)
    result = bench.result(nodes, cells)
    if plot is not None:
        from sim.bench.paper_plot import write_plot

        write_plot(result, plot)
    return result


class _Bench:
    def __init__(
        self, seed: int, sizes: Sizes, figure: tuple, figure_sizes: Sizes
    ) -> None:
        self.recipe = load_recipe(RECIPE)
        self.robot = robot_of(self.recipe)
        self.seed, self.sizes = seed, sizes
        self.figure, self.figure_sizes = figure, figure_sizes
        self.pairs: list[Pair] = []
        self.sweep: list[dict] = []
        self.audits: dict[int, list[Audit]] = {}
        self.rules: dict[int, EdgeRule] = {}
        self.best: tuple[Race, dict] | None = None

    def measure(self, n: int, sampling: str, h_cm: int) -> None:
        recipe = paper_recipe(self.recipe, n, sampling, 0.01 * h_cm, self.seed)
        built, took = seconds(lambda: build_map(recipe, robot=self.robot))
        if not self.pairs:
            most = (self.sizes, self.figure_sizes)
            pairs, frames = (max(getattr(s, k) for s in most) for k in _DRAWN)
            self.pairs = make_pairs(built, pairs, frames, self.seed)
        rho, is_figure = built.safety.rho, (n, sampling, h_cm) == self.figure
        asked = self.figure_sizes if is_figure else self.sizes
        pairs = [CylinderPair.of(p, rho) for p in _thinned(self.pairs, asked)]
        times = update_times(built, pairs[: self.sizes.pairs])
        raced = race(built, pairs, asked.fcl_frames)
        rods = np.concatenate([p.capsules for p in pairs])
        k = np.linspace(0, len(rods) - 1, self.sizes.audit_frames).astype(int)
        found = audit(built, rods[k], SPACINGS, self.sizes.audit_edges, self.seed)
        self.audits.setdefault(h_cm, []).append(found)
        if n == self.figure[0] and sampling == self.figure[1]:
            self.rules[h_cm] = self._rule(built, rods[k])
        self.sweep.append(
            {"nodes": n, "sampling": SAMPLINGS[sampling], "cell_cm": h_cm}
            | _map_facts(built, took) | _audit_facts(found)
            | _time_facts(times, raced)
        )  # fmt: skip
        if is_figure:
            self.best = raced, header(built)

    def _rule(self, built: CellMap, rods: np.ndarray) -> EdgeRule:
        region, occupied = Region(built.grid), []
        for arm in rods:
            job = region.prepare(arm)
            region.expand(job)
            cells = cells_of(region.centers(job), built.grid)
            occupied.append(words_of(cells, built))
        return edge_rule(built, np.array(occupied), self.sizes.rule_edges, self.seed)

    def result(self, nodes: tuple, cells: tuple) -> dict:
        raced, head = self.best
        uninflated = [_by_spacing(h, found) for h, found in self.audits.items()]
        rules = [{"cell_cm": h} | vars(rule) for h, rule in self.rules.items()]
        result = {
            "bench": "odm-paper",
            "header": head,
            "setup": self._setup(nodes, cells),
            "rows": _figure_rows(self.figure, raced, self.sweep),
            "sweep": self.sweep,
            "uninflated": uninflated,
            "edge_rule": rules,
        }
        return result | {"tables": tables(result)}

    def _setup(self, nodes: tuple, cells: tuple) -> dict:
        n, sampling, h_cm = self.figure
        safety = self.recipe.safety
        return {
            "recipe": f"{RECIPE}, in the whole configuration space",
            "nodes": ", ".join(map(str, nodes)),
            "cells": ", ".join(f"{h} cm" for h in cells),
            "figures": f"{n} nodes, {SAMPLINGS[sampling]}, {h_cm} cm",
            "frames of the figures": len(self.best[0].vertices),
            "arm": "two cylinders, 0.30 m r 0.05 and 0.43 m r 0.04, up to 1 m/s, "
            f"{RATE_HZ:g} Hz",
            "covering radius, clearance m, mu": f"{100 * safety.rho:g}, "
            f"{100 * safety.m:g}, {100 * safety.mu:g} cm",
            "start and goal": "the tool on either side of the arm, exactly free in "
            "every frame",
            "seed": self.seed,
        }


_DRAWN = ("pairs", "frames")


def paper_recipe(
    recipe: Recipe, nodes: int, sampling: str, h: float, seed: int
) -> Recipe:
    """Return the recipe of a map of the sweep: the whole configuration space."""
    roadmap = replace(
        recipe.roadmap, nodes=nodes, sampling=sampling, seed=seed, region=None
    )
    name = f"odm_paper_{nodes}_{sampling}_{round(1000 * h)}"
    safety = replace(recipe.safety, h=h)
    return replace(recipe, name=name, roadmap=roadmap, safety=safety)


def _thinned(pairs: list[Pair], sizes: Sizes) -> list[Pair]:
    """Return as many pairs and frames as asked, spread over what was drawn."""
    k = np.linspace(0, len(pairs) - 1, min(sizes.pairs, len(pairs))).astype(int)
    return [pairs[i].part(slice(0, sizes.frames)) for i in k]


def _map_facts(built: CellMap, took: float) -> dict:
    by_edges, by_blocks = built.arm_cells.bytes_by_view()
    return {
        "kept_nodes": built.roadmap.n_nodes,
        "edges": built.roadmap.n_edges,
        "build_cpu_s": round(took, 2),
        "edge_major_bytes": by_edges,
        "direct_bytes": by_blocks,
    }


def _audit_facts(found: Audit) -> dict:
    nodes, edges = np.array(found.nodes), np.array(found.edges)
    ways = ("whole", "surface", "dense")
    counts = {f"cells_{w}": float(np.mean(getattr(found, w))) for w in ways}
    counts |= {f"nodes_{w}": float(nodes[:, k].mean()) for k, w in enumerate(ways)}
    counts |= {f"edges_{w}": float(edges[:, k].mean()) for k, w in enumerate(ways)}
    return counts | {
        "asked": found.asked,
        "contacts": found.contacts,
        "contacts_missed": found.missed,
        "within_m": found.near,
        "within_m_missed": found.near_missed,
    }


def _time_facts(times: dict, raced: Race) -> dict:
    facts = {f"{n}_us": float(np.median(c.cpu)) * 1e-3 for n, c in times.items()}
    frame, fcl = (1e-3 * np.array(c.cpu, float) for c in (raced.ours, raced.theirs))
    wall = 1e-3 * np.array(raced.ours.wall, float)
    straight = raced.vertices == 2
    facts |= {
        "frame_us": _percentiles(wall),
        "frame_cpu_us": _percentiles(frame),
        "fcl_cpu_us": _percentiles(fcl),
        "times_faster": _ratio(raced),
        "frames": len(wall),
        "frames_blocked_straight": int((~straight).sum()),
        "frames_without_path": int((raced.vertices == 0).sum()),
        "found": raced.found.tolist(),
        "fcl_contacts_on_our_paths": raced.touching,
    }
    return facts


def _percentiles(values: np.ndarray) -> dict | None:
    if not len(values):
        return None
    p50, p99 = np.percentile(values, [50, 99])
    return {"p50": float(p50), "p99": float(p99), "max": float(values.max())}


def _ratio(raced: Race) -> float:
    """Return how many times faster the same frames are, by median CPU time."""
    return float(np.median(raced.theirs.cpu) / np.median(raced.same.cpu))


def _by_spacing(h_cm: int, found: list[Audit]) -> dict:
    contacts = sum(a.on_nodes for a in found)
    missed = {s: sum(a.uninflated[s] for a in found) for s in SPACINGS}
    shares = {f"{s:g}": n / contacts if contacts else None for s, n in missed.items()}
    counts = {f"{s:g}": n for s, n in missed.items()}
    return {"cell_cm": h_cm, "contacts": contacts, "missed": counts, "share": shares}


def _figure_rows(figure: tuple, raced: Race, sweep: list[dict]) -> list[dict]:
    blocked = raced.vertices != 2
    missed = sum(row["contacts_missed"] for row in sweep)
    near = sum(row["within_m_missed"] for row in sweep)
    contacts = sum(row["contacts"] for row in sweep)
    stages = 1e6 * np.median(raced.stages, axis=0)
    tests = np.median(raced.work, axis=0)
    note = (
        f"of the median frame, occupancy of the points takes {stages[0]:.1f} us, the "
        f"search {stages[1]:.1f} us: {tests[0]:.0f} cell lists compared, "
        f"{tests[1]:.0f} close tests"
    )
    lost = raced.vertices == 0
    share = 100.0 * float(blocked.mean())
    return [
        raced.ours.row("points to path", note, p50=FRAME_US),
        raced.ours.row("... straight motion blocked", "", blocked & ~lost),
        raced.ours.row("... straight motion free", "", ~blocked),
        raced.ours.row("... no path", "", lost),
        value_row("frames with the straight motion blocked", share, "%"),
        value_row("frames without a path", 100.0 * float(lost.mean()), "%"),
        raced.theirs.row("A* with online python-fcl", _what()),
        value_row("... times faster at p50", _ratio(raced), "", least=FASTER),
        value_row("... contacts it finds on our paths", raced.touching, "", most=0),
        value_row("exact contacts found, all maps", contacts, ""),
        value_row("... missed by the surface's cells", missed, "", most=0),
        value_row("... or within the clearance m", near, "", most=0),
    ]


def _what() -> str:
    from sim.bench.paper_rows import PaperFcl

    return PaperFcl.what
