"""Every file, function and test that docs/safety.md names exists."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOC = ROOT / "docs" / "safety.md"
TEXT = DOC.read_text(encoding="utf-8")
FOLDERS = r"(?:roadmap|odm|sim|docs|tests|maps)/"
NAMED = sorted(set(re.findall(rf"`({FOLDERS}[\w/.-]+\.py)::(\w+)`", TEXT)))
FILES = sorted(set(re.findall(rf"`({FOLDERS}[\w/.-]+)(?:::\w+)?`", TEXT)))


def defines(path: Path, name: str) -> bool:
    """Return whether a file defines a function, method or class of that name."""
    source = path.read_text(encoding="utf-8")
    return re.search(rf"^\s*(?:def|class) {name}\b", source, re.M) is not None


def test_it_names_many():
    assert len(NAMED) > 100


@pytest.mark.parametrize("file", FILES)
def test_files_that_are_named_exist(file):
    assert (ROOT / file).exists()


@pytest.mark.parametrize(("file", "name"), NAMED)
def test_functions_and_tests_that_are_named_exist(file, name):
    assert defines(ROOT / file, name)


def test_claims_are_numbered_and_each_says_who_attacks_it():
    claims = re.split(r"^\*\*(\d+)\. ", TEXT, flags=re.M)[1:]
    numbers = [int(n) for n in claims[::2]]
    assert numbers == list(range(1, len(numbers) + 1))
    for number, claim in zip(numbers, claims[1::2], strict=True):
        assert "- Enforced:" in claim and "- Attacked:" in claim, number


def test_lines_are_short_but_for_tables_and_names():
    table = r"<!-- odm bench tax: begin -->.*?tax: end -->"
    written = re.sub(table, "", TEXT, flags=re.S)
    for line in written.splitlines():
        assert len(line) <= 100 or line.startswith("|") or "::" in line, line


@pytest.mark.parametrize(
    ("file", "stands"),
    [
        ("odm/safety.py", "rho: float = 0.03"),
        ("odm/safety.py", "sensor: float = 0.004"),
        ("odm/safety.py", "tracking: float = 0.002"),
        ("odm/safety.py", "blending: float = 0.004"),
        ("odm/safety.py", "user: float = 0.0"),
        ("odm/attach.py", "_ROOM = 0.01 "),
        ("odm/_kernels/ways.py", "ON = 1e-7 "),
        ("odm/_kernels/step.py", "LIMIT_TOLERANCE = 1e-3 "),
        ("odm/_kernels/close.py", "ESCAPE_SLACK = 1e-3 "),
        ("odm/cell_map.py", "ROUNDING = 1e-6 "),
        ("odm/planner_settings.py", "max_age_s: float = 0.1"),
        ("odm/planner_settings.py", "max_range_m: float = 20.0"),
        ("odm/planner_settings.py", "memory_s: float = 0.25"),
        ("odm/unfit.py", "_LEAVES = 4.0 "),
        ("odm/cameras/settings.py", 'policy: str = "free"'),
        ("odm/cameras/settings.py", "memory_s: float = 0.3"),
        ("odm/sequence_audit.py", "LENGTH = 500 "),
        ("odm/sequence_audit.py", "EXACT_EVERY = 50 "),
        ("odm/sequence_judge.py", "PLACES = 513 "),
        ("odm/static.py", "MARGIN + 2.0 * more"),
        ("roadmap/self_collision.py", "MARGIN = 1e-4"),
        ("roadmap/self_collision.py", "_SAMPLES = 500"),
        ("sim/braking.py", "_SLICE = 0.04 "),
        ("sim/threat.py", "speed: float = 2.0"),
        ("sim/threat.py", "acceleration: float = 4.0"),
        ("sim/threat.py", "noise: float = 0.0"),
        ("sim/threat.py", "top_speed: float = 5.0"),
        ("sim/threat.py", "jump: float = 60.0"),
        ("sim/threat.py", "_CONFIRMED = 3 "),
    ],
)
def test_numbers_it_rests_on_are_those_of_the_sources(file, stands):
    assert stands in (ROOT / file).read_text(encoding="utf-8")
