"""Arguments of another kind are told in a sentence, not by an error from within."""

import numpy as np
import pytest
from small import HOME

import odm
from odm.execution import Executor
from roadmap.errors import BadInput


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda m, p: odm.load_map("nowhere", robot=3), "robot is 3"),
        (lambda m, p: odm.SeenSpace(m, [], 3), "settings is 3"),
        (lambda m, p: Executor(m.robot, p, HOME, 0.01, 3), "settings is 3"),
        (
            lambda m, p: Executor(m.robot, p, HOME, 0.01).limit_speed("half"),
            "share of the speed is 'half'",
        ),
        (
            lambda m, p: Executor(m.robot, p, HOME, 0.01).limit_speed(np.nan),
            "share of the speed is nan",
        ),
        (lambda m, p: odm.Obstacles.of(3), "shapes is 3"),
        (
            lambda m, p: odm.Obstacles(capsules=1, labels={"capsules": 3}),
            "labels of capsules is 3",
        ),
        (
            lambda m, p: odm.Obstacles(capsules=1, classes={"capsules": 3}),
            "classes of capsules is 3",
        ),
    ],
)
def test_what_is_of_another_kind_is_told(small_map, planner, call, told):
    with pytest.raises(BadInput, match=told):
        call(small_map, planner)
