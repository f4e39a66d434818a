"""Commands and flags that a page writes down are there."""

import re
from pathlib import Path

import pytest
import typer
from rows import each

from sim.cli import main as cli

ROOT = Path(__file__).resolve().parents[3]
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
PAGES = [page for page in PAGES if page.name != "CHANGELOG.md"]  # names of the past
FLAG = re.compile(r"(?<![\w-])--[a-z][\w-]*")


def commands(text):
    """Return what stands behind `odm` in blocks of shell and in the text."""
    blocks = "\n".join(re.findall(r"```\n(.*?)```", text, re.S)).replace("\\\n", " ")
    prose = re.sub(r"```.*?```", "", text, flags=re.S).replace("\n", " ")
    found = re.findall(r"^\s*odm ([^\n#]+)", blocks, re.M)
    return found + re.findall(r"`odm ([^`]+)`", prose)


def wrong(line):
    """Return what of a command line is not there; None: all is."""
    command, words = typer.main.get_command(cli.app), line.split()
    while hasattr(command, "commands") and words and words[0] in command.commands:
        command = command.commands[words.pop(0)]
    if hasattr(command, "commands") and words and re.fullmatch("[a-z]+", words[0]):
        return words[0]
    known = {name for p in command.params for name in (*p.opts, *p.secondary_opts)}
    flags = FLAG.findall(" ".join(words))
    return next((flag for flag in flags if flag not in {*known, "--help"}), None)


@each("page", PAGES)
def test_commands_and_flags_of_a_page_are_there(page):
    lines = commands(page.read_text(encoding="utf-8"))
    assert not {line: wrong(line) for line in lines if wrong(line)}


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("build my.toml --out maps/built/mine", None),
        ("build my.toml --target maps", "--target"),
        ("workspace meet --robot panda --hand left", "--hand"),
        ("biuld my.toml", "biuld"),
        ("COMMAND --help", None),
    ],
)
def test_what_is_not_there_is_found(line, told):
    assert wrong(line) == told
    text = f"words `odm {line}`\n```\nodm {line}   # why\n```\n"
    assert [found.strip() for found in commands(text)] == [line, line]


def test_the_readme_has_commands_to_look_at():
    assert len(commands((ROOT / "README.md").read_text(encoding="utf-8"))) > 10
