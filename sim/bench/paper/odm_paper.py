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
from odm.cell_map.build import robot_of
from odm.cell_map.cell_map import CellMap
from odm.cell_map.recipe import Recipe
from sim.bench.frames import RATE_HZ, Pair, make_pairs
from sim.bench.paper.paper_arm import CylinderPair, Region, cells_of
from sim.bench.paper.paper_edges import EdgeRule, edge_rule, words_of
from sim.bench.paper.paper_facts import (
    audit_facts,
    by_spacing,
    figure_rows,
    map_facts,
    time_facts,
)
from sim.bench.paper.paper_rows import (
    SHORT,
    Audit,
    Race,
    Sizes,
    audit,
    race,
    seconds,
    update_times,
)
from sim.bench.paper.paper_tables import tables
from sim.tables.header import header

RECIPE = "kawasaki_fs003n_gross"
NODES, CELLS_CM = (1000, 2000, 4000, 8000), (2, 3, 4, 5)
SAMPLINGS = {"uniform": "random", "grid": "grid"}  # ours: the paper's word
FIGURE = (4000, "uniform", 3)  # nodes, sampling, cells [cm]: the row of the figures
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
        from sim.bench.paper.paper_plot import write_plot

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
        self.rules: list[dict] = []
        self.best: tuple[Race, Race, dict] | None = None

    def measure(self, n: int, sampling: str, h_cm: int) -> None:
        recipe = paper_recipe(self.recipe, n, sampling, 0.01 * h_cm, self.seed)
        built, took = seconds(lambda: build_map(recipe, robot=self.robot))
        is_figure = (n, sampling, h_cm) == self.figure
        if not self.pairs:
            self.pairs = self._drawn(built, sided=False)
        asked = self.figure_sizes if is_figure else self.sizes
        pairs = _thinned(self.pairs, asked, built.safety.rho)
        times = update_times(built, pairs[: self.sizes.pairs])
        raced = race(built, pairs, asked.fcl_frames)
        rods = np.concatenate([p.capsules for p in pairs])
        k = np.linspace(0, len(rods) - 1, self.sizes.audit_frames).astype(int)
        found = audit(built, rods[k], SPACINGS, self.sizes.audit_edges, self.seed)
        self.audits.setdefault(h_cm, []).append(found)
        if sampling == self.figure[1]:
            rule = {"cell_cm": h_cm, "nodes": n}
            self.rules.append(rule | vars(self._rule(built, rods[k])))
        self.sweep.append(
            {"nodes": n, "sampling": SAMPLINGS[sampling], "cell_cm": h_cm}
            | map_facts(built, took) | audit_facts(found)
            | time_facts(times, raced)
        )  # fmt: skip
        if is_figure:
            across = self._drawn(built, sided=True)
            across = _thinned(across, asked, built.safety.rho)
            across = race(built, across, asked.fcl_frames)
            self.best = raced, across, header(built)

    def _drawn(self, built: CellMap, sided: bool) -> list[Pair]:
        most = (self.sizes, self.figure_sizes)
        pairs, frames = (max(getattr(s, k) for s in most) for k in _DRAWN)
        return make_pairs(built, pairs, frames, self.seed, sided=sided)

    def _rule(self, built: CellMap, rods: np.ndarray) -> EdgeRule:
        region, occupied = Region(built.grid), []
        for arm in rods:
            job = region.prepare(arm)
            region.expand(job)
            cells = cells_of(region.centers(job), built.grid)
            occupied.append(words_of(cells, built))
        return edge_rule(built, np.array(occupied), self.sizes.rule_edges, self.seed)

    def result(self, nodes: tuple, cells: tuple) -> dict:
        raced, across, head = self.best
        uninflated = [by_spacing(SPACINGS, *item) for item in self.audits.items()]
        result = {
            "bench": "odm-paper",
            "header": head,
            "setup": self._setup(nodes, cells),
            "rows": figure_rows(raced, across, self.sweep),
            "sweep": self.sweep,
            "uninflated": uninflated,
            "edge_rule": self.rules,
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
            "start and goal": "any valid configurations that are exactly free in every "
            "frame; across the arm: the tool on either side of it",
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


def _thinned(pairs: list[Pair], sizes: Sizes, rho: float) -> list[CylinderPair]:
    """Return as many pairs and frames as asked, spread over what was drawn."""
    k = np.linspace(0, len(pairs) - 1, min(sizes.pairs, len(pairs))).astype(int)
    parts = [pairs[i].part(slice(0, sizes.frames)) for i in k]
    return [CylinderPair.of(part, rho) for part in parts]
