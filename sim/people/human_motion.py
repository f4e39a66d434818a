"""Where the person is at time t: one protocol, scripted motions blind to the robot."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from roadmap.errors import BadInput
from roadmap.ranges import check_kind, check_number, is_between, told
from sim.people.arm import HumanArm
from sim.people.arm_path import Person, Round, ScriptedMotion

TREMBLE = 0.02  # amplitude of the trembling hand [m]
BESIDE = (0.75, -0.50, 0.50)  # shoulder of a second person [m]
AWAY = (0.62, -0.80, 0.20)  # and where its hand rests [m]
ASIDE = (0.70, 0.48, 0.20)  # where a hand rests out of the way, beside the person [m]


class HumanMotion(Protocol):
    """A person seen as closed capsules over time; knows nothing of the robot.

    Attributes:
        name: Name of the motion.
        max_speed: No point of the surface advances faster than this [m/s].
    """

    name: str
    max_speed: float

    def capsules(self, t: float) -> np.ndarray:
        """Return the person at time `t` [s] as (k, 7) capsules a, b, radius [m]."""
        ...


def sweep(person: Person, rng: np.random.Generator) -> ScriptedMotion:
    """Let the hand sweep from side to side through the robot's work place, <= 1 m/s."""
    limit = person.max_speed or 1.0
    script = Round(person, (0.62, 0.55, 0.45), limit)
    side = -1.0
    for _ in range(9):
        place = (0.62, side * rng.uniform(0.45, 0.6), rng.uniform(0.3, 0.6))
        bow = (-rng.uniform(0.10, 0.25), 0.0, -rng.uniform(0.0, 0.2))
        script.move(place, rng.uniform(0.2, 1.0), rng.uniform(0.5, 1.0), bow)
        side = -side
    script.close(0.5, 0.8)
    return script.motion("sweep", limit)


def reach(person: Person, rng: np.random.Generator) -> ScriptedMotion:
    """Let the hand reach into the space and back, each with a peak of about 1 m/s."""
    there, back = ((0.2, 0.8), (0.85, 1.0)), ((0.8, 2.0), (0.6, 0.9))
    return _in_and_out("reach", person, rng, 1.0, 8, there, back)


def jitter(person: Person, rng: np.random.Generator) -> ScriptedMotion:
    """Hold the hand near the robot while it trembles 2 cm at 5 Hz."""
    limit = person.max_speed or 1.0
    script = Round(person, (0.60, 0.0, 0.40), 0.3 * limit)
    for _ in range(6):
        place = (rng.uniform(0.45, 0.6), rng.uniform(-0.2, 0.2), rng.uniform(0.3, 0.6))
        script.move(place, rng.uniform(3.0, 6.0))
    script.close(2.0)
    return script.motion("jitter", limit, _amplitude(limit, rng))


def tremble(person: Person, rng: np.random.Generator) -> ScriptedMotion:
    """Hold the hand at one place near the robot while it trembles 2 cm at 5 Hz."""
    limit = person.max_speed or 1.0
    place = (rng.uniform(0.45, 0.6), rng.uniform(-0.2, 0.2), rng.uniform(0.3, 0.6))
    script = Round(person, place, 0.3 * limit)
    script.move(tuple(np.add(place, (0.001, 0.0, 0.0))), 9.0)  # a leg leads somewhere
    script.close(9.0)
    return script.motion("tremble", limit, _amplitude(limit, rng))


def _amplitude(limit: float, rng: np.random.Generator) -> np.ndarray:
    """Return the (3,) amplitude of a tremble in some direction [m]."""
    direction = rng.normal(size=3)
    return direction * min(TREMBLE, 0.02 * limit) / np.linalg.norm(direction)


def hover(person: Person, rng: np.random.Generator) -> ScriptedMotion:
    """Let the hand rest in the way for some seconds, then move away."""
    there, back = ((2.0, 5.0), (0.5, 1.0)), ((2.0, 4.0), (0.5, 1.0))
    return _in_and_out("hover", person, rng, 0.8, 5, there, back)


