"""The output of `odm info` and `odm audit`, as plain data and as tables."""

from typing import TYPE_CHECKING

import numpy as np

from odm import CellMap
from odm.audit.clearance import clearance_overhead
from roadmap.builds.chunks import Progress
from roadmap.geometry.spheres import cover_report
from sim.tables.fitted import Fitted, table_of
from sim.terminal.output import bytes_text, counted

if TYPE_CHECKING:
    from odm.audit.audit import AuditReport
    from odm.audit.sequence_audit import SequenceReport


MOST_PAIRS, MOST_LINKS = 12, 24  # told one by one; a humanoid has hundreds
LINES, EDGE_LINES = 120, 24  # approaches: a quick look, no measurement


def facts(
    cell_map: CellMap, tell: Progress | None = None, with_overhead: bool = True
) -> dict:
    """Return everything `odm info` says about a map, as plain JSON data.

    The clearance overhead is measured `with_overhead`; else it is None.
    """
    tell = tell or (lambda *_: None)
    overhead = _overhead_facts(cell_map, tell) if with_overhead else None
    robot, roadmap = cell_map.robot, cell_map.roadmap
    edge_major, block_major = cell_map.arm_cells.bytes_by_view()
    n_edges = max(1, roadmap.n_edges)
    lengths = roadmap.lengths if roadmap.n_edges else np.zeros(1)
    cells = np.bitwise_count(cell_map.arm_cells.by_item.mask)
    return {
        "name": cell_map.recipe.name,
        "hash": cell_map.hash,
        "robot": _robot_facts(cell_map),
        "roadmap": {
            "nodes": roadmap.n_nodes,
            "edges": roadmap.n_edges,
            "neighbors_mean": round(2 * roadmap.n_edges / roadmap.n_nodes, 2),
            "edge_length_mean": _rounded(lengths.mean()),
            "edge_length_max": _rounded(lengths.max()),
        },
        "cells": {
            "grid": [int(n) for n in 4 * cell_map.grid.blocks],
            "lower_corner": _rounded(cell_map.grid.origin),
            "upper_corner": _rounded(cell_map.grid.upper),
            "cells_per_entry": _rounded(cells.mean()),
            "entries_per_item": _rounded(len(cells) / (roadmap.n_nodes + n_edges)),
        },
        "bytes": {
            "edge_major": edge_major,
            "block_major": block_major,
            "edge_major_per_edge": round(edge_major / n_edges, 1),
            "block_major_per_edge": round(block_major / n_edges, 1),
        },
        "safety": cell_map.safety.as_dict(),
        "clearance_overhead": overhead,
        "cover": [vars(row) for row in cover_report(robot)],
        "self_pairs": len(robot.self_pairs),
        "dropped_pairs": [list(pair) for pair in robot.dropped_pairs],
        "notes": list(robot.notes),
        "scenery": cell_map.scenery.meta()
        | {"mesh_points": len(cell_map.scenery.points)},
        "payload": _payload_facts(cell_map),
        "built": cell_map.built,
    }


def _payload_facts(cell_map: CellMap) -> dict | None:
    """Return what may be carried, None where the map has no payload layer."""
    layer, n = cell_map.payload, cell_map.roadmap.n_nodes
    if layer is None:
        return None
    return {
        "envelope": layer.recipe.as_dict(),
        "spheres": len(layer.spheres),
        "bytes": sum(a.nbytes for a in layer.arrays().values()),
        "closed_nodes": int(layer.closed[:n].sum()),
        "closed_edges": int(layer.closed[n:].sum()),
    }


def _robot_facts(cell_map: CellMap) -> dict:
    robot = cell_map.robot
    names = ("lower", "upper", "max_velocity", "max_acceleration", "max_jerk")
    columns = {name: _rounded(getattr(robot, name)) for name in names}
    return {
        "name": robot.name,
        "source": robot.source,
        "tip": robot.tip_name,
        "joints": list(robot.joint_names),
        "continuous": [bool(c) for c in robot.continuous],
        **columns,
        "spheres": len(robot.spheres),
        "moving_spheres": int(robot.moving.sum()),
        "links": list(robot.link_names),
        "fingerprint": robot.fingerprint(),
    }


