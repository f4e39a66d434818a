"""What a hand-over sees and feels in one frame: checked where it is given, worked out.

`Sight` finds out who and what is there, how it moves, and where it may be soon.
"""

import math
import operator
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from handover.human.body import ARM_LABELS, Part
from handover.human.human import Human
from odm.execution.missing import MissingParts
from odm.execution.settings import FollowSettings
from odm.execution.threat import Threat, Watcher
from odm.obstacles.obstacles import Obstacles
from roadmap.arrays import as_floats
from roadmap.errors import BadInput
from roadmap.geometry.gaps import ball_gaps, beads, least_gap, moved_rods
from roadmap.ranges import check_kind, check_seconds
from sim.story.robot_hand import Hand
from sim.story.settings import ConductSettings

_WORDS = {int(part): part.words for part in Part}
_LOST = 2.5  # times as long as a tracker takes for a frame, somebody may not be seen
_RIGID, _OFF_RIGID = 1e-9, 0.02  # a rotation off by more is mended; is none
OTHER_SIDE = {"left": "right", "right": "left"}
_NOWHERE = 1e6  # [m] what is that far away, or not finite, is not seen
_SHAPES = {"wrench": (6,), "T_base_object": (4, 4), "q": (-1,), "capsules": (-1, 7)}


@dataclass(frozen=True, eq=False)
class StoryFrame:
    """What is seen and felt in one frame.

    Capsules, a time or a q that are not finite are those of a failing sensor: the robot
    stops, says so, and goes on when they are finite again. For capsules, and an object
    that is not seen any more, the frame before stands in, as old as it is by then, for
    `PlannerSettings.max_age_s`.

    Attributes:
        now: Time [s], of any clock.
        human: The person, world frame; where that is seen from the robot's base tells
            `MeetSettings.T_world_base`.
        wrench: (6,) at the robot's wrist [N], [N m]; None: no sensor, no pull.
        opened: Whether the fingers are open, as measured.
        holds: Whether there is something between closed fingers, as measured.
        T_base_object: (4, 4) where the object is seen [m]; None, not finite, or farther
            away than 1e6 m: unseen.
        q: (dof,) measured configuration; None: at the set-point, or as far from it as
            when last measured.
        capsules: (k, 7) the person as the planner sees them, base frame [m]; none of
            them: nobody is there; None: those of `human`. Parts that were there and are
            not now, or have jumped, count as missing, and stay where they were for
            `ConductSettings.missing_s`; a tracker that knows that it has lost somebody
            tells NaN.
        labels: (k,) `handover.Part` of each; None: `human.labels`.
        stamp: When person and object were seen [s], of the clock of `now`; None: now.
            A loop that is quicker than its tracker tells what was seen last again, with
            the stamp that it had: the frame that had it first counts, as old as it is.

    Raises:
        BadInput: Another shape or kind, or not one label for each capsule.
    """

    now: float
    human: Human
    wrench: np.ndarray | None = None
    opened: bool = True
    holds: bool = False
    T_base_object: np.ndarray | None = None
    q: np.ndarray | None = None
    capsules: np.ndarray | None = None
    labels: np.ndarray | None = None
    stamp: float | None = None

    def __post_init__(self) -> None:
        check_seconds("now", self.now)
        if self.stamp is not None:
            check_seconds("stamp", self.stamp)
        for name in ("opened", "holds"):  # NaN, or what is not known, says neither
            given = getattr(self, name)
            check_kind(name, given, (bool, np.bool_), "give True or False, as measured")
        nobody = "where nobody is seen, any with capsules=np.zeros((0, 7))"
        check_kind("human", self.human, Human, f"give a handover.Human; {nobody}")
        for name, shape in _SHAPES.items():
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _numbers(name, self, shape))
        if self.T_base_object is not None:
            object.__setattr__(self, "T_base_object", _as_pose(self.T_base_object))
        parts = self.human.labels
        if self.labels is not None:
            as_floats("labels", self.labels)  # refuses words, and rows of other lengths
            parts = np.asarray(self.labels)
            object.__setattr__(self, "labels", parts)
        rows = self.human.labels if self.capsules is None else self.capsules
        if self.capsules is not None or self.labels is not None:
            if parts.shape != (len(rows),):
                raise BadInput(
                    f"there are {len(rows)} capsules and {parts.size} labels, but each "
                    "capsule must have one; give both"
                )

    @property
    def seen_at(self) -> float:
        """When person and object were seen [s]."""
        return self.now if self.stamp is None else self.stamp

    def person(
        self, T_base_world: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the capsules (k, 7) of the person, base frame [m], and labels (k,).

        `T_base_world` (4, 4) is the world's pose [m]; None: the base stands there.
        """
        rows, human = self.capsules, self.human
        if rows is None:
            rows = human.capsules()
            rows = rows if T_base_world is None else moved_rods(rows, T_base_world)
        return rows, human.labels if self.labels is None else self.labels


def _numbers(name: str, frame: StoryFrame, shape: tuple[int, ...]) -> np.ndarray:
    """Return what a frame has by a name as an array of a shape; -1: any length."""
    given = getattr(frame, name)
    try:
        numbers = np.asarray(given, float)
    except (TypeError, ValueError, OverflowError):
        numbers = np.zeros(())
    if len(shape) != numbers.ndim or any(
        n not in (-1, m) for n, m in zip(shape, numbers.shape, strict=True)
    ):
        shown = given if numbers.ndim == 0 else f"of shape {numbers.shape}"
        wanted = ", ".join("k" if n < 0 else str(n) for n in shape)
        raise BadInput(f"{name} is {shown!s:.40}, but must be numbers ({wanted})")
    return numbers


def _as_pose(T: np.ndarray) -> np.ndarray | None:
    """Return a measured pose (4, 4), exactly rigid; None where it is nowhere."""
    if not (np.abs(T) < _NOWHERE).all():
        return None
    off = float(np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max())
    wrong = off > _OFF_RIGID or (T[3] != (0.0, 0.0, 0.0, 1.0)).any()
    if wrong or np.linalg.det(T[:3, :3]) < 0.0:
        raise BadInput(
            f"T_base_object is no pose: its rotation is off by {off:.2g} (limit "
            f"{_OFF_RIGID:g}), its last row is {T[3].tolist()} and must be 0, 0, 0, 1, "
            "and mirroring is not allowed; give None where the object is not seen"
        )
    return T if off < _RIGID else _nearest_pose(T)


def _nearest_pose(T: np.ndarray) -> np.ndarray:
    """Return the pose (4, 4) nearest to what is almost one."""
    u, _, v = np.linalg.svd(T[:3, :3])
    near = np.array(T)
    near[:3, :3] = u @ v
    return near


@dataclass(frozen=True, eq=False)
class Seen:
    """A frame, worked out."""

    frame: StoryFrame  # what was given
    # all shapes: the person's parts, then the object's where it is `loose`
    there: Obstacles
    threat: Threat | None  # where they may be soon; None: there are no shapes
    people: int  # how many of the shapes are the person's: they come first
    labels: np.ndarray  # (people,) `handover.Part` of each
    # which of them are the hand, and the arm, that takes part
    hand: np.ndarray
    arm: np.ndarray
    obj: np.ndarray | None  # (k, 7) the object's capsules [m]; None: it is not seen
    # whether the object is a thing by itself: it is seen, not held, and nothing is
    # between the fingers, which what is there moves with
    loose: bool
    hand_gap: float  # from the receiving hand to the object [m]
    # how far the person's other hand is held out, and farther than that one, compared
    # with the first frame that showed it, for who gives [m]
    instead: float
    # (4, 4) where the object is to be taken: with a noisy sensor its mean place of late
    # [m]; None: it is not seen
    T_object: np.ndarray | None
    object_speed: float  # [m/s]
    # time since the frame before, as far as it counts [s]; 0 where nobody knows where
    # the person is
    dt: float
    stamp: float  # when the shapes were seen [s]

    @property
    def person(self) -> np.ndarray:
        """(k, 7) the person's capsules, base frame [m]."""
        return self.there.capsules[: self.people]

    @property
    def hands(self) -> np.ndarray:
        """(k, 7) those of the hand that takes part [m]."""
        return self.there.capsules[self.hand]


class Sight:
    """Works out one frame after another.

    Args:
        hand: The robot's, with the story's settings; what it holds is not looked for.
        conduct: How frames are read.
        side: Which hand of the person takes part.
        T_base_world: (4, 4) the world's pose in the base frame [m]; None: the base
            stands there, and rows stay as they are, to the bit.
    """

    def __init__(
        self,
        hand: Hand,
        conduct: ConductSettings,
        side: str,
        T_base_world: np.ndarray | None = None,
    ) -> None:
        self.hand, self.conduct, self.side = hand, conduct, side
        self.T_base_world = T_base_world
        self.settings = hand.settings
        # who is lost for a frame of their tracker is followed on
        follow = FollowSettings()
        longest = max(follow.drift_s, _LOST * hand.settings.seen_every_s)
        self._watcher = Watcher(hand.settings.threat, replace(follow, drift_s=longest))
        able = hand.settings.threat
        self._missing = MissingParts(conduct.missing_s, able.speed, able.noise)
        self._sound: Seen | None = None  # the last in which all was seen
        # over which time noise makes a still object no faster than half of that
        calm_s = 4.0 * hand.settings.threat.noise / hand.settings.still_speed
        self._averaged_s = max(conduct.goes_on_s, calm_s)
        self._object_was: deque[tuple[float, np.ndarray]] = deque()  # when, (4, 4)
        self._alone_s = 0.0  # for how long nobody could get to the object
        self._began: dict[str, list[float]] = {}  # hands at first, from the torso [m]
        # against gravity, a unit vector in the base frame
        up = np.array([0.0, 0.0, 1.0]) if T_base_world is None else T_base_world[:3, 2]
        self._up: list[float] = up.tolist()
        # which capsules each hand and the torso are, of those that are seen
        self._ends: dict[str, np.ndarray] = {}
        # labels as bytes, the parts that are the hand, the arm, words for all parts
        self._parts: tuple[bytes, np.ndarray, np.ndarray, list[str]] | None = None

    def look(self, frame: StoryFrame, dt: float) -> Seen:
        """Work out a frame, `dt` [s] after the one before."""
        rows, labels = frame.person(self.T_base_world)
        sound, at = are_sound(rows), frame.seen_at
        parts = self._missing.find(rows, labels, at) if sound else None
        lacks = parts is not None and parts.missing is not None
        lacks = lacks or not sound or self._lacks_object(frame)
        if lacks or self._was_told(frame):
            lately = self._as_lately(frame, dt)
            if lately is not None:
                return lately
        may_be, missing = rows, None
        if parts is not None:
            self._missing.keep(parts)
            rows, labels, may_be, missing, _ = parts
            sound = missing is None or are_sound(rows)
        hand, arm, words = self.parts(labels)
        obj = self.hand.capsules(frame.T_base_object)
        # what the fingers hold moves with them, whether it counts as taken or not
        loose = obj is not None and not frame.holds
        loose = loose and not self.hand.has(frame.T_base_object)
        there = Obstacles(capsules=np.concatenate((rows, obj)) if loose else rows)
        there.labels = {"capsules": _told(words[: len(there)], missing)}
        everything = there.capsules
        if missing is not None:
            everything = np.concatenate((may_be, everything[len(rows) :]))
        threat, stamp = None, frame.seen_at
        age = 0.0 if frame.stamp is None else frame.now - stamp
        if len(everything):
            threat = self._watcher.look(everything, stamp, age)
        speed = self.speed_of_object(frame)
        if loose:
            threat = self._as_it_stands(frame, threat, obj, speed, dt)
        near = rows[hand]
        gap = np.inf if obj is None else least_gap(near, obj)
        who = threat, len(rows), labels, hand, arm
        times = dt if sound and self._is_fresh(age) else 0.0, stamp
        asked = self.settings.direction == "give"
        gaps = gap, self._instead(rows) if asked else 0.0
        aim = self._aim_at(frame.T_base_object)
        seen = Seen(frame, there, *who, obj, loose, *gaps, aim, speed, *times)
        self._sound = seen if sound and missing is None else self._sound
        return seen

    def _was_told(self, frame: StoryFrame) -> bool:
        """Whether what a frame shows is no newer than what was seen last."""
        last = self._sound
        told = frame.stamp is not None and last is not None
        return told and frame.stamp <= last.stamp

    def _is_fresh(self, age: float) -> bool:
        """Whether the planner takes what is so old [s], and not of the future."""
        return 0.0 <= age <= self.hand.planner.settings.max_age_s

    def _lacks_object(self, frame: StoryFrame) -> bool:
        """Whether what stood or was held out in the frame before is not seen now."""
        last, held = self._sound, self.hand.holding or frame.holds
        there = last is not None and last.loose and not held
        return there and frame.T_base_object is None

    def _as_lately(self, frame: StoryFrame, dt: float) -> Seen | None:
        """Return a frame with the shapes of the last sound one; None: that is too old.

        Or of another kind: something has been grasped, or let go of, since. Of one that
        was told already there is nothing newer; too old, no time passes by it.
        """
        last, held = self._sound, self.hand.holding or frame.holds
        if last is None or (last.obj is not None and last.loose == held):
            return None
        age = frame.now - last.stamp
        fresh = self._is_fresh(age)
        if not (fresh or age >= 0.0 and self._was_told(frame)):
            return None
        threat = last.threat
        if threat is not None:
            threat = replace(threat, age=age)
        frame = replace(frame, T_base_object=last.frame.T_base_object)
        return replace(last, frame=frame, threat=threat, dt=dt if fresh else 0.0)

    def parts(self, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[str]]:
        """Return which capsules are the hand, and the arm, that takes part.

        And what reasons call the person's parts (n,), and the object's behind them.
        """
        known = self._parts
        if known is None or known[0] != labels.tobytes():
            hand = np.flatnonzero(labels == ARM_LABELS[self.side][0])
            arm = np.flatnonzero(np.isin(labels, ARM_LABELS[self.side]))
            words = [_WORDS.get(label, "") for label in labels.tolist()]
            words += ["the object"] * len(self.hand.obj.capsules)
            ends = {side: parts[0] for side, parts in ARM_LABELS.items()}
            ends["torso"] = Part.TORSO
            at = {name: np.flatnonzero(labels == part) for name, part in ends.items()}
            self._ends = {name: these for name, these in at.items() if len(these)}
            known = self._parts = labels.tobytes(), hand, arm, words
        return known[1:]

    def expect(self, side: str) -> None:
        """Take that hand for the one that takes part from now on."""
        self.side, self._parts = side, None

    def _instead(self, rows: np.ndarray) -> float:
        """Return how far out the other hand is, and farther than the one expected [m].

        Out is toward the robot's base, across gravity, from where it was at first. Of
        capsules whose `parts` were asked for last.
        """
        at = {name: _center(rows[these].tolist()) for name, these in self._ends.items()}
        torso, come = at.pop("torso", None), dict.fromkeys(ARM_LABELS, 0.0)
        for side, hand in at.items():
            if torso is None:
                continue
            off = [a - b for a, b in zip(hand, torso, strict=True)]
            if all(map(math.isfinite, off)):
                began = self._began.setdefault(side, off)
                began = [a + b for a, b in zip(torso, began, strict=True)]
                come[side] = self._far(began) - self._far(hand)
        return come[OTHER_SIDE[self.side]] - max(0.0, come[self.side])

    def _far(self, place: list[float]) -> float:
        """Return how far a place (3,) is from the base's origin, across gravity [m]."""
        high = sum(map(operator.mul, place, self._up))
        return math.hypot(*(a - high * b for a, b in zip(place, self._up, strict=True)))

    def _as_it_stands(
        self,
        frame: StoryFrame,
        threat: Threat,
        obj: np.ndarray,
        speed: float,
        dt: float,
    ) -> Threat:
        """Return the threat of all shapes, the object's (k, 7) last.

        An object that stands in its place, or where it was put down, is not expected to
        start off before somebody can have reached it: beside it the robot need not
        creep, least of all one that is slow to stop (decision 0099).
        """
        at, T, s = self.hand.stands_at, frame.T_base_object, self.settings
        still = at is not None and _length(T[:3, 3] - at) < s.between
        still = still and speed < s.still_speed
        time, these = 0.0, slice(len(threat.error) - len(obj), None)
        if still:
            time = self._unreached_for(threat.of(slice(these.start)), obj)
        window = 0.0 if threat.window is None else float(threat.window[these].max())
        self._alone_s = self._alone_s + dt if time >= dt and still else 0.0
        return threat.left_alone(these, time) if self._alone_s > window else threat

    def _unreached_for(self, person: Threat, obj: np.ndarray) -> float:
        """Return how long nobody can get to an object (k, 7) from now on [s]."""
        balls, person = covering_balls(obj), person.as_lately()
        for time in self.conduct.untouched:
            rows, more = person.between(0.0, time)
            if not more and (ball_gaps(balls, rows.capsules) > 0.0).all():
                return time
        return 0.0

    def speed_of_object(self, frame: StoryFrame) -> float:
        """Return how fast the object goes on [m/s]; a hand that trembles is still."""
        T, past, now = frame.T_base_object, self._object_was, frame.seen_at
        if T is None or (past and not now >= past[-1][0]):  # or the clock went back
            past.clear()
        if T is None:
            return 0.0
        past.append((now, T.copy()))
        while len(past) > 2 and past[0][0] < now - self._averaged_s - 1e-6:
            past.popleft()  # of a rare one the last two: alone it would seem to stand
        (since, there), (now, here) = past[0], past[-1]
        if not math.isfinite(now):
            return math.inf  # nobody knows how long it took
        return _length(here[:3, 3] - there[:3, 3]) / (now - since or 1.0)

    def _aim_at(self, T: np.ndarray | None) -> np.ndarray | None:
        """Return where to take the object that is seen at T (4, 4) in this frame [m].

        A robot that went for each noisy place would turn off anew in each frame.
        """
        if T is None or not self.settings.threat.noise:
            return T
        return _nearest_pose(np.mean([there for _, there in self._object_was], axis=0))


def _told(words: list[str], missing: np.ndarray | None) -> list[str]:
    """Return what the parts are called, those that are missing as such."""
    if missing is None:
        return words
    lost = [*missing.tolist(), *[False] * (len(words) - len(missing))]
    pairs = zip(words, lost, strict=True)
    return [f"unseen {word or 'part'}" if hidden else word for word, hidden in pairs]


def are_sound(rows: np.ndarray) -> bool:
    """Whether capsules (k, 7) are those of somebody: finite, each with a radius."""
    return bool(np.isfinite(rows).all() and (rows[:, 6] > 0.0).all())


def covering_balls(rods: np.ndarray) -> np.ndarray:
    """Return 8 balls for each of some capsules (k, 7) that hold it, as (8 k, 4)."""
    n = 8
    balls = beads(rods, n)
    half = 0.5 / (n - 1) * np.linalg.norm(rods[:, 3:6] - rods[:, :3], axis=1)
    balls[:, 3] = np.hypot(balls[:, 3], np.tile(half, n))
    return balls


def _center(rows: list[list[float]]) -> list[float]:
    """Return the mean (3,) of the ends of capsules (k, 7) [m]."""
    return [
        sum(row[a] + row[a + 3] for row in rows) / (2 * len(rows)) for a in range(3)
    ]


def _length(v: np.ndarray) -> float:
    """Return the length of a vector (3,), to the last bit that of np.linalg.norm."""
    return math.sqrt(v @ v)
