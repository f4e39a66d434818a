"""Every file, function and test that docs/safety.md names exists."""

import re
from functools import cache
from pathlib import Path

from rows import each

ROOT = Path(__file__).resolve().parents[1]
DOC = ROOT / "docs" / "safety.md"
TEXT = DOC.read_text(encoding="utf-8")
FOLDERS = r"(?:roadmap|odm|sim|docs|tests|maps)/"
NAMED = sorted(set(re.findall(rf"`({FOLDERS}[\w/.-]+\.py)::(\w+)`", TEXT)))
FILES = sorted(set(re.findall(rf"`({FOLDERS}[\w/.-]+)(?:::\w+)?`", TEXT)))


@cache
def source_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def defines(path: Path, name: str) -> bool:
    """Return whether a file defines a function, method or class of that name."""
    return re.search(rf"^\s*(?:def|class) {name}\b", source_of(path), re.M) is not None


def test_it_names_many():
    assert len(NAMED) > 100


@each("file", FILES)
def test_files_that_are_named_exist(file):
    assert (ROOT / file).exists()


@each(("file", "name"), NAMED)
def test_functions_and_tests_that_are_named_exist(file, name):
    assert defines(ROOT / file, name)


def test_claims_are_numbered_and_each_says_who_attacks_it():
    claims = re.split(r"^\*\*(\d+)\. ", TEXT, flags=re.M)[1:]
    numbers = [int(n) for n in claims[::2]]
    assert numbers == list(range(1, len(numbers) + 1))
    for number, claim in zip(numbers, claims[1::2], strict=True):
        assert "- Enforced:" in claim and "- Attacked:" in claim, number


def test_lines_are_short_but_for_tables_and_names():
    table = r"<!-- odm bench overhead: begin -->.*?overhead: end -->"
    written = re.sub(table, "", TEXT, flags=re.S)
    for line in written.splitlines():
        assert len(line) <= 100 or line.startswith("|") or "::" in line, line


@each(
    ("file", "stands"),
    [
        ("odm/close_test/safety.py", "rho: float = 0.03"),
        ("odm/close_test/safety.py", "sensor: float = 0.004"),
        ("odm/close_test/safety.py", "tracking: float = 0.002"),
        ("odm/close_test/safety.py", "blending: float = 0.004"),
        ("odm/close_test/safety.py", "user: float = 0.0"),
        ("odm/planner/path.py", "_TUBE_RADIUS = 0.01 "),
        ("odm/search/_paths.py", "ON = 1e-7 "),
        ("roadmap/kinematics/_limits.py", "LIMIT_TOLERANCE = 1e-3 "),
        ("odm/close_test/_close.py", "ESCAPE_SLACK = 1e-3 "),
        ("odm/cell_map/cell_map.py", "ROUNDING = 1e-6 "),
        ("odm/planner/settings.py", "max_age_s: float = setting(0.1, "),
        ("odm/obstacles/unit.py", "MAX_RANGE_M = 20.0 "),
        ("odm/planner/settings.py", "history_s: float = setting(0.25, "),
        ("odm/frame/sensor_watch.py", "_LEAVES = 4.0 "),
        ("odm/cameras/settings.py", 'policy: str = "free"'),
        ("odm/cameras/settings.py", "memory_s: float = setting(0.3, "),
        ("odm/audit/sequence_audit.py", "LENGTH = 500 "),
        ("odm/audit/sequence_audit.py", "EXACT_EVERY = 50 "),
        ("odm/audit/sequence_judge.py", "PLACES = 513 "),
        ("odm/close_test/static.py", "MARGIN + 2.0 * more"),
        ("roadmap/geometry/self_collision.py", "MARGIN = 1e-4"),
        ("roadmap/geometry/self_collision.py", "_SAMPLES = 500"),
        ("odm/execution/settings.py", "slice_s: float = setting(0.04, "),
        ("odm/execution/threat.py", "speed: float = setting(2.0, "),
        ("odm/execution/threat.py", "acceleration: float = setting(4.0, "),
        ("odm/execution/threat.py", "noise: float = setting(0.0, "),
        ("odm/execution/threat.py", "max_plausible_speed: float = setting(5.0, "),
        (
            "odm/execution/threat.py",
            "max_plausible_acceleration: float = setting(60.0, ",
        ),
        ("odm/execution/settings.py", "confirmed: int = setting(3, "),
    ],
)
def test_numbers_it_rests_on_are_those_of_the_sources(file, stands):
    assert stands in source_of(ROOT / file)
