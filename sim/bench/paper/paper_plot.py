"""The plot of `odm bench odm-paper`: cells, times, and what the paper's rules miss."""

from pathlib import Path

from sim.draw.style import (
    AMBER,
    FAINT,
    RED,
    SLATE,
    TEAL,
    legend,
    new_figure,
    save,
    set_title,
    tidy,
)

SHADES = ("#9ed8d2", "#4fb0a8", "#00857c", "#004f4a")  # small to large cells
LINKS_CM = (5.0, 34.0)  # thinnest and longest side of the moving links
_MARK = {"marker": "o", "ms": 4.5, "lw": 1.6}


def write_plot(result: dict, path: str | Path) -> Path:
    """Draw the figures of the bench to a PNG file.

    Args:
        result: What `sim.bench.paper.odm_paper.run` returns.
        path: File to write, whole or not at all.
    """
    figure = new_figure(11.5, 7.6)
    axes = figure.subplots(2, 2)
    for axis in axes.flat:
        tidy(axis)
    _cells(axes[0][0], result["sweep"])
    _times(axes[0][1], result["sweep"])
    _missed(axes[1][0], result["uninflated"])
    _rule(axes[1][1], result["edge_rule"])
    return save(figure, path, dpi=110)


def _cells(axis: object, sweep: list[dict]) -> None:
    sizes = sorted({row["cell_cm"] for row in sweep})
    ways = (
        ("cells_whole", "the whole arm, by region expansion", RED),
        ("cells_dense", "its surface, points a cell apart", AMBER),
        ("cells_surface", "its surface, within rho = 3 cm of a point", TEAL),
    )
    for key, label, colour in ways:
        means = [_mean(sweep, key, cell_cm=h) for h in sizes]
        axis.plot(sizes, means, color=colour, label=label, **_MARK)
    axis.set(xlabel="cells [cm]", xticks=sizes, ylim=(0, None))
    legend(axis)
    set_title(axis, "cells that the arm occupies")


def _times(axis: object, sweep: list[dict]) -> None:
    h = 3 if any(row["cell_cm"] == 3 for row in sweep) else sweep[0]["cell_cm"]
    rows = [r for r in sweep if r["cell_cm"] == h and r["sampling"] == "random"]
    nodes = [r["nodes"] for r in rows]
    ways = (
        ("A* with online python-fcl", SLATE, [r["fcl_cpu_us"]["p50"] for r in rows]),
        (
            "the whole arm's cells, then invalid nodes and edges", RED,
            [r["expand_us"] + r["whole_us"] for r in rows],
        ),
        ("the surface's invalid nodes and edges", AMBER,
         [r["surface_us"] for r in rows]),
        ("a frame, points to path", TEAL, [r["frame_us"]["p50"] for r in rows]),
    )  # fmt: skip
    for label, colour, values in ways:
        axis.plot(nodes, values, color=colour, label=label, **_MARK)
    axis.set(xscale="log", yscale="log", xlabel="nodes of the roadmap")
    axis.set_ylim(1, 40 * max(ways[0][2]))
    axis.set_xticks(nodes, [f"{n:,}" for n in nodes])
    axis.minorticks_off()
    axis.set_ylabel("median time [\N{MICRO SIGN}s]")
    legend(axis)
    set_title(axis, f"update and search, cells of {h} cm")


def _missed(axis: object, by_cell: list[dict]) -> None:
    low, high = LINKS_CM
    axis.axvspan(low, high, color=FAINT, alpha=0.12, lw=0)
    for shade, row in zip(SHADES, by_cell, strict=False):
        points = [(100 * float(s), v) for s, v in row["share"].items() if v is not None]
        x, y = zip(*points, strict=True) if points else ((), ())
        label = f"cells of {row['cell_cm']} cm"
        axis.plot(x, [100 * v for v in y], color=shade, label=label, **_MARK)
    axis.set(xscale="log", yscale="symlog", ylim=(0, 100))
    axis.set_yscale("symlog", linthresh=0.1)
    axis.set_xticks([2, 3, 5, 8, 12, 20, 34], ["2", "3", "5", "8", "12", "20", "34"])
    axis.set_yticks([0, 0.1, 1, 10, 100], ["0", "0.1", "1", "10", "100"])
    axis.minorticks_off()
    axis.set(xlabel="distance of neighbouring points [cm]; grey: sizes of the links")
    axis.set_ylabel("% of contacts")
    legend(axis)
    set_title(axis, "contacts missed where nothing is inflated")


def _rule(axis: object, rules: list[dict]) -> None:
    sizes = sorted({row["cell_cm"] for row in rules})
    for shade, h in zip(SHADES, sizes, strict=False):
        rows = [r for r in rules if r["cell_cm"] == h]
        shares = [100.0 * r["short"] / r["edges"] for r in rows]
        nodes = [r["nodes"] for r in rows]
        axis.plot(nodes, shares, color=shade, label=f"cells of {h} cm", **_MARK)
    nodes = sorted({r["nodes"] for r in rules})
    axis.set(xscale="log", ylim=(0, 100), xlabel="nodes of the roadmap")
    axis.set_xticks(nodes, [f"{n:,}" for n in nodes])
    axis.minorticks_off()
    axis.set_ylabel("% of edges")
    legend(axis)
    set_title(axis, "edges that lack a swept cell by 'until no more are added'")


def _mean(sweep: list[dict], key: str, **only: object) -> float:
    values = [r[key] for r in sweep if all(r[k] == v for k, v in only.items())]
    return sum(values) / len(values)
