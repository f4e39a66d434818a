"""A hand-over of a robot of one's own on a small map, before its first frame."""

from dataclasses import replace

import numpy as np

import handover
import odm
import sim
from odm.execution.executor import Executor
from roadmap.transforms import pose_of
from sim.story.grasping import straight_back
from sim.story.machine import FETCH, TABLES, Machine
from sim.story.settings import ConductSettings

PERIOD = 0.01  # [s] of a frame
BELIEVED = ConductSettings(missing_s=0.0)  # arms of a test may be elsewhere at once


def story_of(
    maps,
    direction="give",
    pads=("flange",),
    node=None,
    before=0.1,
    period=PERIOD,
    kg=0.25,
    T_world_base=None,
    conduct=ConductSettings(),
    **settings,
):
    """Return a story, its person and what it is about, before the first frame."""
    cell_map, reach, index = maps
    planner = odm.ReactivePlanner(
        cell_map, settings=odm.PlannerSettings(finger_pads=pads)
    )
    human = handover.Human().placed(0.9, 0.0, np.pi)
    human = human.moved(
        pose_of((0.0, 0.0, -0.75), (0.0, 0.0, 0.0)) @ human.T_world_pelvis
    )
    obj = handover.wrench()
    obj = obj.held_by(pose_of((0.0, 0.0, 0.05), (0.0, 0.0, 0.0)) @ obj.T_tool_object)
    obj = replace(obj, mass_kg=kg)
    grid = handover.MeetSettings(cell=0.2, rotations=72, T_world_base=T_world_base)
    meet = handover.InteractionWorkspace(reach, human, obj, 4, grid)
    targets = handover.LiveTargets(planner, meet, None, index)
    tools = index.T_base_tool[:, :3, 3]
    q = np.array(index.nodes[np.abs(tools - [0.2, 0.0, 0.6]).sum(axis=1).argmin()])
    if node is not None:  # right before the place that its tool has there
        q = np.array(index.nodes[node])
        if before:
            q = straight_back(planner, index.T_base_tool[node], q, before)
    executor = Executor(cell_map.robot, sim.PhasePlanner(planner), q, period)
    settings = sim.StorySettings(direction=direction, **settings)
    story = sim.Handover(planner, targets, executor, settings, conduct=conduct)
    return story, human


def pulled(force):
    return np.array([force, 0.0, -2.5, 0.0, 0.0, 0.0])


def at_a_place(maps, direction, state):
    """Return a story that fetches from a place or puts down there, and its person."""
    story, human = story_of(maps, direction)
    index = story.targets.finder.index
    near = np.abs(index.T_base_tool[:, :3, 3] - [0.3, 0.2, 0.5]).sum(axis=1).argmin()
    story.placing.T_places = (index.T_base_tool[near] @ story.hand.T_tool_object)[None]
    if state == FETCH:
        story.hand.holding, story.hand.fingers = False, "open"
        story.planner.detach()
    else:
        story.hand.holding, story.hand.fingers = True, "closed"
        story.planner.attach(story.hand.carried, story.hand.T_tool_object)
    story.machine = Machine(TABLES[direction], state)
    story._enter()
    return story, human
