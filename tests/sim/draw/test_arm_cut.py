"""`odm workspace human`: cuts through what a hand can do, told and drawn."""

import json

import numpy as np
import pytest
from command_line import one_sentence

from handover import Human
from handover.meet.places import qualities_at
from sim.draw.arm_cut import FIELDS, arm_cut, write_arm_picture

QUICK = ("--spacing", "0.08", "--rotations", "72")


@pytest.fixture(scope="module")
def human():
    return Human(1.75)


@pytest.fixture(scope="module")
def cut(human):
    shoulder = human.T_world_shoulder("right")[:3, 3]
    return arm_cut(human, "right", 1, shoulder[1], 0.05, rotations=72)


def test_a_cut_holds_what_the_hand_can_do_at_each_of_its_places(human, cut):
    shoulder = human.T_world_shoulder("right")[:3, 3]
    x, z = cut.x[[9, 17, 20]], cut.y[[10, 12, 7]]
    points = np.column_stack([x, np.full(3, shoulder[1]), z])
    own = qualities_at(human, "right", points, rotations=72)
    for name in FIELDS:
        shown = [cut.value(name, *at) for at in zip(x, z, strict=True)]
        np.testing.assert_allclose(shown, own.best[name])


def test_beyond_the_arm_and_below_the_floor_nothing_is_shown(human, cut):
    shoulder = human.T_world_shoulder("right")[:3, 3]
    far = np.hypot(*np.meshgrid(cut.x - shoulder[0], cut.y - shoulder[2]))
    shown = np.isfinite(cut.fields["combined"])
    assert shown.any() and not shown[far > human.arm("right").length].any()
    lying = Human(1.75, "lying")
    level = arm_cut(lying, "right", 1, -0.19, 0.08, rotations=72)
    low = np.isfinite(level.fields["combined"]) & (level.y <= 0.0)[:, None]
    assert not low.any()


def test_the_front_is_more_dextrous_than_the_back(human, cut):
    shoulder = human.T_world_shoulder("right")[:3, 3]
    ahead = np.nanmean(cut.fields["dexterity"][:, cut.x > shoulder[0] + 0.2])
    behind = np.nanmean(cut.fields["dexterity"][:, cut.x < shoulder[0] - 0.2])
    assert ahead > 2 * behind


def test_best_tells_value_and_place(cut):
    value, place = cut.best("effort")
    assert value == np.nanmax(cut.fields["effort"])
    assert cut.value("effort", place[0], place[2]) == value and place[1] == cut.at


def test_the_command_tells_both_planes_and_draws_them(odm, tmp_path):
    picture = tmp_path / "cuts" / "arm.png"
    words = ("workspace", "human", "--side", "left", *QUICK, "--plot", picture)
    code, out, _ = odm(*words, "--json", "-")
    facts = json.loads(out)
    assert code == 0 and facts["plot"] == str(picture)
    assert picture.read_bytes().startswith(b"\x89PNG")
    upright, level = facts["planes"]
    assert (upright["plane"], level["plane"]) == ("y", "z") and upright["at_m"] > 0
    for plane in facts["planes"]:
        assert 0.4 < plane["area_m2"] < 1.6
        assert all(0 < plane[name]["best"] <= 1 for name in FIELDS)
    code, out, _ = odm("workspace", "human", *QUICK)
    assert code == 0 and "most dextrous" in out


def test_the_level_cut_is_above_a_person_who_lies(odm):
    words = ("workspace", "human", "--posture", "lying", *QUICK, "--json", "-")
    code, out, _ = odm(*words)
    shoulder = Human(1.75, "lying").T_world_shoulder("right")[2, 3]
    assert code == 0 and json.loads(out)["planes"][1]["at_m"] > shoulder


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--height", "3"), "body height of 3.0 m"),
        (("--posture", "flying"), "no posture 'flying'"),
        (("--side", "up"), "choose left or right"),
        (("--rotations", "100"), "no grid has 100 rotations"),
    ],
)
def test_bad_input_is_one_sentence(odm, tmp_path, words, said):
    picture = tmp_path / "arm.png"
    code, _, err = odm("workspace", "human", *words, "--plot", picture)
    assert code == 2 and said in err and not picture.exists()
    assert one_sentence(err.strip().splitlines()[-1])


def test_a_picture_that_fails_leaves_nothing(human, cut, tmp_path, monkeypatch):
    from matplotlib.figure import Figure

    def broken(*args, **kwargs):
        args[1].write(b"half")
        raise OSError(28, "No space left on device", "arm.png")

    monkeypatch.setattr(Figure, "savefig", broken)
    with pytest.raises(OSError):
        write_arm_picture(human, "right", [cut], tmp_path / "arm.png")
    assert not list(tmp_path.iterdir())
