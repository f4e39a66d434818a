"""Tables of figures, what was asked beside what was measured, for the terminal."""

from collections.abc import Sequence

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

_HEAD = ("what", "asked", "p50", "p99", "max", "CPU p50 / p99", "met?")
_TEXT = 21  # columns with longer cells are text that may be broken
_VALUES = (0, 1, 2, 6)  # columns of a table without times


def print_bench(result: dict, console: Console | None = None) -> None:
    """Print the table of a bench and the lines about its setting."""
    console = console or Console()
    title = result.get("title") or f"odm bench {result['bench']}"
    head, *rows = lines_of(result)
    own = [{"title": title, "head": head, "rows": rows}] if rows else []
    for table in (*own, *result.get("tables", ())):
        _print_table(table, console)
    for line in setting_lines(result):
        console.print(line, highlight=False)


def _print_table(table: dict, console: Console) -> None:
    if not table["rows"]:
        console.print(f"{table['title']}: none", highlight=False, markup=False)
        return
    lines = [[str(cell) for cell in line] for line in (table["head"], *table["rows"])]
    for k, columns in enumerate(_parts(lines, console.width)):
        head, *rows = [[line[c] for c in columns] for line in lines]
        console.print(plain_table("" if k else table["title"], head, rows))


def _parts(lines: list[list[str]], width: int) -> list[list[int]]:
    """Return which columns stand side by side; the first one in each part.

    All of them where they fit; text that is broken counts with its least width.
    """
    wide = [
        min(max(map(len, column)), _TEXT) + 1 for column in zip(*lines, strict=True)
    ]
    parts, left = [[0]], width - wide[0]
    for k in range(1, len(wide)):
        if wide[k] > left and len(parts[-1]) > 1:
            parts.append([0])
            left = width - wide[0]
        parts[-1].append(k)
        left -= wide[k]
    return parts


def plain_table(title: str, head: Sequence[str], rows: Sequence[Sequence]) -> Table:
    """Return a table whose numbers are never broken; what is text gives way.

    What stands in it is text: "[ms]" is no markup.
    """
    table = Table(
        title=Text(title) if title else None,
        title_justify="left",
        box=None,
        padding=(0, 1, 0, 0),
    )
    table.pad_edge, table.title_style = False, "bold"
    for k, name in enumerate(head):
        longest = max((len(str(line[k])) for line in (head, *rows)), default=0)
        least = min(longest, _TEXT)
        options: dict = {"justify": "right", "no_wrap": True}
        if not k or longest > least:
            options = {"min_width": least}
        table.add_column(Text(name, style="dim"), overflow="fold", **options)
    for row in rows:
        table.add_row(*(Text(str(cell)) for cell in row))
    return table


def lines_of(result: dict) -> list[tuple[str, ...]]:
    """Return the head and the rows of a table; one of values alone has no times."""
    lines = [_HEAD, *map(_cells, result["rows"])]
    if any("value" not in row for row in result["rows"]):
        return lines
    values = [tuple(line[k] for k in _VALUES) for line in lines[1:]]
    return [("what", "asked", "measured", "met?"), *values]


def setting_lines(result: dict) -> list[str]:
    """Return what a figure is worth nothing without: machine, versions, map, frames."""
    head, setup = result["header"], result.get("setup", {})
    versions = [f"{k} {v}" for k, v in head["versions"].items() if v is not None]
    load = " ".join(f"{x:.2f}" for x in head["load_average"])
    lines = [
        f"{head['processor']}, {head['cores']} cores, load average {load}; "
        f"Python {head['python']}, {', '.join(versions)}."
    ]
    if "map" in head:
        about = head["map"]
        lines.append(
            f"Map {about['name']} {about['hash'][:12]}: {about['nodes']} nodes, "
            f"{about['edges']} edges, {about['spheres']} moving spheres."
        )
    if setup:
        lines.append("; ".join(f"{k}: {v}" for k, v in setup.items()) + ".")
    notes = {r["name"]: r["note"] for r in result["rows"] if r.get("note")}
    return lines + [f"{name}: {note}." for name, note in notes.items()]


def _cells(row: dict) -> tuple[str, ...]:
    asked = ", ".join(_limit(row, k, v) for k, v in row["asked"].items())
    if "value" in row:
        return row["name"], asked, _value(row), "", "", "", _yes(row["met"])
    if row["wall"] is None:
        return row["name"], asked, "no frames", "", "", "", ""
    wall = [us_text(row["wall"][k]) for k in ("p50", "p99", "max")]
    cpu = row["cpu"]
    busy = "" if cpu is None else f"{us_text(cpu['p50'])} / {us_text(cpu['p99'])}"
    met = _yes(row["met"])
    if row["met"] is False and row["met_cpu"]:
        met = "by CPU time"
    return row["name"], asked, *wall, busy, met


def _limit(row: dict, share: str, limit: float) -> str:
    if row["unit"] == TRUTH:
        return TRUTH
    if "value" in row:
        sign = "<=" if share == "most" else ">="
        return f"{sign} {limit:g} {row['unit']}".strip()
    return f"{share} <= {us_text(limit)}"


def _value(row: dict) -> str:
    if row["unit"] == TRUTH:
        return "yes" if row["value"] else "no"
    value = row["value"]
    if value is None:
        return "no frames"
    text = f"{value:.0f}" if value.is_integer() else f"{value:.4g}"
    return f"{text} {row['unit']}".strip()


def us_text(us: float) -> str:
    """Return a time that is given in us, in the unit that reads best."""
    if us >= 1e6:
        return f"{us / 1e6:.3g} s"
    if us >= 1e3:
        return f"{us / 1e3:.3g} ms"
    return f"{us:.3g} us"


def _yes(met: bool | None) -> str:
    return "" if met is None else "yes" if met else "no"


TRUTH = "true"  # unit of a value that is 1 where something holds


def value_row(
    name: str,
    value: float,
    unit: str,
    note: str = "",
    most: float | None = None,
    least: float | None = None,
) -> dict:
    """Return a row of one value with its bound, if it has one; NaN is no value."""
    value = None if np.isnan(value) else float(value)
    met = None
    if most is not None and value is not None:
        met = value <= most
    if least is not None and value is not None:
        met = value >= least
    asked = {k: v for k, v in (("most", most), ("least", least)) if v is not None}
    row = {"name": name, "note": note, "unit": unit, "value": value, "asked": asked}
    return row | {"met": met}
