"""The bench of whole runs: its figures are those of the runs, for any processes."""

from types import SimpleNamespace

import numpy as np
import pytest
from mocap_files import person, write_csv
from small import small_recipe

import odm
from roadmap.errors import BadInput
from roadmap.kinematics.forward import tool_pose
from sim.bench.core import motions
from sim.people.human_motion import motion_names


@pytest.fixture(scope="module")
def map_dir(tmp_path_factory):
    return odm.build_map(small_recipe()).save(tmp_path_factory.mktemp("runs") / "arm3")


def test_every_motion_has_its_rows_and_processes_change_nothing(map_dir):
    one = motions.run(map_dir, short=True, processes=1, motions=("sweep", "hover"))
    two = motions.run(map_dir, short=True, processes=2, motions=("sweep", "hover"))
    assert one["rows"] == two["rows"] and one["runs"] == two["runs"]
    names = " ".join(row["name"] for row in one["rows"])
    assert "sweep: contacts" in names and "hover: trips" in names
    assert one["header"]["map"]["hash"]
    assert len(one["runs"]) == 3 and one["runs"][0]["motion"] == "none"


def test_timed_runs_say_where_the_time_goes_and_others_do_not(map_dir):
    options = {"short": True, "processes": 1, "motions": ("hover",)}
    timed = motions.run(map_dir, execution="timed", **options)
    (table,) = timed["tables"]
    assert [row[0] for row in table["rows"]] == ["hover"]
    lost = dict(timed["runs"][1]["lost"])
    for oracle in ("by sight", "stops", "yields", "drives"):
        assert 0.0 <= lost.pop(oracle) <= 1.0
    assert 0.0 < lost.pop("possible") <= 1.0 and np.isclose(sum(lost.values()), 1.0)
    assert np.isclose(lost["trips"], timed["runs"][1]["trips"] * _alone(timed) / 2.0)
    assert motions.run(map_dir, **options)["tables"] == []


def _alone(result):
    """Return the time of a trip with nobody about [s]."""
    alone = result["runs"][0]
    assert alone["trips"] > 0 and "lost" not in alone
    return alone["trip_s"]


def test_pushed_runs_say_so_and_how_far_and_are_the_same_again(map_dir):
    options = {"short": True, "processes": 1, "motions": ("hover",), "pushed": True}
    one, again = (motions.run(map_dir, execution="timed", **options) for _ in range(2))
    assert one["rows"] == again["rows"] and one["runs"] == again["runs"]
    assert one["setup"]["pushed"]["encoder"] == 0.001
    values = {row["name"]: row for row in one["rows"]}
    assert values["all, pushed: contacts while moving"]["met"] is True
    assert values["all, pushed: farthest from the set-point"]["value"] > 0.0
    assert np.isclose(values["all, pushed: simulated time"]["value"], 4.0 / 60.0)
    assert all("pushed" in run for run in one["runs"])


def test_a_contact_of_a_pushed_run_is_one_too_many():
    pushed = {"push": 1, "bump": 2, "slip": 0, "seats": 1, "farthest_m": 0.03}
    run = {"contacts": 0, "duration_s": 60.0, "closest_while_moving": None}
    run["pushed"] = pushed
    rows = motions._pushed_rows([run, run | {"contacts": 1}], "timed")
    values = {row["name"]: row for row in rows}
    assert values["all, pushed: contacts while moving"]["met"] is False
    assert values["all, pushed: pushes, bumps and slips"]["value"] == 6
    assert np.isclose(values["all, pushed: farthest from the set-point"]["value"], 3.0)


