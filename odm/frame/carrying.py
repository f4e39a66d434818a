"""Attach and detach: the planner's tables with and without a payload, exchanged."""

import numpy as np

from odm.cell_map.payload import CarriedObject, carried_object, loaded_map, require_fit
from odm.close_test._arm import make_work
from odm.close_test.static import StaticTest
from odm.frame.frame import Frame
from odm.frame.place import PlaceItems, Standing, place_of
from odm.search.state import center_motion_bounds, exchange, graph_on
from roadmap.errors import BadInput
from roadmap.loading.held_link import with_payload
from roadmap.transforms import check_pose


class Carrier:
    """Exchanges what the hand holds, and the rows of the table that depend on it.

    The map's payload layer is merged with the arm's once. From then on a payload in
    hand means other rows in the planner's table: cell lists of arm and envelope, and
    the arm with the spheres of the very object. All that reads the table follows it.
    Without such a layer the roadmap is closed while something is held, and the tool
    must stay where the map's grid sees what is around the object.

    Attributes:
        bare: The static test of the robot with nothing in its hand.
        robot: The robot with what is in its hand.
        things: What stands at this place, by name.
    """

    def __init__(self, frame: Frame) -> None:
        self.frame, self.bare, self.robot = frame, frame.static, frame.robot
        m, cell_map = frame.memory, frame.cell_map
        self._bare_groups = {
            name: getattr(m, name)
            for name in ("arm", "work", "graph", "direct", "robot_state")
        }
        self.things: dict[str, Standing] = {}
        self._bare_items = PlaceItems(m.graph, m.direct, self.bare)
        if cell_map.payload is None:
            return
        loaded = loaded_map(cell_map)
        self._largest = self.bare.carrying(loaded.robot)
        graph, direct = graph_on(cell_map.roadmap, loaded.arm_cells, m.graph.region)
        graph.closed[:] = closed = np.array(cell_map.payload.closed)
        self._groups = {"graph": graph, "direct": direct}
        self._loaded_items = PlaceItems(graph, direct, self._largest, closed)

    def test_with(self, thing: object, T_tool_object: np.ndarray) -> StaticTest:
        """Return the static test of the robot as if it held an object.

        What stands at this place is that of now; nothing is attached.
        """
        thing = carried_object(thing).moved(check_pose(T_tool_object, "T_tool_object"))
        robot = with_payload(self.frame.robot, thing.spheres, thing.shell, [])
        return self.bare.carrying(robot, fenced=self.frame.cell_map.payload is None)

    def fitting(self, thing: object, T_tool_object: np.ndarray) -> CarriedObject:
        """Return an object as it would be held, in the tool frame.

        BadInput for one that is larger than the map's envelope.
        """
        thing = carried_object(thing).moved(check_pose(T_tool_object, "T_tool_object"))
        layer = self.frame.cell_map.payload
        if layer is not None:
            require_fit(layer.recipe, thing)
        return thing

    def attach(self, thing: object, T_tool_object: np.ndarray) -> None:
        """Take an object into the hand; see `ReactivePlanner.attach`."""
        frame = self.frame
        layer = frame.cell_map.payload
        if frame.thing is not None:
            raise BadInput(
                f"{len(frame.thing.spheres)} spheres are attached already; call detach "
                "before you attach something else"
            )
        thing = self.fitting(thing, T_tool_object)
        robot = with_payload(frame.robot, thing.spheres, thing.shell, [])
        frame.static = self.bare.carrying(robot, fenced=layer is None)
        frame.thing, self.robot = thing, robot
        m, arm = frame.memory, frame.static.arm
        n, motion_bound = len(arm.spheres), center_motion_bounds(arm, robot.dof)
        robot_state = m.robot_state._replace(
            radii=np.zeros(n), bare=np.zeros(n), motion_bound=motion_bound
        )
        held = self._closed_groups() if layer is None else self._groups
        work = make_work(arm, robot.dof)
        groups = {"arm": arm, "work": work, "robot_state": robot_state}
        exchange(m, {**groups, **held})
        self.items.follow(self.things)
        frame.hand_changed()

    def _closed_groups(self) -> dict:
        """Return the roadmap with all its items closed: no cells know of the payload.

        Then only motions that pass the close test with the object's own spheres are
        taken: straight ones, and those of the search beyond the roadmap.
        """
        graph = self._bare_groups["graph"]
        return {"graph": graph._replace(closed=np.ones(len(graph.closed), np.bool_))}

    def detach(self) -> None:
        """Let go; see `ReactivePlanner.detach`."""
        frame = self.frame
        if frame.thing is None:
            raise BadInput("nothing is attached; call attach first")
        frame.static = self.bare
        frame.thing, self.robot = None, frame.robot
        exchange(frame.memory, self._bare_groups)
        self.items.follow(self.things)
        frame.hand_changed()

    @property
    def items(self) -> PlaceItems:
        """What the things of this place close of the graph in use."""
        loaded = self.frame.thing is not None and self.frame.cell_map.payload
        return self._loaded_items if loaded else self._bare_items

    def set_place(self, things: dict[str, Standing], anew: bool = False) -> int:
        """Take what stands at this place, and close what it blocks of the graph in use.

        Returns how many points lie outside the grid. Where distances have changed, all
        is closed `anew`.
        """
        self.things = things
        outside = self.bare.set_place(place_of(things.values()))
        for test in self._others():
            test.share_place(self.bare)
        for items in self._all_items():
            if anew or items is not self.items:
                items.forget()
        self.items.follow(things)
        return outside

    def set_extra(self, extra: float) -> None:
        """Keep more distance from the scenery of this place [m]."""
        for test in (self.bare, *self._others()):
            test.set_extra(extra)

    def _others(self) -> list[StaticTest]:
        """Return the tests of the robot with something in its hand."""
        tests = [] if self.frame.cell_map.payload is None else [self._largest]
        return tests + ([] if self.frame.thing is None else [self.frame.static])

    def _all_items(self) -> list[PlaceItems]:
        if self.frame.cell_map.payload is None:
            return [self._bare_items]
        return [self._bare_items, self._loaded_items]

    # --- memory ----------------------------------------------------------------

    def save(self) -> dict[str, np.ndarray]:
        """Return how far the edges near each thing were tested."""
        return {f"tested_{k}": i.tested() for k, i in enumerate(self._all_items())}

    def load(self, saved: dict[str, np.ndarray]) -> None:
        """Restore how many edges were tested."""
        for k, items in enumerate(self._all_items()):
            tested = saved[f"tested_{k}"]
            items.follow(self.things if len(tested) else {})
            items.go_to(tested)
