"""Frame: what the planner knows now, for itself and for all its helpers.

Helpers take a frame instead of the planner: robot, map and compiled state, the points
that were seen last, what stands in the hand and around, and the distances that count.
"""

import math
from collections.abc import Callable
from functools import cache
from threading import get_ident
from typing import NamedTuple, NoReturn

import numpy as np

from odm._groups import new
from odm.cell_map.cell_map import CellMap
from odm.cell_map.payload import CarriedObject
from odm.checks import check_classes, check_configuration, check_points
from odm.close_test._arm import Arm, Work
from odm.close_test._close import FIRST_SOLID
from odm.close_test.close_test import NO_SOLIDS, CloseTest
from odm.close_test.sorted_clouds import SortedCloud
from odm.close_test.static import StaticTest
from odm.frame.sensor_watch import SensorWatch
from odm.obstacles import _occupancy as occupancy
from odm.obstacles._cloud import ARE_REACHED, LAYOUT, N_OUTSIDE, SORTED
from odm.obstacles._solid_samples import KEPT, Patterns, move_solids
from odm.obstacles._solids import MESH, Solids
from odm.obstacles.obstacles import Obstacles, lent_arrays, room_for, write_meshes
from odm.obstacles.point_cloud import PointCloud
from odm.obstacles.surfaces import rounded_covering
from odm.obstacles.unit import largest_coordinates
from odm.obstacles.world_frame import WorldFrame
from odm.owner import refuse_copy
from odm.search import _frame as kernels
from odm.search import _step as step
from odm.search.state import DirectMap, exchange, lay_out
from roadmap.arrays import is_lendable, lent
from roadmap.compiling.wrapper import without_lookup
from roadmap.errors import BadInput
from roadmap.kinematics.forward import difference
from roadmap.ranges import check_number
from roadmap.transforms import moved_points


class Cover(NamedTuple):
    """Spheres that the close test is run with."""

    arm: Arm
    radii: np.ndarray  # (n,) radius, covering radius and clearance [m]
    links: list[str]  # of each sphere
    work: Work
    bare: np.ndarray  # (n,) the same from solids: without the covering radius [m]


class Near(NamedTuple):
    """The obstacle with the least margin at a configuration.

    Attributes:
        gap: Its distance [m]; inf where there is nothing.
        keep: The distance that it must have [m].
        link: The link that it is near to.
        what: What it is called; None for nothing.
        point: Its index where it is a point, else -1.
    """

    gap: float
    keep: float
    link: str | None
    what: str | None
    point: int


MOST_SAMPLES = 2_000_000  # of all shapes of a frame
_LOADED = (  # nor how its meshes are sampled
    "the memory that was loaded does not say which shapes are near the grid now that "
    "the base or the clearance is another; show a frame"
)
_CROPPED = (
    "the last cloud was cropped where the base stood, or with the clearance that was "
    "kept, before; show a frame"
)
_AS_THE_MAP = None, None  # how points are sampled where nothing is told
_NOT_ASKED = step.NOT_ASKED  # which every frame compares with
_NOTHING_AGAIN = object()  # no obstacles at all


def _too_many(n: int) -> str:
    return (
        f"the shapes of the frame take {n} samples, more than {MOST_SAMPLES}; give "
        "metres, or leave out what is far"
    )


@cache
def compiled_step_again(table: np.dtype) -> Callable[[np.ndarray, np.ndarray], int]:
    """Return `step_again` for tables of this type and for what `Frame.asked` returns.

    The type of a memory's table stays, and so does that of q.
    """
    return without_lookup(step.step_again, np.empty(0, table), np.empty(0))


