"""The words and strips of the panel: HTML and SVG from plain data."""

from html import escape

import numpy as np

from sim.draw.style import AMBER, BLUE, FAINT, INK, LINE, PALE, RED, TEAL
from sim.view import moment as m
from sim.view import theme
from sim.view.moment import Event, Moment

STRIP_S = 10.0  # what the strips show before the present moment [s]
COLUMNS = 400  # of a time line, at most
_STRIP = 600.0, 46.0  # width and height of a strip, in units of its picture
NEAR = 0.10  # a separation below this is drawn as near [m]
_FONT = "font-family:inherit"
_MOST_TEXT = 400

ENDED = (
    f'<div role="status" style="{_FONT};padding:10px 14px 0 14px;font-size:13px;'
    f'color:{RED}">It has ended: what is seen is the last moment.</div>'
)


def status_card(moment: Moment, events: list[Event], length_s: float) -> str:
    """Return state, reason, time and separation of a moment in words."""
    state = shown_state(moment, events)
    word = m.WORDS[state]
    colour = theme.STATE_COLOURS[state]
    reason = moment.reason if state != m.NEW_PATH else ""
    why = f'<div style="color:{INK};margin-top:4px">{_clip(reason)}</div>'
    gap = moment.separation
    at = f"{moment.time_s:.2f} / {length_s:.2f} s" if length_s > 0 else ""
    told = _in_cm(gap) if np.isfinite(gap) else "\N{EN DASH}"
    gap_colour = INK if not gap < NEAR else (RED if gap <= 0 else AMBER)
    return (
        f'<div style="{_FONT};padding:10px 14px 4px 14px;font-size:13px">'
        f'<div style="display:flex;align-items:center;gap:8px">'
        f'<span style="width:12px;height:12px;border-radius:6px;flex:none;'
        f'background:{colour}"></span>'
        f'<b style="font-size:15px;color:{INK}">{word[0].upper()}{word[1:]}</b>'
        f'<span style="margin-left:auto;color:{FAINT};'
        f'font-variant-numeric:tabular-nums">{at}'
        f"</span></div>{why if reason else ''}"
        f'<div style="margin-top:6px;color:{FAINT}">robot to person '
        f'<b style="font-size:17px;color:{gap_colour};'
        f'font-variant-numeric:tabular-nums">{told}</b></div></div>'
    )


def _in_cm(gap: float) -> str:
    """Return a separation [m] in words; what touches is not below 0."""
    return f"{max(gap, 0.0) * 100:.1f} cm"


def shown_state(moment: Moment, events: list[Event]) -> int:
    """Return the state to tell; a new path is told long enough to be read."""
    if moment.state != m.ON_THE_WAY:
        return moment.state
    new = any(
        e.state == m.NEW_PATH and 0 <= moment.time_s - e.time_s < m.STICKY_S
        for e in events[-8:]
    )
    return m.NEW_PATH if new else moment.state


def strips(rows: np.ndarray, now: float, latency: bool = True) -> str:
    """Return separation and latency of the last seconds before `now` [s] as two strips.

    `rows` are (n, 5) as in `Moment`, by time; latencies may not be known.
    """
    recent = rows[(rows[:, m.TIME] > now - STRIP_S) & (rows[:, m.TIME] <= now + 1e-9)]
    gap = recent[np.isfinite(recent[:, m.GAP])]
    nearest = f"{_in_cm(gap[:, m.GAP].min())} at the least" if len(gap) else "nobody"
    top = max(0.3, float(gap[:, m.GAP].max(initial=0.0)))
    body = _strip(gap[:, m.TIME], gap[:, m.GAP], now, top, TEAL, NEAR)
    scale = f"0 to {100 * top:.0f} cm, dashed: {100 * NEAR:.0f} cm"
    told = [_titled("Separation", nearest, body, scale)]
    if latency and len(recent):
        took = 1e3 * recent[:, m.LATENCY]
        p50, p99 = np.percentile(took, [50, 99])
        most = float(took.max())
        top = max(1.0, 1.1 * most)
        body = _strip(recent[:, m.TIME], took, now, top, BLUE)
        # of one line, however long a frame took
        told_ms = [f"{t:.2f}" if t < 10.0 else f"{t:.0f}" for t in (p50, p99, most)]
        words = "p50 {}, p99 {}, most {} ms".format(*told_ms)
        told.append(_titled("Latency of a frame", words, body, f"0 to {top:.1f} ms"))
    return f'<div style="{_FONT};padding:2px 14px">{"".join(told)}</div>'


