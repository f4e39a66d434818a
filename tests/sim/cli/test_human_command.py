"""`odm human info`: figures, table and picture."""

import json
from functools import partial

import numpy as np
import pytest
from forms import some

from handover import POSTURES, Human
from sim.cli.human_command import grip_reach, human_facts
from sim.draw import human_picture
from sim.people.grips import grip_points


def test_figures_are_those_of_the_model(odm):
    code, out, err = odm("human", "info", "--height", "1.6", "--mass", "60", "--json")
    assert code == 0 and "odm: " not in err
    facts = json.loads(out)
    rows = {row["segment"]: row for row in facts["segments"]}
    assert rows["upper arm"]["length_m"] == pytest.approx(0.186 * 1.6, abs=1e-4)
    assert rows["forearm"]["mass_kg"] == pytest.approx(0.016 * 60)
    parts = [rows[n]["of_height"] for n in ("upper arm", "forearm", "hand")]
    assert sum(parts) == pytest.approx(0.44)
    assert len(facts["joints"]) == 7
    assert facts["joints"][3]["upper_deg"] == 150.0
    assert facts["reach"]["arm_length_m"] == pytest.approx(0.383 * 1.6, abs=1e-4)
    assert facts["reach"]["shoulder_height_m"] == pytest.approx(0.818 * 1.6, abs=1e-4)


def test_reach_is_that_of_a_straight_arm_where_ranges_allow_it():
    human = Human(1.75)
    reach = grip_reach(human)
    length = human.arm("right").length
    for direction in ("forward", "up", "down", "outward"):
        assert reach[direction] == pytest.approx(length, abs=0.005)
        assert reach[direction] <= length + 1e-9
    # extension ends at 60 degrees, adduction at 45: less behind and across
    assert 0.5 * length < reach["across"] < 0.95 * length
    assert 0.5 * length < reach["backward"] < 0.95 * length


def test_the_table_names_every_segment_and_joint(odm):
    code, out, _ = odm("human", "info", "--posture", "sitting")
    assert code == 0 and "sitting" in out
    facts = human_facts(Human(1.75, "sitting"))
    names = [row["segment"] for row in facts["segments"]]
    names += [row["joint"] for row in facts["joints"]]
    for name in names:
        assert name in out


@pytest.mark.parametrize("posture", some(POSTURES, 0, 2))
def test_a_picture_of_every_posture_shows_the_person(odm, tmp_path, posture):
    from matplotlib.image import imread

    path = tmp_path / "new" / "person.png"
    code, _, _ = odm("human", "info", "--posture", posture, "--plot", str(path))
    assert code == 0 and [p.name for p in path.parent.iterdir()] == ["person.png"]
    pixels = (255 * imread(path)[..., :3]).round().astype(int)
    assert pixels.shape[0] > 500
    for colour in ((0xC9, 0x7B, 0x12), (0x4A, 0x7F, 0xB5)):  # right, left
        near = (np.abs(pixels - colour).max(axis=2) < 20).mean()
        assert near > 0.005


def test_json_holds_the_pictures_name(odm, tmp_path, monkeypatch):
    few = partial(grip_points, samples=2000)  # what is drawn is not looked at
    monkeypatch.setattr(human_picture, "grip_points", lambda human, _: few(human))
    target, path = tmp_path / "facts.json", tmp_path / "person.png"
    code, out, _ = odm("human", "info", "--json", str(target), "--plot", str(path))
    assert code == 0 and "plot: " in out
    assert json.loads(target.read_text())["plot"] == str(path)
