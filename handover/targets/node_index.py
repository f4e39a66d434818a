"""NodeIndex: which roadmap nodes hold the tool near a pose; built once for a map."""

import math

import numpy as np

from roadmap.arrays import frozen
from roadmap.errors import BadInput
from roadmap.kinematics.forward import tool_pose
from roadmap.robot.robot import Robot

_RADIAN_M = 0.3  # one radian counts as much as so many metres


class NodeIndex:
    """Roadmap nodes by the pose of the tool.

    A goal at a node costs nothing to attach: the roadmap leads there already.

    Attributes:
        nodes: (n, dof) the same configurations, read-only.
        T_base_tool: (n, 4, 4) pose of the tool at each [m].
        apart_m: Median distance of a node's tool from the next one's [m].
    """

    def __init__(self, robot: Robot, nodes: np.ndarray) -> None:
        """Work out every pose, some 20 us each."""
        nodes = np.asarray(nodes, float)
        if nodes.ndim != 2 or nodes.shape[1] != robot.dof or not len(nodes):
            raise BadInput(
                f"nodes have shape {nodes.shape}; give at least one configuration of "
                f"{robot.dof} joints, (n, {robot.dof})"
            )
        self.nodes = frozen(nodes, np.float64)
        poses = np.array([tool_pose(robot, q) for q in self.nodes])
        self.T_base_tool = frozen(poses, np.float64)
        from scipy.spatial import cKDTree  # what runs without targets need not load it

        # |R_a - R_b| is sqrt(2) angle, for small ones
        self._turn = _RADIAN_M / math.sqrt(2.0)
        self._tree = cKDTree(self._points(self.T_base_tool))
        self._places = cKDTree(poses[:, :3, 3])
        apart = self._places.query(poses[:, :3, 3], k=2)[0][:, 1]
        self.apart_m = float(np.median(apart))

    def __len__(self) -> int:
        return len(self.nodes)

    def nearest(self, T_base_tool: np.ndarray, k: int = 1) -> np.ndarray:
        """Return the (k,) nodes whose tool is nearest to a pose (4, 4), nearest first.

        A radian counts as 0.3 m.
        """
        k = min(k, len(self))
        _, found = self._tree.query(self._points(T_base_tool[None])[0], k=k)
        return np.atleast_1d(found)

    def is_remote(self, T_base_tool: np.ndarray, far: float) -> bool:
        """Return whether no node has its tool near a pose (4, 4), however turned.

        `far` is the limit, as so many times from one node's tool to the next.
        """
        return bool(self._places.query(T_base_tool[:3, 3])[0] > far * self.apart_m)

    def off(self, node: int, T_base_tool: np.ndarray) -> tuple[float, float]:
        """Return how far a node's tool is from a pose: [m] and [rad]."""
        T = self.T_base_tool[node]
        turn = (np.trace(T[:3, :3].T @ T_base_tool[:3, :3]) - 1.0) / 2.0
        angle = math.acos(min(max(turn, -1.0), 1.0))
        return float(np.linalg.norm(T[:3, 3] - T_base_tool[:3, 3])), angle

    def within(
        self, T_base_tool: np.ndarray, distance: float, angle: float, k: int = 4
    ) -> list[int]:
        """Return at most k nodes whose tool is near enough to a pose, nearest first.

        Args:
            T_base_tool: (4, 4) [m].
            distance: Largest distance of the tool [m].
            angle: Largest angle [rad].
            k: Most nodes looked at.
        """
        found = self.nearest(T_base_tool, k)
        offs = [(int(n), *self.off(int(n), T_base_tool)) for n in found]
        return [n for n, d, a in offs if d <= distance and a <= angle]

    def _points(self, poses: np.ndarray) -> np.ndarray:
        """Return poses (n, 4, 4) as points (n, 12) whose distances are like theirs."""
        turns = self._turn * poses[:, :3, :3].reshape(-1, 9)
        return np.concatenate([poses[:, :3, 3], turns], axis=1)
