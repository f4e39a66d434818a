"""The docs name files that are there."""

import re
from pathlib import Path

from rows import each

ROOT = Path(__file__).resolve().parent.parent
TEXTS = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
FILE = re.compile(r"(?<![\w/.])((?:roadmap|odm|handover|sim|tests|maps)/[\w/]+\.\w+)")
LINK = re.compile(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)")


@each("path", TEXTS)
def test_files_that_a_text_names_exist(path):
    text = path.read_text(encoding="utf-8")
    named = {m for m in FILE.findall(text) if not m.startswith("maps/built/")}
    named -= {"maps/NAME.toml"}  # an example
    assert not {name for name in named if not (ROOT / name).exists()}
    links = set(LINK.findall(text))
    assert not {name for name in links if not (path.parent / name).exists()}


DECISIONS = {
    path.name[:4]: path.read_text(encoding="utf-8")
    for path in (ROOT / "docs" / "decisions").glob("0*.md")
}


def test_decisions_have_status_and_date_and_are_listed_with_them():
    listed = (ROOT / "docs" / "decisions" / "README.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| \[(\d{4})\]\([^|]*(\|.*)$", listed, flags=re.M))
    assert set(rows) == set(DECISIONS)
    for number, text in DECISIONS.items():
        title = re.search(r"^# (?:\d{4}:? )?(.+)$", text, flags=re.M)
        status = re.search(r"^Status: (accepted|changed|superseded)(.*)", text, re.M)
        date = re.search(r"^Date: (\d{4}-\d\d-\d\d)", text, flags=re.M)
        assert title and status and date, number
        others = re.findall(r"\b\d{4}\b", re.sub(r"\([^)]*\)", "", status[2]))
        told = {title[1], status[1], date[1], *others}
        assert not {word for word in told if word not in rows[number]}, number


def test_a_number_without_a_decision_is_explained():
    listed = (ROOT / "docs" / "decisions" / "README.md").read_text(encoding="utf-8")
    numbers = {f"{n:04d}" for n in range(1, int(max(DECISIONS)) + 1)}
    missing = listed.partition("**0008")[2].partition("\n## ")[0]
    explained = {"0008", *re.findall(r"\d{4}", missing)}
    assert not numbers - set(DECISIONS) - explained


CHANGES = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_each_line_of_the_changelog_has_a_section_and_is_short():
    """A flat list of a thousand lines is read by nobody: see CONTRIBUTING.md."""
    release = CHANGES.partition("\n## ")[2]
    before, *sections = re.split(r"^### ", release, flags=re.M)
    assert "\n- " not in before, "a line of the changelog belongs into a section"
    titles = [section.partition("\n")[0] for section in sections]
    assert len(titles) == len(set(titles))
    assert not [s for s, title in zip(sections, titles, strict=True) if "\n- " not in s]
    assert not [line for line in CHANGES.splitlines() if len(line) > 120]


def test_the_changelog_names_decisions_that_are_there():
    assert not set(re.findall(r"\b0\d{3}\b", CHANGES)) - set(DECISIONS)
