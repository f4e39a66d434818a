"""The arm that keys move, as a human motion like any other."""

import math
from collections.abc import Iterable

import numpy as np

from roadmap.errors import BadInput
from sim.keyboard.bindings import ARM_KEYS
from sim.keyboard.control import TICK, ArmLimits, ArmState, KeyEvent, advance, press
from sim.people.arm import HumanArm, facing_robot
from sim.people.arm_path import Person


class KeyboardArm:
    """An arm moved by keys; a `sim.people.human_motion.HumanMotion`.

    The place at time t is a function of the keys pressed before t and of nothing
    else: the events of a live run, handed to a new arm, give the same bytes again.

    Args:
        person: Sizes, place and speed limit; None is an adult in front of the robot
            whose arm's surface moves at no more than 1.6 m/s.
        events: Keys of a recorded run, by time.
    """

    name = "keyboard"

    def __init__(
        self, person: Person | None = None, events: Iterable[KeyEvent] = ()
    ) -> None:
        self.limits = ArmLimits.of(person or Person(HumanArm.sized()))
        self._events = _checked(events)
        self._latest = 0
        self._restart()

    @property
    def max_speed(self) -> float:
        """No point of the surface advances faster than this [m/s]."""
        return self.limits.max_speed

    @property
    def events(self) -> tuple[KeyEvent, ...]:
        """All keys so far, by time."""
        return tuple(self._events)

    @property
    def state(self) -> ArmState:
        """The last state that was worked out, with keys not yet followed."""
        state = self._after
        for event in self._events[self._used :]:
            if event.t <= self._tick * TICK:
                state = press(state, event.key, self.limits)
        return state

    def press(self, key: str) -> KeyEvent:
        """Take a key of the arm: it acts from the last moment on that was asked for.

        Refused while recorded keys are still to come.
        """
        (event,) = _checked([KeyEvent(self._latest * TICK, key)])
        if self._events and self._events[-1].t > event.t:
            raise BadInput(
                f"a key at {event.t:.2f} s comes before the recorded one at "
                f"{self._events[-1].t:.2f} s; let the recording end first"
            )
        self._events.append(event)
        return event

    def capsules(self, t: float) -> np.ndarray:
        """Return the arm at time `t` [s] as (2, 7) capsules a, b, radius [m]."""
        x = self.at(t)
        return self.limits.arm.capsules(facing_robot(x[:3]), x[3:])

    def at(self, t: float) -> np.ndarray:
        """Return (7,) shoulder [m] and angles [rad] at a time [s], from 0 on."""
        if not 0 <= t < math.inf:
            raise BadInput(f"the arm was asked for at {t} s; ask for 0 s or later")
        if t < (self._tick - 1) * TICK:
            self._restart()
        while self._tick * TICK < t:
            self._turn()
        share = min(max(t / TICK - (self._tick - 1), 0.0), 1.0)
        return self._before.x + share * (self._after.x - self._before.x)

    def _restart(self) -> None:
        self._before = self._after = self.limits.start()
        self._tick = self._used = 0

    def _turn(self) -> None:
        """Follow the keys of this moment, and go on by one tick."""
        state, now = self._after, self._tick * TICK
        while self._used < len(self._events) and self._events[self._used].t <= now:
            state = press(state, self._events[self._used].key, self.limits)
            self._used += 1
        self._before, self._after = self._after, advance(state, self.limits)
        self._tick += 1
        self._latest = max(self._latest, self._tick)


def _checked(events: Iterable[KeyEvent]) -> list[KeyEvent]:
    events, last = list(events), 0.0
    for event in events:
        if event.key not in ARM_KEYS:
            known = " ".join(sorted(ARM_KEYS))
            raise BadInput(f"{event.key!r} is no key of the arm; they are {known}")
        if not last <= event.t < math.inf:
            raise BadInput(
                f"key {event.key!r} at {event.t} s does not come after {last} s; give "
                "finite times in order, from 0 on"
            )
        last = event.t
    return events
