"""The one screen: what the loop does, in as many columns and lines as there are."""

import io
import textwrap
from collections.abc import Sequence

from rich.console import Console
from rich.text import Text

from sim.keyboard.bindings import OTHERS, SLIDERS
from sim.keyboard.shown import View

WIDE = (72, 20)  # columns and lines that the full screen needs
_COLOURS = {
    "following": "bold green",
    "replanned": "bold cyan",
    "holding": "bold yellow",
}
_KEY, _DIM, _LABEL = "cyan", "dim", 12
_TRACK = 60  # widest slider


def picture(view: View, width: int, height: int) -> list[Text]:
    """Return at most `height` lines, each of at most `width` columns."""
    if view.help:
        *lines, last = _help()
    elif width >= WIDE[0] and height >= WIDE[1]:
        *lines, last = _full(view, width)
    else:
        *lines, last = _small(view, width)
    if len(lines) >= height > 1:  # the keys stay, whatever is cut
        lines = [line for line in lines if line.plain.strip()][: height - 1]
    lines = [*lines, last][:height]
    for line in lines:
        line.truncate(width)
    return lines


def painted(lines: Sequence[Text], width: int) -> list[tuple[str, bool]]:
    """Return each line with its colours, and whether it fills the whole width."""
    console = Console(
        file=io.StringIO(), force_terminal=True, width=width, legacy_windows=False
    )
    with console.capture() as captured:
        whole = Text("\n").join(lines)
        console.print(whole, no_wrap=True, overflow="crop", end="", highlight=False)
    rows = captured.get().split("\n")
    full = [line.cell_len >= width for line in lines]
    return list(zip(rows, full, strict=True))


def key_lines() -> list[tuple[str, str]]:
    """Return the keys and what they do."""
    return [(s.shown, s.meaning) for s in SLIDERS] + list(OTHERS)


def _full(view: View, width: int) -> list[Text]:
    stats = view.stats
    slipped = f", {view.slipped_s:.2f} s behind the clock" if view.late else ""
    return [
        _head(view, width, f"{view.title} · {view.rate_hz:g} Hz · {view.clock}"),
        Text("─" * width, _DIM),
        *_reason(view, width),
        Text(),
        _row("separation", view.separation),
        _row("robot", f"fastest point {view.speed}"),
        _row("latency", view.latency),
        _row("blocked", *_bar(view, 20), f" of {view.edges:,} edges"),
        _row("trips", f"{stats.trips}, new paths {stats.new_paths}"),
        _row("late", f"{view.late} of {stats.frames:,} frames{slipped}"),
        Text(),
        *(_slider(view, axis, width) for axis in range(len(SLIDERS))),
        Text(),
        _bottom(view, "   "),
    ]


def _small(view: View, width: int) -> list[Text]:
    stats = view.stats
    values = [f"{s.name} {view.value(k)}" for k, s in enumerate(SLIDERS)]
    place = " ".join(value.removesuffix(" m") for value in values[:3]) + " m"
    return [
        _head(view, width, view.clock),
        *_reason(view, width),
        Text(f"separation {view.separation}"),
        Text(f"latency {view.latency}"),
        Text.assemble("blocked ", *_bar(view, min(max(width - 16, 4), 24))),
        Text(f"trips {stats.trips}, late frames {view.late} of {stats.frames:,}"),
        Text(),
        Text.assemble(f"{place:<30} ", ("↑↓←→ uj", _KEY)),
        Text.assemble(f"{', '.join(values[3:5]):<33} ", ("ws ed", _KEY)),
        Text.assemble(f"{', '.join(values[5:]):<33} ", ("rf tg", _KEY)),
        _bottom(view, " "),
    ]


def _help() -> list[Text]:
    rows = [
        Text.assemble((f"{keys:<5}", _KEY), meaning) for keys, meaning in key_lines()
    ]
    return [
        *rows[:-2],
        Text("pgup and pgdn move the shoulder as well", _DIM),
        rows[-1],
        rows[-2],
    ]


def _head(view: View, width: int, right: str) -> Text:
    style = _COLOURS.get(view.status, "bold")
    left = Text.assemble(("● ", style), (view.state, style))
    room = width - left.cell_len - 1
    clock = Text(right, _DIM)
    clock.truncate(max(room, 0))
    gap = " " * max(width - left.cell_len - clock.cell_len, 1)
    return Text.assemble(left, gap, clock)


def _reason(view: View, width: int) -> list[Text]:
    """Return two lines, whatever the reason's length."""
    style = "" if view.stats.held is not None else _DIM
    room = max(width - 2, 10)
    rows = textwrap.wrap(view.reason, room, max_lines=2, placeholder=" …")
    return [Text("  " + row, style) for row in (rows + ["", ""])[:2]]


def _row(label: str, *parts: str | tuple[str, str]) -> Text:
    return Text.assemble((f"{label:<{_LABEL}}", _DIM), *parts)


def _bar(view: View, room: int) -> list[tuple[str, str] | str]:
    filled = round((view.blocked or 0.0) * room)
    empty = ("░" * (room - filled), _DIM)
    return [("█" * filled, "yellow"), empty, f" {view.blocked_percent}"]


def _slider(view: View, axis: int, width: int) -> Text:
    slider, room = SLIDERS[axis], min(width - 28, _TRACK)
    track = ["─"] * room
    now, target = (round(share * (room - 1)) for share in view.shares(axis))
    track[target], track[now] = "○", "●"
    name = slider.name if axis > 2 else f"shoulder {slider.name}"
    return Text.assemble(
        (f"{slider.shown:<5}", _KEY), f"{name:<12}{view.value(axis):>8}  ",
        ("".join(track), _DIM),
    )  # fmt: skip


def _bottom(view: View, gap: str) -> Text:
    keys = [("h", "home"), ("p", "pause"), ("?", "help"), ("q", "end")]
    line = Text.assemble(("+-", _KEY), " ", view.nudge)
    for key, word in keys:
        line.append_text(Text.assemble(gap, (key, _KEY), " ", word))
    return line