def _overhead_facts(cell_map: CellMap, tell: Progress) -> dict:
    """Return mean and 95 % of each term and in all [m], None without approaches."""
    tell("clearance overhead", 0, 1)
    overhead = clearance_overhead(cell_map, LINES, n_edges=EDGE_LINES)
    tell("clearance overhead", 1, 1)
    whole = {
        "nodes, cells": overhead.by_cells,
        "nodes, close test": overhead.by_close_test,
        "nodes, cells of shapes": overhead.by_shape_cells,
        "nodes, close test of shapes": overhead.by_shapes,
        "edges, cells": overhead.edge_by_cells,
        "edges, close test": overhead.edge_by_close_test,
        "edges, cells of shapes": overhead.edge_by_shape_cells,
        "edges, close test of shapes": overhead.edge_by_shapes,
    }
    rows = {**overhead.terms, **whole}
    return {
        "lines": overhead.lines,
        "edge_lines": overhead.edge_lines,
        **{
            name: {
                share: None if np.isnan(value[at]) else _rounded(value[at])
                for share, at in (("mean", 0), ("p95", 2))
            }
            for name, value in rows.items()
        },
    }


def _rounded(value: float | np.ndarray) -> float | list:
    return np.round(np.asarray(value, float), 6).tolist()


def show(facts: dict) -> None:
    """Print what `facts` returned."""
    from rich.console import Console

    console = Console(highlight=False)
    robot, roadmap, size = facts["robot"], facts["roadmap"], facts["bytes"]
    console.print(
        f"[bold]{facts['name']}[/]  map {facts['hash'][:12]}, robot {robot['name']} "
        f"from {robot['source']}, tool {robot['tip']}"
    )
    console.print(
        f"{counted(roadmap['nodes'], 'node')}, {counted(roadmap['edges'], 'edge')}, "
        f"{roadmap['neighbors_mean']} neighbours a node; bytes per edge: "
        f"{size['edge_major_per_edge']:.0f} edge-major, on disk and in memory, and "
        f"{size['block_major_per_edge']:.0f} block-major, derived in memory "
        f"({bytes_text(size['edge_major'])} and {bytes_text(size['block_major'])})"
    )
    grid = " x ".join(map(str, facts["cells"]["grid"]))
    low, high = facts["cells"]["lower_corner"], facts["cells"]["upper_corner"]
    console.print(f"grid of {grid} cells from {low} to {high} m")
    console.print(_safety_table(facts["safety"]))
    if facts["clearance_overhead"] is None:
        what = (
            "[bold]Clearance overhead[/]: not measured; --overhead takes a quick look"
        )
        console.print(what)
    else:
        console.print(_overhead_table(facts["clearance_overhead"]))
    console.print(_joint_table(robot))
    console.print(_cover_table(facts["cover"]))
    _show_lists(console, facts)


