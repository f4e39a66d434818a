"""Attach and detach: the planner's tables with and without a payload, exchanged."""

from typing import TYPE_CHECKING

import numpy as np

from odm.cell_map.payload import (
    CarriedObject,
    carried_object,
    loaded_map,
    require_fit,
    required,
)
from odm.close_test._arm import make_work
from odm.planner.place import items_in_place
from odm.search.state import exchange, graph_on, joint_sway
from roadmap.errors import BadInput
from roadmap.loading.held_link import PAYLOAD, with_payload
from roadmap.transforms import check_pose

if TYPE_CHECKING:
    from odm.planner.planner import ReactivePlanner


class Carrier:
    """What a planner carries.

    The map's payload layer is merged with the arm's once. From then on a payload in
    hand means other rows in the planner's table: cell lists of arm and envelope, and
    the arm with the spheres of the very object. All that looks at the table heeds it.

    Args:
        planner: Its memory and scenery must be laid out.

    Attributes:
        thing: What is attached, in the tool frame; None for nothing.
        robot: The robot with it in its hand.
    """

    def __init__(self, planner: "ReactivePlanner") -> None:
        """Merge the layers, where the map has a payload layer."""
        self.planner = planner
        self.bare = planner.static
        self.thing: CarriedObject | None = None
        self.robot = planner.robot
        m, cell_map = planner.memory, planner.cell_map
        self._bare_groups = {
            name: getattr(m, name) for name in ("arm", "work", "graph", "direct", "own")
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
        planner = self.planner
        layer = required(planner.cell_map)
        if self.thing is not None:
            raise BadInput(
                f"{len(self.thing.spheres)} spheres are attached already; call detach "
                "before you attach something else"
            )
        T = check_pose(T_tool_object, "T_tool_object")
        thing = carried_object(thing).moved(T)
        require_fit(layer.recipe, thing)
        robot = with_payload(planner.robot, thing.spheres, thing.shell, [])
        planner.static = self.bare.carrying(robot)
        self.thing, self.robot = thing, robot
        m, arm = planner.memory, planner.static.arm
        work = make_work(len(arm.spheres), len(arm.tree_i), robot.dof)
        radii, sway = np.zeros(len(arm.spheres)), joint_sway(arm, robot.dof)
        own = m.own._replace(radii=radii, sway=sway)
        exchange(m, {"arm": arm, "work": work, "own": own, **self._groups})
        planner.hand_changed()

    def detach(self) -> None:
        """Let go; see `ReactivePlanner.detach`."""
        if self.thing is None:
            raise BadInput("nothing is attached; call attach first")
        planner = self.planner
        planner.static = self.bare
        self.thing, self.robot = None, planner.robot
        exchange(planner.memory, self._bare_groups)
        planner.hand_changed()

    def set_place(self, points: np.ndarray) -> int:
        """Take scenery of this place, and close what it blocks, with and without.

        Returns:
            How many points lie outside the grid.
        """
        outside = self.bare.set_place(points)
        closed = self._bare_groups["graph"].closed
        roadmap = self.planner.cell_map.roadmap
        closed[:] = items_in_place(self._bare_groups["graph"], self.bare, roadmap)
        layer = self.planner.cell_map.payload
        if layer is not None:
            self._follow(self._largest)
            graph = self._groups["graph"]
            graph.closed[:] = layer.closed
            graph.closed[:] |= items_in_place(graph, self._largest, roadmap)
        if self.thing is not None:
            self._follow(self.planner.static)
        return outside

    def set_extra(self, extra: float) -> None:
        """Keep more distance from the scenery of this place [m]."""
        tests = [self.bare, self.planner.static]
        if self.planner.cell_map.payload is not None:
            tests.append(self._largest)
        for test in tests:
            test.set_extra(extra)

    def _follow(self, static: object) -> None:
        """Let a test with a payload see the scenery of the one without."""
        static.place_points = self.bare.place_points
        static.place_cloud = self.bare.place_cloud
        static.set_extra(self.bare.extra)


__all__ = ["PAYLOAD", "Carrier"]
