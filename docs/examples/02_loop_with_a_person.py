"""A loop of 100 frames a second beside a moving person: plan, brake, move on.

    python docs/examples/02_loop_with_a_person.py [MAP]

The robot goes to and fro; a person reaches into its way every few seconds. In every
frame the planner answers, and the executor takes the path only as far as the robot can
still stop before anyone who comes, as fast as people can.
"""

import sys
from pathlib import Path

import numpy as np

import odm
import roadmap
from odm.execution import ExecutionSettings, Executor, Watcher

RECIPE = Path(__file__).with_name("small_arm.toml")
PERIOD = 0.01  # [s]


def person(t: float, p_reached: np.ndarray) -> np.ndarray:
    """Return a forearm (1, 7) that reaches to a place and back every 4 s [m]."""
    far = 0.5 + 0.4 * np.cos(2.0 * np.pi * t / 4.0)
    hand = p_reached + np.array([far, 0.0, 0.0])
    elbow = hand + np.array([0.25, 0.1, 0.05])
    return np.concatenate([elbow, hand, [0.05]])[None]


def two_places(planner: odm.ReactivePlanner) -> np.ndarray:
    """Return two free configurations, left and right in front of the robot."""
    nodes = planner.cell_map.roadmap.nodes
    tools = np.array([roadmap.tool_pose(planner.robot, q)[:3, 3] for q in nodes])
    ahead = tools[:, 0] > 0.25
    order = np.argsort(np.where(ahead, tools[:, 1], 0.0))
    free = [nodes[k] for k in order if planner.is_free(nodes[k], nodes[k])]
    return np.array([free[0], free[-1]])


def main(cell_map: odm.CellMap, seconds: float = 20.0) -> dict:
    """Run the loop and return what happened."""
    robot = cell_map.robot
    planner = odm.ReactivePlanner(cell_map)
    places = two_places(planner)
    reached = np.mean([roadmap.tool_pose(robot, q)[:3, 3] for q in places], axis=0)
    settings = ExecutionSettings(speed_scale=0.5)
    executor = Executor(robot, planner, places[0].copy(), PERIOD, settings)
    watcher, obstacles = Watcher(), odm.Obstacles(capsules=1)
    place, trips, closest, braked = 1, 0, np.inf, 0
    planner.set_goals([places[place]])

    for frame in range(round(seconds / PERIOD)):
        now = frame * PERIOD
        capsules = person(now, reached)
        obstacles.capsules = capsules
        set_point, commit = executor.set_point, executor.commit()

        # plan from where a new path can begin at the earliest
        answer = planner.step(
            obstacles, q=commit.q, dq=set_point.dq, stamp=now, now=now
        )
        # where the person can be until the robot stands, and the braking for it
        threat = watcher.look(capsules, now)
        executor.update(answer, commit, threat)
        if np.abs(set_point.dq).max() > 0.01:
            closest = min(closest, planner.separation(set_point.q))
        braked += executor.state in ("slowed", "braked")

        executor.advance()  # set_point.q, dq, ddq go to the robot's controller here
        off = np.abs(executor.set_point.q - places[place]).max()
        if executor.at_rest and off < 1e-6:
            trips, place = trips + 1, 1 - place
            planner.set_goals([places[place]])
            executor.new_goal()

    print(f"{trips} trips in {seconds:.0f} s, {braked} frames slowed or braked")
    print(f"while it moved it kept {100 * closest:.1f} cm from the person at least")
    return {"trips": trips, "closest": closest, "braked": braked}


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(odm.load_map(sys.argv[1]))
    else:
        main(odm.build_map(odm.load_recipe(RECIPE)))
