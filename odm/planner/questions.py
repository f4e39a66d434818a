"""What a planner can be asked between frames, about what it has seen last.

After a frame that could not be used (`planner.trouble` says why) every answer is no.
"""

import numpy as np

from odm.answer import Freedom
from odm.approach import approach
from odm.cell_map.cell_map import CellMap
from odm.checks import as_floats, check_numbers
from odm.close_test.close_test import CloseTest
from odm.obstacles.world_frame import WorldFrame
from odm.planner import explain
from odm.search.state import DirectMap, Memory
from roadmap.robot.robot import Robot
from roadmap.transforms import check_pose


class Questions:
    """Methods of `ReactivePlanner`."""

    robot: Robot
    cell_map: CellMap
    memory: Memory
    direct: DirectMap
    trouble: str | None
    world: WorldFrame
    close_test: CloseTest
    _approacher: "approach.Approacher | None"

    def is_free(
        self, q_a: np.ndarray, q_b: np.ndarray, phase: str | None = None
    ) -> Freedom:
        """Test the straight motion from q_a to q_b: all four tests, all the way.

        Limits, self-collision, scenery (the recipe's and set_static's) and the last
        frame's points, with the motion bound over the whole length.

        Args:
            q_a: (dof,) start [rad or m].
            q_b: (dof,) end.
            phase: "give" lets the payload touch CONTACT points, "receive" the finger
                pads OBJECT points; see `odm.planner.last_phase`.

        Raises:
            BadInput: Wrong length or not finite, or a phase that cannot be.
        """
        self.memory.owner.check()
        return explain.is_free(self, q_a, q_b, phase)

    def approach(
        self,
        T_base_tool: np.ndarray,
        q: np.ndarray | None = None,
        distance: float = 0.15,
        direction: np.ndarray | None = None,
        phase: str | None = None,
    ) -> "approach.Approach":
        """Find a straight tool motion to a pose, every leg proved free.

        Scenery and the last frame's points count. The first call prepares for seconds.

        Args:
            T_base_tool: (4, 4) where the tool ends, base frame [m] (the world's after
                `set_base`, as the direction).
            q: (dof,) where the motion starts; None finds the start, too: `distance`
                back from the pose.
            distance: Length of the motion where q is None [m].
            direction: (3,) which way the tool moves, base frame; None: along its z.
            phase: As in `is_free`; where q is None, the line starts where none
                of the points is touched.

        Raises:
            BadInput: The pose is not rigid, q, distance or direction is out of range.
        """
        self.memory.owner.check()
        if self._approacher is None:
            self._approacher = approach.Approacher(self)
        T = self.world.pose(check_pose(T_base_tool, "T_base_tool"))
        if direction is not None:
            direction = self.world.direction(as_floats("the direction", direction))
        return self._approacher.run(T, q, distance, direction, phase)

    def stands_clear(self, q: np.ndarray) -> bool:
        """Return whether the robot would keep clear of the last frame's points at q.

        The part of `is_free` that changes from frame to frame: limits, self-collision
        and scenery are not looked at.

        Args:
            q: (dof,) [rad or m].

        Raises:
            BadInput: Wrong length or not finite.
        """
        self.memory.owner.check()
        q = check_numbers(self.robot, q)
        if self.trouble is not None:
            return False
        self._sort()
        return self.close_test.clear(q, np.zeros_like(q), self.memory.cloud)

    def separation(self, q: np.ndarray) -> float:
        """Return the smallest distance of the cover at q from the frame's points [m].

        Infinity when the frame has no point inside the grid; minus infinity after a
        frame that could not be used: then the person may be anywhere.

        Raises:
            BadInput: Wrong length or not finite.
        """
        self.memory.owner.check()
        q = check_numbers(self.robot, q)
        return -np.inf if self.trouble is not None else self._nearest(q)

    def invalid_nodes(self) -> np.ndarray:
        """Return the ids of the nodes that the frame invalidates, ascending."""
        if self.trouble is not None:
            return np.arange(self.direct.n_nodes)
        return self.direct.nodes().copy()

    def invalid_edges(self) -> np.ndarray:
        """Return the ids of the edges that the frame invalidates, ascending."""
        if self.trouble is not None:
            return np.arange(self.direct.n_edges)
        return self.direct.edges().copy()

    def _nearest(self, q: np.ndarray) -> float:
        self._sort()
        return self.close_test.separation(q, self.memory.cloud)
