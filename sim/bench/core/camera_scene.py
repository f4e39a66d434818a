"""What `odm bench camera` shows to its cameras: a person, a room, a hand."""

import numpy as np

from odm import Capsule, CellMap, ReactivePlanner
from odm.exact.distances import ExactRobot
from roadmap.kinematics.forward import body_frames
from roadmap.transforms import pose_of

HAND_RADIUS, HAND_LENGTH = 0.04, 0.16  # [m]
STEP = 0.15  # [rad or m] of the first joint: the motion into the hand
SIDES = ((0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0))


def far_box(reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Return floor and walls of a room as poses (5, 4, 4) and sizes (5, 3) [m]."""
    far = 2.2 * reach
    middles = [(0, 0, -0.06), (far, 0, 1), (-far, 0, 1), (0, far, 1), (0, -far, 1)]
    sizes = np.full((5, 3), 2.0 * far)
    sizes[[0, 1, 2, 3, 4], [2, 0, 0, 1, 1]] = 0.1
    return np.stack([pose_of(p) for p in middles]), sizes


def person_at(reach: float, phase: np.ndarray) -> np.ndarray:
    """Return a person beside the robot as capsules (k, 7) [m].

    Args:
        reach: Of the robot [m].
        phase: (3,) of the moving arm along x, y and z [rad].
    """
    x, y = 0.62 * reach, -0.3 * reach
    shoulder = np.array([x, y + 0.2, 0.62])
    hand = shoulder + [-0.2, 0.1, 0.05] + 0.12 * np.sin(phase)
    elbow = 0.5 * (shoulder + hand) - [0.0, 0.0, 0.12]
    rows = [
        ([x, y, 0.05], [x, y, 0.55], 0.14),
        ([x, y - 0.13, 0.62], [x, y + 0.13, 0.62], 0.08),
        ([x, y, 0.86], [x, y, 0.92], 0.09),
        (shoulder, elbow, 0.05),
        (elbow, hand, 0.04),
    ]
    return np.array([[*a, *b, r] for a, b, r in rows])


class HandBeside:
    """A hand `gap` from a link, and a small motion into it that is free without it.

    Args:
        cell_map: The map.
        gap: Exact distance of hand and link [m].

    Attributes:
        q: (dof,) where the robot stands.
        into: (dof,) where the motion ends.
        link: Name of the link: the fifth moving one, or the last.
        capsule: (7,) the hand, upright.
        side: (3,) unit vector from link to hand.
    """

    def __init__(self, cell_map: CellMap, gap: float) -> None:
        """Look for a place; the first that will do is taken."""
        robot = cell_map.robot
        moving = [
            name
            for name, body in zip(robot.link_names, robot.link_body, strict=True)
            if body > 0
        ]
        self.link = moving[min(4, len(moving) - 1)]
        self._body = int(robot.link_body[robot.link_names.index(self.link)])
        self._exact, self._gap = ExactRobot(robot), gap
        planner = ReactivePlanner(cell_map)
        middle = 0.5 * (robot.lower + robot.upper)
        for q in (middle, *cell_map.roadmap.nodes):
            for side in SIDES:
                if self._fits(planner, np.array(q), np.array([*side, 0.0])):
                    return
        raise AssertionError(f"no hand fits beside {self.link}")

    def _fits(self, planner: ReactivePlanner, q: np.ndarray, side: np.ndarray) -> bool:
        robot = planner.robot
        middle = body_frames(robot, q)[self._body][:3, 3]
        low, high = 0.0, 0.6
        for _ in range(40):
            far = 0.5 * (low + high)
            near = self._exact.distance(q, [_upright(middle + far * side)])
            low, high = (far, high) if near.distance < self._gap else (low, far)
        hand = middle + high * side
        if near.link != self.link or hand[2] < 0.2:
            return False
        for step in (-STEP, STEP):
            into = q.copy()
            into[0] += step
            moved = body_frames(robot, into)[self._body][:3, 3] - middle
            shape = [_upright(hand)]
            hits = self._exact.distance(into, shape).distance <= 0.0
            if hits and moved @ side > 0.0 and planner.static.motion_free(q, into - q):
                half = [0.0, 0.0, 0.5 * HAND_LENGTH]
                self.q, self.into, self.side = q, into, side
                self.capsule = np.array([*(hand - half), *(hand + half), HAND_RADIUS])
                return True
        return False


def _upright(middle: np.ndarray) -> Capsule:
    half = np.array([0.0, 0.0, 0.5 * HAND_LENGTH])
    return Capsule.between(middle - half, middle + half, HAND_RADIUS)