def test_the_rows_say_what_the_runs_were():
    moment = {"separation_m": 0.04, "point_speed_m_s": 0.5}
    run = {
        "contacts": 1,
        "standing_contacts": 3,
        "trips_per_minute": 20.0,
        "path_changes": 3,
        "moving_s": 30.0,
        "held_s": 6.0,
        "duration_s": 60.0,
        "closest_while_moving": moment,
        "occupied": 0.25,
    }
    rows = motions._rows("sweep", [run, run | {"contacts": 2}], 40.0, "kinematic")
    values = {row["name"]: row for row in rows}
    assert values["sweep: contacts while moving"]["value"] == 3
    assert values["sweep: contacts while moving"]["met"] is False
    assert np.isclose(values["sweep: smallest separation while moving"]["value"], 4.0)
    trips = values["sweep: trips, of those with nobody"]
    assert trips["value"] == 50.0 and trips["met"] is False
    assert values["sweep: holding"]["value"] == 10.0
    assert values["sweep: contacts while it stood"]["value"] == 6.0
    assert values["sweep: path changes a minute while moving"]["value"] == 6.0
    occupied = "sweep: the place to go to is within m of the person"
    assert values[occupied]["value"] == 25.0


def test_what_could_have_been_evaded_is_a_share_of_the_contacts_at_rest():
    run = {"standing_contacts": 4, "duration_s": 30.0}
    run |= {"evadable": 1, "evadable_before": 4}
    bare = run | dict.fromkeys(("standing_contacts", "evadable", "evadable_before"), 0)
    values = {row["name"]: row for row in motions._standing_rows([run, bare])}
    assert values["all: contacts while it stood"]["value"] == 4
    assert values["all: the same, a minute"]["value"] == 4.0
    one = values["all: of those evadable from where it stood"]
    assert one["value"] == 25.0 and one["met"] is False
    assert motions._standing_rows([bare])[2]["value"] == 0.0


def test_a_place_counts_as_occupied_while_the_person_is_within_the_clearance(map_dir):
    planner = odm.ReactivePlanner(odm.load_map(map_dir))
    places = planner.cell_map.roadmap.nodes[:2]
    tools = [tool_pose(planner.robot, q)[:3, 3] for q in places]
    here, there = (np.r_[p, p, 0.02][None] for p in tools)
    away = here + np.r_[0.0, 0.0, 3.0, 0.0, 0.0, 3.0, 0.0]
    frames = [here, there, away, away]
    result = SimpleNamespace(rate_hz=10.0, place=[0, 0, 0, 1], capsules=frames)
    assert np.linalg.norm(tools[0] - tools[1]) > 0.2
    assert motions._occupied(planner, places, result) == 0.25
    bare = SimpleNamespace(rate_hz=10.0, place=[0], capsules=[np.zeros((0, 7))])
    assert motions._occupied(planner, places, bare) == 0.0


def test_an_unknown_motion_is_refused_before_any_work():
    with pytest.raises(BadInput, match=motion_names()[0]):
        motions.run("nowhere", motions=("walk",))


def test_a_recording_that_asks_for_it_is_played_with_defects_and_a_mapping(
    odm, map_dir, tmp_path
):
    joints = person(60)
    joints["neck"] += [0, -0.5, -0.1]  # a trunk bent backwards
    names = {name: f"m{i}" for i, name in enumerate(joints)}
    file = write_csv(tmp_path / "bent.csv", joints, names=names)
    toml = tmp_path / "names.toml"
    toml.write_text("\n".join(f'{joint} = "{n}"' for joint, n in names.items()))
    asked = ("bench", "motions", "--map", map_dir, "--short", "--file", file)
    asked += ("--processes", "1", "--motion", "hover", "--mapping", toml)
    code, _, told = odm(*asked)
    assert code == 2 and "--accept-defects" in told
    code, shown, _ = odm(*asked, "--accept-defects")
    assert code == 0 and "bent: trips" in shown


@pytest.mark.parametrize("option", [{"mapping": "a.toml"}, {"accept_defects": True}])
def test_what_is_about_recordings_is_refused_without_one(option):
    with pytest.raises(BadInput, match="name one with --file"):
        motions.run("nowhere", motions=("hover",), **option)
