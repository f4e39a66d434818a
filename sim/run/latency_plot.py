"""The plot of a run: latency, separation, holds."""

from pathlib import Path

import numpy as np

from sim.draw import style
from sim.loop.run_result import STATUS, RunResult, percentiles

WIDTH_PX = 1600  # more frames than this are drawn as the worst of each column


def write_latency_plot(result: RunResult, path: str | Path) -> Path:
    """Draw latency per frame, its distribution, separation and holds: a PNG."""
    figure = style.new_figure(11.5, 6.2)
    options = {"width_ratios": [4.2, 1], "height_ratios": [1.1, 1]}
    axes = figure.subplots(2, 2, gridspec_kw=options)
    for axis in axes.flat:
        style.tidy(axis)
    latency_us = 1e6 * result.wall_s
    shown = percentiles(latency_us)
    _draw_latency(axes[0][0], result, latency_us, shown)
    _draw_distribution(axes[0][1], latency_us, shown)
    _draw_separation(axes[1][0], result)
    _draw_shares(axes[1][1], result)
    return style.save(figure, path, dpi=110)


def _draw_latency(axis: object, result: RunResult, latency_us, shown: dict) -> None:
    time, worst = _columns(latency_us, result.rate_hz)
    axis.plot(time, worst, _dot(time), color=style.TEAL, lw=0.7, ms=5, clip_on=False)
    axis.fill_between(time, worst, 0.5, color=style.TEAL, alpha=0.10, lw=0)
    for name, dash in (("p50", "-"), ("p99", "--")):
        axis.axhline(shown[name], color=style.SLATE, lw=0.9, ls=dash)
    axis.set(yscale="log", ylabel="latency [\N{MICRO SIGN}s]")
    axis.set(xlim=(0, result.duration_s), ylim=_log_limits(latency_us))
    _plain_numbers(axis.yaxis)
    style.set_title(
        axis, "latency of every frame, from what is seen to the path; holds shaded"
    )
    _shade_holds(axis, result)


def _draw_distribution(axis: object, latency_us: np.ndarray, shown: dict) -> None:
    low, high = _log_limits(latency_us)
    bins = np.geomspace(low, high, 60)
    axis.hist(latency_us, bins, orientation="horizontal", color=style.TEAL, alpha=0.75)
    across = axis.get_yaxis_transform()
    # on either side of their lines, which may lie on one another
    for name, dash, side in (("p50", "-", "top"), ("p99", "--", "bottom")):
        axis.axhline(shown[name], color=style.SLATE, lw=0.9, ls=dash)
        text, place = f"{name} {_duration(shown[name])}", (1.03, shown[name])
        axis.text(*place, text, color=style.INK, size=9, transform=across, va=side)
    axis.set(yscale="log", ylim=(low, high), xlabel="frames")
    _plain_numbers(axis.yaxis)
    style.set_title(axis, f"by latency; most {_duration(shown['max'])}")


def _draw_separation(axis: object, result: RunResult) -> None:
    cm = 100 * np.where(np.isfinite(result.separation), result.separation, np.nan)
    time, least = _columns(-cm, result.rate_hz)
    axis.plot(time, -least, color=style.AMBER, lw=1.3)
    axis.axhline(0, color=style.RED, lw=0.9)
    axis.set(xlabel="time [s]", ylabel="separation [cm]", xlim=(0, result.duration_s))
    closest = result.closest()
    if closest is not None:
        _mark_closest(axis, closest / result.rate_hz, cm[closest])
    style.set_title(axis, "exact distance of robot and person; holds shaded")
    _shade_holds(axis, result)


def _mark_closest(axis: object, time: float, cm: float) -> None:
    """Mark the least distance; it is told below, where no line can be."""
    axis.plot([time], [cm], "o", color=style.AMBER, ms=5, clip_on=False)
    low, high = axis.get_ylim()
    axis.set_ylim(min(low, cm - 0.16 * (high - min(low, cm))), high)
    begin, end = axis.get_xlim()
    share = (time - begin) / (end - begin)
    axis.annotate(
        f"{cm:.1f} cm",
        (time, cm),
        (0, -6),
        textcoords="offset points",
        ha="left" if share < 0.05 else "right" if share > 0.95 else "center",
        va="top",
        color=style.INK,
        size=9,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
    )


def _draw_shares(axis: object, result: RunResult) -> None:
    """Draw which share of the frames was following, replanned or holding."""
    shares = [np.mean(result.status == k) * 100 for k in range(len(STATUS))]
    bars = axis.barh(
        STATUS, shares, color=(style.TEAL, style.AMBER, style.RED), alpha=0.75
    )
    labels = [f"{share:.1f} %" for share in shares]
    axis.bar_label(bars, labels, padding=3, size=9, color=style.INK)
    axis.set(xlim=(0, 135), xticks=[])
    axis.invert_yaxis()
    axis.spines["bottom"].set_visible(False)
    style.set_title(axis, "share of frames")


def _shade_holds(axis: object, result: RunResult) -> None:
    for hold in result.holds:
        axis.axvspan(
            hold.start_s, hold.end_s, color=style.RED, alpha=0.10, lw=0, zorder=0
        )


def _dot(time: np.ndarray) -> str:
    """Return how a curve is drawn: as a dot where it has a single moment."""
    return "o" if len(time) == 1 else "-"


def _columns(values: np.ndarray, rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times [s] and the largest value of each column of the picture."""
    size = max(1, -(-len(values) // WIDTH_PX))
    padded = np.pad(values, (0, -len(values) % size), mode="edge").reshape(-1, size)
    return np.arange(len(padded)) * size / rate_hz, padded.max(axis=1)


def _log_limits(values: np.ndarray) -> tuple[float, float]:
    low, high = float(np.min(values)), float(np.max(values))
    return max(0.7 * low, 0.5), max(1.5 * high, 2.0)


def _plain_numbers(axis: object) -> None:
    """Write 1,000 at the ticks of a logarithmic axis, and nothing between decades."""
    axis.set_major_formatter("{x:,.0f}")
    axis.set_minor_formatter("")


def _duration(us: float) -> str:
    return f"{us:.0f} \N{MICRO SIGN}s" if us < 1000 else f"{us / 1000:.1f} ms"
