"""Two robots in one space: each plans round the other and brakes for it.

    python docs/examples/06_two_robots.py [MAP]

`odm run-two` does the same with turns taken, an exact audit and pictures.
"""

import importlib

import numpy as np

import odm
from odm import execution as run
from odm.obstacles.robot_surface import standing_shapes
from roadmap.transforms import pose_of

plan_once = importlib.import_module("01_plan_once")
PERIOD = 0.01  # [s]
T_FIRST_SECOND = pose_of((0.95, 0.0, 0.0), (0.0, 0.0, np.pi))  # face to face
RULES = run.ExecutionSettings(speed_scale=0.5, min_retreat_separation=np.inf)


def main(cell_map: odm.CellMap, seconds: float = 20.0) -> dict[str, object]:
    """Run two of the same robot to and fro and return what happened."""
    robot, bases = cell_map.robot, (T_FIRST_SECOND, np.linalg.inv(T_FIRST_SECOND))
    spheres = run.RobotSpheres(robot)  # they hold the whole robot
    planners, places, executors = [], [], []
    for T in bases:  # of the other one, in the own base frame
        planner = odm.ReactivePlanner(cell_map)
        planner.set_static(standing_shapes(robot, T))
        left, right = plan_once.two_places(planner)
        planner.set_goals([right])
        planners.append(planner)
        places.append((left, right))
        executors.append(run.Executor(robot, planner, left.copy(), PERIOD, RULES))
    trips, closest = [0, 0], np.inf
    for now in np.arange(0.0, seconds, PERIOD):
        for mine, other, T in ((0, 1, bases[0]), (1, 0, bases[1])):
            planner, executor = planners[mine], executors[mine]
            there = spheres.obstacles(executors[other].set_point.q, T)
            commit, point = executor.commit(), executor.set_point
            answer = planner.step(there, q=commit.q, dq=point.dq, stamp=now, now=now)
            threat = run.intent_threat(spheres, run.intent_of(executors[other]), T)
            executor.update(answer, commit, threat)
            closest = min(closest, planner.separation(point.q))
        for k, executor in enumerate(executors):
            executor.advance()
            off = executor.set_point.q - places[k][1 - trips[k] % 2]
            if executor.at_rest and np.abs(off).max() < 1e-6:
                trips[k] += 1
                planners[k].set_goals([places[k][1 - trips[k] % 2]])
                executor.new_goal()
    print(f"trips: {trips}; never nearer to each other than {closest:.3f} m")
    return {"trips": trips, "closest": closest}


if __name__ == "__main__":
    main(plan_once.the_map())
