"""The bench of runs to targets: its table is that of the runs."""

import json

import pytest

from roadmap.errors import BadInput
from sim.bench.command import markdown_of
from sim.bench.handover import targets
from sim.run.meet import MeetTask


@pytest.fixture(scope="module")
def result(meet_maps):
    return targets.run(meet_maps[0], reach=meet_maps[1], short=True)


def test_short_is_one_run_of_the_figures_asked(result):
    run, cycling, trembling = result["runs"]
    assert run["distance_m"] == 0.9 and result["bench"] == "targets"
    assert run["dwell_s"] is None and cycling["dwell_s"] == targets.DWELL_S
    assert cycling["distance_m"] == 0.9 and cycling["seed"] == run["seed"]
    assert cycling["audit"]["judged"] == 0 < run["audit"]["judged"]
    assert trembling["dwell_s"] is None and trembling["seed"] == run["seed"]
    assert (trembling["motion"], run["motion"]) == ("tremble", "reach")
    rows = {row["name"]: row for row in result["rows"]}
    p99 = next(row for name, row in rows.items() if name.startswith("loop, CPU: p99"))
    both = max(r["loop_cpu_s"]["p99"] for r in result["runs"])
    assert p99["value"] == pytest.approx(1e3 * both)
    assert p99["asked"] == {"most": 8.0} and rows["contacts"]["asked"] == {"most": 0.0}
    assert rows["contacts"]["value"] == run["contacts"] == 0
    json.dumps(result, allow_nan=False)


def test_the_rows_say_what_the_runs_were(result):
    run, cycling, trembling = result["runs"]
    audit = {"judged": 10, "out_of_reach": 2, "top": 0.5, "within_margin": 0.75}
    audit |= {"worse": 0.125, "none": 0.125}
    other = run | {"audit": audit, "contacts": 3, "distance_m": 1.3}
    other["loop_cpu_s"] = {"p50": 0.004, "p99": 0.009, "max": 0.05}
    empty = run | {"audit": {**dict.fromkeys(audit, 0.0), "judged": 4}}
    empty["audit"]["out_of_reach"] = 4
    went = {"arrivals": 9, "handovers": 7, "changes": 2, "seconds": 30.0}
    shook = {"path_changes": 3, "changes": 5, "arrivals": 4, "seconds": 120.0}
    runs = [empty, other, cycling | went, trembling | shook]
    rows = {r["name"]: r for r in targets._rows(runs)}
    values = {name: row["value"] for name, row in rows.items()}
    assert values["loop, CPU: p50, largest of 4 runs"] == 4.0
    assert rows["loop, CPU: p99, largest of 4 runs"]["met"] is False
    assert values["contacts"] == 3.0 and rows["contacts"]["met"] is False
    assert values["at or on the way to the top-ranked reachable target"] == 50.0
    assert values["to it or one within the margin of its quality"] == 75.0
    assert values["arrivals a minute, cycling"] == 18.0
    assert rows["arrivals a minute, cycling"]["met"] is True
    assert values["stays of 1 s a minute, cycling"] == 14.0
    assert values["target changes a minute, cycling"] == 4.0
    assert rows["arrivals a minute, staying"]["asked"] == {}
    assert values["new paths a minute, trembling"] == 1.5
    assert rows["new paths a minute, trembling"]["met"] is False
    assert values["target changes a minute, trembling"] == 2.5
    tables = targets._tables(runs)
    times, cycled, trembled, shares, cycles, trembles = tables
    assert trembles["rows"][0][4:6] == ["2.0", "1.5"]
    assert len(trembled["rows"]) == 1
    assert cycles["rows"][0][:3] == ["0.9 m", "18.0", "14.0"]
    assert times["rows"][1] == ["1.3 m", "4.0", "9.0", "50.0", *times["rows"][0][4:]]
    assert shares["rows"][0][4:6] == ["-", "-"]
    assert shares["rows"][1][4:6] == ["50 %", "75 %"]
    for more in tables:
        assert all(len(row) == len(more["head"]) for row in more["rows"])
    assert "1.3 m" in markdown_of(result | {"tables": [times, cycled, shares]})


def test_other_distances_are_other_runs(meet_maps, monkeypatch):
    # what makes the first frames quick is looked at elsewhere
    monkeypatch.setattr(MeetTask, "_rehearse", lambda *_: None)
    two = targets.run(
        meet_maps[0],
        reach=meet_maps[1],
        short=True,
        seconds=0.1,
        distances=(0.8, 1.0),
        seed=3,
    )
    told = [(run["distance_m"], run["seed"]) for run in two["runs"]]
    assert told == 3 * [(0.8, 3), (1.0, 4)]


def test_the_command_prints_it(odm, meet_maps, tmp_path):
    words = ["bench", "targets", "--map", meet_maps[0], "--reach", meet_maps[1]]
    code, out, err = odm(*words, "--short", "--seconds", "0.5", "--execution", "timed")
    assert code == 0, err
    assert "top-ranked" in out and "0.9 m" in out and "execution: timed" in out


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"distances": (9.0,)}, "9.0"),
        ({"seconds": 0.0}, "seconds"),
        ({"execution": "fast"}, "kinematic, timed"),
    ],
)
def test_what_cannot_be_run_is_refused_before_any_work(wrong, words):
    with pytest.raises(BadInput, match=words):
        targets.run("nowhere", **wrong)
