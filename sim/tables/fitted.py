"""A table where the terminal has room for it; else each row as lines of its own."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.table import Table
from rich.text import Text


class Fitted:
    """What is printed in place of a table, so that no word of it is ever cut.

    Args:
        table: The table; its cells are text.
    """

    def __init__(self, table: Table) -> None:
        self.table = table

    def __rich_console__(
        self, console: Console, options: ConsoleOptions
    ) -> Iterator[RenderableType]:
        """Draw the table if all of its words stand in it whole, else its rows."""
        lines = console.render_lines(self.table, options, pad=False)
        text = "\n".join("".join(part.text for part in line) for line in lines)
        if self._words() <= set(text.split()):
            yield self.table
        else:
            yield from _rows(self.table)

    def _words(self) -> set[str]:
        columns = self.table.columns
        cells = [cell for column in columns for cell in column.cells]
        heads = [c.header for c in columns] if self.table.show_header else []
        return {word for cell in (*heads, *cells) for word in _text(cell).plain.split()}


def table_of(
    title: str,
    heads: Sequence[str],
    rows: Iterable[Sequence[str]],
    left: Collection[int] = (0,),
    **look: Any,
) -> Fitted:
    """Return rows as a table, columns `left` to the left, others to the right.

    The title is text, heads and cells are markup; `look` goes to `rich.table.Table`.
    """
    look = {"title_style": "bold"} | look
    table = Table(title=Text(title), title_justify="left", **look)
    for k, head in enumerate(heads):
        table.add_column(head, justify="left" if k in left else "right", no_wrap=not k)
    for row in rows:
        table.add_row(*row)
    return Fitted(table)


def numbers_of(
    title: str, heads: Sequence[str], rows: Iterable[Sequence[str]]
) -> Fitted:
    """Return a table of numbers without lines; none of its cells is broken."""
    look = {"box": None, "padding": (0, 1, 0, 0), "pad_edge": False}
    fitted = table_of(title, heads, rows, left=(), **look)
    for column in fitted.table.columns:
        column.no_wrap = True
    return fitted


def _rows(table: Table) -> Iterator[RenderableType]:
    """Yield the title, and each row: its first cell, the others beneath by name.

    Without names they stand in one line.
    """
    if table.title:
        title = _text(table.title)
        title.stylize("bold")
        yield title
    heads = [_text(column.header) for column in table.columns]
    for row in zip(*(column.cells for column in table.columns), strict=True):
        first, *others = map(_text, row)
        if not table.show_header:
            shown = [cell for cell in others if cell.plain]
            yield Text("  ").join([first, *shown])
            continue
        yield first
        for head, cell in zip(heads[1:], others, strict=True):
            name = f"{' '.join(head.plain.split())}: " if head.plain else ""
            if cell.plain:
                yield Text.assemble("  ", name, cell)


def _text(cell: object) -> Text:
    return cell if isinstance(cell, Text) else Text.from_markup(str(cell))
