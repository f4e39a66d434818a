"""The bench of whole runs: its figures are those of the runs, for any processes."""

import numpy as np
import pytest
from small import small_recipe

import odm
from roadmap.errors import BadInput
from sim.bench import motions
from sim.human_motion import motion_names


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


def test_the_rows_say_what_the_runs_were():
    moment = {"separation_m": 0.04, "point_speed_m_s": 0.5}
    run = {
        "contacts": 1,
        "trips_per_minute": 20.0,
        "changes_per_minute": 3.0,
        "held_s": 6.0,
        "duration_s": 60.0,
        "closest_while_moving": moment,
    }
    rows = motions._rows("sweep", [run, run | {"contacts": 2}], 40.0, "kinematic")
    values = {row["name"]: row for row in rows}
    assert values["sweep: contacts while moving"]["value"] == 3
    assert values["sweep: contacts while moving"]["met"] is False
    assert np.isclose(values["sweep: smallest separation while moving"]["value"], 4.0)
    trips = values["sweep: trips, of those with nobody"]
    assert trips["value"] == 50.0 and trips["met"] is False
    assert values["sweep: holding"]["value"] == 10.0


def test_an_unknown_motion_is_refused_before_any_work():
    with pytest.raises(BadInput, match=motion_names()[0]):
        motions.run("nowhere", motions=("walk",))