class Frame:
    """The present frame, and what every test of a motion needs to know of it.

    Args:
        cell_map: The map of the robot.
        point_capacity: Points that memory is laid out for at first; it grows.
        finger_pads: Links that may touch what is about to be grasped.
        watch: Judges whether a frame's points can be used.

    Attributes:
        robot, cell_map, finger_pads, watch: As given.
        memory: The arrays of the compiled loops.
        direct: The nodes and edges that the points invalidate.
        static: The test of what never moves, with what is in the hand.
        thing: What is in the hand; None for nothing.
        rho, extra: The map's covering radius, and what is kept beyond its m [m].
        sampled: (covering radius, rounding) that the points were declared with.
        world, world_ahead: Where the base stands; each has a buffer for points.
        base_world: (4, 4) the world's pose in the base frame, for compiled loops.
        q: (dof,) where the robot is.
        q_taken: (dof,) what came last as q, as compiled loops take it.
        points: (n, 3) of the last frame, base frame [m]; copied. The samples of its
            shapes follow the points that were given.
        n_given: How many of the points were given; the rest are samples of shapes,
            which only mark cells.
        obstacles: The shapes of the last frame; None where it had points alone.
        classes: (n,) of these points, or None.
        again: The obstacles that `take_again` may take: the table points at their
            arrays, and nothing was told beside them.
        step_again: The compiled call that does it; None before the first such frame.
        keep_from_points, keep_from_shapes: What is nearer to a sphere is too near [m].
        trouble: Why the last frame could not be used; None where it could.
    """

    def __init__(
        self,
        cell_map: CellMap,
        point_capacity: int,
        finger_pads: tuple[str, ...],
        watch: SensorWatch,
    ) -> None:
        self.cell_map, self.robot = cell_map, cell_map.robot
        self.finger_pads, self.watch = finger_pads, watch
        self.static = StaticTest(
            self.robot, cell_map.scenery, cell_map.safety, cell_map.grid
        )
        self.thing: CarriedObject | None = None
        self.memory = lay_out(cell_map, point_capacity)
        n, m = cell_map.roadmap.n_nodes, cell_map.roadmap.n_edges
        self.direct = DirectMap(self.memory, n, m)
        self.q = self.memory.robot_state.q
        self.rho, self.extra = cell_map.safety.rho, 0.0
        self.keep_from_points = self.keep_from_shapes = 0.0
        self.again: object = _NOTHING_AGAIN
        self.step_again: Callable[[np.ndarray, np.ndarray], int] | None = None
        self.set_sampling(_AS_THE_MAP)
        self.base_world = np.eye(4)
        grid = cell_map.grid
        half = 0.5 * (grid.upper - grid.origin)
        self._half = float(np.linalg.norm(half)) + 0.1  # ball around the grid
        self.memory.patterns.near[:] = *(grid.origin + half), self._half
        self.memory.patterns.base_world[:] = self.base_world
        self._nothing = grid.new_cloud(0)
        self.obstacles: Obstacles | None = None
        self._shape_classes = b""  # as they were when the frame was taken
        self.n_given = 0
        # the arrays that came last, as they were found good: they need no second look
        self._taken = self._nothing.xyz
        self._asked: np.ndarray | None = self.q
        # views of them: who closes an array to writing later does not close these
        self._points_view, self.q_taken = self._nothing.xyz[:], self.q[:]
        self._copies_q, self._dof = False, cell_map.robot.dof
        self._owner = self.memory.owner
        self._known: Obstacles | None = None  # whose meshes are laid out
        self._arrays: tuple[np.ndarray, np.ndarray]  # and rows, which are kept alive
        # shapes and classes that were checked and not taken yet; None: as before
        self._given: tuple[Obstacles | None, np.ndarray | None] | None = None
        self.world, self.world_ahead = WorldFrame(np.eye(4)), WorldFrame(np.eye(4))
        # two buffers: the points of an earlier frame may be kept for the watch
        self._buffers = [np.empty((point_capacity, 3)) for _ in range(2)]
        self._views = [buffer[:0] for buffer in self._buffers]
        self._buffer = 0
        self.points = self._kept = self._views[0]
        self.classes: np.ndarray | None = None
        self.trouble: str | None = None
        self._unfit: str | None = None  # what a cloud that came last says of itself
        # whether a planner or a map cropped the cloud that came last, and the frame's
        self._is_cut = self._was_cut = False
        self.loaded = 0  # how often a memory was loaded
        self._sorted_outside = SortedCloud(grid)  # of the points of an epoch
        self._outside_in: tuple[int, int] | None = None

    def __reduce_ex__(self, protocol: object) -> NoReturn:
        """Refuse to be copied or pickled, and what holds a frame with it."""
        refuse_copy()

    # --- what is seen ----------------------------------------------------------

    @property
    def number(self) -> int:
        """How many frames were taken, the first of which is number 1."""
        return self.memory.numbers.step.item()

    @property
    def epoch(self) -> tuple[int, int]:
        """Another one whenever points are marked anew: so long a verdict holds."""
        return self.loaded, self.memory.numbers.frame.item()

    def checked(
        self,
        points: np.ndarray | Obstacles | PointCloud,
        q: np.ndarray,
        dq: np.ndarray | None,
        labels: np.ndarray | None,
        covering_radius: float | None,
        classes: np.ndarray | None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return a frame's points and q as compiled loops take them.

        Its shapes and classes wait for `take`: what was refused is no frame.
        """
        if get_ident() != self._owner.thread:
            self._owner.check()
        obstacles = None
        if type(points) is Obstacles:
            obstacles, points = points, points.points
            if classes is not None:
                raise BadInput(
                    "classes were given beside Obstacles; give them to Obstacles "
                    "by kind"
                )
            classes = obstacles.classes
        self._unfit, self._is_cut = None, False
        if type(points) is PointCloud:
            self._unfit, self._is_cut = points.trouble, self._cut(points)
            points = points.points
        # mostly both are what the compiled frame took before, which is seen at once
        if (
            points is not self._taken
            or len(points) != len(self._points_view)
            or labels is not None
            or covering_radius is not None
        ):
            points = check_points(points, labels, covering_radius, self.rho)
            self._taken = points
            self._points_view = points[:]
        points = self._points_view
        q = self.asked(q, dq)
        classes = None if classes is None else check_classes(classes, len(points))
        same = obstacles is self.obstacles and classes is None and self.classes is None
        self._given = None if same else (obstacles, classes)
        return points, q

    def _cut(self, cloud: PointCloud) -> bool:
        """Return whether a cloud was cropped by a planner or a map; refuse too much."""
        grid, extra = self.cell_map.grid, self.extra
        if not cloud.holds(grid.origin - extra, grid.upper + extra, self.base_world):
            raise BadInput(
                "the cloud was cropped for another base, extra clearance or map than "
                "the planner's, so what counts may be missing; crop it with this "
                "planner, after set_base and set_extra_clearance"
            )
        return cloud.is_cut

    def asked(self, q: np.ndarray, dq: np.ndarray | None = None) -> np.ndarray:
        """Return q as compiled loops take it, which is kept as `q_taken`."""
        if q is self._asked and len(q) == self._dof and dq is None:
            if self._copies_q:  # such as float32: compiled loops take float64
                self.q_taken[:] = q
            return self.q_taken
        given, q = q, check_configuration(self.robot, q, dq)
        self._asked, self._copies_q = given, q is not given
        if type(given) is not np.ndarray:
            self._asked = None
        elif self._copies_q and is_lendable(given):
            q, self._copies_q = lent(given), False
        self.q_taken = q[:]  # who closes q to writing later does not close a view
        return self.q_taken

    def take(
        self,
        points: np.ndarray,
        covering_radius: float | None,
        rounding: float | None,
        stamp: float | None,
        now: float | None,
        q: np.ndarray | None = None,
    ) -> int:
        """Copy and mark a frame's points (n, 3) of the world, as `checked` gave them.

        `trouble` says whether they can be used. Where they can, no time was given and
        `q` is, the frame is answered from there in the same compiled call: returns what
        `respond` says, else NOT_ASKED (`odm/search/_step.py`).

        Raises:
            BadInput: The rounding, or a mesh that is too large to be sampled; the last
                frame stays.
        """
        if rounding is not None:
            check_number("rounding in m", rounding, 0.0, np.inf)
        self.again, self._was_cut = _NOTHING_AGAIN, self._is_cut
        if self._given is not None:
            obstacles, classes = self._given
            if obstacles is not None and obstacles is not self._known:
                self._know(obstacles)
            self.obstacles, self.classes, self._given = obstacles, classes, None
        if stamp is not None or now is not None or self._unfit is not None:
            q = None
        plain = covering_radius is None and rounding is None
        sampling = _AS_THE_MAP if plain else (covering_radius, rounding)
        if sampling is not self.sampled and sampling != self.sampled:
            self.set_sampling(sampling)
        self.n_given = len(points)
        if self.obstacles is None:
            return self._take_points(points, stamp, now, q)
        classes = self.obstacles.told_classes
        self._shape_classes = b"" if classes is None else classes.tobytes()
        if self.watch.seen_inside is not None and self._kept is self.points:
            self._buffer = 1 - self._buffer
        return self._take_shapes(points, stamp, now, q)

    def take_again(self, obstacles: Obstacles, q: np.ndarray) -> int | None:
        """Take and answer a frame that comes by the same arrays as the last one.

        They are those of `again`; nothing but these may be told with it. It is checked
        and laid out already, which is most of what Python does for a frame.

        Returns:
            As `take`; None where it is another frame than the last, and was not taken.
        """
        points = obstacles.points
        if points is not self._taken or len(points) != self.n_given:
            return None
        if obstacles.classes is not None:
            return None
        if q is not self._asked or self._copies_q or len(q) != self._dof:
            self.asked(q)
        if self.step_again is None:
            self.step_again = compiled_step_again(self.memory.table.dtype)
        classes = obstacles.told_classes
        self._shape_classes = b"" if classes is None else classes.tobytes()
        said = self.step_again(self.memory.table, self.q_taken)
        if said != _NOT_ASKED:
            self.trouble = None
            return said
        room = self.points.base
        n = self.memory.numbers.taken.item()
        self._take_rest(n, self._points_view, None, None)
        self._keep_lent(room)
        return said

    def _take_shapes(
        self,
        points: np.ndarray,
        stamp: float | None,
        now: float | None,
        q: np.ndarray | None,
    ) -> int:
        """Take a frame with shapes that are laid out; see `take`."""
        memory = self.memory
        room, now_seen = self._buffers[self._buffer], self.points
        table, (data, counts) = memory.table, self._arrays
        if q is None or now_seen.base is not room:
            n = kernels.begin_shapes(table, points, data, counts, room)
            self._take_rest(n, points, stamp, now)
            return step.NOT_ASKED
        n_before = len(now_seen)
        said = step.step_shapes(table, points, data, counts, room, n_before, q)
        if said != step.NOT_ASKED:
            self.trouble = None
        else:
            self._take_rest(memory.numbers.taken.item(), points, stamp, now)
        self._keep_lent(room)
        return said

    def _keep_lent(self, room: np.ndarray) -> None:
        """Let the obstacles come again whose arrays, and `room`, the table points at.

        Not where something was told beside them.
        """
        plain = self.sampled is _AS_THE_MAP and self.classes is None
        if plain and self.points.base is room:
            self.again = self.obstacles

    def _take_rest(
        self, n: int, points: np.ndarray, stamp: float | None, now: float | None
    ) -> None:
        """Judge what `begin_shapes` took, which returned `n`."""
        trouble, now_seen = None, self.points
        if n != len(now_seen) or now_seen.base is not self._buffers[self._buffer]:
            trouble = self._take_others(n, points)
        if trouble is None:
            trouble = self.watch.unfit(self.memory.cloud.counts, self, stamp, now)
        self.trouble = trouble

    def _take_points(
        self,
        points: np.ndarray,
        stamp: float | None,
        now: float | None,
        q: np.ndarray | None,
    ) -> int:
        """Take a frame without shapes; see `take`."""
        if len(points) > len(self.memory.cloud.where):
            self.grow_clouds(2 * len(points))
        buffer = self.points
        if self.watch.seen_inside is not None or len(points) != len(buffer):
            buffer = self._buffer_for(len(points))
        self.trouble, said = None, step.NOT_ASKED
        if q is not None:
            said = step.step_points(self.memory.table, points, buffer, q)
            if said != step.NOT_ASKED:
                return said
        else:
            kernels.begin_step(self.memory.table, points, buffer)
        unfit = self.watch.unfit(self.memory.cloud.counts, self, stamp, now)
        self.trouble = self._unfit or unfit
        return said

    def _take_others(self, n: int, points: np.ndarray) -> str | None:
        """Go on where `begin_shapes` returned another number of points than before.

        Returns why there are no points to use, None where there are.
        """
        obstacles = self.obstacles
        while True:
            memory, room = self.memory, self._buffers[self._buffer]
            if n >= kernels.ODD:
                n -= kernels.ODD
            if n == kernels.MORE_PATTERNS:
                self._fit_shapes(obstacles, 2 * len(memory.patterns.rows) + 1024)
            elif n == kernels.MORE_POINTS:
                n = memory.patterns.wrong.item(0)
                if n - len(points) > MOST_SAMPLES:
                    break
                self.grow_clouds(2 * n)
                self._buffers[self._buffer] = room = np.empty((2 * n, 3))
            else:
                break
            n = kernels.begin_shapes(memory.table, points, *self._arrays, room)
        trouble = None
        if n > len(room):  # too many samples: nothing was begun
            kernels.begin_step(memory.table, points, self._buffer_for(len(points)))
            trouble = _too_many(n)
        elif n < 0:
            kind, k = memory.patterns.wrong.tolist()
            trouble = obstacles.trouble(kernels.WRONG - n, kind, k)
            n = len(points)
        if n != len(self.points) or self.points.base is not room:
            self._view_of(min(n, len(room)))
        return trouble

    def _know(self, obstacles: Obstacles) -> None:
        """Lay out what never changes about obstacles: room, and their meshes."""
        # what has no meshes needs rows alone
        if obstacles.meshes or len(obstacles) > len(self.memory.solids.kind):
            self._fit_shapes(obstacles)
            write_meshes(obstacles, self.memory.solids, self.memory.patterns)
        self._known, self._arrays = obstacles, lent_arrays(obstacles)

    def _fit_shapes(self, obstacles: Obstacles, patterns: int = 0) -> None:
        """Make room for shapes and their patterns, where there is too little."""
        memory = self.memory
        larger = room_for(obstacles, memory.solids, memory.patterns, patterns)
        if larger is not None:
            memory.owner.check()
            exchange(memory, dict(zip(("solids", "patterns"), larger, strict=True)))
            write_meshes(obstacles, *larger)

    def replace(self, points: np.ndarray, n_given: int) -> None:
        """Replace the frame's points by (n, 3) others, outside of a step.

        The close test counts the first `n_given` of them.
        """
        self.n_given = n_given
        self._buffer_for(len(points))[...] = points
        self.mark()

    def mark(self) -> None:
        """Mark the frame's points anew: verdicts about them are void."""
        if len(self.points) > len(self.memory.cloud.where):
            self.grow_clouds(2 * len(self.points))  # which marks them
            return
        # while room is made the points may be those of the frame before
        n_given = min(len(self.points), self.n_given)
        kernels.take_points(self.memory.table, self.points, n_given)

    def grow_clouds(self, capacity: int) -> None:
        """Let clouds hold that many points or more; the frame's stay marked."""
        memory = self.memory
        memory.owner.check()
        grid, capacity = self.cell_map.grid, max(capacity, len(memory.cloud.where))
        clouds = "cloud", "picked", "reached"
        exchange(memory, {n: grid.new_cloud(capacity) for n in clouds})
        self.mark()

    def _buffer_for(self, n: int) -> np.ndarray:
        """Let `points` be an array (n, 3) of our own, and return it to be filled."""
        if self.watch.seen_inside is not None and self._kept is self.points:
            self._buffer = 1 - self._buffer
        return self._view_of(n)

    def _view_of(self, n: int) -> np.ndarray:
        """Let `points` be the first n of our own array in use."""
        view, room = self._views[self._buffer], self._buffers[self._buffer]
        if len(view) != n or view.base is not room:
            if n > len(room):
                room = self._buffers[self._buffer] = np.empty((2 * n, 3))
            view = self._views[self._buffer] = room[:n]
        self.points, self.again = view, _NOTHING_AGAIN
        return view

    def sort(self) -> None:
        """Lay the frame's points out for the close test, unless they are."""
        if self.memory.cloud.counts[LAYOUT] != SORTED:
            occupancy.sort_points(self.points, self.memory.cloud)

    # --- numbers about the points, for the watch -----------------------------------

    def beyond(self, limit: float) -> tuple[int, int]:
        """Return how many points there are, and are farther off than `limit` [m]."""
        return len(self.points), occupancy.count_beyond(self.points, limit)

    def median_distance(self) -> float:
        """Return the median of the points' largest coordinates [m]."""
        return float(np.median(largest_coordinates(self.points)))

    def depth_kept(self) -> float:
        """Return how far the innermost of the points kept last is in the grid [m]."""
        return occupancy.deepest(self._kept, self.memory.cloud)

    def keep_points(self) -> None:
        """Keep this frame's points for `depth_kept` until others are kept."""
        self._kept = self.points

    # --- memory ----------------------------------------------------------------

    def save(self) -> dict[str, np.ndarray]:
        """Return the frame that was seen last."""
        sampled = [np.nan if value is None else value for value in self.sampled]
        kept = self._kept if self.watch.seen_inside is not None else np.zeros((0, 3))
        return {
            "points": self.points.copy(),
            "heeded": np.array(self.n_given),
            **self._save_solids(),
            "classes": np.zeros(0) if self.classes is None else self.classes.copy(),
            "trouble": np.array(self.trouble or ""),
            "sampled": np.array(sampled, float),
            "cropped": np.array(self._was_cut),
            "q": self.q.copy(),
            "counted_in": self.memory.direct.frame.copy(),
            **{f"watch_{k}": array for k, array in self.watch.save().items()},
            "watch_inside": kept.copy(),  # the watch may still ask for them
        }

    def load(self, saved: dict[str, np.ndarray]) -> None:
        """Take up a frame that was saved, after the arrays of the state."""
        self.loaded += 1
        self.watch.load({k[6:]: a for k, a in saved.items() if k.startswith("watch_")})
        self._kept = saved["watch_inside"].copy()
        self.q[:] = saved["q"]
        classes = saved["classes"]
        n_given = int(saved["heeded"])  # as files have called it
        self.classes = classes.copy() if len(classes) == n_given else None
        self.trouble = str(saved["trouble"]) or None
        self._was_cut = bool(saved["cropped"])
        sampling = [None if np.isnan(value) else value for value in saved["sampled"]]
        self.set_sampling(tuple(sampling))
        self.memory.numbers.frame[0] -= 1  # which marking adds
        self._load_solids(saved)
        self.replace(saved["points"], n_given)
        self.direct.clear()
        self.memory.direct.frame[:] = saved["counted_in"]

    def _save_solids(self) -> dict[str, np.ndarray]:
        solids, n = self.memory.solids, self.memory.solids.count.item()
        last = int(solids.rows[:n][solids.kind[:n] == MESH, 13].max(initial=0))
        return {
            "solids": solids.rows[:n].copy(),
            "solid_kinds": solids.kind[:n].copy(),
            "solid_faces": solids.faces[:last].copy(),
            "solid_classes": self.solid_classes.copy(),
        }

    def _load_solids(self, saved: dict[str, np.ndarray]) -> None:
        rows, faces = saved["solids"], saved["solid_faces"]
        memory = self.memory
        solids, patterns = memory.solids, memory.patterns
        self.obstacles = self._known = None
        if len(rows) > len(solids.kind) or len(faces) > len(solids.faces):
            larger = new(Solids, {"shapes": len(rows), "faces": len(faces)})
            sizes = {"shapes": len(rows), "patterns": 0, "samples": 0}
            kept = {name: getattr(patterns, name) for name in KEPT}
            patterns = new(Patterns, sizes, **kept)
            exchange(memory, {"solids": larger, "patterns": patterns})
        memory.solids.rows[: len(rows)] = rows
        memory.solids.kind[: len(rows)] = saved["solid_kinds"]
        memory.solids.faces[: len(faces)] = faces
        memory.solids.count[0] = len(rows)
        self._shape_classes = saved["solid_classes"].tobytes()

    # --- distances -------------------------------------------------------------

    @property
    def radii(self) -> np.ndarray:
        """(n,) radii of the close test [m]: spheres, covering radius, clearance."""
        return self.memory.robot_state.radii

    def set_sampling(self, sampled: tuple[float | None, float | None]) -> None:
        """Let the close test's radii follow how the points were `sampled`."""
        self.sampled = sampled
        m = self.cell_map.safety.m + self.extra
        radii = self.memory.arm.spheres[:, 3]
        self.memory.terms.widest[0] = radii.max()
        balls = radii + m
        needed = [self.covering(ball) for ball in balls]
        self.radii[:] = balls + needed
        if not (self.bare == balls).all():
            self._forget_slacks()
        self.bare[:] = balls
        self.keep_from_shapes, self.keep_from_points = m, m + float(np.max(needed))
        # what cells of a payload were made for may have smaller balls than all these
        patterns, layer = self.memory.patterns, self.cell_map.payload
        patterns.rho[0] = self.rho
        least = radii.min() if layer is None else 0.0
        patterns.ball_least[0] = least + self.cell_map.safety.m

    @property
    def bare(self) -> np.ndarray:
        """(n,) what the spheres keep from shapes [m]: their radii and clearance."""
        return self.memory.robot_state.bare

    @property
    def keep(self) -> float:
        """What is nearer than this to a sphere is too near [m].

        Where there are shapes alone, which need no covering radius, it is less.
        """
        bare = self.n_given == 0 and self.memory.solids.count.item() > 0
        return self.keep_from_shapes if bare else self.keep_from_points

    @property
    def solid_classes(self) -> np.ndarray:
        """(k,) classes of the frame's shapes, all odm.AVOID where none were told."""
        n = self.memory.solids.count.item()
        if not self._shape_classes:
            return np.zeros(n, np.int8)
        return np.frombuffer(self._shape_classes, np.int8)[:n]

    @property
    def solids(self) -> Solids:
        """The frame's shapes."""
        return self.memory.solids

    def covering(self, ball: float) -> float:
        """Return how far a surface may be from its samples, for a ball's radius [m]."""
        declared, rounding = self.sampled
        rho = self.rho if declared is None else declared
        return rounded_covering(rho, rounding or 0.0, ball)

    def grown(self, radii: np.ndarray, balls: np.ndarray, extra: float) -> np.ndarray:
        """Return radii (n,) that keep so much more distance from the points [m].

        Of rounded surfaces a smaller ball needs more than a larger one.

        Args:
            radii: (n,) with the covering radius of the frame's points.
            balls: (n,) the same without it.
            extra: More distance; less where negative.
        """
        if extra >= 0.0 or self.sampled[1] is None:
            return radii + extra
        smaller = balls + extra
        return smaller + [self.covering(ball) for ball in smaller.tolist()]

    def set_extra(self, extra: float) -> None:
        """Keep that much more distance than the map's clearance [m]."""
        self.extra = float(extra)
        self.memory.terms.extra[0] = self.extra
        self.memory.patterns.near[3] = self._half + self.extra
        self.set_sampling(self.sampled)
        self._place_again(self.points[: self.n_given].copy())

    def hand_changed(self) -> None:
        """Take up the table's new groups: another arm, other cells."""
        self._forget_slacks()
        self.set_sampling(self.sampled)
        self.memory.search.memo[:] = -1
        self.memory.recent.memo[:] = -1
        self.memory.search.hit_at[:] = 0
        self.memory.cloud.counts[ARE_REACHED] = 0  # by another arm

    def _forget_slacks(self) -> None:
        """Forget what motions had to spare: of another robot, or another distance."""
        self.memory.slacks.chords[:] = 0
        self.memory.blocked_places.q[:] = np.nan

    def set_base(self, T_world_base: np.ndarray) -> None:
        """Say where the base stands; the points stay where they are in the world."""
        before = self.world.T_world_base
        self.world = WorldFrame(T_world_base)
        self.world_ahead = WorldFrame(T_world_base)
        self.base_world = self.world.T_base_world.copy()
        self.memory.patterns.base_world[:] = self.base_world
        move_solids(self.solids, self.base_world @ before)
        p_world = moved_points(self.points[: self.n_given], before)
        self._place_again(self.world.points(p_world))

    def _place_again(self, given: np.ndarray) -> None:
        """Mark the given points (n, 3) and the frame's shapes where they are now.

        Other shapes are near the grid than before, so they are sampled anew.
        """
        table, n = self.memory.table, len(given)
        n_all = n
        if self._was_cut:
            self.trouble = self.trouble or _CROPPED
        if self.solids.count.item() and self.obstacles is None:
            self.trouble = self.trouble or _LOADED
        elif self.solids.count.item():
            n_all = kernels.sample_again(table, self._nothing.xyz, n)
            if n_all > MOST_SAMPLES:
                self.trouble, n_all = _too_many(n_all), n
        room = self._buffer_for(n_all)
        room[:n] = given
        if n_all > n:
            kernels.sample_again(table, room, n)
        self.mark()

    # --- tests of motions ------------------------------------------------------

    def difference(self, q_a: np.ndarray, q_b: np.ndarray) -> np.ndarray:
        """Return the motion from q_a to q_b; continuous joints go the short way."""
        return np.ascontiguousarray(difference(self.robot, q_a, q_b))

    @property
    def close_test(self) -> CloseTest:
        """The close test of motions, with what the hand carries."""
        m = self.memory
        tolerance = self.cell_map.motion_tolerance
        return CloseTest(
            m.arm, m.robot_state.radii, tolerance, m.work, m.robot_state.bare
        )

    def close_test_with(self, extra: float) -> CloseTest:
        """Return the close test that keeps so much more distance, or less [m]."""
        m, tolerance = self.memory, self.cell_map.motion_tolerance
        radii = self.grown(self.radii, self.bare, extra)
        return CloseTest(m.arm, radii, tolerance, m.work, self.bare + extra)

    def motion_clear(
        self,
        q: np.ndarray,
        dq: np.ndarray,
        cloud: object = None,
        more: float = 0.0,
        escape: bool = False,
    ) -> bool:
        """Run the close test of q + t dq, t in [0, 1], against points and all shapes.

        The points laid out in `cloud` (None: the frame's), with `more` distance kept
        [m]. With `escape` only what is too near now may be near; see `_close.py`.
        Points outside the grid count where the robot's own reach does not keep it off.
        """
        test = self.close_test_with(more) if more else self.close_test
        if not test.clear(q, dq, self._laid_out(cloud), escape, self.solids):
            return False
        if cloud is not None or not (more > 0.0 or self.thing is not None):
            return True
        outside = self._outside_grid()
        return outside is None or test.clear(q, dq, outside, escape)

    def separation(
        self, q: np.ndarray, cloud: object = None, most: float = np.inf
    ) -> float:
        """Return the least distance of the cover at q from points, at most `most` [m].

        None for `cloud`: from the frame's points and shapes, also outside the grid.
        """
        solids = self.solids if cloud is None else NO_SOLIDS
        test = self.close_test
        gap = test.separation(q, self._laid_out(cloud), most, solids)
        outside = self._outside_grid() if cloud is None else None
        return gap if outside is None else test.separation(q, outside, gap)

    def _outside_grid(self) -> object | None:
        """Return the given points outside the grid, laid out once; None: no point is.

        No cell knows of them, and they are in no list of the frame's cloud.
        """
        cloud, epoch = self.memory.cloud, self.epoch
        if cloud.counts[N_OUTSIDE] == 0:
            return None
        if self._outside_in != epoch:
            outside = cloud.where[: self.n_given] < 0
            self._sorted_outside.of(self.points[: self.n_given][outside])
            self._outside_in = epoch
        return self._sorted_outside.cloud

    def _laid_out(self, cloud: object) -> object:
        if cloud is not None:
            return cloud
        self.sort()
        return self.memory.cloud

    def nearest(self, q: np.ndarray) -> Near:
        """Return the point or shape with the least distance to spare from q."""
        q, test = np.ascontiguousarray(q), self.close_test
        found = Near(math.inf, self.keep, None, None, -1)
        for cloud, solids, keep in (
            (self._laid_out(None), NO_SOLIDS, self.keep_from_points),
            (self._nothing, self.solids, self.keep_from_shapes),
        ):
            gap = test.separation(q, cloud, solids=solids)
            sphere, point = test.blocked_by
            if sphere >= 0 and gap - keep < found.gap - found.keep:
                link, what = self.static.link_of(sphere), self.name_of(point)
                found = Near(gap, keep, link, what, max(point, -1))
        return found

    def kept_from(self, point: int) -> float:
        """Return what is kept from a point that a close test found, or a shape [m]."""
        return self.keep_from_shapes if point <= FIRST_SOLID else self.keep_from_points

    def name_of(self, point: int) -> str:
        """Return what a point is called that a close test found, or a shape."""
        if point > FIRST_SOLID:
            return f"point {point}"
        if self.obstacles is None:  # a memory that was loaded knows no names
            return f"shape {FIRST_SOLID - point}"
        return self.obstacles.name(FIRST_SOLID - point)

    def cover(self) -> Cover:
        """Return the spheres of the map's cover, payload included."""
        m = self.memory
        return Cover(m.arm, self.radii, self.static.sphere_links, m.work, self.bare)
