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
from roadmap.kinematics.forward import sphere_centers

plan_once = importlib.import_module("01_plan_once")
loop = importlib.import_module("03_loop_at_100_hz")
PERIOD = loop.PERIOD


def main(cell_map: odm.CellMap, seconds: float = 20.0) -> dict:
    """Go to and fro; return trips, frames slowed or braked, and the least distance."""
    robot, rho = cell_map.robot, cell_map.safety.rho
    planner = odm.ReactivePlanner(cell_map)
    places = plan_once.two_places(planner)
    reached = np.mean([roadmap.tool_pose(robot, q)[:3, 3] for q in places], axis=0)
    settings = ExecutionSettings(speed_scale=0.5)
    executor = Executor(robot, planner, places[0].copy(), PERIOD, settings)
    watcher = Watcher(covering=rho)
    margin = float(robot.spheres[robot.moving, 3].max()) + cell_map.safety.m
    place, trips, closest, braked = 1, 0, np.inf, 0
    planner.set_goals([places[place]])
    for now in np.arange(0.0, seconds, PERIOD):
        capsules = loop.forearm(now, reached)
        points = odm.sample_capsules(capsules, spacing=rho)
        point, commit = executor.set_point, executor.commit()
        seen = {"stamp": now, "now": now, "closed": True}
        answer = planner.step(points, q=commit.q, dq=point.dq, **seen)
        centers = sphere_centers(robot, point.q)[robot.moving]
        threat = watcher.look(capsules, points, centers, now, margin=margin)
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
