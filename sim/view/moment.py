"""What is drawn of one frame, as plain arrays, and its state in words."""

from dataclasses import dataclass, field

import numpy as np

from odm.execution.executor import BRAKED, RETREATING, SLOWED

# codes of a state, in the order in which they hide each other on the time line
(STILL, ON_THE_WAY, NEW_PATH, SLOW, BRAKING, AWAY, HOLDING, CONTACT) = range(8)
WORDS = (
    "standing",
    "on its way",
    "new path",
    "slowed for the person",
    "braked for the person",
    "backing off",
    "holding",
    "contact",
)
STICKY_S = 0.4  # a new path is told so long, and being slowed is one event [s]
NOBODY = np.zeros((0, 7))

# columns of a strip: one row for every frame, drawn or not
TIME, GAP, LATENCY, STATE, PLACE = range(5)


@dataclass(frozen=True)
class Event:
    """Something that happened."""

    time_s: float  # when [s]
    state: int  # code of the state that began, or `NEW_PATH`
    text: str  # what, in words


@dataclass(frozen=True, eq=False)
class Moment:
    """One frame."""

    time_s: float  # when [s]
    q: np.ndarray  # (dof,) where the robot is [rad or m]
    capsules: np.ndarray = field(default_factory=lambda: NOBODY)  # (k, 7) person [m]
    state: int = STILL  # code of what the robot does, see `WORDS`
    reason: str = ""  # why it does not move, in the planner's words
    # exact distance of robot and person [m]; infinite: nobody, or not known
    separation: float = np.inf
    # (n, dof) the path in use and the one that it took the place of
    path: np.ndarray | None = None
    before: np.ndarray | None = None
    # (n, 5) places of the tool [m], quality in [0, 1] (NaN: none), and 1 where it is
    # pursued
    targets: np.ndarray | None = None
    points: np.ndarray | None = None  # (n, 3) what a sensor saw [m]
    payload: np.ndarray | None = None  # (k, 4) spheres in the hand, tool frame [m]
    # how many of the capsules, the last ones, are no person but what is handed over
    things: int = 0
    # (n, 5) time, separation, latency [s], state, place of each frame since the moment
    # before, this one last
    rows: np.ndarray | None = None
    # what happened since the run began, at most the latest
    events: tuple[Event, ...] = ()


def state_of(status: str, pace: str, separation: float = np.inf) -> int:
    """Return the code of a state from the planner's status and the executor's pace."""
    if separation <= 0.0:
        return CONTACT
    if pace == RETREATING:
        return AWAY
    if status == "standing":  # it means to
        return STILL
    if status == "holding":
        return HOLDING
    if pace in (BRAKED, SLOWED):
        return BRAKING if pace == BRAKED else SLOW
    return ON_THE_WAY


class Happenings:
    """Makes events of states, frame by frame, and keeps them by time."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self._state, self._place = ON_THE_WAY, None
        self._slow_s = -np.inf  # when it was slowed last

    def take(
        self,
        time_s: float,
        state: int,
        place: int,
        reason: str = "",
        new_path: bool = False,
    ) -> None:
        """Take one frame of a time [s] and the code of its state.

        `reason` may be given with the first frame of a state. A frame with another goal
        `place` has to have a new path. Who is slowed again and again in a moment is
        slowed once.
        """
        if self._place is not None and place != self._place:
            self.events.append(Event(time_s, STILL, "a new goal"))
        elif new_path:
            self.events.append(Event(time_s, NEW_PATH, WORDS[NEW_PATH]))
        still_slow = (
            state == SLOW
            and time_s - self._slow_s < STICKY_S
            and self.events[-1].state == SLOW
        )
        if state != self._state and state not in (ON_THE_WAY, STILL) and not still_slow:
            word = WORDS[state]
            told = f"{word}: {reason}" if reason else word
            self.events.append(Event(time_s, state, told))
        if state == SLOW:
            self._slow_s = time_s
        self._state, self._place = state, place