def _show_lists(console: object, facts: dict) -> None:
    console.print(
        f"[bold]Self-collision[/]: {facts['self_pairs']} pairs of links tested"
    )
    for line in pair_lines(facts["dropped_pairs"]):
        console.print(f"  not tested: {line}", soft_wrap=True)
    for note in folded(facts["notes"]):
        console.print(f"[bold]Note[/]: {note}", soft_wrap=True)
    scenery, built = facts["scenery"], facts["built"]
    names = ", ".join(scenery["names"]) or "none"
    console.print(f"[bold]Scenery[/]: {names}; {scenery['mesh_points']} mesh points")
    for link, solid in scenery["dropped"]:
        console.print(f"  not tested: {link} and {solid}, always in contact")
    held = facts["payload"]
    if held is not None:
        shape = ", ".join(f"{k} {v}" for k, v in held["envelope"].items())
        console.print(
            f"[bold]Payload[/]: {shape} (tool frame); {bytes_text(held['bytes'])}, "
            f"{held['closed_edges']} edges closed by arm and scenery",
            soft_wrap=True,
        )
    versions = ", ".join(f"{k} {v}" for k, v in built.get("versions", {}).items())
    parts = built.get("n_components", 1)
    kept = f"the largest of {parts} components was kept; " if parts != 1 else ""
    console.print(
        f"[bold]Built[/] in {built.get('seconds')} s from {built.get('drawn')} drawn "
        f"configurations, {built.get('free_edges')} of {built.get('candidate_edges')} "
        f"edges free; {kept}{versions}",
        soft_wrap=True,
    )
    if "plot" in facts:
        console.print(f"plot: {facts['plot']}", soft_wrap=True)


def pair_lines(pairs: list[list[str]]) -> list[str]:
    """Return a line for each pair of links, or one for many of the same reason."""
    reasons: dict[str, list[str]] = {}
    for a, b, reason in pairs:
        reasons.setdefault(reason, []).append(f"{a} and {b}")
    lines = []
    for reason, found in reasons.items():
        if len(found) > MOST_PAIRS:
            found = [f"{len(found)} pairs such as {found[0]} (--json lists them all)"]
        lines += [f"{pair}, {reason}" for pair in found]
    return lines


def folded(notes: list[str]) -> list[str]:
    """Return the notes, what is said of many links or joints in one line."""
    of: dict[str, list[str]] = {}
    for note in notes:
        name, mark, rest = note.partition(": ")
        name, rest = (name, rest) if mark and " " not in name else ("", note)
        of.setdefault(rest, []).append(name)
    return [
        f"{', '.join(names)}: {rest}" if names[0] else rest
        for rest, names in of.items()
    ]


def _safety_table(safety: dict[str, float]) -> Fitted:
    means = {
        "h": "side of a cell",
        "rho": "largest covering radius of an obstacle's samples",
        "m": "clearance kept beyond contact, the sum of",
        "sensor": "  sensor error",
        "tracking": "  tracking error",
        "blending": "  corners cut between motions",
        "user": "  the user's own",
        "mu": "motion bound: a piece is inflated by at most mu / 2",
    }
    rows = ((key, told, f"{1000 * safety[key]:.1f}") for key, told in means.items())
    return table_of("Safety terms", ("term", "meaning", "mm"), rows, left=(0, 1))


def _overhead_table(overhead: dict) -> Fitted:
    means = {
        "cover": "spheres stick out of the solids",
        "rho": "a sample stands for the surface around it",
        "cells": "a sample blocks its whole cell",
        "mu": "a piece of an edge is inflated",
        "nodes, cells": "in all, on nodes",
        "nodes, close test": "without the cells",
        "edges, cells": "in all, on edges",
        "edges, close test": "without the cells",
    }
    title = (
        f"Clearance overhead beyond m, from {overhead['lines']} approaches of an arm "
        f"to nodes and {overhead['edge_lines']} to edges (odm bench overhead: from "
        "thousands)"
    )
    rows = []
    for key, meaning in means.items():
        values = (overhead[key]["mean"], overhead[key]["p95"])
        cells = ("-" if v is None else f"{100 * v:.1f}" for v in values)
        rows.append((key, meaning, *cells))
    heads = ("term", "meaning", "mean \\[cm]", "95 % \\[cm]")
    return table_of(title, heads, rows, left=(0, 1))


_JOINTS = "Joints: rad or m, and per s, s², s³"


