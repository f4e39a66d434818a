"""`odm doctor`: what is there, what is missing, and what to do about it."""

import json

import pytest

from roadmap.errors import PlanningError
from sim.cli import doctor_command
from sim.cli.doctor_command import examine


def by_name(rows):
    return {row.what: row for row in rows}


def test_here_all_that_is_needed_is_there(odm, tmp_path):
    code, out, _ = odm("doctor", "--maps", tmp_path, "--json")
    found = json.loads(out)
    states = {row["what"]: row["state"] for row in found["rows"]}
    assert code == 0 and found["sound"] and "wrong" not in states.values()
    assert states["numba"] == "ok" and states["maps"] == "missing"
    code, out, _ = odm("doctor", "--maps", tmp_path)
    assert code == 0 and "numba" in out and "odm demo" in out


@pytest.mark.parametrize(
    ("module", "state", "remedy"),
    [
        ("numba", "wrong", "pip install numba"),
        ("fcl", "wrong", "pip install python-fcl"),
        ("matplotlib", "missing", "pip install 'odm-planner[sim]'"),
        ("sphinx", "missing", "pip install 'odm-planner[docs]'"),
    ],
)
def test_what_is_not_installed_is_told_with_its_remedy(
    odm, monkeypatch, tmp_path, module, state, remedy
):
    monkeypatch.setattr(doctor_command, "is_there", lambda name: name != module)
    names = doctor_command.NEEDED | {m: p for m, (p, *_) in doctor_command.MORE.items()}
    row = by_name(examine(tmp_path))[names[module]]
    assert row.state == state and remedy in row.remedy
    code, out, _ = odm("doctor", "--maps", tmp_path)
    assert code == (1 if state == "wrong" else 0)
    assert remedy.split()[-1] in "".join(out.split())  # no markup eats the extra


def test_maps_and_a_cache_that_cannot_be_written_are_seen(monkeypatch, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "manifest.json").write_text("{}")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "nowhere"))
    rows = by_name(examine(tmp_path))
    assert rows["maps"].found == "mine"
    cache = rows["cache of compiled loops"]
    assert cache.state == "missing" and "NUMBA_CACHE_DIR" in cache.remedy


def test_it_tells_where_nothing_of_ours_can_be_imported(monkeypatch, tmp_path):
    def refuse(*_):
        raise PlanningError("set NUMBA_CACHE_DIR")

    monkeypatch.setattr(doctor_command.Compiling, "missing", refuse)
    row = by_name(examine(tmp_path))["compiled"]
    assert row.state == "wrong" and "NUMBA_CACHE_DIR" in row.remedy
