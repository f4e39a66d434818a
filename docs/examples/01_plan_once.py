"""Plan once: a map, a goal, a ball in the way, another path.

    python docs/examples/01_plan_once.py [MAP]

MAP is the folder of a map made by `odm build`; without one a small map is built here.
"""

import sys
from pathlib import Path

import numpy as np

import odm
import roadmap

RECIPE = Path(__file__).with_name("small_arm.toml")


def two_places(planner: odm.ReactivePlanner) -> tuple[np.ndarray, np.ndarray]:
    """Return free configurations whose tools are far to the left and to the right."""
    nodes = planner.cell_map.roadmap.nodes
    tools = np.array([roadmap.tool_pose(planner.robot, q)[:3, 3] for q in nodes])
    order = np.argsort(np.where(tools[:, 0] > 0.25, tools[:, 1], 0.0))
    free = [nodes[k] for k in order if planner.is_free(nodes[k], nodes[k])]
    return free[0].copy(), free[-1].copy()


def main(cell_map: odm.CellMap) -> list[odm.Answer]:
    """Plan with nobody there, then with a ball in the middle of that path."""
    planner = odm.ReactivePlanner(cell_map)
    start, goal = two_places(planner)
    planner.set_goals([goal])
    free = planner.step(np.zeros((0, 3)), q=start)  # a frame without obstacles
    print(f"nobody there: {free.status}, a path of {len(free.path)} corners")

    # a ball where the tool would be halfway
    middle = len(free.path) // 2
    halfway = 0.5 * (free.path[middle - 1] + free.path[middle])
    p = roadmap.tool_pose(cell_map.robot, halfway)[:3, 3]
    ball = odm.Obstacles(spheres=np.array([[*p, 0.06]]))
    around = planner.step(ball, q=start)
    print(f"a ball at {p.round(2)} m: {around.status}, {len(around.path)} corners")

    # the same frame answers questions, too
    straight = planner.is_free(start, halfway)
    print("straight into the ball:", bool(straight), "-", straight.reason)
    print(f"the robot is {100 * planner.separation(start):.0f} cm from the ball")
    return [free, around]


def the_map() -> odm.CellMap:
    """Return the map that was named, or a small one that is built in seconds."""
    if len(sys.argv) > 1:
        return odm.load_map(sys.argv[1])
    return odm.build_map(odm.load_recipe(RECIPE))


if __name__ == "__main__":
    main(the_map())
