"""Where the robot goes back and forth: two places in front of it, left and right."""

from collections.abc import Callable

import numpy as np

from roadmap.errors import PlanningError
from roadmap.graph import Roadmap
from roadmap.kinematics import difference, tool_pose
from roadmap.robot import Robot
from roadmap.transforms import rotation_rpy

FORWARD, SIDE, HEIGHT = 0.58, 0.48, 0.32  # share of the robot's reach
CANDIDATES = 400  # nodes looked at

IsFree = Callable[[np.ndarray, np.ndarray], object]


class NoWorkPlaces(PlanningError):
    """No two free work places were found in front of the robot."""

    def __init__(self, tool: np.ndarray) -> None:
        """Name the place that was tried."""
        super().__init__(
            f"no free configuration reaches a work place at {np.round(tool, 2)} m; "
            "name two with --start and --goal, or look at the scenery of the recipe"
        )


def work_places(robot: Robot, roadmap: Roadmap, is_free: IsFree) -> np.ndarray:
    """Return two free configurations whose tools stand left and right, pointing down.

    Args:
        robot: The robot.
        roadmap: Its roadmap: seeds of the inverse kinematics, and what is taken where
            the tool cannot point down.
        is_free: (q, q) -> true where the robot may stand.

    Returns:
        (2, dof) the left and the right one, near each other in joint space.

    Raises:
        NoWorkPlaces: There are none.
    """
    places = []
    for side in (1.0, -1.0):
        tool = reach_of(robot, roadmap) * np.array([FORWARD, side * SIDE, HEIGHT])
        found = _reaching(robot, roadmap, tool, is_free)
        if not len(found):
            raise NoWorkPlaces(tool)
        places.append(found)
    return _nearest_pair(robot, *places)


def reach_of(robot: Robot, roadmap: Roadmap) -> float:
    """Return how far to the side the tool gets, but for rare stretches [m]."""
    tools = [tool_pose(robot, q)[:2, 3] for q in roadmap.nodes[:CANDIDATES]]
    return float(np.percentile(np.linalg.norm(tools, axis=1), 90))


def _reaching(robot: Robot, roadmap: Roadmap, tool: np.ndarray, is_free: IsFree):
    """Return free configurations with the tool there, or the nearest free nodes."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation_rpy(np.pi, 0.0, 0.0), tool
    nodes = roadmap.nodes[:CANDIDATES]
    tools = np.array([tool_pose(robot, q)[:3, 3] for q in nodes])
    order = np.argsort(np.linalg.norm(tools - tool, axis=1), kind="stable")
    near = nodes[order]
    middle = (robot.lower + robot.upper) / 2
    seeds = [middle, *near[:12]]
    solved = [q for seed in seeds for q in _solutions(robot, T, seed)]
    for some in (solved, list(near[:40])):
        free = [q for q in some if is_free(q, q)]
        if free:
            return np.array(free)
    return np.zeros((0, robot.dof))


def _solutions(robot: Robot, T: np.ndarray, seed: np.ndarray) -> list[np.ndarray]:
    return [np.asarray(getattr(found, "q", found)) for found in robot.ik(T, seed)]


def _nearest_pair(robot: Robot, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the pair that is near each other, and near the middle of the limits."""
    middle = (robot.lower + robot.upper) / 2
    between = np.abs(difference(robot, left[:, None], right[None])).sum(axis=2)
    off_left = np.abs(difference(robot, left, middle)).sum(axis=1)
    off_right = np.abs(difference(robot, right, middle)).sum(axis=1)
    cost = between + 0.5 * (off_left[:, None] + off_right[None])
    a, b = np.unravel_index(cost.argmin(), cost.shape)
    return np.array([left[a], right[b]])
