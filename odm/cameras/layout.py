"""Memory of a SeenSpace, laid out once."""

from collections.abc import Sequence

import numpy as np

from odm.cameras._cubes import Cells, pack
from odm.cameras._seen import BEYOND, UNSEEN
from odm.cameras.camera import DepthCamera
from odm.cameras.settings import SeenSettings
from odm.cameras.view import View, lay_out_view
from odm.cell_map.cell_map import CellMap
from odm.cell_map.payload import largest_robot
from odm.obstacles.grid import bounding_ball
from roadmap.arrays import as_floats
from roadmap.errors import BadInput
from roadmap.kinematics import _forward as kinematics
from roadmap.ranges import check_kind
from roadmap.robot.robot import Robot
from roadmap.transforms import moved_points

_MOST_PAYLOAD = 64
_LEAST_BALL, _FAR = 1e-6, 10.0  # [m] of a payload; beyond, the unit is another
_NO_PAYLOAD = np.zeros((0, 4))


class CellBuffers:
    """Arrays over all cells, z fastest; see `_seen.py`.

    A byte each (nx, ny, nz), or a bit (nx, ny, words). Arrays named ...4 or ...8 are
    views of the same memory, 4 or 8 cells in a word.
    """

    def __init__(self, cell_map: CellMap, settings: SeenSettings) -> None:
        grid = cell_map.grid
        self.origin, self.h = np.array(grid.origin), float(grid.h)
        self.shape = 4 * np.array(grid.blocks)
        cells = tuple(int(n) for n in self.shape)
        n = int(np.prod(cells))
        self._pair = [np.zeros(cells, np.uint8) for _ in range(2)]
        self.hit, self.eighths, self.spared, self.blank = (
            np.zeros(cells, np.uint8) for _ in range(4)
        )
        self.hit4 = self.hit.view(np.uint32)
        self.kept, self.since = np.zeros(n, np.uint8), np.zeros(n)
        self.kept8 = self.kept.view(np.uint64)
        self.sources = np.zeros(n, np.int32)
        most = int(np.ceil(settings.speed * settings.memory_s / self.h))
        self.ptr = np.zeros(min(most, max(cells)) + 2, np.int64)
        words = (*cells[:2], -(-cells[2] // 64))
        names = ("bits", "spare", "unseen", "blocked", "unknown", "closed", "full")
        for name in (*names, "inner", "beyond"):
            setattr(self, name, np.zeros(words, np.uint64))
        self.bits2 = self.bits.reshape(cells[0], -1)
        self.spare2 = self.spare.reshape(cells[0], -1)
        self.counts, self.once = np.zeros(5, np.int64), np.zeros(5, np.int64)
        self.scratch = np.zeros((1, 1, 1, 5), np.uint16)
        self.blank[:] = BEYOND
        self.reach_to(cell_map, largest_robot(cell_map))
        self._take(0)

    def reach_to(self, cell_map: CellMap, robot: Robot) -> bool:
        """Count what a robot may come near, too; False: all of it counted already."""
        new = (self.blank == BEYOND) & _in_reach(cell_map, robot)
        for array in (self.blank, *self._pair):
            array[new] = UNSEEN
        pack(self.blank.view(np.uint32), self.spare, self.beyond)
        return bool(new.any())

    def _take(self, now: int) -> None:
        self._now = now
        self.state, before = self._pair[now], self._pair[1 - now]
        self.flat, self.flat_before = self.state.reshape(-1), before.reshape(-1)
        self.state8 = self.flat.view(np.uint64)
        self.before8 = self.flat_before.view(np.uint64)

    def cells(self) -> Cells:
        """Return the arrays of the present frame as compiled loops take them."""
        return Cells(**{name: getattr(self, name) for name in Cells._fields})

    def swap(self) -> None:
        """Let what is seen now be what was seen before."""
        self._take(1 - self._now)

    def forget(self) -> None:
        """Let no cell have been seen."""
        for array in self._pair:
            array[:] = self.blank
        for array in (self.kept, self.bits, self.unknown):
            array[:] = 0

    @property
    def seen_last(self) -> np.ndarray:
        """What was seen in the last fit frame."""
        return self._pair[1 - self._now]

    def unpack(self, bits: np.ndarray) -> np.ndarray:
        """Return cells held as bits as (nx, ny, nz) bool."""
        flat = np.unpackbits(bits.view(np.uint8), axis=2, bitorder="little")
        return flat[:, :, : int(self.shape[2])].astype(bool)


class BodySpheres:
    """The robot's cover, base and locked links included, and what it carries."""

    def __init__(self, robot: Robot, d_self: float | None) -> None:
        self.robot = robot
        self._d = d_self or 0.0
        n = len(robot.spheres) + _MOST_PAYLOAD
        self._frames = np.zeros((len(robot.tree_i), 12))
        self._centers, self._radii = np.zeros((n, 3)), np.zeros(n)
        self._radii[: len(robot.spheres)] = robot.spheres[:, 3]
        self._owner = np.zeros(n, np.int64)
        self._owner[: len(robot.spheres)] = robot.sphere_link
        self._owner[len(robot.spheres) :] = len(robot.link_names)
        self._balls = np.zeros((n, 4))
        self.names = (*robot.link_names, "payload")
        self.removed = np.zeros(len(self.names), np.int64)
        self._use(len(robot.spheres))

    def _use(self, n: int) -> None:
        self.centers, self.plain = self._centers[:n], self._radii[:n]
        self.radii = self.plain + self._d
        self.owner, self.balls = self._owner[:n], self._balls[:n]

    def place(self, q: np.ndarray, payload: np.ndarray) -> None:
        """Put all balls where they are at q."""
        robot, n = self.robot, len(self.robot.spheres)
        kinematics.body_frames(robot.tree_i, robot.tree_f, q, self._frames)
        kinematics.place_points(
            self._frames, robot.sphere_body, robot.spheres, self._centers[:n]
        )
        if len(payload):
            f = self._frames[robot.tip_body]
            turn = f[:9].reshape(3, 3)
            tip = robot.T_body_tip
            local = moved_points(payload[:, :3], tip)
            self._centers[n : n + len(payload)] = local @ turn.T + f[9:]
            self._radii[n : n + len(payload)] = payload[:, 3]
        if len(self.centers) != n + len(payload) or len(payload):
            self._use(n + len(payload))

    def name_of(self, ball: int) -> str:
        """Return the link that a ball belongs to."""
        return self.names[self.owner[ball]]


def check_payload(payload: np.ndarray | None) -> np.ndarray:
    """Return a payload as (k, 4) float64; None is an empty one."""
    if payload is None:
        return _NO_PAYLOAD
    payload = as_floats("the payload", payload)
    if payload.ndim != 2 or payload.shape[1] != 4 or not np.isfinite(payload).all():
        raise BadInput(
            f"the payload has shape {payload.shape}; give (k, 4) finite balls in the "
            "tool frame, centre and radius [m]"
        )
    wrong = (payload[:, 3] < _LEAST_BALL) | (np.abs(payload) > _FAR).any(axis=1)
    if wrong.any():
        raise BadInput(
            f"the payload has a ball {payload[wrong][0].tolist()}, but a radius must "
            f"be {_LEAST_BALL:g} m or more, no number beyond {_FAR:g} m; give metres"
        )
    if len(payload) > _MOST_PAYLOAD:
        raise BadInput(
            f"the payload has {len(payload)} balls, at most {_MOST_PAYLOAD} are "
            "taken; cover it with fewer and larger ones"
        )
    return payload


def covering_radius(cell_map: CellMap) -> float:
    """Return half the diagonal of an eighth of a cell [m]; at most the map's rho."""
    radius = float(np.sqrt(3.0) * cell_map.grid.h / 4.0) * (1.0 + 1e-9)
    rho = cell_map.safety.rho
    if radius > rho:
        raise BadInput(
            f"eighths of cells of {100 * cell_map.grid.h:.3g} cm have a covering "
            f"radius of {100 * radius:.3g} cm, more than rho = {100 * rho:.3g} cm; "
            "build a map with smaller cells or a larger rho"
        )
    return radius


def needs_all_cubes(cell_map: CellMap, radius: float) -> bool:
    """Return True if centres of inner cells alone would not do; see `_cubes.py`."""
    least = float(cell_map.arm.spheres[:, 3].min(initial=np.inf))
    if cell_map.payload is not None:
        least = 0.0  # what will be carried may be covered by ever so small spheres
    return 2.0 * radius > least + radius + cell_map.safety.m


def views(
    cameras: Sequence[DepthCamera],
    cell_map: CellMap,
    buffers: CellBuffers,
    noise_m: float,
) -> list[View]:
    """Return the views of all cameras, or refuse one: none, or one inside the base.

    Robot, grid and rho of the map count; cells of the buffers that are out of reach are
    left out. A reading is exact to `noise_m` [m].
    """
    if not cameras:
        raise BadInput("no camera was given; give at least one DepthCamera")
    for camera in cameras:
        check_kind("a camera", camera, DepthCamera, "give DepthCamera objects")
    robot, found = cell_map.robot, []
    base = robot.sphere_body == 0
    centers = robot.spheres[base, :3]
    frame = robot.tree_f[0]
    centers = centers @ frame[:9].reshape(3, 3).T + frame[9:12]
    most, rho = len(robot.spheres) + _MOST_PAYLOAD, cell_map.safety.rho
    for camera in cameras:
        eye = camera.T_base_camera[:3, 3]
        far = np.linalg.norm(centers - eye, axis=1) - robot.spheres[base, 3]
        if len(far) and far.min() <= 0.0:
            link = robot.link_names[robot.sphere_link[base][far.argmin()]]
            raise BadInput(
                f"{camera.name} at {np.round(eye, 3)} m is inside {link} of the robot; "
                "check its pose T_base_camera"
            )
        beyond = buffers.blank == BEYOND
        found.append(lay_out_view(camera, cell_map.grid, beyond, most, noise_m, rho))
    return found


def _in_reach(cell_map: CellMap, robot: Robot) -> np.ndarray:
    """Return (nx, ny, nz) bool: cells that a robot, payload included, may come near."""
    grid = cell_map.grid
    center, radius = bounding_ball(robot)
    reach = radius + cell_map.safety.rho + cell_map.safety.m + 1e-3
    far2 = np.zeros((1, 1, 1))
    for a in range(3):
        low = grid.origin[a] + grid.h * np.arange(4 * int(grid.blocks[a]))
        gap = np.maximum(0.0, np.maximum(low - center[a], center[a] - low - grid.h))
        shape = [1, 1, 1]
        shape[a] = -1
        far2 = far2 + gap.reshape(shape) ** 2
    return far2 <= reach**2
