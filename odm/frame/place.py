"""What stands at a place beside the recipe's scenery, and the items that it closes."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from odm.close_test.close_test import NO_SOLIDS
from odm.close_test.static import Place, StaticTest
from odm.frame import _place as kernels
from odm.obstacles import shapes
from odm.obstacles._cloud import Cloud
from odm.obstacles._solids import Solids
from odm.obstacles.mesh_surface import cover_densely, is_inside, is_small_hull
from odm.obstacles.obstacles import Obstacles, SolidRoom, together
from odm.obstacles.point_cloud import thinned
from odm.obstacles.surfaces import Surface, require_covering, surface_of
from odm.search._state import Direct, Graph
from roadmap.arrays import as_floats
from roadmap.errors import BadInput
from roadmap.transforms import moved_points

NODES_AT_ONCE = 400  # of what a thing comes near to: 3 us each, the others wait
_FINE = 0.35  # share of rho that a mesh is cut to before it is thinned


class Standing(NamedTuple):
    """One thing where it stands, base frame.

    Attributes:
        name: What it is called.
        samples: (k, 3) points that mark the cells of all its parts [m].
        points: (n, 3) points of the parts that have no exact distance [m].
        solids: The parts that have one.
    """

    name: str
    samples: np.ndarray
    points: np.ndarray
    solids: Solids


class ShapeGroup:
    """Shapes, or surfaces, in a frame of their own: made once, placed anywhere.

    Spheres, capsules, cylinders, boxes and convex meshes of at most 200 faces
    are tested by their exact distance. Other meshes, and surfaces, count by points that
    cover them within the map's rho.

    Args:
        name: What it is called.
        parts: The shapes and surfaces.
        rho: Covering radius of the map [m].

    Raises:
        BadInput: Something else, a surface sampled too coarsely, a mesh that is not
            closed, or a shape too large.
    """

    def __init__(self, name: str, parts: tuple, rho: float) -> None:
        self.name, self.parts = name, parts
        exact, loose = [], [np.zeros((0, 3))]
        self._meshes: list[np.ndarray] = []  # corners (m, 3, 3) of those by points
        for part in parts:
            if isinstance(part, Surface):
                require_covering(part, rho)
                loose.append(part.points)
            elif isinstance(part, shapes.Mesh) and not is_small_hull(
                part.vertices, part.faces
            ):
                loose.append(_mesh_points(part, rho))
                vertices = moved_points(part.vertices, part.T_base_shape)
                self._meshes.append(vertices[part.faces])
            else:
                exact.append(part)
        self._obstacles, self._room = Obstacles.of(exact), SolidRoom()
        self._solids_at(np.eye(4))  # refuses sizes before samples take their time
        covers = [surface_of(part, rho).points for part in exact]
        self._points = np.concatenate(loose)
        self._samples = np.concatenate([*covers, self._points])

    def at(self, T_base_thing: np.ndarray, static: StaticTest) -> Standing:
        """Return it where its frame has this pose (4, 4) in the base frame.

        A mesh that counts by points of its surface may hold the whole robot: places of
        `static` that are inside of it are points, too.
        """
        held = [np.zeros((0, 3))]
        if self._meshes:
            places = moved_points(static.places, np.linalg.inv(T_base_thing))
            held += [places[is_inside(mesh, places)] for mesh in self._meshes]
        points = np.concatenate([self._points, *held])
        samples = np.concatenate([self._samples, *held])
        samples = moved_points(samples, T_base_thing)
        points = moved_points(points, T_base_thing)
        return Standing(self.name, samples, points, self._solids_at(T_base_thing))

    def _solids_at(self, T_base_thing: np.ndarray) -> Solids:
        if not len(self._obstacles):
            return NO_SOLIDS
        room = self._room.of(self._obstacles, T_base_thing)
        if room is None:
            raise BadInput(
                f"a shape of {self.name!r} is too large or has a size that is not "
                "above 0; give metres: a radius of at most 5, a size of at most 1000"
            )
        return together([room])[0]


def _mesh_points(mesh: shapes.Mesh, rho: float) -> np.ndarray:
    """Return (n, 3) points that cover a closed mesh within rho, quickly made.

    Every place of the mesh is within `fine` of a centre, and every centre within the
    rest of rho of one that is kept.
    """
    fine = _FINE * rho
    centers = cover_densely(mesh.vertices, mesh.faces, fine)
    kept, _ = thinned(centers, rho - fine)
    return moved_points(centers[kept], mesh.T_base_shape)


def place_of(things: Iterable[Standing]) -> Place:
    """Return all that stands at a place as the static test takes it."""
    things = list(things)
    names = [thing.name for thing in things]
    points = np.concatenate([np.zeros((0, 3)), *(thing.points for thing in things)])
    solids, of_solids = together([thing.solids for thing in things])
    of_points = np.cumsum([0, *(len(thing.points) for thing in things)])
    firsts = of_points.tolist(), of_solids.tolist()  # and the ends, which name nothing
    named = (tuple(zip(first, names, strict=False)) for first in firsts)
    return Place(points, solids, *named)


def place_points(points_or_shapes: object, rho: float) -> np.ndarray:
    """Return (n, 3) surface points of points, a shape, surfaces or a list of them."""
    if isinstance(points_or_shapes, np.ndarray):
        return Surface(as_floats("points", points_or_shapes), rho, "scenery").points
    parts = points_or_shapes
    if isinstance(parts, Surface) or not isinstance(parts, Iterable):
        parts = [parts]
    found = [np.zeros((0, 3))]
    for part in parts:
        surface = part if isinstance(part, Surface) else surface_of(part, rho)
        require_covering(surface, rho)
        found.append(surface.points)
    return np.concatenate(found)


class _Closed(NamedTuple):
    """What one thing closes.

    Attributes:
        thing: Where it stands.
        items: (k,) nodes and edges that it closes for good, ascending.
        waiting: (e,) items that share a cell with it, nodes first: closed until they
            are tested.
        free: (e,) which of these were tested and found free.
        tested: (1,) how many were tested, from the first on.
        cloud: Its points for the close test.
    """

    thing: Standing
    items: np.ndarray
    waiting: np.ndarray
    free: np.ndarray
    tested: np.ndarray
    cloud: Cloud


class PlaceItems:
    """Which nodes and edges of a roadmap are closed by what stands at the place.

    Each thing closes what shares a cell with it, at once. Nodes are tested at once,
    too, up to `NODES_AT_ONCE` of them; the others, and all edges, wait for
    `test_waiting`, which opens what the close test proves free. So nothing is ever open
    that is not proved free, and in the end nothing is closed for its cells alone.

    Args:
        graph, direct: The roadmap's cells; `graph.closed` is written.
        static: The robot, with what it may carry; its distances count.
        closed: (n + m,) items that are closed whatever stands there, or None.
    """

    def __init__(
        self,
        graph: Graph,
        direct: Direct,
        static: StaticTest,
        closed: np.ndarray | None = None,
    ) -> None:
        self._graph, self._direct, self._static = graph, direct, static
        n = len(graph.closed)
        self._closed = np.zeros(n, np.bool_) if closed is None else closed
        self._count = np.zeros(n, np.uint16)  # things that close an item
        self._mark, self._found = np.zeros(n, np.uint8), np.empty(n, np.int32)
        self._things: dict[str, _Closed] = {}

    @property
    def waiting(self) -> int:
        """How many items are closed by cells alone, and still to be tested."""
        return sum(len(c.waiting) - int(c.tested[0]) for c in self._things.values())

    def follow(self, things: dict[str, Standing]) -> None:
        """Close what these things block, and nothing else; only changes cost time."""
        for name in list(self._things):
            if self._things[name].thing is not things.get(name):
                self._let_go(self._things.pop(name))
        for name, thing in things.items():
            if name not in self._things:
                self._things[name] = self._add(thing)

    def forget(self) -> None:
        """Take all things away, so that `follow` closes everything anew."""
        self.follow({})

    def test_waiting(self, most: int | None = None) -> int:
        """Test items that wait, `most` of them; return how many still do."""
        for name in sorted(self._things):
            closed = self._things[name]
            begin, n = int(closed.tested[0]), len(closed.waiting)
            end = n if most is None else min(n, begin + most)
            self._test(closed, end)
            most = None if most is None else most - (end - begin)
        return self.waiting

    def _test(self, closed: _Closed, end: int) -> None:
        """Test the items of a thing up to number `end`; open those that are free."""
        begin = int(closed.tested[0])
        if end <= begin:
            return
        items, free = closed.waiting[begin:end], closed.free[begin:end]
        robot = self._static.robot
        joints, dq = robot.continuous, np.empty(robot.dof)
        kernels.items_clear(*self._test_of(closed), items, joints, dq, free)
        closed.tested[0] = end
        self._step(items[free], -1)

    def motions_clear(
        self, name: str, q: np.ndarray, dq: np.ndarray, static: StaticTest
    ) -> np.ndarray:
        """Return which motions (k, dof) from q keep clear of a thing, (k,) bool.

        `static` is the robot with what it holds now.
        """
        clear = np.zeros(len(q), np.bool_)
        clearance, _, cloud, solids = self._test_of(self._things[name], static)
        q, dq = np.ascontiguousarray(q), np.ascontiguousarray(dq)
        kernels.motions_clear(clearance, cloud, solids, q, dq, clear)
        return clear

    def tested(self) -> np.ndarray:
        """Return (k,) how many items were tested of each thing, by name."""
        of = [int(self._things[name].tested[0]) for name in sorted(self._things)]
        return np.array(of, np.int64)

    def go_to(self, tested: np.ndarray) -> None:
        """Restore how many items of each thing were tested."""
        things = {name: closed.thing for name, closed in self._things.items()}
        if (self.tested() > tested).any():
            self.forget()
            self.follow(things)
        for name, n in zip(sorted(self._things), tested.tolist(), strict=True):
            self._test(self._things[name], n)

    def _test_of(self, closed: _Closed, static: StaticTest | None = None) -> tuple:
        clearance = (static or self._static).place_test.group
        return clearance, self._graph, closed.cloud, closed.thing.solids

    def _add(self, thing: Standing) -> _Closed:
        static = self._static
        cells = cloud = static.cloud_of(thing.samples, static.extra)
        if len(thing.points) != len(thing.samples):
            cloud = static.cloud_of(thing.points, static.extra)
        graph, mark = self._graph, self._mark
        n = kernels.items_near(self._direct, graph, cells, mark, self._found)
        items = np.sort(self._found[:n])
        nothing = np.zeros(0, np.int32), np.zeros(0, np.bool_), np.zeros(1, np.int64)
        closed = _Closed(thing, items, *nothing, cloud)
        clearance, _, _, solids = self._test_of(closed)
        now = items[:NODES_AT_ONCE]
        kernels.shut_nodes(clearance, graph, cloud, solids, now, mark)
        nodes = items[len(now) : np.searchsorted(items, len(graph.nodes))]
        n = kernels.split_edges(graph, items, mark, self._found)
        waiting = np.concatenate([nodes, self._found[:n]])
        shut = items[mark[items] == kernels.SHUT]
        mark[items] = 0
        self._step(shut, 1)
        self._step(waiting, 1)
        free = np.zeros(len(waiting), np.bool_)
        return closed._replace(items=shut, waiting=waiting, free=free)

    def _let_go(self, closed: _Closed) -> None:
        self._step(closed.items, -1)
        self._step(closed.waiting[~closed.free], -1)

    def _step(self, items: np.ndarray, step: int) -> None:
        if step > 0:
            self._count[items] += 1
        else:
            self._count[items] -= 1
        self._graph.closed[items] = self._closed[items] | (self._count[items] > 0)
