"""What the README shows works as it stands there."""

import re
from pathlib import Path

import pytest

from odm import build_map
from sim.bench.command import fill_section
from sim.loop.warmup import tiny_recipe

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_python_example_runs(tmp_path, monkeypatch, capsys):
    build_map(tiny_recipe(tmp_path), threads=1).save(tmp_path / "maps/built/story")
    monkeypatch.chdir(tmp_path)
    names = {}
    for example in re.findall(r"```python\n(.*?)```", README, re.S):
        exec(compile(example, "README.md", "exec"), names)
    assert len(capsys.readouterr().out.splitlines()) == 1
    assert abs(names["motion"].q_end - names["q_goal"]).max() < 1e-6


def test_it_is_short():
    assert len(README.splitlines()) <= 130


@pytest.mark.parametrize(
    ("page", "bench"), [("docs/measured.md", "latency"), ("docs/safety.md", "overhead")]
)
def test_the_measured_tables_have_their_places(page, bench):
    fill_section(ROOT / page, bench, None)


@pytest.mark.parametrize("page", ["README.md", "docs/safety.md"])
def test_links_and_files_named_exist(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)]+)\)", text):
        assert (ROOT / page).parent.joinpath(link).exists(), link
    for name in re.findall(r"`((?:roadmap|odm|sim|docs|tests)/[\w/.]+)`", text):
        assert (ROOT / name).exists() or list(ROOT.glob(f"{name}*")), name
