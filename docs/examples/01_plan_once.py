"""Plan once: build or load a map, block the way of the tool, get another path.

    python docs/examples/01_plan_once.py [MAP]

MAP is the folder of a map made by `odm build`; without one a small map is built here.
"""

import sys
from pathlib import Path

import numpy as np

import odm
import roadmap

RECIPE = Path(__file__).with_name("small_arm.toml")
NOBODY = np.zeros((0, 3))  # a frame without points
RADIUS = 0.06  # of the ball that is put into the way [m]


def two_places(planner: odm.ReactivePlanner) -> tuple[np.ndarray, np.ndarray]:
    """Return two free configurations whose tools are far from each other."""
    cell_map = planner.cell_map
    free = [q for q in cell_map.roadmap.nodes[:200] if planner.is_free(q, q)]
    tools = np.array([roadmap.tool_pose(cell_map.robot, q)[:3, 3] for q in free])
    apart = np.linalg.norm(tools[:, None] - tools[None], axis=2)
    i, j = np.unravel_index(apart.argmax(), apart.shape)
    return free[i].copy(), free[j].copy()


def main(cell_map: odm.CellMap) -> list[odm.Answer]:
    """Plan with nobody there, then with a ball in the middle of that path."""
    planner = odm.ReactivePlanner(cell_map)
    start, goal = two_places(planner)
    planner.set_goals([goal])

    for _ in range(2):  # the first frame loads compiled code
        free = planner.step(NOBODY, q=start)
    tell("nobody there", free)

    # a ball where the tool would be halfway; obstacles are points on closed surfaces,
    # no farther from each other than the map allows
    middle = len(free.path) // 2
    halfway = 0.5 * (free.path[middle - 1] + free.path[middle])
    p = roadmap.tool_pose(cell_map.robot, halfway)[:3, 3]
    ball = np.concatenate([p, p, [RADIUS]])[None]  # a capsule (1, 7) of no length
    points = odm.sample_capsules(ball, spacing=cell_map.safety.rho)

    around = planner.step(points, q=start, closed=True)
    tell(f"a ball at {p.round(2)} m", around)

    # the same frame answers questions, too
    straight = planner.is_free(start, halfway)
    print("straight into the ball:", bool(straight), "-", straight.reason)
    print(f"the robot is {100 * planner.separation(start):.0f} cm from the ball")
    return [free, around]


def tell(what: str, answer: odm.Answer) -> None:
    """Print an answer in a line."""
    took = 1e6 * answer.latency_s["total"]
    if answer.status == "holding":
        print(f"{what}: holding, {answer.reason}")
        return
    turns = len(answer.path) - 1
    length = np.linalg.norm(np.diff(answer.path, axis=0), axis=1).sum()
    print(f"{what}: {turns} legs, {length:.2f} rad, answered in {took:.0f} us")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(odm.load_map(sys.argv[1]))
    else:
        main(odm.build_map(odm.load_recipe(RECIPE)))
