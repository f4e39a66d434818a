"""Move: the path of a plan as set-points in time, a stop, another way on from there.

    python docs/examples/02_move_in_time.py [MAP]

`plan_once` is example 1: a map, two places, a path.
"""

import importlib

import numpy as np

import odm
import roadmap

plan_once = importlib.import_module("01_plan_once")


def main(cell_map: odm.CellMap) -> roadmap.Motion:
    """Time a path, stop on it, and go on somewhere else from where it can be left."""
    robot = cell_map.robot
    planner = odm.ReactivePlanner(cell_map)
    start, goal = plan_once.two_places(planner)
    planner.set_goals([goal])
    answer = planner.step(np.zeros((0, 3)), q=start)

    # within the limits of velocity, acceleration and jerk; corners rounded by 4 mm
    motion = roadmap.time_path(robot, answer.path, blend=0.004, speed_scale=0.5)
    print(f"{motion.duration:.2f} s from start to goal")
    for t in np.arange(0.0, 0.05, 0.01):  # any thread may ask, at any rate
        point = motion.at(t)
        print(f"{t:.2f} s: q {point.q.round(4)}, dq {point.dq.round(3)}")

    now = 0.4 * motion.duration
    halt = motion.stop(now)  # the quickest stop that stays on the path
    print(f"a stop begun at {now:.2f} s takes {halt.duration:.2f} s")

    # turn back on the way: plan from where the path can be left, then join there
    commit = motion.commit(now)
    planner.set_goals([start])
    back = planner.step(np.zeros((0, 3)), q=commit.q)
    motion = motion.join(now, commit, back.path)
    print(f"back at the start after {motion.duration:.2f} s more")
    return motion


if __name__ == "__main__":
    main(plan_once.the_map())
