"""The same loop as a robot can drive it: set-points in time, and braking for people.

    python docs/examples/04_brake_for_people.py [MAP]

The executor takes a path only as far as the robot can still stop before anyone who
comes, as fast as people can.
"""

import importlib

import numpy as np

import odm
import roadmap
from odm.execution import ExecutionSettings, Executor, Watcher

plan_once = importlib.import_module("01_plan_once")
loop = importlib.import_module("03_loop_at_100_hz")
PERIOD = loop.PERIOD


def main(cell_map: odm.CellMap, seconds: float = 20.0) -> dict[str, float]:
    """Go to and fro; return trips, frames slowed or braked, and the least distance."""
    robot = cell_map.robot
    planner = odm.ReactivePlanner(cell_map)
    places = plan_once.two_places(planner)
    reached = np.mean([roadmap.tool_pose(robot, q)[:3, 3] for q in places], axis=0)
    settings = ExecutionSettings(speed_scale=0.5)
    executor = Executor(robot, planner, places[0].copy(), PERIOD, settings)
    watcher, obstacles = Watcher(), odm.Obstacles(capsules=1)
    place, trips, closest, braked = 1, 0, np.inf, 0
    planner.set_goals([places[place]])
    for now in np.arange(0.0, seconds, PERIOD):
        capsules = loop.forearm(now, reached)
        obstacles.capsules = capsules
        point, commit = executor.set_point, executor.commit()
        # plan from where a new path can begin at the earliest
        answer = planner.step(obstacles, q=commit.q, dq=point.dq, stamp=now, now=now)
        # where the person can be until the robot stands, and the braking for it
        threat = watcher.look(capsules, now)
        executor.update(answer, commit, threat)
        if np.abs(point.dq).max() > 0.01:
            closest = min(closest, planner.separation(point.q))
        braked += executor.state in ("slowed", "braked")
        executor.advance()  # set_point.q, dq, ddq go to the robot's controller here
        off = np.abs(executor.set_point.q - places[place]).max()
        if executor.at_rest and off < 1e-6:
            trips, place = trips + 1, 1 - place
            planner.set_goals([places[place]])
            executor.new_goal()
    print(f"{trips} trips, slowed or braked in {braked} frames")
    print(f"while it moved it kept {100 * closest:.1f} cm from the person at least")
    return {"trips": trips, "closest": closest, "braked": braked}


if __name__ == "__main__":
    main(plan_once.the_map())
