"""`odm replay plan.json`: a hand-over plan is played from its file alone."""

import json

import numpy as np
import pytest
from command_line import one_sentence
from planned import plan_by_hand
from small import HOME

from handover.scenes.plan_file import object_at, write_plan
from sim.run import handover_film
from sim.run.played_plan import read_played

CUBE = {"type": "box", "size": [0.04, 0.04, 0.04], "pose": np.eye(4).tolist()}
IN_HAND = np.eye(4)
IN_HAND[2, 3] = 0.1


@pytest.fixture
def record():
    """A plan whose giver takes the object with its tool after 0.8 s."""
    told = plan_by_hand() | {
        "object": {"name": "cube", "mass_kg": 0.1, "parts": [CUBE]}
    }
    told["holds"][0]["end"] = 0.8
    told["holds"].append(
        {"who": "giver", "link": "tool", "T_link_object": IN_HAND.tolist(),
         "begin": 0.8, "end": None, "touching": ["tool"]}
    )  # fmt: skip
    return told


def test_the_object_is_where_the_link_that_holds_it_is(record, small_map, tmp_path):
    from roadmap.kinematics.forward import tool_pose

    link = small_map.robot.tip_name
    record["holds"][1]["link"] = link
    played = read_played(write_plan(tmp_path / "plan.json", record))
    assert np.allclose(object_at(played.record, played, 0.5), np.eye(4))
    T = tool_pose(small_map.robot, HOME) @ IN_HAND
    assert np.allclose(object_at(played.record, played, 0.9), T, atol=1e-6)
    (shape,) = played.object_shapes(T)
    assert np.allclose(shape.T_base_shape, T)
    assert [f.name for f in played.scenery] == ["box"]


def test_a_plan_is_told_and_drawn(odm, record, small_map, tmp_path, monkeypatch):
    monkeypatch.setattr(handover_film, "_FRAMES", 3)
    record["holds"][1]["link"] = small_map.robot.tip_name
    plan, film = write_plan(tmp_path / "plan.json", record), tmp_path / "film.gif"
    code, out, err = odm("replay", plan, "--animation", film)
    assert code == 0, err
    assert "1.00 to    3.00 s  giver    carry" in out
    assert f"the object is held by the giver, {small_map.robot.tip_name}" in out
    assert film.read_bytes().startswith(b"GIF8")
    code, out, err = odm("replay", plan, "--json", "-")
    assert code == 0 and [m["who"] for m in json.loads(out)["motions"]] == [
        "giver", "giver", "receiver",
    ]  # fmt: skip


@pytest.mark.parametrize(
    "change, words, told",
    [
        ({"object": None}, (), "lacks 'object'"),
        ({"format": "mine"}, (), "no odm hand-over plan"),
        ({"giver": "/nowhere/arm.urdf"}, (), "the URDF /nowhere/arm.urdf"),
        ({}, ("--holds",), "--holds goes with a recording"),
        ({}, ("--animation", "film.mp4"), ".gif"),
    ],
)
def test_what_cannot_be_played_is_refused(odm, record, tmp_path, change, words, told):
    for name, value in change.items():
        if value is None:
            del record[name]
        elif name == "giver":
            record[name]["urdf"] = value
        else:
            record[name] = value
    plan = tmp_path / "plan.json"
    plan.write_text(json.dumps(record))
    code, _, err = odm("replay", plan, *words)
    assert code == 2 and one_sentence(err) and told in err


def test_a_film_of_a_recording_is_asked_elsewhere(odm, tmp_path):
    file = tmp_path / "frames.npz"
    np.savez(file, capsules=np.zeros((1, 1, 7)))
    code, _, err = odm("replay", file, "--animation", tmp_path / "f.gif")
    assert code == 2 and one_sentence(err) and "goes with a hand-over plan" in err
