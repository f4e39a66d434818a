"""A whole person, a `handover.Human`, from the motion of an arm or a recording.

The workspace of a hand-over needs to know who stands there: joints, trunk, gaze. What
the planner sees is made of that very `Human`: there is one person and not two.
"""

from dataclasses import dataclass

import numpy as np

from handover import Human, human_from_joints
from handover.human.body import ARM_LABELS, joint_places
from handover.human.fit import arm_joints
from roadmap.errors import BadInput
from sim.people.arm import HumanArm, facing_robot
from sim.people.arm_path import Person, minimum_jerk
from sim.people.human_motion import HumanMotion, make_motion, motion_names
from sim.people.mocap import MocapMotion

# Of the robot's base above the floor that a scripted person stands on [m].
BASE_HEIGHT = 0.75
WALKING = 0.25  # fastest pace of a scripted person who changes place [m/s]
NEAR, FAR = 0.6, 1.3  # distances a scripted person walks between, if not told [m]
LOOKED_AT = (0.0, 0.0, 0.3)  # where a person looks who watches the robot [m]
NEAREST, FARTHEST = 0.4, 3.0  # distances at which people may be placed [m]
_STAY = (4.0, 9.0)  # least and longest stay at a place [s]
_ASIDE = 0.35  # largest bearing of a place, seen from the robot [rad]


@dataclass(frozen=True, eq=False)
class Walk:
    """Places a person stands at, one after the other, for ever."""

    # (n, 2) distance of the pelvis from the robot's base [m] and bearing [rad]; the
    # person faces the base
    places: np.ndarray
    times: np.ndarray  # (n,) when the stay at each ends [s]
    last: float  # when the round begins again [s]

    @classmethod
    def drawn(cls, near: float, far: float, rng: np.random.Generator) -> "Walk":
        """Return a walk between two distances [m]; equal ones: standing still."""
        if not NEAREST <= near <= far <= FARTHEST:
            raise BadInput(
                f"the person is to stand {near} to {far} m from the robot; give two "
                f"distances from {NEAREST} to {FARTHEST} m, the smaller one first"
            )
        if near == far:
            return cls(np.array([[near, 0.0]]), np.array([np.inf]), np.inf)
        spread = np.linspace(near, far, 6)  # the whole range in every round
        places = np.stack([rng.permutation(spread), rng.uniform(-1, 1, 6)], axis=1)
        places[:, 1] *= _ASIDE
        stays, now = [], 0.0
        for k in range(len(places)):
            now += rng.uniform(*_STAY)
            stays.append(now)
            now += _walk_s(places[k], places[(k + 1) % len(places)])
        return cls(places, np.array(stays), now)

    def at(self, t: float) -> tuple[float, float]:
        """Return distance [m] and bearing [rad] at time `t` [s]."""
        t = t % self.last if np.isfinite(self.last) else t
        k = int(np.searchsorted(self.times, t))
        place = self.places[k % len(self.places)]
        if k:
            before = self.places[k - 1]
            u = (t - self.times[k - 1]) / _walk_s(before, place)
            if u < 1.0:
                place = before + minimum_jerk(u) * (place - before)
        return float(place[0]), float(place[1])


def _walk_s(a: np.ndarray, b: np.ndarray) -> float:
    """Return how long the walk between two places takes [s]."""
    length = abs(b[0] - a[0]) + max(a[0], b[0]) * abs(b[1] - a[1])
    return max(0.5, 1.875 * length / WALKING)  # the peak of a minimum-jerk curve


