"""Flags of a command from a frozen dataclass: name, default, unit, help in one place.

Also the flags that several commands share. What a flag is given is checked before the
command begins, see `sim.terminal.checks`.
"""

import functools
import inspect
from collections.abc import Callable, Iterable
from dataclasses import MISSING, Field, field, fields
from pathlib import Path
from typing import Annotated, get_origin, get_type_hints

import typer

from sim.terminal.checks import MOST_WORKERS, Limits, Refused, Writes, check_value

JSON_HELP = "Write the figures as JSON to FILE; alone or as '-': to the terminal."
MapArgument = Annotated[Path, typer.Argument(metavar="MAP", help="Folder of a map.")]
MapOption = Annotated[
    Path, typer.Option("--map", metavar="MAP", help="A map's folder.")
]
Json = Annotated[str | None, typer.Option("--json", metavar="FILE", help=JSON_HELP)]
Threads = Annotated[
    int, typer.Option(min=0, max=MOST_WORKERS, help="Threads; 0: one per core.")
]
Seed = Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Same seed, same run.")]
MocapFile = Annotated[
    Path | None, typer.Option(metavar="CSV|BVH", help="Recorded motion, for mocap.")
]
JointNames = Annotated[
    Path | None,
    typer.Option(
        metavar="TOML", help="Joint names of the recording; see docs/mocap.md."
    ),
]
Port = Annotated[
    int | None, typer.Option(help="Port of the page (--view); 0: any free one.  [8080]")
]
Host = Annotated[
    str | None,
    typer.Option(
        help="Address of the page (--view); see odm view --help.  [127.0.0.1]"
    ),
]
Token = Annotated[
    str | None,
    typer.Option(help="Token that visitors must give (--view --host); see odm view."),
]
Posture = Annotated[
    str,
    typer.Option(
        metavar="standing|bending|sitting|kneeling|lying|ladder",
        help="What the person does.",
    ),
]
Lock = Annotated[
    list[str] | None,
    typer.Option(
        metavar="JOINT=VALUE",
        help="Make a joint rigid, at a value in rad or m; may be repeated.",
    ),
]
Side = Annotated[str, typer.Option(metavar="right|left", help="The person's hand.")]


def flag(
    default: object,
    text: str,
    *names: str,
    limits: Limits | tuple[Limits, ...] | None = None,
    writes: Writes | None = None,
    **options: object,
) -> Field:
    """Declare a field of a request that is a flag.

    Args:
        default: Its value where it is not given; `...`: it must be given.
        text: The help, with the unit.
        names: Of the flag, where it is not that of the field.
        limits: What numbers are taken; several: by each of its values, which the
            metavar names.
        writes: What is written there; looked at before any work, and its metavar.
        options: Of `typer.Option`; `panel` is the part of the help it stands in.
    """
    if writes is not None:
        options = {"metavar": writes.metavar} | options
    option = typer.Option(*names, help=text, **_named(options))
    return _field(default, option, limits=limits, writes=writes)


def optional(text: str, *names: str, **options: object) -> Field:
    """Declare a flag that is None where it is not given; see `flag`."""
    return flag(None, text, *names, **options)


def switch(text: str, **options: object) -> Field:
    """Declare a flag without a value, that is on where it is given; see `flag`."""
    return flag(False, text, **options)


def argument(default: object, text: str, **options: object) -> Field:
    """Declare a field of a request that is given by its place; see `flag`."""
    return _field(default, typer.Argument(help=text, **_named(options)))


def _named(options: dict) -> dict:
    panel = {"rich_help_panel": options.pop("panel")} if "panel" in options else {}
    return options | panel


def _field(default: object, option: object, **checks: object) -> Field:
    given = {} if default is ... else {"default": default}
    return field(metadata={"option": option, **checks}, **given)


def _options(kind: type) -> dict[str, tuple[Field, object, object]]:
    """Return (field, its type for typer, typer's option) of each flag by name."""
    hints, found = get_type_hints(kind, include_extras=True), {}
    for one in fields(kind):
        hint = hints[one.name]
        if option := one.metadata.get("option"):
            if one.default is False and not option.param_decls:  # no --no-x beside it
                option.param_decls = (f"--{one.name.replace('_', '-')}",)
            hint = Annotated[hint, option]
        if get_origin(hint) is Annotated:
            found[one.name] = one, hint, hint.__metadata__[0]
    return found


def flags_of(kind: type) -> dict[str, str]:
    """Return the flag of every field of a request that has one: file -> "--file"."""
    found = {}
    for name, (_, _, option) in _options(kind).items():
        # typer keeps the first name where functions have their default
        words = [option.default, *(option.param_decls or ())]
        words = [w for w in words if isinstance(w, str) and w.startswith("--")]
        found[name] = words[0] if words else "--" + name.replace("_", "-")
    return found


def check_values(kind: type, values: dict[str, object]) -> None:
    """Refuse what a request cannot be given, by the names of its flags.

    Raises:
        Refused: A number outside its limits, a word that is no choice, a file that
            could not be written; told before any work.
    """
    flags = flags_of(kind)
    for name, (one, _, option) in _options(kind).items():
        if name not in values or values[name] is None:
            continue
        word = flags[name] if option_like(option) else option.metavar or name
        limits, writes = (one.metadata.get(k) for k in ("limits", "writes"))
        if name == "json":
            writes = Writes()
        check_value(word, values[name], limits, writes, option.metavar or "")


def option_like(option: object) -> bool:
    """Return whether typer's declaration is that of a flag, no argument by place."""
    return not isinstance(option, typer.models.ArgumentInfo)


def of_panels(request: object, *panels: str) -> list[str]:
    """Return the fields of a request whose flags stand in some panels of the help."""
    options = _options(type(request)).items()
    return [name for name, (*_, option) in options if option.rich_help_panel in panels]


def is_given(request: object, name: str) -> bool:
    """Return whether a field of a request is another than where it is left out."""
    value, one = getattr(request, name), type(request).__dataclass_fields__[name]
    return value is not None and value != one.default


def goes_with(
    request: object,
    names: Iterable[str],
    what: str,
    remedy: str = "add that or leave it out",
) -> str:
    """Return a sentence on the first of some fields that was given, "" for none."""
    for name in names:
        if is_given(request, name):
            word = flags_of(type(request))[name].rpartition("/")[2]
            return f"{word} goes with {what}; {remedy}"
    return ""


def refuse_beside(
    request: object, names: Iterable[str], what: str, remedy: str = "leave it out"
) -> None:
    """Refuse fields that have no effect in what was asked for; see `goes_with`."""
    if told := goes_with(request, names, what, remedy):
        raise Refused(told)


def from_request(kind: type) -> Callable[[Callable], Callable]:
    """Return a decorator that makes a command of one argument a command with flags.

    Fields of the dataclass `kind` are flags where they are declared by `flag` or
    `argument`, or have an `Annotated` type for typer; others are for callers in Python
    only. What it refuses when it is made, the command refuses.
    """
    empty = inspect.Parameter.empty
    parameters = [
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=empty if one.default is MISSING else one.default,
            annotation=hint,
        )
        for name, (one, hint, _) in _options(kind).items()
    ]

    def decorate(command: Callable) -> Callable:
        @functools.wraps(command)
        def run(**values: object) -> object:
            check_values(kind, values)
            return command(kind(**values))

        run.__signature__ = inspect.Signature(parameters)
        run.__annotations__ = {p.name: p.annotation for p in parameters}
        return run

    return decorate
