"""What never moves: self-collision, the recipe's scenery, this place's scenery."""

import os
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from odm.close_test import _static as kernels
from odm.close_test._arm import Clearance, Work, make_work
from odm.close_test._close import FIRST_SOLID
from odm.close_test.arm import arm_of, moving_order
from odm.close_test.close_test import NO_SOLIDS, CloseTest
from odm.close_test.safety import Safety
from odm.obstacles import _occupancy as occupancy
from odm.obstacles._cloud import Cloud
from odm.obstacles._solids import Solids
from odm.obstacles.grid import WorkspaceGrid, grid_for
from odm.obstacles.mesh_surface import is_inside
from odm.obstacles.scenery import Scenery
from roadmap.arrays import writable
from roadmap.errors import BadInput
from roadmap.geometry._self_collision import SelfWork, motion_clear
from roadmap.geometry.self_collision import FINEST, MARGIN, TOLERANCE, self_collision
from roadmap.kinematics.forward import sphere_centers
from roadmap.loading.held_link import extended_collision
from roadmap.robot.robot import Robot

_CHUNK = 128
ONLINE_TOLERANCE = 0.01  # [m] inflation of a piece of motion; coarser than edges


class Place(NamedTuple):
    """What stands at this place beside the recipe's scenery, base frame.

    Attributes:
        points: (n, 3) points that cover surfaces within the map's rho [m].
        solids: Shapes that are tested by their exact distance.
        names: What a point or solid is called: (first index, name) in order, of each.
    """

    points: np.ndarray
    solids: Solids
    point_names: tuple[tuple[int, str], ...] = ()
    solid_names: tuple[tuple[int, str], ...] = ()

    def name(self, found: int) -> str:
        """Return the name of a point's index, or of FIRST_SOLID - k for solid k."""
        k, names = found, self.point_names
        if found <= FIRST_SOLID:
            k, names = FIRST_SOLID - found, self.solid_names
        before = [name for first, name in names if first <= k]
        return before[-1] if before else SET_STATIC


SET_STATIC = "the scenery set by set_static"
NOWHERE = Place(np.zeros((0, 3)), NO_SOLIDS)


