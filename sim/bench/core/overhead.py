"""`odm bench overhead`: how much farther than m an arm already blocks, term by term."""

from collections.abc import Callable
from pathlib import Path

from odm import load_map
from odm.audit.clearance import ClearanceOverhead, clearance_overhead
from sim.tables.header import header
from sim.tables.table import value_row

# asked of the means [cm]: of points, and of shapes
BY_CELLS, BY_CLOSE_TEST, BY_SHAPE_CELLS, BY_SHAPES = 9.0, 5.0, 6.0, 1.6
NOTES = {
    "cover": "the spheres stick out of the solids",
    "rho": "a sample stands for the surface around it",
    "cells": "a sample blocks its whole cell",
    "mu": "a piece of an edge is inflated; edges only",
}
SHARES = (("mean", 0), ("p95", 2))  # of what `ClearanceOverhead` holds


def run(
    map_dir: str | Path,
    *,
    lines: int = 4000,
    edge_lines: int = 800,
    seed: int = 0,
    short: bool = False,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Measure what `odm.audit.clearance.ClearanceOverhead` explains.

    Args:
        map_dir: Folder of a built map.
        lines: Approaches of the arm to nodes.
        edge_lines: Approaches to edges, which take longer.
        seed: Of nodes, edges, lines and arms.
        short: Few approaches: to see that it runs, not to measure.
        tell: Called with what is measured.

    Returns:
        Plain data for JSON: "header", "setup" and "rows", in centimetres.
    """
    if short:
        lines, edge_lines = min(lines, 100), min(edge_lines, 20)
    cell_map = load_map(map_dir, verify=False)
    (tell or (lambda text: None))(f"{lines} approaches to nodes, {edge_lines} to edges")
    found = clearance_overhead(cell_map, lines, seed, edge_lines)
    setup = {
        "approaches to nodes": found.lines,
        "approaches to edges": found.edge_lines,
        "seed": seed,
        "clearance m, no overhead itself": f"{100 * found.m:g} cm",
    }
    return {
        "bench": "overhead",
        "header": header(cell_map),
        "setup": setup,
        "rows": _rows(found),
    }


def _rows(found: ClearanceOverhead) -> list[dict]:
    """Return mean and 95 % of each way to ask, then of each term [cm]."""
    rows = []
    for where, prefix in (("nodes", ""), ("edges", "edge_")):
        for name, part, most in (
            ("cells of points", "by_cells", BY_CELLS),
            ("close test of points", "by_close_test", BY_CLOSE_TEST),
            ("cells of shapes", "by_shape_cells", BY_SHAPE_CELLS),
            ("close test of shapes", "by_shapes", BY_SHAPES),
        ):
            rows += _pair(f"{where}, {name}", getattr(found, prefix + part), most=most)
    for term, value in found.terms.items():
        rows += _pair(f"term {term}", value, NOTES[term])
    return rows


def _pair(
    name: str, value: tuple[float, ...], note: str = "", most: float | None = None
) -> list[dict]:
    """Return the rows of one figure; the bound is on its mean."""
    bounds = {"mean": most, "p95": None}
    return [
        value_row(
            f"{name}: {share}", 100 * value[at], "cm", note * (at == 0), bounds[share]
        )
        for share, at in SHARES
    ]
