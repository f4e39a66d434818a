"""The states of a hand-over, and what leads from one to the next, as one table.

`docs/story.md` draws its diagrams from `GIVE` and `RECEIVE`; a test holds that they
agree. The machine knows nothing of robots: each frame it is told which signals hold,
and takes the first row of its state whose signal does.
"""

from collections import defaultdict
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from roadmap.errors import BadInput

FETCH, APPROACH, PRESENT, WAIT = "fetch", "approach", "present", "wait"
RELEASE, CLOSE, RETREAT, PUT_DOWN = "release", "close", "retreat", "put_down"
DONE, KEPT = "done", "kept"
ENDS = DONE, KEPT
STANDS = PRESENT, WAIT  # before the person, for as long as it is patient
BRIEF_S = 0.5  # away from there for no longer, it has been there all the while
DIRECTIONS = "give", "receive"


@dataclass(frozen=True)
class Row:
    """One way from a state."""

    state: str  # where it begins
    signal: str  # what must hold in a frame; see `SIGNALS`
    then: str  # where it leads
    reason: str  # what happened, as a person says it
    failure: bool = False  # whether that is something that went wrong


SIGNALS = {
    "lost": "the fingers should hold the object and do not",
    "found": "the fingers that stayed closed hold the object",
    "pulled": "the wrist felt a pull that lasted",
    "slack": "nobody pulls any more",
    "arrived": "the robot stands where it wants to be",
    "moved": "the place to go to is another one now",
    "left": "no place in reach has been left for a while",
    "near": "the person's hand is near to the object",
    "gone": "the hand went away again",
    "other_hand": "the person's other hand has been held out instead",
    "steady": "the object has been held still",
    "between": "the object is held still between the open fingers",
    "held": "the fingers hold the object",
    "free": "the fingers hold the object, and the person does not hold on to it",
    "missed": "the fingers are closed on nothing",
    "open": "the fingers are open",
    "away": "the robot is back, out of the way",
    "away_holding": "the robot is back, the object in its hand",
    "placed": "the object stands in its place",
    "placed_elsewhere": "the object stands in another place",
    "no_place": "the robot is at rest, and knows no place for the object",
    "unreached": "the robot is at rest, and no place is within reach as it holds it",
    "blocked": "no certified motion has led on for a while",
    "in_vain": "no certified motion has led on, as often as it is tried",
    "hindered": "the time limit is over, most of it slowed or stopped for the person",
    "under_way": "the time limit is over, and it is still on its way",
    "taken_up": "the time limit is over, and no way to a place known in reach was free",
    "kept_off": "the time limit is over, most of it held, slowed or stopped on its way",
    "ungripped": "the time limit is over, and its fingers never closed",
    "unfelt": "the time limit is over, and the wrist measured no force all the while",
    "weak_pull": "the time limit is over, and a pull too weak to count was felt",
    "occupied": "the time limit is over, and the person is at the object's place",
    "late": "the state has lasted longer than its time limit",
    "late_holding": "the state has lasted too long, and the object is in the hand",
    "beset": "the same, and the person was in the way to the places",
}

_OF_PLACES = (
    Row(PUT_DOWN, "placed_elsewhere", RETREAT,
        "its place was not free: the object stands in another one"),
    Row(PUT_DOWN, "no_place", KEPT, "there is no place for the object: it keeps it"),
    Row(PUT_DOWN, "unreached", KEPT,
        "no place is within reach as it is held: it keeps the object", True),
    Row(PUT_DOWN, "beset", KEPT,
        "the person is in the way to each place: it keeps the object", True),
    Row(PUT_DOWN, "late_holding", KEPT,
        "no free way leads to a place: it keeps the object", True),
    Row(PUT_DOWN, "late", RETREAT, "its way back from the place is blocked", True),
)  # fmt: skip