class StaticTest:
    """Tests of motions against the robot itself and what stands still around it.

    Args:
        robot: The robot.
        scenery: The recipe's scenery.
        safety: Its m is kept from scenery, its mu bounds the pieces of a motion.
        grid: Grid for surface points; made for the robot when None.
        threads: Worker threads of `motions_free`; 0 means one per core.
        finest: The ends of a motion are looked at in pieces down to this length [m]: a
            robot that stands hardly clear of itself may leave. Edges of a map need no
            more than TOLERANCE; a planner's start and goals are where they are.
    """

    def __init__(
        self,
        robot: Robot,
        scenery: Scenery,
        safety: Safety,
        grid: WorkspaceGrid | None = None,
        threads: int = 0,
        finest: float = FINEST,
    ) -> None:
        self.robot, self.scenery, self.safety = robot, scenery, safety
        self.finest = finest
        self.arm = arm_of(robot)
        self.tolerance = 0.5 * safety.mu
        self.threads = threads or os.cpu_count() or 1
        self.grid = grid or grid_for(robot, safety.h, safety.rho + safety.m + 0.02)
        self.itself = self_collision(robot)
        self.skip = _skipped(robot, scenery)
        self.radii = self.arm.spheres[:, 3] + scenery.covering_radius + safety.m
        self.cloud = self.cloud_of(scenery.points)
        self.place = NOWHERE
        self.place_cloud = self.cloud_of(self.place.points)
        self.set_extra(0.0)
        self.own = _Own(self)

    def set_place(self, place: Place) -> int:
        """Take what stands at this place; return how many points lie outside."""
        self.place = place
        self.place_cloud = self.cloud_of(place.points, self.extra)
        return int(self.place_cloud.counts[2])

    def share_place(self, other: "StaticTest") -> None:
        """Take what stands at this place from another test with the same grid."""
        self.place, self.place_cloud = other.place, other.place_cloud
        self.set_extra(other.extra)

    def carrying(self, loaded: Robot, fenced: bool = False) -> "StaticTest":
        """Return the same test of the robot with a payload; points are shared.

        Args:
            loaded: The robot with what it holds.
            fenced: Its tool's body must stay so far inside the grid that whatever could
                be too near to it lies inside, too: the grid was made for a robot that
                holds nothing.
        """
        other = copy(self)
        other.robot, other.arm = loaded, arm_of(loaded)
        other.itself = extended_collision(self.itself, loaded)
        if fenced:
            other.scenery = _fenced(self.scenery, self.grid, self.safety)
        other.skip = _skipped(loaded, other.scenery)
        if fenced:
            held = np.arange(len(loaded.tree_i)) == loaded.tip_body
            other.skip[~held, -6:] = True  # the other bodies stay inside anyway
        grown = self.scenery.covering_radius + self.safety.m
        other.radii = other.arm.spheres[:, 3] + grown
        other.own = _Own(other)
        vars(other).pop("sphere_links", None)
        other.set_extra(self.extra)
        return other

    def beside(self, solid: int) -> "StaticTest":
        """Return the same test, in which the tool's body may touch a solid.

        Args:
            solid: Index in the recipe's scenery: what an object in the hand stands on.
        """
        other = copy(self)
        other.skip = self.skip.copy()
        other.skip[self.robot.tip_body, solid] = True
        other.own = _Own(other)
        return other

    def set_extra(self, extra: float) -> None:
        """Keep that much more distance from the scenery of this place [m]."""
        self.extra = extra
        grown = self.safety.rho + self.safety.m + extra
        self.place_radii = self.arm.spheres[:, 3] + grown
        self.place_bare = self.arm.spheres[:, 3] + self.safety.m + extra

    def motions_free(
        self, q: np.ndarray, dq: np.ndarray, more: float = 0.0, nearer: float = 0.0
    ) -> np.ndarray:
        """Test motions q + t dq, t in [0, 1]; (k, dof) twice -> (k,) bool.

        With `more` every point of the robot may be so far beside the motion [m]. With
        `nearer` scenery may be so much nearer than the clearance [m]; what the robot
        keeps from itself stays.
        """
        q, dq = writable(q), writable(dq)
        result = np.zeros(len(q), np.bool_)
        parts = [slice(k, k + _CHUNK) for k in range(0, len(q), _CHUNK)]

        def run(part: slice) -> None:
            still, scratch = self.still(more, nearer), self.scratch()
            kernels.motions_free(still, q[part], dq[part], scratch, result[part])

        if len(parts) <= 1 or self.threads == 1:
            for part in parts:
                run(part)
            return result
        with ThreadPoolExecutor(self.threads) as pool:
            list(pool.map(run, parts))
        return result

    def motion_free(self, q: np.ndarray, dq: np.ndarray, more: float = 0.0) -> bool:
        """Test one motion; see `motions_free`."""
        return bool(self.motions_free(q[None], dq[None], more)[0])

    def why(self, q: np.ndarray, dq: np.ndarray) -> str | None:
        """Say what the motion q + t dq runs into, or None where it is free."""
        q, dq = writable(q), writable(dq)
        text = self.touches_itself(q, dq)
        if text is not None:
            return text
        work = self.work
        solids = self._solids(0.0)
        if not kernels.motion_clear_of_solids(self.arm, q, dq, solids, work):
            name = self.scenery.names[work.found[1]]
            return f"{self.link_of(work.found[0])} would touch {name}"
        test = CloseTest(self.arm, self.radii, self.tolerance, work)
        if not test.clear(q, dq, self.cloud):
            return f"{self.link_of(work.found[0])} would touch a scenery mesh"
        if not self.clear_of_place(q, dq):
            name = self.place.name(int(work.found[1]))
            return f"{self.link_of(work.found[0])} would touch {name}"
        return None

    def clear_of_place(self, q: np.ndarray, dq: np.ndarray) -> bool:
        """Return whether the motion q + t dq is clear of this place's scenery."""
        return self.place_test.clear(q, dq, self.place_cloud, solids=self.place.solids)

    @property
    def place_test(self) -> CloseTest:
        """The close test against this place's scenery."""
        radii, bare = self.place_radii, self.place_bare
        return CloseTest(self.arm, radii, self.tolerance, self.work, bare)

    def _solids(self, more: float) -> kernels.Solids:
        kept, scenery = self.safety.m + more, self.scenery
        faces, finest = scenery.faces, self.finest
        return kernels.Solids(scenery.solids, self.skip, kept, finest, faces)

    def touches_itself(self, q: np.ndarray, dq: np.ndarray) -> str | None:
        """Say which links the motion q + t dq brings together, or None."""
        pair, t = motion_clear(
            self.itself.model, q, dq, MARGIN, TOLERANCE, self.finest, self.scratch()
        )
        if pair < 0:
            return None
        a, b = (self.robot.link_names[i] for i in self.itself.links[pair])
        return f"{a} would touch {b} at {t:.0%} of the motion"

    def link_of(self, sphere: int) -> str:
        """Return the link that a sphere of the moving robot belongs to."""
        return self.sphere_links[sphere]

    @cached_property
    def sphere_links(self) -> list[str]:
        """Links of all spheres of the moving robot, in their order."""
        owner, names = self.robot.sphere_link, self.robot.link_names
        return [names[k] for k in owner[moving_order(self.robot)].tolist()]

    @cached_property
    def places(self) -> np.ndarray:
        """See `still_places`."""
        return still_places(self.robot)

    def still(self, more: float = 0.0, nearer: float = 0.0) -> kernels.Still:
        """Return all that stands still, with the scratch of this thread."""
        radii, place_radii, bare = self.radii, self.place_radii, self.place_bare
        grown = more - nearer
        if grown:
            radii, place_radii = radii + grown, place_radii + grown
            bare = bare + grown
        return kernels.Still(
            itself=self.itself.model,
            margin=MARGIN + 2.0 * more,
            tolerance=TOLERANCE,
            finest=self.finest,
            solids=self._solids(grown),
            scenery=Clearance(self.arm, radii, radii, self.tolerance, self.work),
            cloud=self.cloud,
            place=Clearance(self.arm, place_radii, bare, self.tolerance, self.work),
            place_cloud=self.place_cloud,
            shapes=NO_SOLIDS,
            place_shapes=self.place.solids,
        )

    def scratch(self) -> SelfWork:
        """Return the scratch of this thread for tests of the robot against itself."""
        return self.own.scratch

    @property
    def work(self) -> Work:
        """The scratch of this thread for all other tests."""
        return self.own.work

    def new_work(self) -> Work:
        """Return scratch for one thread of tests."""
        return make_work(self.arm, self.robot.dof)

    def cloud_of(self, points: np.ndarray, extra: float = 0.0) -> Cloud:
        """Return points (n, 3) on the grid as the close test takes them.

        Their cells are dilated by `extra` [m].
        """
        cloud = self.grid.new_cloud(max(1, len(points)))
        points = writable(np.asarray(points, float).reshape(-1, 3))
        occupancy.mark_points(points, cloud)
        if extra > 0.0:
            occupancy.dilate_points(points, extra, cloud)
        if cloud.counts[3]:
            raise BadInput(
                f"{cloud.counts[3]} scenery points are NaN or infinite; remove them"
            )
        occupancy.sort_points(points, cloud)
        return cloud


