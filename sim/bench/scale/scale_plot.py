"""The plot of `odm bench scale`: costs and gains over the number of nodes."""

from pathlib import Path

from sim.draw.style import (
    AMBER,
    RED,
    SLATE,
    TEAL,
    legend,
    new_figure,
    save,
    set_title,
    tidy,
)

_MARK = {"marker": "o", "ms": 4.5, "lw": 1.6}


def write_plot(result: dict, path: str | Path) -> Path:
    """Draw the curves to a PNG file.

    Args:
        result: What `sim.bench.scale.scale.run` returns.
        path: File to write, whole or not at all.
    """
    figure = new_figure(11.0, 7.0)
    axes = figure.subplots(2, 2)
    for axis in axes.flat:
        tidy(axis)
        axis.set(xscale="log", xlabel="nodes")
    sizes = result["sizes"]
    first = [s for s in sizes if s["h"] == sizes[0]["h"]]
    k = result["exponents"]
    panels = (
        (axes[0][0], "bytes and build", (
            ("megabytes", "folder [MB]", TEAL),
            ("build_cpu_s", "build [CPU s]", SLATE),
        )),
        (axes[0][1], "load, and a planner made [ms]", (
            ("load_ms", "load, unverified", TEAL),
            ("planner_ms", "planner", SLATE),
        )),
        (axes[1][0], "a frame [us]", (
            ("frame_p50_us", "p50", TEAL),
            ("frame_p99_us", "p99", RED),
        )),
    )  # fmt: skip
    for axis, title, curves in panels:
        for key, name, colour in curves:
            label = f"{name}, n^{k[key]:.2f}" if key in k else name
            xy = [s["nodes"] for s in first], [s[key] for s in first]
            axis.plot(*xy, color=colour, label=label, **_MARK)
        axis.set(yscale="log")
        legend(axis)
        set_title(axis, title)
    axis = axes[1][1]
    for key, name, colour in (
        ("crossing", "frames of a crossing arm", TEAL),
        ("clutter", "cluttered scenes", AMBER),
    ):
        xy = [s["nodes"] for s in first], [s[key] for s in first]
        axis.plot(*xy, color=colour, label=name, **_MARK)
    axis.set(ylim=(0, 102))
    legend(axis)
    set_title(axis, "solved [%]")
    return save(figure, path, dpi=110)