def _joint_table(robot: dict) -> Fitted:
    kinds = ["continuous" if endless else "" for endless in robot["continuous"]]
    heads = ("lower", "upper", "velocity", "accel.", "jerk")
    names = ("lower", "upper", "max_velocity", "max_acceleration", "max_jerk")
    rows = [
        (joint, kinds[k], *(f"{robot[name][k]:.4g}" for name in names))
        for k, joint in enumerate(robot["joints"])
    ]
    if not any(kinds):
        rows = [(joint, *numbers) for joint, _, *numbers in rows]
        return table_of(_JOINTS, ("joint", *heads), rows)
    return table_of(_JOINTS, ("joint", "kind", *heads), rows, left=(0, 1))


def _cover_table(cover: list[dict]) -> Fitted:
    more = max(0, len(cover) - MOST_LINKS)
    rest = f"; {more} more links: --json" if more else ""
    title = f"Sphere cover, worst links first{rest}"
    heads = ("link", "moves", "spheres", "sticks out \\[mm]", "on average \\[mm]")
    rows = []
    for row in sorted(cover, key=lambda row: -row["excess"])[:MOST_LINKS]:
        cells = f"{1000 * row['excess']:.1f}", f"{1000 * row['protrusion']:.1f}"
        kind = "yes" if row["moving"] else "no"
        rows.append((row["link"], kind, str(row["spheres"]), *cells))
    return table_of(title, heads, rows, left=(0, 1))


def show_audit(report: "AuditReport", map_hash: str) -> None:
    """Print the verdict, the families of obstacles and the nearest cases."""
    from rich.console import Console

    console = Console(highlight=False)
    console.print(str(report), soft_wrap=True)
    if report.free_share < 0.2:
        console.print("less than 20 % was called free: too little to show anything")
    rows = []
    for name, (pairs, free, bad, smallest) in report.families.items():
        nearest = f"{1000 * smallest:.2f}" if np.isfinite(smallest) else "-"
        rows.append((name, f"{pairs:,}", f"{free:,}", f"{bad:,}", nearest))
    heads = ("obstacle", "pairs", "free", "violations", "smallest \\[mm]")
    console.print(table_of("By kind of obstacle", heads, rows))
    console.print("nearest pairs that were called free:")
    for case in report.worst:
        console.print(f"  {case}", soft_wrap=True)
    console.print(_with_seed(report, map_hash))


def _with_seed(report: "AuditReport | SequenceReport", map_hash: str) -> str:
    sabotage = f", sabotage {report.sabotage}" if report.sabotage else ""
    return f"seed {report.seed}{sabotage}, {report.seconds:.1f} s, map {map_hash[:12]}"


def show_sequences(report: "SequenceReport", map_hash: str) -> None:
    """Print the verdict of an audit by sequences, its counts and its faults."""
    from rich.console import Console

    console = Console(highlight=False)
    console.print(str(report), soft_wrap=True)
    if report.complete and report.answered_share < 0.5:
        console.print("less than half was answered with a path: too little to show")
    smallest = f"{1000 * report.smallest:.2f} mm" if report.exact else "-"
    rows = (
        ("steps", f"{report.steps:,}"),
        ("answered with a path", f"{report.answered:,}"),
        ("legs judged by a fresh planner", f"{report.legs:,}"),
        ("answers measured with exact solids", f"{report.exact:,}"),
        ("answers near to what they must keep", f"{report.near:,}"),
        ("false answers", f"{report.wrong:,}"),
        ("legs refused as a whole, but at no place", f"{report.unproved:,}"),
        ("smallest exact distance beyond what is kept", smallest),
        ("ways out of frames that hold, measured", f"{report.ways_out:,}"),
    )
    console.print(table_of("What was judged", ("count of", ""), rows, left=(0, 1)))
    kinds = [(name, f"{n:,}", f"{m:,}") for name, (n, m) in report.kinds.items()]
    heads = ("answers with", "", "measured")
    console.print(table_of("Kinds of answers", heads, kinds, left=(0,)))
    for seed, step, fault in report.first_faults:
        console.print(f"  sequence {seed}, step {step}: {fault}", soft_wrap=True)
    console.print(_with_seed(report, map_hash))
