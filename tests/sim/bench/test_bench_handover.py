"""`odm bench handover`: unsolvable draws apart; Ctrl-C tells what was done."""

import pytest

from roadmap.errors import BadInput
from sim.bench.handover import handover as bench


def unsolved(seed, unsolvable):
    proof = "no grasp is left" if unsolvable else ""
    row = {"seed": seed, "found": False, "seconds": 0.1, "wall_s": 0.1}
    return row | {"reason": "why", "unsolvable": unsolvable, "proof": proof}


@pytest.fixture
def draws(monkeypatch):
    """Replace planning: seed 1 is unsolvable, 2 fails, 4 is interrupted."""

    def one_run(name, seed):
        if seed == 4:
            raise KeyboardInterrupt
        return unsolved(seed, seed == 1)

    monkeypatch.setattr(bench, "one_run", one_run)
    monkeypatch.setattr(bench, "_plan", lambda *args, **more: None)
    monkeypatch.setattr(bench, "load_scene", lambda name, seed: None)
    return bench


def values(result):
    return {row["name"]: row["value"] for row in result["rows"]}


def test_unsolvable_draws_are_told_apart_from_failures(draws):
    result = draws.run(runs=2, varied=True, seed=1)
    assert values(result)["varied: planned, of 1 solvable draws"] == 0.0
    assert values(result)["varied: unsolvable draws, of 2"] == 1
    table = result["tables"][-1]
    assert [row[2] for row in table["rows"]] == ["unsolvable", "failed"]
    assert "ended" not in result["setup"]


def test_ctrl_c_tells_what_was_done(draws):
    result = draws.run(runs=9, varied=True, seed=1)
    assert result["setup"]["ended"] == "by Ctrl-C, in varied after 3 draws"
    assert [row["seed"] for row in result["runs"]["varied"]] == [1, 2, 3]
    assert values(result)["varied: unsolvable draws, of 3"] == 1


def test_kept_draws_are_not_done_again(draws, tmp_path, monkeypatch):
    first = draws.run(runs=3, varied=True, seed=1, out=tmp_path)
    monkeypatch.setattr(draws, "one_run", lambda name, seed: unsolved(seed, False))
    again = draws.run(runs=4, varied=True, seed=1, out=tmp_path)
    assert first["runs"]["varied"] == again["runs"]["varied"][:3]
    assert [row["seed"] for row in again["runs"]["varied"]] == [1, 2, 3, 4]
    assert again["setup"]["draws kept in"] == str(tmp_path)


def test_one_scene_alone_and_no_other(draws):
    found = draws.run(runs=2, seed=1, only=["stool"], short=True)
    assert list(found["runs"]) == ["stool"]
    with pytest.raises(BadInput, match=r"no scene 'stol'; give one of butler, stool"):
        draws.run(runs=2, only=["stol"])
