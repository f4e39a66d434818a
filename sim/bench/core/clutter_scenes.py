"""Cluttered scenes of our own making: shelves, boxes, cages, tables, under tables.

Furniture of boxes, placed at random before the robot, and two configurations that have
to do with it: in compartments, in the open box, between the bars, above and below the
table top. Both keep a distance from all boxes by exact geometry, and are free of what
stands still. Nothing is looked at but that: no planner says which scenes are taken.
"""

from dataclasses import dataclass

import numpy as np

from odm import Box
from odm.cell_map.cell_map import CellMap
from odm.close_test.static import StaticTest
from odm.exact.distances import ExactRobot, obstacles_of
from roadmap.arrays import frozen
from roadmap.errors import PlanningError
from roadmap.kinematics.forward import tool_pose

CLEAR = 0.025  # [m] the exact solids at both ends keep so much from all boxes
APART = 1.0  # [rad or m] the two ends are at least so far apart
_POOL = 120_000  # configurations drawn once, from which ends are taken
_LOOKS = 400  # of them looked at for one end
_BOARD = 0.02  # [m] thickness of boards


@dataclass(frozen=True, eq=False)
class Scene:
    """One problem.

    Attributes:
        kind: One of KINDS.
        boxes: The obstacles, base frame.
        q_start, q_goal: (dof,) both ends [rad or m].
    """

    kind: str
    boxes: tuple[Box, ...]
    q_start: np.ndarray
    q_goal: np.ndarray


@dataclass(frozen=True, eq=False)
class _Furniture:
    """Boxes about an origin of their own, and where a tool goes there.

    Attributes:
        sizes: (k, 3) edge lengths [m].
        centers: (k, 3) [m].
        inner, outer: Regions (2, 3), low and high corner [m]: one end of a problem has
            its tool in an inner one, the other in any other region.
    """

    sizes: np.ndarray
    centers: np.ndarray
    inner: list[np.ndarray]
    outer: list[np.ndarray]


class NoScene(PlanningError):
    """The robot has no configurations in these scenes."""


def make_scenes(cell_map: CellMap, count: int, seed: int) -> list[Scene]:
    """Draw scenes, kind by kind in turn; the same seed gives the same ones.

    Raises:
        NoScene: No configurations were found in many of them.
    """
    draw = _Draw(cell_map, seed)
    return [draw.scene(list(KINDS)[k % len(KINDS)]) for k in range(count)]


class _Draw:
    """Draws scenes from one stream of random numbers."""

    def __init__(self, cell_map: CellMap, seed: int) -> None:
        self.robot = robot = cell_map.robot
        self.rng = np.random.default_rng(seed)
        self.exact = ExactRobot(robot)
        self.static = StaticTest(
            robot, cell_map.scenery, cell_map.safety, cell_map.grid, threads=1
        )
        lower = np.where(robot.continuous, -np.pi, robot.lower)
        upper = np.where(robot.continuous, np.pi, robot.upper)
        self.pool = self.rng.uniform(lower, upper, (_POOL, robot.dof))
        self.tool = np.array([tool_pose(robot, q)[:3, 3] for q in self.pool])

    def scene(self, kind: str) -> Scene:
        for _ in range(200):
            T, made = self.furniture(kind)
            boxes = _placed(made, T)
            obstacles = obstacles_of(list(boxes))
            inner = made.inner[self.rng.integers(len(made.inner))]
            others = [r for r in made.inner + made.outer if r is not inner]
            other = others[self.rng.integers(len(others))]
            ends: list[np.ndarray] = []
            for region in (inner, other):
                q = self.end(region, T, obstacles, ends)
                if q is None:
                    break
                ends.append(q)
            if len(ends) == 2:
                if self.rng.random() < 0.5:
                    ends.reverse()
                return Scene(kind, boxes, *(frozen(q, np.float64) for q in ends))
        raise NoScene(
            f"no two configurations of {self.robot.name} were found in 200 scenes of "
            f"the kind {kind}; this bench needs an arm of about a metre"
        )

    def furniture(self, kind: str) -> tuple[np.ndarray, _Furniture]:
        """Return the pose of a piece of furniture, and what it is made of."""
        made, place, turn = KINDS[kind](self.rng)
        yaw = self.rng.uniform(-np.pi, np.pi)  # where about the robot
        T = _turned(yaw) @ _moved(place) @ _turned(turn)
        return T, made

    def end(
        self, region: np.ndarray, T: np.ndarray, obstacles: object, ends: list
    ) -> np.ndarray | None:
        """Return a configuration with its tool in a region, or None."""
        local = (self.tool - T[:3, 3]) @ T[:3, :3]
        inside = ((region[0] <= local) & (local <= region[1])).all(axis=1)
        found = np.flatnonzero(inside)
        self.rng.shuffle(found)
        still = np.zeros(self.robot.dof)
        for k in found[:_LOOKS]:
            q = self.pool[k]
            if any(np.linalg.norm(q - other) < APART for other in ends):
                continue
            if self.exact.collides(q, obstacles, CLEAR):
                continue
            if self.static.motion_free(q, still):
                return q
        return None


