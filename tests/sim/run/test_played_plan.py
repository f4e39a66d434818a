"""`odm replay plan.json`: a hand-over plan is played from its file alone."""

import json
import re

import numpy as np
import pytest
from command_line import one_sentence
from planned import plan_by_hand
from small import HOME

from handover.scenes.plan_file import object_at, write_plan
from roadmap.errors import BadInput
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


@pytest.mark.parametrize(
    "at, value, told",
    [
        (("motions",), None, "the plan lacks 'motions'"),
        (("holds",), 3, "holds of the plan is 3; give a list"),
        (("motions", 0), "x", "number 0 of motions of the plan is 'x'; give its name"),
        (("motions", 0, "who"), None, "lacks 'who'"),
        (("motions", 0, "joints"), "bend", "is 'bend'; give a list of texts"),
        (("motions", 0, "times", 0), "x", "must be an array of real numbers"),
        (("motions", 0, "times"), [[0.0], [1.0]], "give a row for each time"),
        (("motions", 0, "positions", 0), [], "all rows of the same length"),
        (("giver", "joints", "bend"), "0.3", "give joints, each with a finite number"),
        (("giver", "joints", "bent"), 0.3, "has no joint 'bent'"),
        (("receiver", "joints", "left_knee"), None, "lacks joint 'left_knee'"),
        (("giver", "T_world_base"), [1.0], "has shape (1,); give a (4, 4) pose"),
        (("giver", "T_world_base", 0, 0), 1e300, "is not a rigid motion"),
        (("holds", 0, "begin"), None, "lacks 'begin'"),
        (("holds", 0, "begin"), True, "is True; give a finite number"),
        (("holds", 1, "end"), "never", "give a finite number or null"),
        (("holds", 1, "link"), "toes", "has no link 'toes'"),
        (("scenery", 0, "type"), "cone", "no shape of type 'cone'"),
        (("scenery", 0, "size"), None, "lacks 'size'"),
        (("object", "parts"), {}, "is {}; give a list"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_a_plan_of_another_form_is_refused(
    record, small_map, tmp_path, at, value, told
):
    record["holds"][1]["link"] = small_map.robot.tip_name
    *way, last = at
    part = record
    for key in way:
        part = part[key]
    if value is None:
        del part[last]
    else:
        part[last] = value
    plan = tmp_path / "plan.json"
    plan.write_text(json.dumps(record))
    with pytest.raises(BadInput, match=re.escape(told)):
        read_played(plan)


def test_a_film_of_a_recording_is_asked_elsewhere(odm, tmp_path):
    file = tmp_path / "frames.npz"
    np.savez(file, capsules=np.zeros((1, 1, 7)))
    code, _, err = odm("replay", file, "--animation", tmp_path / "f.gif")
    assert code == 2 and one_sentence(err) and "goes with a hand-over plan" in err
