"""How the arm follows keys: a pure function of its state, the keys and the time."""

import math
from dataclasses import dataclass, replace

import numpy as np

from roadmap.arrays import freeze
from roadmap.errors import BadInput
from sim.keyboard.bindings import HOME, LARGER, MOVES, SMALLER
from sim.people.arm import HumanArm
from sim.people.arm_path import Person

MAX_SPEED = 1.6  # of a person's arm, where nothing else is said [m/s]
TICK = 0.01  # step of the control [s], whatever the rate of the frames
NUDGES = tuple(  # what a key moves: the shoulder [m], an angle [rad]
    (metres, math.radians(degrees))
    for metres, degrees in ((0.01, 2), (0.02, 4), (0.05, 8), (0.1, 15), (0.2, 30))
)
BOX = (0.7, 1.0, 0.6)  # the shoulder moves that far about the person's place [m]
# flexion, abduction, rotation, elbow of a right arm; outward is negative
HOME_ANGLES = np.radians([-35.0, -25.0, -40.0, 95.0])
LOWEST, HIGHEST = np.radians([[-60.0, -150.0, -90.0, 0.0], [180.0, 45.0, 90.0, 150.0]])

_STIFFNESS = 6.0  # of the critically damped follower [1/s]
_AHEAD = 4  # nudges the target may be ahead, so that the arm stops soon after a key
_FARTHEST = (0.55, 0.8)  # and never more than this [m], [rad]: full speed needs it


@dataclass(frozen=True)
class KeyEvent:
    """A key that moves the arm, at a time of the simulation.

    Attributes:
        t: From the start of the run [s].
        key: A name of `bindings.ARM_KEYS`.
    """

    t: float
    key: str


@dataclass(frozen=True, eq=False)
class ArmState:
    """Where the arm is and where it is going."""

    x: np.ndarray  # (7,) p_base_shoulder [m]; flexion, abduction, rotation, elbow [rad]
    v: np.ndarray  # (7,) its rate, per second
    target: np.ndarray  # (7,) where it is going
    size: int = 2  # index into `NUDGES`

    def __post_init__(self) -> None:
        freeze(self, x=float, v=float, target=float)


@dataclass(frozen=True, eq=False)
class ArmLimits:
    """What the arm may do."""

    arm: HumanArm  # its sizes
    # (7,) start, and bounds of `ArmState.x` [m], [rad]
    home: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    max_speed: float  # no point of the surface advances faster than this [m/s]

    @classmethod
    def of(cls, person: Person) -> "ArmLimits":
        """Return the limits of a person: a box about the place, joint ranges."""
        speed = MAX_SPEED if person.max_speed is None else person.max_speed
        if not 0 < speed < np.inf:
            raise BadInput(
                f"a speed limit of {speed} m/s is none for an arm; give one above 0"
            )
        place = np.asarray(person.p_base_shoulder, float)
        home = np.r_[place, HOME_ANGLES]
        lower, upper = np.r_[place - BOX, LOWEST], np.r_[place + BOX, HIGHEST]
        return cls(person.arm, home, lower, upper, speed)

    def start(self) -> ArmState:
        """Return the arm at rest at home."""
        return ArmState(self.home, np.zeros(7), self.home)

    def fastest(self, v: np.ndarray) -> float:
        """Bound the speed of the surface at the rate `v` (7,), however the arm stands.

        Flexion and abduction turn about perpendicular axes, and so do rotation and
        elbow; a capsule advances no faster than the ends of its axis.

        Returns:
            The bound [m/s].
        """
        fore = self.arm.lengths[1] - self.arm.radii[1]
        base = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
        return (
            base + self.arm.reach * math.hypot(v[3], v[4]) + fore * math.hypot(*v[5:])
        )


def press(state: ArmState, key: str, limits: ArmLimits) -> ArmState:
    """Return the state after a key; a key that moves nothing changes nothing."""
    if key == HOME:
        return replace(state, target=limits.home)
    if key in (LARGER, SMALLER):
        size = state.size + (1 if key == LARGER else -1)
        return replace(state, size=min(max(size, 0), len(NUDGES) - 1))
    if key not in MOVES:
        return state
    axis, sign = MOVES[key]
    target = state.target.copy()
    target[axis] = _nudged(state, axis, sign, limits)
    return replace(state, target=target)


def _nudged(state: ArmState, axis: int, sign: float, limits: ArmLimits) -> float:
    kind = int(axis > 2)
    nudge = NUDGES[state.size][kind]
    x, ahead = state.x[axis], state.target[axis] - state.x[axis]
    if ahead * sign < 0:  # turned round: not first back over what is still to come
        ahead = 0.0
    most = max(min(_AHEAD * nudge, _FARTHEST[kind]), nudge)
    moved = x + sign * min(abs(ahead) + nudge, most)
    return min(max(moved, limits.lower[axis]), limits.upper[axis])


def advance(state: ArmState, limits: ArmLimits) -> ArmState:
    """Return the state one `TICK` later.

    A critically damped follower, solved exactly; it never passes a bound, since its
    rate towards one stays below stiffness times distance. Step and rate are scaled
    down together where a point of the arm would be too fast.
    """
    off = state.x - state.target
    c = state.v + _STIFFNESS * off
    decay = math.exp(-_STIFFNESS * TICK)
    step = (off + c * TICK) * decay - off
    v = (state.v - _STIFFNESS * TICK * c) * decay
    speed = limits.fastest(step / TICK)
    if speed > limits.max_speed:
        share = limits.max_speed / speed
        step, v = share * step, share * v
    x = np.clip(state.x + step, limits.lower, limits.upper)
    return replace(state, x=x, v=v)
