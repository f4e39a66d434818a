"""The docs name files that are there."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
TEXTS = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
TEXTS = [path for path in TEXTS if path.name != "CHANGELOG.md"]
FILE = re.compile(r"(?<![\w/.])((?:roadmap|odm|handover|sim|tests|maps)/[\w/]+\.\w+)")
LINK = re.compile(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)")


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_files_that_a_text_names_exist(path):
    text = path.read_text(encoding="utf-8")
    named = {m for m in FILE.findall(text) if not m.startswith("maps/built/")}
    named -= {"maps/NAME.toml"}  # an example
    assert not {name for name in named if not (ROOT / name).exists()}
    links = set(LINK.findall(text))
    assert not {name for name in links if not (path.parent / name).exists()}