class WholePerson:
    """A person whose right arm follows a scripted or steered arm; a HumanMotion.

    The angles of the arm are those of the `Human`; the rest of the body stands behind
    it, faces the robot and looks at it.

    Args:
        motion: Of one arm: two capsules, its trunk facing -x of the base.
        walk: Where the body stands, on its floor; None: behind the arm's shoulder.

    Raises:
        BadInput: More or less than one arm.
    """

    def __init__(self, motion: HumanMotion, walk: Walk | None = None) -> None:
        n = len(motion.capsules(0.0))
        if n != 2:
            one = [m for m in motion_names() if len(make_motion(m).capsules(0.0)) == 2]
            raise BadInput(
                f"{motion.name} moves {n} capsules; a hand-over is with one person and "
                f"one arm: choose {', '.join(one)}, mocap or keyboard"
            )
        self.motion, self.walk = motion, walk
        self._standing = Human(1.75)
        self._last: tuple[float, Human] | None = None

    @property
    def name(self) -> str:
        """Name of the motion."""
        return self.motion.name

    @property
    def max_speed(self) -> float:
        """No point of the surface advances faster than this [m/s]."""
        walks = self.walk is not None and len(self.walk.places) > 1
        return self.motion.max_speed + (WALKING if walks else 0.0)

    def human(self, t: float) -> Human:
        """Return the person at time `t` [s], in the frame of the robot's base."""
        if self._last is None or self._last[0] != t:
            self._last = t, self._human(t)
        return self._last[1]

    def capsules(self, t: float) -> np.ndarray:
        """Return the whole body at time `t` [s] as (k, 7) capsules a, b, radius [m]."""
        return self.human(t).capsules()

    def _human(self, t: float) -> Human:
        upper, lower = self.motion.capsules(t)
        R = facing_robot(np.zeros(3))[:3, :3]
        u, v = R.T @ (upper[3:6] - upper[:3]), R.T @ (lower[3:6] - lower[:3])
        q = arm_joints(u / np.linalg.norm(u), v / np.linalg.norm(v))
        body = self._standing.with_arm("right", q)
        if self.walk is None:
            body = body.placed(0.0, 0.0, np.pi)
            off = upper[:3] - body.T_world_shoulder("right")[:3, 3]
        else:
            distance, bearing = self.walk.at(t)
            x, y = distance * np.cos(bearing), distance * np.sin(bearing)
            body = body.placed(x, y, bearing + np.pi)
            off = np.array([0.0, 0.0, -BASE_HEIGHT])
        T = body.T_world_pelvis.copy()
        T[:3, 3] += off
        return body.moved(T).looking_at(LOOKED_AT)


class RecordedPerson:
    """A recorded person as a `Human` too; a HumanMotion.

    The planner sees what the tracker knows, parts that it does not see grown by their
    age; the workspace sees the person as they probably are.

    Raises:
        BadInput: The recording does not show a whole arm and the trunk.
    """

    def __init__(self, motion: MocapMotion) -> None:
        self.motion = motion
        self._last: tuple[float, Human] | None = None
        self.human(0.0)

    def __getattr__(self, name: str) -> object:
        """Everything else is the recording's."""
        return getattr(self.motion, name)

    @property
    def sides(self) -> tuple[str, ...]:
        """The sides whose arm is in the recording."""
        arms = ARM_LABELS.items()
        return tuple(side for side, arm in arms if arm[0] in self.motion.labels)

    def human(self, t: float) -> Human:
        """Return the person at time `t` [s], in the frame of the robot's base."""
        if self._last is None or self._last[0] != t:
            places = joint_places(self.motion.guess(t), self.motion.labels)
            self._last = t, human_from_joints(places)
        return self._last[1]


def scripted_person(
    name: str, seed: int = 0, distances: tuple[float, float] = (NEAR, FAR)
) -> WholePerson:
    """Return a scripted arm as a whole person who walks between two distances.

    Args:
        name: Of the motion; see `sim.people.human_motion.motion_names`.
        seed: Of the arm's motion, and of the walk.
        distances: Least and largest distance of the pelvis from the robot's base [m].

    Raises:
        BadInput: An unknown motion or one of several people, distances that are none.
    """
    walk = Walk.drawn(*distances, np.random.default_rng(seed))
    arm = arm_at(float(np.mean(distances)))
    return WholePerson(make_motion(name, seed, arm), walk=walk)


def arm_at(distance: float) -> Person:
    """Return the right arm of who stands so far [m] before the robot, facing it."""
    body = Human().placed(distance, 0.0, np.pi)
    shoulder = body.T_world_shoulder("right")[:3, 3] - [0.0, 0.0, BASE_HEIGHT]
    return Person(HumanArm.sized(), tuple(shoulder.tolist()))
