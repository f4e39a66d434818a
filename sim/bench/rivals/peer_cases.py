"""What all peers are asked: a start, a goal, and what stands around in each frame."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from odm import Box, Capsule
from odm.cell_map.cell_map import CellMap
from sim.bench.core.clutter_scenes import KINDS, make_scenes
from sim.bench.core.map_rows import camera_cloud
from sim.bench.frames import MORE_MOTIONS, MOTIONS, make_pairs, shapes

CLUTTER = "clutter"
ALL = (*MOTIONS, *MORE_MOTIONS)


@dataclass(frozen=True, eq=False)
class Frame:
    """What stands around.

    Attributes:
        rods: (k, 7) capsules: a, b, radius [m].
        boxes: Boxes, base frame.
        cloud: (n, 3) points that a camera saw of the rods and of what lies behind; the
            peers get these instead of the rods. None: they get the shapes.
    """

    rods: np.ndarray
    boxes: tuple[Box, ...] = ()
    cloud: np.ndarray | None = None

    def solids(self) -> list[Capsule | Box]:
        """Return the exact shapes, against which paths are judged."""
        return [*shapes(self.rods), *self.boxes]


@dataclass(frozen=True, eq=False)
class Case:
    """One start and goal, and frames between which the obstacles move.

    Attributes:
        kind: A motion of the hand, or CLUTTER.
        q_start, q_goal: (dof,) both ends.
        frames: One after the other at 100 Hz; the first is for warming up.
        picked: Which frames are counted.
    """

    kind: str
    q_start: np.ndarray
    q_goal: np.ndarray
    frames: tuple[Frame, ...]
    picked: tuple[int, ...]

    def with_clouds(self, rng: np.random.Generator) -> "Case":
        """Return the case as a camera sees it, a cloud for each counted frame."""
        seen = []
        for k, frame in enumerate(self.frames):
            if k in self.picked or k == 0:
                frame = replace(frame, cloud=camera_cloud(frame.rods, rng))
            seen.append(frame)
        kept = tuple(f for f in seen if f.cloud is not None)
        first = () if 0 in self.picked else (0,)
        picked = tuple(range(len(first), len(kept)))
        return Case(self.kind, self.q_start, self.q_goal, kept, picked)


def make_cases(
    cell_map: CellMap, pairs: int, frames: int, each: int, scenes: int, seed: int
) -> Iterator[Case]:
    """Yield cases of all motions in turn, then cluttered scenes.

    Args:
        cell_map: The map of the robot.
        pairs: Starts and goals for each motion.
        frames: Frames of each at 100 Hz.
        each: Runs of two successive frames that are counted in each.
        scenes: Cluttered scenes, one frame each.
        seed: Same seed, same cases.
    """
    drawn = make_pairs(
        cell_map, pairs * len(ALL), frames, seed, condition="every", motions=ALL
    )
    for pair in drawn:
        at = np.linspace(1, frames - 2, each).round().astype(int)
        picked = sorted({int(k) + j for k in at for j in (0, 1)})
        seen = tuple(Frame(rods) for rods in pair.capsules)
        yield Case(pair.motion, pair.q_start, pair.q_goal, seen, tuple(picked))
    none = np.zeros((0, 7))
    for scene in make_scenes(cell_map, scenes, seed) if scenes else ():
        assert scene.kind in KINDS
        seen = (Frame(none, scene.boxes),)
        yield Case(CLUTTER, scene.q_start, scene.q_goal, seen, (0,))