def _placed(made: _Furniture, T: np.ndarray) -> tuple[Box, ...]:
    """Return the furniture's boxes where it stands; what is below the floor, too."""
    return tuple(
        Box(size, T @ _moved(center))
        for size, center in zip(made.sizes, made.centers, strict=True)
    )


def _turned(yaw: float) -> np.ndarray:
    T, c, s = np.eye(4), np.cos(yaw), np.sin(yaw)
    T[:2, :2] = [[c, -s], [s, c]]
    return T


def _moved(by: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = by
    return T


def _region(low: list[float], high: list[float]) -> np.ndarray:
    return np.array([low, high])


def _furniture(rows: list, inner: list, outer: list) -> _Furniture:
    table = np.array(rows, float).reshape(-1, 6)
    return _Furniture(table[:, :3], table[:, 3:], inner, outer)


def shelf(rng: np.random.Generator) -> tuple[_Furniture, np.ndarray, float]:
    """Two or three boards between two sides and a back; compartments are inner."""
    wide, deep = rng.uniform(0.6, 0.9), rng.uniform(0.25, 0.35)
    gaps = rng.uniform(0.30, 0.40, rng.integers(2, 4))
    low = rng.uniform(0.0, 0.25)
    high = low + gaps.sum() + _BOARD * len(gaps)
    middle = 0.5 * (low + high)
    rows = [[_BOARD, wide, high - low, 0.5 * deep, 0, middle]]
    for side in (-0.5, 0.5):
        rows.append([deep, _BOARD, high - low, 0, side * wide, middle])
    z, inner = low, []
    for gap in [*gaps, 0.0]:
        rows.append([deep, wide, _BOARD, 0, 0, z])
        if gap:
            region = _region(
                [-0.4 * deep, -0.4 * wide, z], [0.4 * deep, 0.4 * wide, z + gap]
            )
            inner.append(region)
        z += gap + _BOARD
    out = _region([-0.5, -0.6, 0.2], [-0.5 * deep - 0.1, 0.6, 0.9])
    place = np.array([rng.uniform(0.6, 0.75), 0.0, 0.0])
    return _furniture(rows, inner, [out]), place, rng.uniform(-0.3, 0.3)


def open_box(rng: np.random.Generator) -> tuple[_Furniture, np.ndarray, float]:
    """A box without a lid; its inside is the inner region, beside and above outer."""
    x, y = rng.uniform(0.35, 0.5, 2)
    high, z = rng.uniform(0.2, 0.35), rng.uniform(0.0, 0.2)
    rows = [[x, y, _BOARD, 0, 0, z]]
    for side in (-0.5, 0.5):
        rows.append([_BOARD, y, high, side * x, 0, z + 0.5 * high])
        rows.append([x, _BOARD, high, 0, side * y, z + 0.5 * high])
    inner = _region([-0.4 * x, -0.4 * y, z], [0.4 * x, 0.4 * y, z + 0.9 * high])
    beside = [
        _region([-0.4, side * 0.5 - 0.2, 0.1], [0.4, side * 0.5 + 0.2, 0.7])
        for side in (-1, 1)
    ]
    place = np.array([rng.uniform(0.45, 0.6), 0.0, 0.0])
    return _furniture(rows, [inner], beside), place, rng.uniform(-np.pi, np.pi)


def cage(rng: np.random.Generator) -> tuple[_Furniture, np.ndarray, float]:
    """Bars around the robot, with a ring on top; between and beyond them is inner."""
    far, bars = rng.uniform(0.45, 0.55), int(rng.integers(6, 9))
    thick, high = rng.uniform(0.03, 0.05), rng.uniform(0.7, 0.9)
    turns = 2 * np.pi * (np.arange(bars) + rng.uniform()) / bars
    at = far * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    rows = [[thick, thick, high, x, y, 0.5 * high] for x, y in at]
    side = 2 * far * np.sin(np.pi / 4)
    for sx, sy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        size = [thick, side + 0.2, thick] if sx else [side + 0.2, thick, thick]
        rows.append([*size, sx * far, sy * far, high])
    inner = []
    for k in range(bars):
        a, b = at[k], at[(k + 1) % bars]
        middle = 1.15 * 0.5 * (a + b)
        reach = np.array([0.12, 0.12])
        inner.append(
            _region([*(middle - reach), 0.15], [*(middle + reach), high - 0.1])
        )
    return _furniture(rows, inner, []), np.zeros(3), 0.0


def table(rng: np.random.Generator) -> tuple[_Furniture, np.ndarray, float]:
    """A table top with boxes upon it; between the boxes is inner."""
    x, y, z = rng.uniform(0.5, 0.7), rng.uniform(0.9, 1.3), rng.uniform(0.05, 0.3)
    rows = [[x, y, _BOARD, 0, 0, z]]
    things = int(rng.integers(4, 8))
    for _ in range(things):
        size = rng.uniform([0.06, 0.06, 0.1], [0.18, 0.18, 0.4])
        at = rng.uniform(-0.5, 0.5, 2) * [x, y]
        rows.append([*size, *at, z + 0.5 * size[2]])
    sides = [
        _region([-0.5 * x, low * y, z], [0.5 * x, high * y, z + 0.25])
        for low, high in ((-0.5, -0.1), (-0.1, 0.1), (0.1, 0.5))
    ]
    place = np.array([rng.uniform(0.55, 0.65), 0.0, 0.0])
    return _furniture(rows, sides, []), place, rng.uniform(-0.2, 0.2)


def under_table(rng: np.random.Generator) -> tuple[_Furniture, np.ndarray, float]:
    """A table top with four legs; below it is inner, above it outer."""
    x, y, z = rng.uniform(0.5, 0.7), rng.uniform(0.8, 1.1), rng.uniform(0.4, 0.55)
    rows = [[x, y, _BOARD, 0, 0, z]]
    for sx in (-0.5, 0.5):
        for sy in (-0.5, 0.5):
            rows.append([0.04, 0.04, z, 0.95 * sx * x, 0.95 * sy * y, 0.5 * z])
    below = _region([-0.45 * x, -0.4 * y, 0.05], [0.45 * x, 0.4 * y, z - 0.05])
    above = _region([-0.5 * x, -0.5 * y, z + 0.05], [0.5 * x, 0.5 * y, z + 0.4])
    place = np.array([rng.uniform(0.55, 0.7), 0.0, 0.0])
    return _furniture(rows, [below], [above]), place, rng.uniform(-0.3, 0.3)


KINDS = {
    "shelf": shelf,
    "open box": open_box,
    "cage": cage,
    "table": table,
    "under a table": under_table,
}