def _in_and_out(
    name: str,
    person: Person,
    rng: np.random.Generator,
    limit: float,
    times: int,
    there: tuple,
    back: tuple,
) -> ScriptedMotion:
    """Return a hand that goes to and fro between the robot's work place and aside.

    `there` and `back` are the ranges of each rest [s] and share of the speed limit.
    """
    limit = person.max_speed or limit
    script = Round(person, ASIDE, limit)
    for _ in range(times):
        for place, ranges in ((_in_work_space(rng), there), (ASIDE, back)):
            script.move(place, *(rng.uniform(*one) for one in ranges))
    script.close(1.0)
    return script.motion(name, limit)


def intrusion(person: Person, rng: np.random.Generator) -> ScriptedMotion:
    """Thrust the hand straight at the robot's work place with a peak of 2 m/s."""
    limit = person.max_speed or 2.0
    script = Round(person, ASIDE, limit)
    for _ in range(6):
        script.move(_in_work_space(rng), rng.uniform(0.1, 0.6))
        script.move(ASIDE, rng.uniform(1.5, 4.0), 0.3)
    script.close(1.0)
    return script.motion("intrusion", limit)


@dataclass(frozen=True, eq=False)
class Together:
    """Several people at once; a HumanMotion of all their capsules."""

    name: str
    motions: tuple[HumanMotion, ...]  # one for each person

    @property
    def max_speed(self) -> float:
        """No point of any surface advances faster than this [m/s]."""
        return max(motion.max_speed for motion in self.motions)

    def capsules(self, t: float) -> np.ndarray:
        """Return the people at time `t` [s] as (k, 7) capsules a, b, radius [m]."""
        return np.vstack([motion.capsules(t) for motion in self.motions])


def crowding(person: Person, rng: np.random.Generator) -> Together:
    """Let two people reach into the space, one from the front, one from beside it."""
    limit = person.max_speed or 0.8
    beside = replace(person, p_base_shoulder=BESIDE)
    script = Round(beside, AWAY, limit)
    for _ in range(6):
        x, y, z = _in_work_space(rng)
        script.move((x + 0.1, y - 0.2, z), rng.uniform(0.5, 2.5), rng.uniform(0.5, 1.0))
        script.move(AWAY, rng.uniform(1.0, 3.0), rng.uniform(0.5, 1.0))
    script.close(1.0)
    second = script.motion("beside", limit)
    return Together("crowding", (reach(person, rng), second))


def _in_work_space(rng: np.random.Generator) -> tuple[float, float, float]:
    """Return a place in front of the robot, mostly in its way [m]."""
    return rng.uniform(0.32, 0.5), rng.uniform(-0.25, 0.3), rng.uniform(0.15, 0.55)


MotionSource = Callable[[Person, np.random.Generator], HumanMotion]
_SOURCES: dict[str, MotionSource] = {
    source.__name__: source
    for source in (sweep, reach, jitter, hover, intrusion, tremble, crowding)
}


def motion_names() -> tuple[str, ...]:
    """Return the names `make_motion` knows."""
    return tuple(_SOURCES)


def register_motion(name: str, source: MotionSource) -> None:
    """Make a further source of motion known by name: source(person, rng) -> motion.

    `make_motion` knows it then, in this process; what the commands take is told in
    `sim/run/request.py`.
    """
    _SOURCES[name] = source


def make_motion(name: str, seed: int = 0, person: Person | None = None) -> HumanMotion:
    """Return the motion of that name; the same seed gives the same motion.

    Args:
        name: One of `motion_names()`.
        seed: Seed of the places, speeds and rests.
        person: Sizes, place and speed limit; None is an adult of 1.75 m whose right
            shoulder is 0.85 m in front of the robot's base.

    Raises:
        BadInput: There is no motion of that name, the speed limit is not positive, or
            an argument is of another kind.
    """
    if not (isinstance(name, str) and name in _SOURCES):
        raise BadInput(f"no motion {told(name)}; choose one of {', '.join(_SOURCES)}")
    seed = int(check_number("the seed of a motion", seed, 0, math.inf, whole=True))
    if person is None:
        person = Person(HumanArm.sized())
    check_kind("person", person, Person, "give a sim.people.arm_path.Person")
    limit = person.max_speed
    if limit is not None and not is_between(limit, 1e-6, 1e6):
        raise BadInput(
            f"a speed limit of {told(limit)} m/s is not positive; give one above 0 or "
            "none"
        )
    return _SOURCES[name](person, np.random.default_rng(seed))
