"""The plot of `odm bench peers`: latency of each, and how its paths were judged."""

from pathlib import Path

import numpy as np

from sim.draw.style import AMBER, RED, SLATE, TEAL, new_figure, save, set_title, tidy


def write_plot(result: dict, path: str | Path) -> Path:
    """Draw p50 to p99 latencies and the share of paths in contact to a PNG file.

    Args:
        result: What `sim.bench.rivals.peers.run` returns.
        path: File to write, whole or not at all.
    """
    names = list(dict.fromkeys(one["name"] for one in result["peers"]))
    figure = new_figure(11.0, 0.5 * len(names) + 2.2)
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=[2, 1])
    for axis in (left, right):
        tidy(axis)
    at = np.arange(len(names))[::-1]
    for world, shift, colour in (
        ("shapes", 0.12, TEAL),
        ("camera cloud", -0.12, AMBER),
    ):
        for y, name in zip(at, names, strict=True):
            times = _all(result, name, world, "wall_us")
            if times:
                low, high = np.percentile(times, [50, 99]) / 1e3
                left.plot([low, high], [y + shift] * 2, color=colour, lw=3)
                left.plot([low], [y + shift], "o", color=colour, ms=5)
    for y, name in zip(at, names, strict=True):
        ones = [o for o in result["peers"] if o["name"] == name]
        paths = sum(len(o["lengths"]) for o in ones)
        touching = sum(o["in_contact"] for o in ones)
        share = 100.0 * touching / max(1, paths)
        right.barh(y, share, 0.5, color=RED if share else SLATE)
        right.text(share, y, f"  {touching} of {paths}", va="center", fontsize=8)
    left.set(xscale="log", xlabel="obstacles to path [ms], p50 to p99", yticks=at)
    left.set_yticklabels(names)
    right.set(xlabel="paths in exact contact [%]", xlim=(0, None))
    set_title(left, "latency: shapes (teal), 20 000 points (amber)")
    set_title(right, "validity")
    return save(figure, path, dpi=110)


def _all(result: dict, name: str, world: str, what: str) -> list:
    ones = [o for o in result["peers"] if o["name"] == name and o["world"] == world]
    return [x for one in ones for x in one[what]]
