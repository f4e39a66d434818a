"""The object's place on the table is one that the robot reaches, or there is none."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from odm.cell_map.recipe import PayloadRecipe
from roadmap.errors import BadInput
from sim.cli import run_command
from sim.draw.cover_world import CoverWorld
from sim.story import cases
from sim.story.cases import StoryCase, setup_of, upright, with_room_for
from sim.story.play import StoryPlay
from sim.story.record import StoryRecorder
from sim.story.request import DemoRequest
from sim.story.tell import _about_envelope, _about_place, _run_of
from sim.story.watched import write_story_film
from sim.story.wrist import PlainWrist

PADS = ("flange",)


def run_of(setup, direction):
    request = DemoRequest("handover", direction=direction)
    return _run_of(request, setup, PlainWrist(setup.obj), None)


def test_the_usual_place_is_taken_where_it_is_within_reach(maps):
    setup = setup_of(*maps[:2], pads=PADS)
    assert np.allclose(setup.T_place, upright(setup.obj, cases.PLACE_XY))
    run = run_of(setup, "give")
    assert run.story.fetches and _about_place(setup, run) == ""


def test_a_place_out_of_reach_is_another_one_that_is_told(maps, monkeypatch):
    usual = np.array(cases.PLACE_XY)
    monkeypatch.setattr(cases, "PLACE_XY", tuple(10.0 * usual))
    monkeypatch.setattr(cases, "_NEARER", (1.0, 0.1))
    setup = setup_of(*maps[:2], pads=PADS)
    assert np.allclose(setup.T_place[:2, 3], usual)
    assert run_of(setup, "give").story.fetches


@pytest.mark.parametrize(
    "direction, told", [("give", "from the beginning"), ("receive", "in the end")]
)
def test_a_robot_that_reaches_no_place_begins_with_the_object_and_keeps_it(
    maps, monkeypatch, direction, told
):
    monkeypatch.setattr(cases, "_NEARER", ())
    setup = setup_of(*maps[:2], pads=PADS)
    assert setup.T_place is None
    run = run_of(setup, direction)
    assert not run.story.fetches
    assert run.story.holding == (direction == "give")
    said = _about_place(setup, run)
    assert "reaches no place" in said and told in said
    run.step()


def test_pads_are_looked_at_before_a_map_of_reach_is_built(meet_maps, monkeypatch):
    monkeypatch.setattr(
        "sim.run.meet.reach_map_of", lambda *told: pytest.fail("it was built before")
    )
    request = DemoRequest("handover", map_dir=meet_maps[0], pads=["nail"])
    with pytest.raises(BadInput, match="--pads nail"):
        run_command._hand_over(request)


def test_a_film_says_how_many_of_its_pictures_are_painted(maps, tmp_path):
    setup = setup_of(*maps[:2], place=False, pads=PADS)
    run = StoryPlay(setup, StoryCase("give"))
    recorder = StoryRecorder(run)
    for _ in range(40):
        recorder.add(run.step())
    told, world = [], CoverWorld(maps[0].robot)
    path = tmp_path / "film.gif"
    record, robot = recorder.record(), maps[0].robot
    tell = lambda *said: told.append(said)  # noqa: E731
    write_story_film(record, robot, world, path, None, tell)
    assert path.exists() and len(told) > 2
    n = len(told) - 1
    drawn = [("writing the film", k, n) for k in range(n)]
    assert told == [*drawn, ("packing the film", 0, 1)]


@pytest.mark.parametrize("size, fits", [(0.4, True), (0.2, False)])
def test_an_object_too_large_for_the_envelope_of_a_map_is_carried_without_it(
    maps, size, fits
):
    """A bottle 6.6 cm thick was refused by the demo's own map."""
    recipe = PayloadRecipe(size=(size, size, size), position=(0.0, 0.0, 0.1))
    of_it = replace(maps[0].recipe, payload=recipe)
    layer = SimpleNamespace(recipe=recipe)  # all that is asked of it here
    cell_map = replace(maps[0], recipe=of_it, payload=layer)
    found = with_room_for(cell_map, cases.story_wrench())
    assert (found is cell_map) is fits and (found.payload is None) is not fits
    assert with_room_for(maps[0], cases.story_wrench()) is maps[0]
    setup = SimpleNamespace(cell_map=found, obj=cases.story_wrench())
    assert ("larger than the payload envelope" in _about_envelope(setup)) is not fits
