"""Flags made from a frozen request: each is declared once, with its help."""

import importlib
import inspect
import pkgutil
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import get_type_hints

import pytest
import typer
from rows import each
from typer.testing import CliRunner

import sim.cli
from sim.run.request import RunRequest
from sim.terminal.flags import (
    Json,
    argument,
    flag,
    flags_of,
    from_request,
    is_given,
    of_panels,
    optional,
    switch,
)


@dataclass(frozen=True)
class Request:
    file: Path = argument(..., "What is read.", metavar="FILE")
    width: float = flag(0.5, "In m.", min=0.1, panel="Sizes")
    tall: bool = switch("Whether it is.", panel="Sizes")
    names: list[str] | None = optional("Again for more.", "--name")
    json: Json = None
    hidden: int = 3


def requests():
    """Yield every request of the command line."""
    modules = [m.name for m in pkgutil.iter_modules(sim.cli.__path__, "sim.cli.")]
    for name in ["sim.run.request", *modules]:
        for kind in vars(importlib.import_module(name)).values():
            ours = inspect.isclass(kind) and kind.__module__ == name
            if ours and is_dataclass(kind) and kind.__name__.endswith("Request"):
                yield kind


@pytest.fixture
def run():
    """Return a function that runs a command line: (result, the request it made)."""
    found = []

    @from_request(Request)
    def command(request: Request) -> None:
        """Do it."""
        found.append(request)

    app = typer.Typer()
    app.command()(command)

    def call(*words):
        return CliRunner().invoke(app, words), found

    return call


def test_a_request_is_made_of_the_flags_and_defaults(run):
    result, found = run("a.txt", "--tall", "--name", "x", "--name", "y")
    assert result.exit_code == 0
    assert found == [Request(Path("a.txt"), 0.5, True, ["x", "y"])]


@pytest.mark.parametrize(
    "words", [(), ("a", "--width", "0"), ("a", "--hidden", "1"), ("a", "--no-tall")]
)
def test_what_is_missing_out_of_range_or_no_flag_is_a_usage_error(run, words):
    result, found = run(*words)
    assert result.exit_code == 2 and not found


def test_flags_know_their_names_and_which_of_a_panel_were_given():
    assert flags_of(Request) == {
        "file": "--file", "width": "--width", "tall": "--tall", "names": "--name",
        "json": "--json",
    }  # fmt: skip
    request = Request(Path("a"), None, True)
    assert of_panels(request, "Sizes") == ["width", "tall"]
    assert of_panels(request, "Others") == []
    assert is_given(request, "tall") and not is_given(request, "names")


@each("kind", list(requests()))
def test_every_flag_of_every_command_has_a_help(kind):
    assert flags_of(kind)
    for field in fields(kind):
        if "option" in field.metadata:
            assert field.metadata["option"].help.strip(), field.name


@each("kind", list(requests()))
def test_every_number_of_every_command_has_limits_of_its_own(kind):
    hints = get_type_hints(kind, include_extras=True)
    for name, word in flags_of(kind).items():
        field = next(f for f in fields(kind) if f.name == name)
        option = field.metadata.get("option") or hints[name].__metadata__[-1]
        typed = str(hints[name])
        if word == "--port":  # sim.view.gate refuses it by this name
            continue
        if not ("int" in typed or "float" in typed) or "str" in typed:
            continue
        told = field.metadata.get("limits") or option.max is not None
        assert told, f"{word} of {kind.__name__} would be refused by inner names"


def test_only_the_time_between_audits_of_a_run_is_no_flag():
    hidden = {f.name for f in fields(RunRequest)} - set(flags_of(RunRequest))
    assert hidden == {"audit_s"}
