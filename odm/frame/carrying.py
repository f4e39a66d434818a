"""Attach and detach: the planner's tables with and without a payload, exchanged."""

import numpy as np

from odm.cell_map.payload import (
    carried_object,
    loaded_map,
    require_fit,
    required,
)
from odm.close_test._arm import make_work
from odm.close_test.static import StaticTest
from odm.frame.frame import Frame
from odm.frame.place import items_in_place
from odm.search.state import center_motion_bounds, exchange, graph_on
from roadmap.errors import BadInput
from roadmap.loading.held_link import with_payload
from roadmap.transforms import check_pose


class Carrier:
    """Exchanges what a hand holds, and what that makes of the tables.

    The map's payload layer is merged with the arm's once. From then on a payload in
    hand means other rows in the planner's table: cell lists of arm and envelope, and
    the arm with the spheres of the very object. All that reads the table follows it.

    Args:
        frame: Its memory and scenery must be laid out.

    Attributes:
        bare: The static test of the robot with nothing in its hand.
        robot: The robot with what is in its hand.
    """

    def __init__(self, frame: Frame) -> None:
        """Merge the layers, where the map has a payload layer."""
        self.frame, self.bare, self.robot = frame, frame.static, frame.robot
        m, cell_map = frame.memory, frame.cell_map
        self._bare_groups = {
            name: getattr(m, name)
            for name in ("arm", "work", "graph", "direct", "robot_state", "tubes")
        }
        if cell_map.payload is None:
            return
        loaded = loaded_map(cell_map)
        self._largest = self.bare.carrying(loaded.robot)
        graph, direct = graph_on(cell_map.roadmap, loaded.arm_cells, m.graph.region)
        graph.closed[:] = cell_map.payload.closed
        self._groups = {"graph": graph, "direct": direct}

    def attach(self, thing: object, T_tool_object: np.ndarray) -> None:
        """Take an object into the hand; see `ReactivePlanner.attach`."""
        frame = self.frame
        layer = required(frame.cell_map)
        if frame.thing is not None:
            raise BadInput(
                f"{len(frame.thing.spheres)} spheres are attached already; call detach "
                "before you attach something else"
            )
        T = check_pose(T_tool_object, "T_tool_object")
        thing = carried_object(thing).moved(T)
        require_fit(layer.recipe, thing)
        robot = with_payload(frame.robot, thing.spheres, thing.shell, [])
        frame.static = self.bare.carrying(robot)
        frame.thing, self.robot = thing, robot
        m, arm = frame.memory, frame.static.arm
        work = make_work(len(arm.spheres), len(arm.tree_i), robot.dof)
        n, motion_bound = len(arm.spheres), center_motion_bounds(arm, robot.dof)
        robot_state = m.robot_state._replace(
            radii=np.zeros(n),
            bare=np.zeros(n),
            grown=np.zeros(n),
            grown_bare=np.zeros(n),
            motion_bound=motion_bound,
        )
        tubes = m.tubes._replace(
            speed=np.zeros((len(m.tubes.count), n)),
            bend=np.zeros((len(m.tubes.count), n)),
        )
        groups = {"arm": arm, "work": work, "robot_state": robot_state, "tubes": tubes}
        exchange(m, {**groups, **self._groups})
        frame.hand_changed()

    def detach(self) -> None:
        """Let go; see `ReactivePlanner.detach`."""
        frame = self.frame
        if frame.thing is None:
            raise BadInput("nothing is attached; call attach first")
        frame.static = self.bare
        frame.thing, self.robot = None, frame.robot
        exchange(frame.memory, self._bare_groups)
        frame.hand_changed()

    def set_place(self, points: np.ndarray) -> int:
        """Take scenery of this place, and close what it blocks, with and without.

        Returns:
            How many points lie outside the grid.
        """
        cell_map = self.frame.cell_map
        outside = self.bare.set_place(points)
        closed = self._bare_groups["graph"].closed
        roadmap = cell_map.roadmap
        closed[:] = items_in_place(self._bare_groups["graph"], self.bare, roadmap)
        layer = cell_map.payload
        if layer is not None:
            self._follow(self._largest)
            graph = self._groups["graph"]
            graph.closed[:] = layer.closed
            graph.closed[:] |= items_in_place(graph, self._largest, roadmap)
        if self.frame.thing is not None:
            self._follow(self.frame.static)
        return outside

    def set_extra(self, extra: float) -> None:
        """Keep more distance from the scenery of this place [m]."""
        tests = [self.bare, self.frame.static]
        if self.frame.cell_map.payload is not None:
            tests.append(self._largest)
        for test in tests:
            test.set_extra(extra)

    def _follow(self, static: StaticTest) -> None:
        """Let a test with a payload see the scenery of the one without."""
        static.place_points = self.bare.place_points
        static.place_cloud = self.bare.place_cloud
        static.set_extra(self.bare.extra)
