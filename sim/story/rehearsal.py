"""All that a frame of a hand-over may call, called once before the first one."""

import gc

import numpy as np

from odm.checks import AVOID, CONTACT, OBJECT
from odm.obstacles.obstacles import Obstacles
from roadmap.kinematics.forward import tool_pose
from sim.loop.warmup import exercise
from sim.run.meet import exercise_choice
from sim.story.cases import StoryCase, StorySetup
from sim.story.machine import DIRECTIONS
from sim.story.play import StoryPlay, play

_SECONDS = 1.0  # that are played in each direction
_CLASSES = {"give": CONTACT, "receive": OBJECT}


def rehearse(setup: StorySetup) -> None:
    """Compile and load what the frames of a setup's runs may call.

    Loading compiled code takes 5 to 30 ms at its first call, compiling it seconds: in
    whatever frame first rates a target again, or finds no place to go to.
    """
    exercise(setup.cell_map)
    for direction in DIRECTIONS:
        run = StoryPlay(setup, StoryCase(direction))
        play(run, _SECONDS)
        exercise_choice(run.story.targets)
        _touch(run)
    gc.collect()
    gc.freeze()  # a collection of all that was loaded would be some frame's


def _touch(run: StoryPlay) -> None:
    """Test and evade by the rules of each phase, beside somebody at the hand."""
    view, planner, q = run.story.view, run.planner, run.setup.rest
    tool = tool_pose(planner.robot, q)[:3, 3]
    rows = np.array([[*tool, *tool, 0.05], [*tool + 0.3, *tool + 0.3, 0.05]])
    for phase in (None, run.case.direction):
        view.phase, view.person, view.offered = phase, rows[1:], 0
        view.classes = np.array([_CLASSES.get(phase, AVOID), AVOID], np.int8)
        view.meant = np.zeros(1, np.int64)
        answer = planner.step(Obstacles(capsules=rows), q=q)
        _ = answer.reason, answer.retreat
        view.line_free(q, q + 1e-3, Obstacles(capsules=rows))
        view.evasion(q, [(0.1, Obstacles(capsules=rows))], 0.5)
        view.separation(q)
    view.phase, view.offered = None, 1
    m = planner.cell_map.safety.m
    view.blocked_leg(np.array([q, q + 1e-3]), -m, Obstacles(capsules=rows))
    view.separation(q)