class _Own(threading.local):
    """Scratch of each thread that tests motions."""

    def __init__(self, test: StaticTest) -> None:
        self.work, self.scratch = test.new_work(), test.itself.scratch()


def _fenced(scenery: Scenery, grid: WorkspaceGrid, safety: Safety) -> Scenery:
    """Return the scenery with the six sides of the grid as half-spaces.

    A sphere of radius r that keeps m from them, has all that is within r + rho + m of
    it inside the grid, and the cells of its online motions too.
    """
    rows = np.zeros((6, 16))
    inside = safety.rho + max(0.5 * safety.mu, ONLINE_TOLERANCE) + 1e-4
    for a in range(3):
        rows[2 * a, 1 + a], rows[2 * a, 4] = 1.0, grid.origin[a] + inside
        rows[2 * a + 1, 1 + a], rows[2 * a + 1, 4] = -1.0, -(grid.upper[a] - inside)
    return replace(
        scenery,
        solids=np.concatenate([scenery.solids, rows]),
        names=(*scenery.names, *["the edge of the map's grid"] * 6),
    )


def _skipped(robot: Robot, scenery: Scenery) -> np.ndarray:
    skip = np.zeros((len(robot.tree_i), max(1, len(scenery.solids))), np.bool_)
    for link, solid in scenery.dropped:
        body = robot.link_body[robot.link_names.index(link)]
        skip[body, scenery.names.index(solid)] = True
    return skip