GIVE = (
    Row(FETCH, "held", APPROACH, "the object is in the hand"),
    Row(FETCH, "lost", RETREAT, "the object was dropped as it was lifted", True),
    Row(FETCH, "missed", RETREAT, "there was nothing to grasp", True),
    Row(FETCH, "occupied", RETREAT,
        "somebody stood where the object is: it could not be fetched in time", True),
    Row(FETCH, "kept_off", RETREAT,
        "no way to the object was free in time, or the person was in it", True),
    Row(FETCH, "late", RETREAT, "the object could not be fetched in time", True),
    Row(APPROACH, "lost", RETREAT, "the object was dropped on the way", True),
    Row(APPROACH, "pulled", WAIT, "somebody pulls on the way: it stands", True),
    Row(APPROACH, "arrived", PRESENT, "at the best place in reach"),
    Row(APPROACH, "hindered", PUT_DOWN,
        "slowed for the person, it ran out of time", True),
    Row(APPROACH, "under_way", PUT_DOWN, "its way took longer than it may", True),
    Row(
        APPROACH,
        "taken_up",
        PUT_DOWN,
        "no way to a place within the person's reach was free in time",
        True,
    ),
    Row(APPROACH, "late", PUT_DOWN, "nobody came within reach in time", True),
    Row(PRESENT, "lost", RETREAT, "the object was dropped", True),
    Row(PRESENT, "near", WAIT, "a hand is near: it stands"),
    Row(PRESENT, "pulled", WAIT, "somebody pulls: it stands"),
    Row(PRESENT, "other_hand", APPROACH, "the other hand is held out: it goes there"),
    Row(PRESENT, "left", APPROACH, "the person left", True),
    Row(PRESENT, "moved", APPROACH, "the person moved: it follows"),
    Row(PRESENT, "late", PUT_DOWN, "nobody took the object in time", True),
    Row(WAIT, "lost", RETREAT, "the object is gone without a release", True),
    Row(WAIT, "pulled", RELEASE, "the pull lasted: it lets go"),
    Row(WAIT, "other_hand", APPROACH, "the other hand is held out: it goes there"),
    Row(WAIT, "gone", PRESENT, "the hand went away again"),
    Row(WAIT, "unfelt", PUT_DOWN,
        "no force at the wrist was measured, so that a pull could not be felt", True),
    Row(WAIT, "weak_pull", PUT_DOWN,
        "somebody pulled, but too weakly to count: pull harder, or ask for less", True),
    Row(WAIT, "late", PUT_DOWN, "the hand never pulled", True),
    Row(RELEASE, "open", RETREAT, "the person has the object"),
    Row(RELEASE, "slack", WAIT, "the hand let go too early: it holds on", True),
    Row(RELEASE, "late", KEPT, "the fingers did not open: it stands", True),
    Row(RETREAT, "found", APPROACH, "the object is in the hand after all"),
    Row(RETREAT, "away", DONE, "it is back"),
    Row(RETREAT, "late", DONE, "its way back is blocked: it stands", True),
    Row(PUT_DOWN, "lost", RETREAT, "the object was dropped on the way back", True),
    Row(PUT_DOWN, "placed", RETREAT, "the object is back in its place"),
    *_OF_PLACES,
)  # fmt: skip

