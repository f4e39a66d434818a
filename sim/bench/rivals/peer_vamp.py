"""VAMP, where `import vamp` works: it has no wheel, and its build needs a code host.

It is called as its authors' settings and our trials have it: the helper's sample limit
lowered (allocating for a million samples costs 0.4 ms a plan), the Halton sampler reset
in each frame (repeatable paths), capsules by centre, angles, radius and length, clouds
filtered first, with the smallest and largest radius of its own spheres. What turns our
numbers into its own is counted, so it is plain arithmetic: numpy cost more than a plan.
Its "Euler XYZ" turns about x first: R = Rz Ry Rx.
"""

import math

import numpy as np

from roadmap.errors import PlanningError
from sim.bench.rivals.peer_cases import Case, Frame

_SAMPLES, _ITERATIONS = 10_000, 100_000
_POINT_RADIUS = 0.0025  # [m]


class VampMissing(PlanningError):
    """VAMP is not installed, or does not know the robot."""


class Vamp:
    """RRT-Connect of VAMP on the Panda, raw or simplified."""

    cost = 1e-3

    def __init__(self, robot: str, simplified: bool) -> None:
        """Set it up.

        Raises:
            VampMissing: It is not there, or knows no such robot.
        """
        try:
            import vamp
        except ImportError as error:
            raise VampMissing("not installed") from error
        if not robot.startswith("panda") or not hasattr(vamp, "panda"):
            raise VampMissing(f"no robot {robot}")
        self.vamp, self.simplified = vamp, simplified
        made = vamp.configure_robot_and_planner_with_kwargs("panda", "rrtc")
        self.robot, _, self.plan, self.simp = made
        self.plan.max_samples, self.plan.max_iterations = _SAMPLES, _ITERATIONS
        self.sampler = self.robot.halton()
        how = "simplified" if simplified else "raw"
        self.name = f"VAMP {how}"
        self.setting = (
            f"RRT-Connect; {_SAMPLES} samples and {_ITERATIONS} iterations at most, "
            "Halton reset in each frame, its own resolution of 32 states a radian; "
            "contact only, no clearance, and no floor: its own base reaches 3 cm below"
        )

    def begin(self, case: Case) -> None:
        """Take start and goal."""
        self.ends = case.q_start.tolist(), case.q_goal.tolist()

    def path(self, frame: Frame) -> np.ndarray | None:
        """Make its world, plan, simplify."""
        path = self.planned(self.world(frame))
        # not by iteration, which has no end: its paths read on past their last row
        return None if path is None else path.numpy().astype(float)

    def planned(self, world: object) -> object | None:
        """Return a path of VAMP's own in a world, None for none."""
        self.sampler.reset()
        found = self.robot.rrtc(*self.ends, world, self.plan, self.sampler)
        if not found.solved:
            return None
        if not self.simplified:
            return found.path
        return self.robot.simplify(found.path, world, self.simp, self.sampler).path

    def after(self) -> None:
        """Do nothing."""

    def world(self, frame: Frame) -> object:
        """Return VAMP's environment of what stands around."""
        world = self.vamp.Environment()
        if frame.cloud is not None:
            low, high = self.robot.min_max_radii()
            bounds = [-1.2] * 3, [1.2] * 3
            points = self.vamp.filter_pointcloud(
                frame.cloud.tolist(), low, 1.2, [0.0, 0.0, 0.3], *bounds, True
            )[0]
            world.add_pointcloud(points, low, high, _POINT_RADIUS)
            return world
        for rod in frame.rods:
            world.add_capsule(self._capsule(rod))
        for box in frame.boxes:
            T = box.T_base_shape
            half = (0.5 * np.asarray(box.size)).tolist()
            angles = list(_euler_xyz(T[:3, :3]))
            world.add_cuboid(self.vamp.Cuboid(T[:3, 3].tolist(), angles, half))
        return world

    def _capsule(self, rod: np.ndarray) -> object:
        ax, ay, az, bx, by, bz, radius = rod.tolist()
        x, y, z = bx - ax, by - ay, bz - az
        angles = [math.atan2(-y, math.hypot(x, z)), math.atan2(x, z), 0.0]
        middle = [0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz)]
        return self.vamp.Cylinder(middle, angles, radius, math.hypot(x, y, z))


def _euler_xyz(R: np.ndarray) -> tuple[float, float, float]:
    """Return the angles (x, y, z) of R = Rz Ry Rx."""
    y = -math.asin(max(-1.0, min(1.0, R[2, 0])))
    return math.atan2(R[2, 1], R[2, 2]), y, math.atan2(R[1, 0], R[0, 0])
