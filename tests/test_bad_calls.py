"""Bad calls end in one sentence or a no, never in a crash and never in "free"."""

import json

import numpy as np
import pytest
from bad_calls import FREE
from command_line import ROOT, started
from small import HOME


@pytest.fixture(scope="module")
def outcomes(small_map, tmp_path_factory):
    folder = tmp_path_factory.mktemp("maps") / "arm3"
    small_map.save(folder)
    script = str(ROOT / "tests" / "bad_calls.py")
    with started([script, str(folder), *map(str, HOME)], folder) as process:
        out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    return json.loads(out)


def test_none_of_them_crashes_or_is_called_free(outcomes):
    assert len(outcomes) > 70
    for name, told in outcomes.items():
        assert told, name
        assert not told.startswith((FREE, "ended with")), (name, told)


def test_each_sentence_is_one_and_says_what_to_do(outcomes):
    told = {name: text for name, text in outcomes.items() if text != "no"}
    for name, text in told.items():
        assert "\n" not in text, name
        assert len(text) > 30, (name, text)
    assert "millimetres" in outcomes["millimetres"]
    assert "no goals" in outcomes["no goals"]


def test_a_lone_point_is_no_whole_surface(planner):
    planner.set_goals([HOME])
    lone = np.array([[0.0, 2.0, 1.0]])
    assert planner.step(lone, q=HOME).certified == "visible surface"
    assert planner.step(lone, q=HOME, closed=True).certified == "whole surface"