RECEIVE = (
    Row(APPROACH, "between", CLOSE, "the object was put between the fingers"),
    Row(APPROACH, "arrived", WAIT, "before the object"),
    Row(APPROACH, "hindered", RETREAT,
        "slowed for the person, it ran out of time", True),
    Row(APPROACH, "under_way", RETREAT, "its way took longer than it may", True),
    Row(APPROACH, "taken_up", RETREAT,
        "no way to what was held out was free in time", True),
    Row(APPROACH, "late", RETREAT, "nothing was held out in reach in time", True),
    Row(WAIT, "between", CLOSE, "the object was put between the fingers"),
    Row(WAIT, "left", APPROACH, "the person left", True),
    Row(WAIT, "moved", APPROACH, "the object moved: it follows"),
    Row(WAIT, "steady", CLOSE, "the object is held still"),
    Row(WAIT, "late", RETREAT, "the object never came to rest", True),
    Row(CLOSE, "between", CLOSE, "stopped on its way, the object between the fingers"),
    Row(CLOSE, "lost", RETREAT, "the object was dropped, or taken back", True),
    Row(CLOSE, "missed", RETREAT, "the hand let go too early", True),
    Row(CLOSE, "free", RETREAT, "the object is in the robot's hand"),
    Row(CLOSE, "moved", APPROACH, "the object was drawn back: it follows", True),
    Row(CLOSE, "in_vain", RETREAT, "no way to the object is free: it gives up", True),
    Row(CLOSE, "blocked", APPROACH, "the object is blocked: another way", True),
    Row(CLOSE, "hindered", RETREAT, "slowed for the person, it ran out of time", True),
    Row(CLOSE, "ungripped", RETREAT, "the object was not held still at its hand", True),
    Row(CLOSE, "late", RETREAT, "the person holds on: it lets go", True),
    Row(RETREAT, "lost", RETREAT, "the object was dropped", True),
    Row(RETREAT, "found", PUT_DOWN, "the object is in the hand after all"),
    Row(RETREAT, "away_holding", PUT_DOWN, "back with the object"),
    Row(RETREAT, "away", DONE, "it is back"),
    Row(RETREAT, "late_holding", KEPT, "its way back is blocked: it keeps it", True),
    Row(RETREAT, "late", DONE, "its way back is blocked: it stands", True),
    Row(PUT_DOWN, "lost", RETREAT, "the object was dropped on the way", True),
    Row(PUT_DOWN, "placed", RETREAT, "the object stands in its place"),
    *_OF_PLACES,
)  # fmt: skip
TABLES: Mapping[str, tuple[Row, ...]] = {"give": GIVE, "receive": RECEIVE}


class Step(NamedTuple):
    """One thing to do in a state: "goal", "line", "grip", "take", "let" and others."""

    kind: str
    value: object = None


@dataclass(frozen=True)
class StoryEvent:
    """What happened."""

    time_s: float  # when [s]
    state: str  # the state it led to
    signal: str  # what led there
    reason: str  # the same as a person says it
    failure: bool = False  # whether something went wrong


class Machine:
    """Goes through a table.

    Attributes:
        state: Where it is.
        since: When it came there [s]; where it stands before the person, and has been
            away for a moment only, when it came there first.
        reason: Why, as a person says it.
        events: All that happened.

    Raises:
        BadInput: No row begins at the state.
    """

    def __init__(self, rows: tuple[Row, ...], state: str) -> None:
        self.rows, self.state, self.since = rows, state, 0.0
        self._leaving: dict[str, list[Row]] = defaultdict(list)  # rows of each state
        for row in rows:
            self._leaving[row.state].append(row)
        self._before = "", 0.0  # the state before, and since when
        self._came = 0.0  # when the state was entered [s]
        self.reason = ""
        self.events: list[StoryEvent] = []
        if state not in {row.state for row in rows}:
            raise BadInput(
                f"no hand-over begins at {state!r}; choose one of "
                f"{', '.join(dict.fromkeys(row.state for row in rows))}"
            )

    @property
    def ended(self) -> bool:
        """Whether nothing follows."""
        return self.state in ENDS

    def outcome(self, passed: str) -> str:
        """Return what came of it: "handed over", or what went wrong.

        `passed` is the signal with which the object changed hands. Empty before the
        end.
        """
        if not self.ended:
            return ""
        if any(e.signal == passed and not e.failure for e in self.events):
            late = [e for e in self.events if e.signal in ("lost", "found")]
            lost = bool(late) and late[-1].signal == "lost"
            return late[-1].reason if lost else "handed over"
        failures = [e.reason for e in self.events if e.failure]
        return failures[-1] if failures else self.reason

    def begin(self, now: float) -> None:
        """Begin at a time [s]."""
        self.since = self._came = now

    def leap(self, passed: float) -> None:
        """Let some time [s] not count."""
        state, since = self._before
        self._before = state, since + passed
        self.since, self._came = self.since + passed, self._came + passed

    def step(self, signals: Collection[str], now: float) -> Row | None:
        """Take the first row that begins here and whose signal holds; return it."""
        for row in self._leaving[self.state]:
            if row.signal in signals:
                state, since = self._before
                back = row.then == state in STANDS and now - self._came < BRIEF_S
                self._before, self._came = (self.state, self.since), now
                self.state, self.since = row.then, since if back else now
                self.reason = row.reason
                args = (now, row.then, row.signal, row.reason, row.failure)
                self.events.append(StoryEvent(*args))
                return row
        return None
