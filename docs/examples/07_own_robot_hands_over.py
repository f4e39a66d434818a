"""A robot of your own hands over: a URDF, a person, a wrist that feels."""

import numpy as np

import handover
import odm
import sim
from odm.cell_map.recipe import RobotRecipe
from odm.execution.executor import Executor
from roadmap.transforms import pose_of

ROBOT = RobotRecipe("kawasaki_fs003n")  # or ("my.urdf", tip="tool0"), on a table
PADS = ("flange",)  # its links that touch what is held


def the_maps() -> tuple[odm.CellMap, handover.ReachMap]:
    """Build both maps: what the robot sweeps, and what its hand reaches."""
    cell_map = odm.build_map(odm.Recipe("mine", ROBOT))
    settings = handover.ReachSettings(cell=0.1, rotations=72, samples=60_000)
    chain = handover.chain_of(cell_map.robot)
    return cell_map, handover.build_reach_map(chain, settings)


def main(cell_map: odm.CellMap, reach: handover.ReachMap) -> sim.Handover:
    """Let somebody pull at what is held out, and tell what happened."""
    pads = odm.PlannerSettings(finger_pads=PADS)
    planner = odm.ReactivePlanner(cell_map, settings=pads)
    human = handover.Human().placed(0.9, 0.0, np.pi)
    down = pose_of((0.0, 0.0, -0.75), (0.0, 0.0, 0.0))
    human = human.moved(down @ human.T_world_pelvis)  # below the base, on the floor
    grid = handover.MeetSettings(cell=0.2, rotations=72)
    out = pose_of((0.0, 0.0, 0.05), (0.0, 0.0, 0.0))
    obj = handover.wrench()
    obj = obj.held_by(out @ obj.T_tool_object)  # 5 cm farther out of the hand
    meet = handover.InteractionWorkspace(reach, human, obj, 4, grid)
    targets = handover.LiveTargets(planner, meet)
    tools = targets.finder.index.T_base_tool[:, :3, 3]
    q = np.array(cell_map.roadmap.nodes[np.abs(tools - [0.2, 0, 0.6]).sum(1).argmin()])
    executor = Executor(cell_map.robot, sim.PhasePlanner(planner), q, 0.01)
    story = sim.Handover(planner, targets, executor)
    opened, shown = False, 0
    for k in range(3000):
        pull = 12.0 if story.state in ("present", "wait", "release") else 0.0
        wrench = np.array([pull, 0.0, -2.5, 0.0, 0.0, 0.0])  # your sensor
        arm = np.array(meet.best(1)[0].arm_q) if pull else human.arms["right"]
        there = human.with_arm("right", arm)  # your tracker's: it takes what is held
        seen = sim.StoryFrame(0.01 * k, there, wrench, opened, holds=not opened)
        command = story.update(seen)  # send command.q and command.fingers
        opened = command.fingers == "open"
        for event in story.events[shown:]:
            print(f"{event.time_s:5.2f} s  {event.state}: {event.reason}")
        shown = len(story.events)
        if story.ended:
            break
    return story


if __name__ == "__main__":
    main(*the_maps())