def _titled(name: str, words: str, body: str, scale: str) -> str:
    """Return a strip between its title, its figures and the scale of its axes."""
    picture = _svg(*_STRIP, body, f"{name}, last {STRIP_S:.0f} s: {words}")
    return (
        f'<div style="display:flex;font-size:12px;color:{FAINT};margin-top:6px">'
        f'<span style="color:{INK}">{name}</span>'
        f'<span style="margin-left:auto;font-variant-numeric:tabular-nums">{words}'
        f"</span></div>"
        f'{picture}<div style="font-size:11px;color:{FAINT}">'
        f"last {STRIP_S:.0f} s, {scale}</div>"
    )


def _strip(
    times: np.ndarray,
    values: np.ndarray,
    now: float,
    top: float,
    colour: str,
    line: float | None = None,
) -> str:
    """Return a filled curve over the last seconds, the newest at the right."""
    width, height = _STRIP
    body = f'<rect width="{width}" height="{height}" fill="{PALE}"/>'
    if len(times) > 1:
        step = -(-len(times) // COLUMNS)  # the extreme of each column stays
        pick = np.arange(0, len(times), step)
        worst = np.minimum if line is not None else np.maximum
        y = worst.reduceat(np.clip(values / top, 0.0, 1.0), pick)
        x = width * (1.0 + (times[pick] - now) / STRIP_S)
        points = " ".join(
            f"{a:.1f},{b:.1f}" for a, b in zip(x, height * (1 - y), strict=True)
        )
        area = f"{x[0]:.1f},{height} {points} {x[-1]:.1f},{height}"
        body += f'<polygon points="{area}" fill="{colour}" opacity="0.18"/>'
        body += (
            f'<polyline points="{points}" fill="none" stroke="{colour}" '
            'stroke-width="1.6" vector-effect="non-scaling-stroke"/>'
        )
    if line is not None and line < top:
        y = height * (1 - line / top)
        body += (
            f'<line x1="0" x2="{width}" y1="{y:.1f}" y2="{y:.1f}" stroke="{AMBER}" '
            'stroke-width="1" stroke-dasharray="4 4" '
            'vector-effect="non-scaling-stroke"/>'
        )
    return body


def time_line(rows: np.ndarray, events: list[Event], span: tuple, now: float) -> str:
    """Return the whole run as a band of colours by state, with its events.

    `rows` are (n, 5) as in `Moment`, by time; `span` are the first and the last moment
    [s].
    """
    width, height = 1000.0, 40.0
    begin, length = span[0], max(span[1] - span[0], 1e-6)

    def at(time_s: float) -> float:
        return width * min(max((time_s - begin) / length, 0.0), 1.0)

    body = f'<rect y="12" width="{width}" height="18" fill="{PALE}"/>'
    for first, last, state in _stretches(rows, begin, length):
        x, wide = at(first), max(at(last) - at(first), 1.5)
        body += (
            f'<rect x="{x:.1f}" y="12" width="{wide:.1f}" height="18" '
            f'fill="{theme.STATE_COLOURS[state]}"/>'
        )
    for event in [e for e in events if e.state == m.NEW_PATH][-COLUMNS:]:
        x = at(event.time_s)
        colour = theme.STATE_COLOURS[m.NEW_PATH]
        body += f'<rect x="{x - 1:.1f}" y="4" width="2.4" height="8" fill="{colour}"/>'
    x = at(now)
    body += f'<rect x="{x - 1.5:.1f}" y="0" width="3" height="{height}" fill="{INK}"/>'
    told = f"States of the robot, {span[0]:.2f} to {span[1]:.2f} s, now {now:.2f} s"
    picture = _svg(width, height, body, told)
    latest = [e for e in events if e.time_s <= now + 1e-9][-4:]
    lines = "".join(_event_line(e) for e in reversed(latest))
    return (
        f'<div style="{_FONT};padding:4px 14px">{picture}'
        f'<div style="font-size:12px;min-height:72px">{lines}</div></div>'
    )


def _event_line(event: Event) -> str:
    colour = theme.STATE_COLOURS[event.state]
    return (
        '<div style="white-space:nowrap;overflow:hidden;text-overflow:ellipsis" '
        f'title="{_clip(event.text)}"><span style="color:{FAINT};'
        f'font-variant-numeric:tabular-nums">{event.time_s:7.2f} s</span> '
        f'<span style="color:{colour}">\N{BLACK CIRCLE}</span> '
        f'<span style="color:{INK}">{_clip(event.text)}</span></div>'
    )


def _stretches(rows: np.ndarray, begin: float, length: float) -> list[tuple]:
    """Return (first [s], last [s], state) by column; the gravest of a column stays."""
    if len(rows) == 0:
        return []
    column = np.clip((rows[:, m.TIME] - begin) / length * COLUMNS, 0, COLUMNS - 1)
    grave = np.full(COLUMNS, -1)
    np.maximum.at(grave, column.astype(int), rows[:, m.STATE].astype(int))
    for i in range(1, COLUMNS):  # where columns are finer than frames
        if grave[i] < 0 and i <= column[-1]:
            grave[i] = grave[i - 1]
    grave[grave == m.NEW_PATH] = m.ON_THE_WAY
    cuts = np.flatnonzero(np.r_[True, grave[1:] != grave[:-1]])
    ends = np.r_[cuts[1:], COLUMNS]
    scale = length / COLUMNS
    return [
        (begin + a * scale, begin + b * scale, int(grave[a]))
        for a, b in zip(cuts, ends, strict=True)
        if grave[a] >= 0
    ]


def roadmap_line(nodes: int, edges: int, blocked: int | None) -> str:
    """Return how large a roadmap is, and how many edges the person blocks, if known."""
    text = f"{nodes:,} nodes, {edges:,} edges"
    if blocked is not None:
        share = blocked / max(1, edges)
        text += f"; the person blocks <b>{blocked:,}</b> ({share:.0%})"
    return (
        f'<div style="{_FONT};font-size:13px;padding:0 14px;color:{INK}">{text}</div>'
    )


def legend(
    has_map: bool,
    has_quality: bool,
    runs: bool = True,
    lacks: frozenset[str] = frozenset(),
) -> str:
    """Return what each colour means; of a map alone, in which nothing runs, less.

    `lacks` are the layers that are never there, see `Source`.
    """
    rows = [("box", theme.SLEEVE, "person: clothes")]
    rows.append(("box", theme.SKIN, "person: skin"))
    if runs:
        rows.append(("line", theme.PATH, "path of the tool"))
        if "before" not in lacks:
            rows.append(("line", theme.BEFORE, "the path before it"))
        rows.append(("box", theme.LOAD, "what is carried"))
    if has_map:
        rows.append(("line", theme.FREE_EDGE, "edge that is free"))
        rows.append(("line", theme.BLOCKED_EDGE, "edge that is blocked"))
        rows.append(("box", theme.CELL, "occupied cell"))
    if runs and not has_quality:
        rows.append(("dot", theme.GOAL, "place; large: the goal"))
    items = "".join(_swatch(kind, theme.hex_of(c), text) for kind, c, text in rows)
    states = "".join(
        _swatch("box", theme.STATE_COLOURS[s], m.WORDS[s])
        for s in (
            *(m.STILL, m.ON_THE_WAY, m.SLOW, m.NEW_PATH),  # long words in one column
            *(m.BRAKING, m.AWAY, m.HOLDING, m.CONTACT),
        )
    )
    bar = ""
    if has_quality:
        stops = theme.quality_colours(np.linspace(0, 1, 6))
        gradient = ",".join(theme.hex_of(c) for c in stops)
        bar = (
            f'<div style="margin-top:6px;color:{FAINT}">target quality 0 '
            f'<span style="display:inline-block;width:110px;height:9px;'
            f'vertical-align:middle;background:linear-gradient(90deg,{gradient})">'
            "</span> 1; the larger is pursued</div>"
        )
    grid = "display:grid;grid-template-columns:auto auto;gap:1px 8px"
    states = (
        f'<div style="border-top:1px solid {LINE};margin:4px 0 3px 0"></div>'
        f'<div style="{grid}">{states}</div>'
    )
    return (
        f'<div style="{_FONT};font-size:12px;padding:0 10px 2px 10px;color:{INK}">'
        f'<div style="{grid}">{items}</div>{bar}{states if runs else ""}</div>'
    )


def _swatch(kind: str, colour: str, text: str) -> str:
    height = {"box": 10, "line": 4, "dot": 10}[kind]
    radius = 5 if kind == "dot" else 2
    return (
        '<div style="display:flex;align-items:center;gap:7px"><span style="width:'
        f"{10 if kind == 'dot' else 16}px;height:{height}px;border-radius:{radius}px;"
        f'flex:none;background:{colour}"></span>{escape(text)}</div>'
    )


def note(sentences: list[str]) -> str:
    """Return sentences about what is not shown, "" for none."""
    if not sentences:
        return ""
    text = " ".join(f"{_clip(s[:1].upper() + s[1:])}." for s in sentences)
    return (
        f'<div style="{_FONT};font-size:12px;color:{FAINT};padding:4px 14px 8px 14px">'
        f"{text}</div>"
    )


def _clip(text: str) -> str:
    """Return text that is safe in HTML, not too long."""
    cut = text if len(text) <= _MOST_TEXT else text[:_MOST_TEXT] + "..."
    return escape(cut.rstrip("."))


def _svg(width: float, height: float, body: str, told: str) -> str:
    """Return a picture as wide as the panel; `told` is it in words, read aloud."""
    return (
        f'<svg role="img" aria-label="{escape(told)}" '
        f'viewBox="0 0 {width:g} {height:g}" preserveAspectRatio="none" '
        f'style="width:100%;height:{height:g}px;display:block;border-radius:3px">'
        f"{body}</svg>"
    )