def still_places(robot: Robot) -> np.ndarray:
    """Return where 256 drawn configurations bring a sphere's centre, (256, 3) [m].

    The moving sphere that is moved least, base frame: whatever holds the whole robot
    in it holds some of these places. None (0, 3) if nothing moves.
    """
    moving = robot.sphere_body > 0
    if not moving.any():
        return np.zeros((0, 3))
    centers = np.array([sphere_centers(robot, q)[moving] for q in _drawn(robot)])
    return centers[:, np.linalg.norm(np.ptp(centers, axis=0), axis=1).argmin()]


def with_insides(robot: Robot, scenery: Scenery) -> Scenery:
    """Let the meshes that count by points of their surface block their inside, too.

    A mesh whose surface is near no link may hold the whole robot: those of
    `still_places` that are inside of one become points of it.
    """
    places = still_places(robot) if scenery.loose else np.zeros((0, 3))
    held = [places[is_inside(mesh, places)] for mesh in scenery.loose]
    return replace(scenery, points=np.concatenate([scenery.points, *held]), loose=())


def _drawn(robot: Robot) -> np.ndarray:
    """Return 256 configurations (256, dof) within the limits, always the same."""
    share = np.random.default_rng(0).random((256, robot.dof))
    return robot.lower + share * (robot.upper - robot.lower)


def always_touching(robot: Robot, scenery: Scenery, safety: Safety) -> Scenery:
    """Drop (link, solid) pairs that touch in every one of 256 drawn configurations.

    Such a link stands in the scenery by construction (a shoulder by its mounting
    plate). Only bodies that the first joint alone moves are looked at, so a link that
    could get away is never dropped, and none whose body carries a link that comes to
    touch the solid on its way. Every drop is listed in the map.
    """
    arm = arm_of(robot)
    work = make_work(arm, robot.dof)
    sample, dropped = _drawn(robot), []
    still = np.zeros(robot.dof)
    for body in range(1, len(robot.tree_i)):
        if robot.tree_i[body, 0] != 0:
            continue
        if not (arm.body == body).any():
            continue
        for k in range(len(scenery.solids)):
            skip = np.ones((len(robot.tree_i), len(scenery.solids)), np.bool_)
            skip[body, k] = False
            solids = kernels.Solids(scenery.solids, skip, safety.m, faces=scenery.faces)
            clear = kernels.motion_clear_of_solids
            if not any(clear(arm, q, still, solids, work) for q in sample):
                links = np.flatnonzero(robot.link_body == body)
                if len(links) > 1 and _comes_to_touch(robot, links, solids, sample):
                    continue
                dropped += [(robot.link_names[i], scenery.names[k]) for i in links]
    return replace(scenery, dropped=tuple(dropped))


def _comes_to_touch(
    robot: Robot, links: np.ndarray, solids: kernels.Solids, sample: Sequence
) -> bool:
    """Return whether one of the links of a body touches here and may not do so there.

    A link that never touches is one whose whole way is proved clear.
    """
    still, clear = np.zeros(robot.dof), kernels.motion_clear_of_solids
    joint = robot.tree_i[robot.link_body[links[0]], 1]
    step = np.zeros(robot.dof)
    step[joint] = (robot.upper[joint] - robot.lower[joint]) / len(sample)
    way = np.tile(sample[0], (len(sample), 1))
    way[:, joint] = robot.lower[joint] + step[joint] * np.arange(len(sample))
    for link in links:
        own = robot.sphere_link == link
        if not own.any():
            continue
        names = ("spheres", "sphere_body", "sphere_link", "sphere_reach")
        alone = replace(robot, **{name: getattr(robot, name)[own] for name in names})
        arm = arm_of(alone)
        work = make_work(arm, robot.dof)
        always = not any(clear(arm, q, still, solids, work) for q in sample)
        if not always and not all(clear(arm, q, step, solids, work) for q in way):
            return True
    return False
