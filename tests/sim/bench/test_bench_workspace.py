"""`odm bench workspace` counts what the paper counts, and would see a difference."""

import json

import numpy as np
import pytest

from handover import ReachSettings, build_reach_map, chain_of
from roadmap import load_robot
from sim.bench.command import markdown_of
from sim.bench.handover import workspace_cases


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    chain = chain_of(load_robot("armar3", cover_excess=0.1), self_collisions=False)
    settings = ReachSettings(cell=0.15, rotations=72, samples=40_000)
    path = tmp_path_factory.mktemp("reach") / "armar3"
    return build_reach_map(chain, settings, threads=2).save(path)


def test_the_table_has_the_papers_counts_beside_ours(odm, folder, tmp_path):
    file = tmp_path / "workspace.json"
    code, out, err = odm(
        "bench", "workspace", "--map", folder, "--short", "--json", file
    )
    assert code == 0, err
    result = json.loads(file.read_text())
    rows = {row["name"]: row for row in result["rows"]}
    counts = [
        rows[f"Table I, {d} cm: targets"]["value"] for d in (70, 90, 110, 130, 150)
    ]
    assert all(a > b > 0 for a, b in zip(counts, counts[1:]))
    paper = [3576, 2290, 1110, 373, 78]
    # a map of coarse cells: the shape of the curve, not its figures
    assert np.allclose(np.log(counts), np.log(paper), atol=0.7)
    assert rows["best-first top 10 that differ from the full grid's"]["value"] == 0
    assert rows["15 cm / 72, 8 grasps: moved 2 cm"]["n"] == 10
    assert "10 cm / 576" not in out and "| 150 cm | 78 |" in markdown_of(result)


def test_another_robot_is_refused(odm, robot_reach):
    code, _, err = odm("bench", "workspace", "--map", robot_reach, "--short")
    assert (
        code != 0 and "kawasaki_fs003n" in err and "odm workspace build armar3" in err
    )


@pytest.fixture
def robot_reach(tmp_path):
    chain = chain_of(load_robot("kawasaki_fs003n", cover_excess=0.1), False)
    settings = ReachSettings(cell=0.3, rotations=72, samples=2_000)
    return build_reach_map(chain, settings, threads=1).save(tmp_path / "reach")


def test_a_difference_would_be_seen(folder, monkeypatch):
    from handover import InteractionWorkspace, load_reach_map

    reach, best = load_reach_map(folder), InteractionWorkspace.best
    monkeypatch.setattr(
        InteractionWorkspace, "best", lambda meet, k: best(meet, k + 1)[1:]
    )
    wrong = workspace_cases.equal_cases(reach, 20, 0, lambda text: None)
    assert wrong > 5
