"""Flags of a command from a frozen dataclass: name, default, unit, help in one place.

Also the flags that several commands share.
"""

import functools
import inspect
from collections.abc import Callable
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Annotated, get_origin, get_type_hints

import typer

JSON_HELP = "Write the figures as JSON to FILE.json; alone or as '-': to the terminal."
MapArgument = Annotated[Path, typer.Argument(metavar="MAP", help="Folder of a map.")]
MapOption = Annotated[
    Path, typer.Option("--map", metavar="MAP", help="A map's folder.")
]
Json = Annotated[str | None, typer.Option("--json", metavar="FILE", help=JSON_HELP)]
Threads = Annotated[int, typer.Option(min=0, help="Threads; 0: one per core.")]
Seed = Annotated[int, typer.Option(min=0, help="Same seed, same run.")]
Posture = Annotated[
    str,
    typer.Option(
        metavar="standing|bending|sitting|kneeling|lying|ladder",
        help="What the person does.",
    ),
]
Side = Annotated[str, typer.Option(metavar="right|left", help="The person's hand.")]


def flags_of(kind: type) -> dict[str, str]:
    """Return the flag of every field of a request that has one: file -> "--file"."""
    hints = get_type_hints(kind, include_extras=True)
    found = {}
    for name, hint in hints.items():
        if get_origin(hint) is Annotated:
            words = hint.__metadata__[0].param_decls
            found[name] = words[0] if words else "--" + name.replace("_", "-")
    return found


def given(request: object, panel: str) -> list[str]:
    """Return the flags of a panel of the help that were given, by their names."""
    hints = get_type_hints(type(request), include_extras=True)
    return [
        flag
        for name, flag in flags_of(type(request)).items()
        if hints[name].__metadata__[0].rich_help_panel == panel
        and getattr(request, name) not in (None, False)
    ]


def from_request(kind: type) -> Callable[[Callable], Callable]:
    """Return a decorator that makes a command of one argument a command with flags.

    A field of `kind` is a flag where its type is `Annotated` for typer; fields without
    are for callers in Python only.

    Args:
        kind: A dataclass; what it refuses when it is made, the command refuses.
    """
    hints = get_type_hints(kind, include_extras=True)
    annotations = {name: hints[name] for name in flags_of(kind)}
    parameters = [
        inspect.Parameter(
            f.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=inspect.Parameter.empty if f.default is MISSING else f.default,
            annotation=annotations[f.name],
        )
        for f in fields(kind)
        if f.name in annotations
    ]

    def decorate(command: Callable) -> Callable:
        @functools.wraps(command)
        def run(**values: object) -> object:
            return command(kind(**values))

        run.__signature__ = inspect.Signature(parameters)
        run.__annotations__ = annotations
        return run

    return decorate
