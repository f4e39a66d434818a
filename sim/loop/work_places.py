"""Where the robot goes back and forth: two places in front of it, left and right."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from roadmap.errors import PlanningError
from roadmap.graph.roadmap import Roadmap
from roadmap.kinematics.forward import difference, tool_pose
from roadmap.ranges import CheckedSettings, setting
from roadmap.robot.robot import Robot
from roadmap.transforms import pose_of

IsFree = Callable[[np.ndarray, np.ndarray], object]


@dataclass(frozen=True)
class WorkPlaceSettings(CheckedSettings):
    """Where work places are looked for.

    Attributes:
        forward, side, height: Where the tool is to be, as shares of the robot's reach.
        candidates: Nodes looked at first. More: places nearer to what was asked for,
            and more time where inverse kinematics does not get there.
        apart: Share of the distance asked for that the two tools keep at least.
    """

    forward: float = setting(0.58, 0.0, 1.0)
    side: float = setting(0.48, 0.0, 1.0)
    height: float = setting(0.32, 0.0, 1.0)
    candidates: int = setting(400, 1, 1_000_000)
    apart: float = setting(0.5, 0.0, 1.0)


class NoWorkPlaces(PlanningError):
    """No two free work places were found in front of the robot."""

    def __init__(self, tool: np.ndarray, apart: float | None = None) -> None:
        """Name the place that was tried, or how far from it the robot gets."""
        what = f"no free configuration reaches a work place at {np.round(tool, 2)} m"
        if apart is not None:
            what = (
                f"of all free configurations none is further than {100 * apart:.0f} cm "
                f"from the one nearest to {np.round(tool, 2)} m"
            )
        super().__init__(
            f"{what}; build the map with more nodes or a region in front of the "
            "robot, or look at the scenery of the recipe"
        )


def work_places(robot: Robot, roadmap: Roadmap, is_free: IsFree) -> np.ndarray:
    """Return two free configurations (2, dof), tools left and right, pointing down.

    Where the tool cannot point down or go sideways, nodes of the roadmap near to that
    are taken. The two are near each other in joint space. NoWorkPlaces: there are none.
    """
    # the first nodes may all lie on one side, or keep the arm folded
    s = WorkPlaceSettings()
    for some in (roadmap.nodes[: s.candidates], roadmap.nodes):
        asked, found = _places(robot, some, is_free, s)
        pair = _nearest_pair(robot, *found) if all(map(len, found)) else None
        if pair is not None and _apart(robot, pair) >= s.apart * _apart_asked(asked):
            return pair
    if pair is None:
        raise NoWorkPlaces(asked[0] if not len(found[0]) else asked[1])
    return _aside(robot, roadmap.nodes, pair[0], asked, is_free, s)


def _places(
    robot: Robot, nodes: np.ndarray, is_free: IsFree, s: WorkPlaceSettings
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return where the tool should be, left and right, and what reaches there."""
    asked, found, tools = [], [], _tools(robot, nodes)
    for side in (1.0, -1.0):
        tool = _reach(tools) * np.array([s.forward, side * s.side, s.height])
        asked.append(tool)
        near = nodes[np.argsort(np.linalg.norm(tools - tool, axis=1), kind="stable")]
        found.append(_reaching(robot, near, tool, is_free))
    return asked, found


def _apart_asked(asked: list[np.ndarray]) -> float:
    return float(np.linalg.norm(asked[0] - asked[1]))


def _apart(robot: Robot, pair: np.ndarray) -> float:
    """Return how far the tools of two configurations are from each other [m]."""
    a, b = (tool_pose(robot, q)[:3, 3] for q in pair)
    return float(np.linalg.norm(a - b))


def _aside(
    robot: Robot,
    nodes: np.ndarray,
    q: np.ndarray,
    asked: list,
    is_free: IsFree,
    s: WorkPlaceSettings,
) -> np.ndarray:
    """Return `q` and a node as far from it as asked: an arm that cannot go sideways."""
    wanted = _apart_asked(asked)
    away = np.array([_apart(robot, np.array([q, node])) for node in nodes])
    order = np.argsort(np.abs(away - wanted), kind="stable")[: s.candidates]
    far = [
        k for k in order if away[k] >= s.apart * wanted and is_free(nodes[k], nodes[k])
    ]
    if not far:
        raise NoWorkPlaces(asked[0], float(away.max(initial=0.0)))
    return _nearest_pair(robot, q[None], nodes[far[:40]])


def reach_of(robot: Robot, nodes: np.ndarray) -> float:
    """Return how far to the side the tool gets, but for rare stretches [m]."""
    return _reach(_tools(robot, nodes))


def _tools(robot: Robot, nodes: np.ndarray) -> np.ndarray:
    return np.array([tool_pose(robot, q)[:3, 3] for q in nodes])


def _reach(tools: np.ndarray) -> float:
    return float(np.percentile(np.linalg.norm(tools[:, :2], axis=1), 90))


def _reaching(robot: Robot, near: np.ndarray, tool: np.ndarray, is_free: IsFree):
    """Return free configurations with the tool there, or the nearest free nodes."""
    T = pose_of(tool, (np.pi, 0.0, 0.0))
    # from the middle and from random starts, once; then from each node near there
    solved = [one.q for one in robot.ik(T, (robot.lower + robot.upper) / 2)]
    solved += [one.q for q in near[:12] for one in robot.ik(T, q, attempts=1)]
    for some in (solved, list(near[:40])):
        free = [q for q in some if is_free(q, q)]
        if free:
            return np.array(free)
    return np.zeros((0, robot.dof))


def _nearest_pair(robot: Robot, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the pair that is near each other, and near the middle of the limits."""
    middle = (robot.lower + robot.upper) / 2
    between = np.abs(difference(robot, left[:, None], right[None])).sum(axis=2)
    off_left = np.abs(difference(robot, left, middle)).sum(axis=1)
    off_right = np.abs(difference(robot, right, middle)).sum(axis=1)
    cost = between + 0.5 * (off_left[:, None] + off_right[None])
    a, b = np.unravel_index(cost.argmin(), cost.shape)
    return np.array([left[a], right[b]])
