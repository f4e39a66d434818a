"""From a tuple of H to the motions of both partners, proved over their whole length.

What is cheap comes first: straight lines, fingers that close or open, lifts. Only where
all of those are free are paths searched between them. What does not depend on the whole
tuple is worked out once for all of them.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from types import SimpleNamespace

import numpy as np

from handover.grasps.grasp_set import GraspSet
from handover.plans.choose import HandoverChoice, Kept, Pair, Report
from handover.plans.limb import Limb
from handover.plans.paths import SAME, Blocked, Clock, Paths
from handover.plans.settings import PlanSettings
from handover.scenes.scene import PlacedAgent, Scene
from roadmap.motion.motion import Motion, time_path


@dataclass(frozen=True, eq=False)
class PlannedMotion:
    """A part of a hand-over.

    Attributes:
        name: reach, pick, carry, offer, take, release, retreat, place, ...
        who: "giver" or "receiver".
        joints: Names of the joints that it moves.
        motion: Timed; its time 0 is `begin` of the plan.
        begin: [s]
        holds: Whether the one that moves holds the object.
    """

    name: str
    who: str
    joints: tuple[str, ...]
    motion: Motion
    begin: float
    holds: bool

    @property
    def end(self) -> float:
        """When it ends [s]."""
        return self.begin + self.motion.duration


@dataclass(frozen=True, eq=False)
class Piece:
    """A path of one arm, not timed yet."""

    name: str
    who: str
    path: np.ndarray
    holds: bool


@dataclass(frozen=True, eq=False)
class _Start:
    """How the giver grasps and lifts the object, the way there left out."""

    key: tuple[int, int]  # grasp, number of its posture
    q: np.ndarray
    pre: np.ndarray
    pick: np.ndarray
    up: np.ndarray


@dataclass(frozen=True, eq=False)
class _Meeting:
    """How the object changes hands, the ways there and home left out."""

    q_giver: np.ndarray
    q_receiver: np.ndarray
    take_pre: np.ndarray
    take: np.ndarray
    release: np.ndarray
    leave_pre: np.ndarray
    leave: np.ndarray


@dataclass(frozen=True, eq=False)
class _Goal:
    """How the receiver puts the object down and lets go, the ways left out."""

    down: np.ndarray | None  # None: it stays in the hand
    opening: np.ndarray | None = None
    pre: np.ndarray | None = None
    line: np.ndarray | None = None


class MotionPlanner:
    """Looks for the motions of tuples in a scene until the clock is over."""

    def __init__(
        self, scene: Scene, pair: Pair, settings: PlanSettings, clock: Clock
    ) -> None:
        self.scene, self.pair, self.settings = scene, pair, settings
        self.giver = Paths(
            pair.giver, home_of(scene.giver, pair.giver.limb), settings, clock
        )
        self.receiver = Paths(
            pair.receiver, home_of(scene.receiver, pair.receiver.limb), settings, clock
        )
        self._known: dict = {}  # what does not depend on the whole tuple
        self._meetings: dict[int, tuple] = {}  # by tuple: (it, hard, what was found)

    def of(
        self, chosen: HandoverChoice, budget: int
    ) -> tuple[list[Piece], HandoverChoice]:
        """Return the pieces of a tuple's motions, in order, and the tuple.

        The tuple's arms may have got other postures, the palms where they were.

        Raises:
            Blocked: One of them was not found.
        """
        try:
            return self._of(chosen, budget)
        finally:  # H is chosen from with the other arm where it waits
            self.pair.receiver.put_other(self.giver.home)

    def tell_hopeless(self, chosen: HandoverChoice, report: Report) -> None:
        """Note a tuple's grasps that fail at the start, or goal, whatever follows."""
        if isinstance(self._known.get(("start", chosen.grasp_giver)), Blocked):
            report.unpickable.add(chosen.grasp_giver)
        if isinstance(self._known.get(("goal", chosen.grasp_receiver)), Blocked):
            report.unplaceable.add(chosen.grasp_receiver)

    def _of(
        self, chosen: HandoverChoice, budget: int
    ) -> tuple[list[Piece], HandoverChoice]:
        g, r = chosen.grasp_giver, chosen.grasp_receiver
        hard = budget > self.settings.first_budget
        trouble = self._known.get(("start", g))
        if isinstance(trouble, Blocked):
            raise trouble
        goal = self._once(("goal", r), lambda: self._goal(chosen))
        meetings = self._meetings_of(chosen, hard)
        starts = self._once(("start", g), lambda: self._some(self._starts(chosen)))
        met, home = self._way_home(chosen, meetings, budget)
        start, carry = self._carried(starts, met, budget)
        approach = self._approach(chosen, met, budget)
        place = self._place(chosen, met, goal, budget)
        reach = self._searched(
            ("reach", *start.key), budget, lambda: self._reach(start, budget)
        )
        cut = max(1, len(carry) - 2)
        pieces = [
            Piece("reach", "giver", reach, False),
            Piece("pick", "giver", start.pick, False),
            Piece("lift", "giver", start.up, True),
            Piece("carry", "giver", carry[: cut + 1], True),
            Piece("offer", "giver", carry[cut:], True),
            Piece("approach", "receiver", approach, False),
            Piece("take", "receiver", met.take, False),
            Piece("release", "giver", met.release, False),
            Piece(
                "retreat", "giver", np.vstack([met.leave[::-1], home[::-1][1:]]), False
            ),
            *place,
        ]
        used = replace(
            chosen, q_start=start.q, q_giver=met.q_giver, q_receiver=met.q_receiver
        )
        return pieces, used

    # --- what is cheap --------------------------------------------------------------

    def _starts(self, chosen: HandoverChoice) -> Iterator[_Start]:
        """Yield ways to grasp and lift: line, fingers, lift. Blocked: there is none."""
        g, trouble, found = chosen.grasp_giver, None, False
        wide = self.pair.of_giver.preshape[g]
        for slanted in (False, True):
            every = self.giver.postures(chosen.q_start, wide)
            most, put = self.settings.postures + 1, self._put_giver_at_start
            for k, q in enumerate(_put_before(every, most, put)):
                try:
                    pre, line, up = self._pick(g, q, slanted)
                except Blocked as blocked:
                    trouble = trouble or blocked
                    if blocked.by_hand:
                        break
                    continue
                found = True
                yield _Start((g, k), q, pre, line, up)
            if found:
                return
        raise trouble

    def _pick(self, g: int, q: np.ndarray, slanted: bool) -> tuple:
        """Return (where the line begins, line and closing hand, lift) of the giver."""
        paths, grasps, put = self.giver, self.pair.of_giver, self._put_giver_at_start
        pre, pick = _grasped(paths, q, (grasps, g), "the pick", "giver", put, slanted)
        paths.mover.hold(np.linalg.inv(grasps.T_object_palm[g]))
        return pre, pick, paths.lift(q)

    def _goal(self, chosen: HandoverChoice) -> _Goal:
        """Return how the receiver lets go at the goal: lift, fingers, line."""
        scene, grasps, g = self.scene, self.pair.of_receiver, chosen.grasp_receiver
        if scene.goal_held:
            return _Goal(None)
        receiver, paths = self.pair.receiver, self.receiver
        self._put_receiver_to_carry(g)
        down = paths.lift(chosen.q_goal)[::-1]
        receiver.stand(self.giver.home, scene.T_world_goal, touching=True)
        q_open = _with_hand(receiver.limb, chosen.q_goal, grasps.preshape[g])
        opening = _closing(receiver.limb, q_open, chosen.q_goal)[::-1]
        paths.prove(opening, "opening the receiver's hand")
        pre, line = paths.line_to(q_open, "the receiver's retreat", (grasps, g), True)
        return _Goal(down, opening, pre, line)

    def _meetings_of(self, chosen: HandoverChoice, hard: bool) -> list[_Meeting]:
        """Return how the object may change hands; more postures are tried if `hard`."""
        _, tried, met = self._meetings.get(id(chosen), (None, None, None))
        known = isinstance(met, Blocked) and (tried or not hard or met.by_hand)
        if met is None or (tried < hard and not known):
            try:
                met = self._meet(chosen, hard)
            except Blocked as blocked:
                met = blocked
            self._meetings[id(chosen)] = chosen, hard, met
        if isinstance(met, Blocked):
            raise met
        return met

    def _meet(self, chosen: HandoverChoice, hard: bool) -> list[_Meeting]:
        """Return fingers and lines of both where the object changes hands.

        All with one posture of the receiver, and some of the giver.
        """
        trouble, tries = None, self.settings.meetings if hard else 1
        wide = self.pair.of_receiver.preshape[chosen.grasp_receiver]
        put = partial(self._put_receiver_to_take, chosen, chosen.q_giver)
        every = self.receiver.postures(chosen.q_receiver, wide)
        for q_receiver in _put_before(every, tries, put):
            try:
                if not hard:  # what fails most often comes first
                    self._release(chosen, chosen.q_giver, q_receiver)
                taken = self._take(chosen, chosen.q_giver, q_receiver)
                return self._leave(chosen, q_receiver, taken, tries)
            except Blocked as blocked:
                trouble = trouble or blocked
                if blocked.by_hand:
                    break
        trouble.more = not trouble.by_hand and not hard
        raise trouble

    def _leave(
        self, chosen: HandoverChoice, q_receiver: np.ndarray, taken: tuple, tries: int
    ) -> list[_Meeting]:
        """Return how the giver leaves the object to the receiver."""
        trouble, met = None, []
        wide = self.pair.of_giver.preshape[chosen.grasp_giver]
        put = partial(self._put_giver_to_leave, chosen, q_receiver)
        every = self.giver.postures(chosen.q_giver, wide)
        for q_giver in _put_before(every, tries, put):
            if len(met) == self.settings.starts:
                break
            try:
                left = self._release(chosen, q_giver, q_receiver)
                if q_giver is not chosen.q_giver:
                    self._offered(chosen, q_giver)
                    taken = self._take(chosen, q_giver, q_receiver)
            except Blocked as blocked:
                trouble = trouble or blocked
                if blocked.by_hand:
                    break
                continue
            met.append(_Meeting(q_giver, q_receiver, *taken, *left))
        if not met:
            raise trouble
        return met

    def _take(
        self, chosen: HandoverChoice, q_giver: np.ndarray, q: np.ndarray
    ) -> tuple:
        """Return (where the line begins, line and closing hand) of the receiver."""
        put = partial(self._put_receiver_to_take, chosen, q_giver)
        held = self.pair.of_receiver, chosen.grasp_receiver
        return _grasped(self.receiver, q, held, "the take", "receiver", put)

    def _release(
        self, chosen: HandoverChoice, q: np.ndarray, q_receiver: np.ndarray
    ) -> tuple:
        """Return (opening hand, where the line begins, line) of the giver."""
        giver, grasps, paths = self.pair.giver, self.pair.of_giver, self.giver
        g = chosen.grasp_giver
        q_open = _with_hand(giver.limb, q, grasps.preshape[g])
        self._put_giver_to_leave(chosen, q_receiver)  # the line fails most often
        pre, line = paths.line_to(q_open, "the giver's retreat", (grasps, g))
        self._put_giver_to_leave(chosen, q_receiver, touching=True)
        opening = _closing(giver.limb, q_open, q)[::-1]
        paths.prove(opening, "opening the giver's hand")
        return opening, pre, line

    def _offered(self, chosen: HandoverChoice, q_giver: np.ndarray) -> None:
        """Look whether the giver can hold the object where it is handed over."""
        self._put_giver_to_carry(chosen.grasp_giver)
        _, trouble = self.pair.giver.why(q_giver)
        if trouble:
            raise Blocked(f"offer: {trouble}")

    # --- what is searched -------------------------------------------------------------

    def _carried(
        self, starts: Kept, met: _Meeting, budget: int
    ) -> tuple[_Start, np.ndarray]:
        """Return the path of the object, and where it begins."""
        every = starts.first(self.settings.starts)
        self._put_giver_to_carry(every[0].key[0])
        begin = np.array([start.up[-1] for start in every])
        path, first, _ = self.giver.between(begin, met.q_giver[None], "carry", budget)
        if len(path) == 2:
            path = np.array([path[0], 0.5 * (path[0] + path[1]), path[1]])
            self.giver.prove(path, "carry")
        return every[first], path

    def _reach(self, start: _Start, budget: int) -> np.ndarray:
        self._put_giver_at_start()
        return self.giver.reach(start.pre[None], "reach", budget)[0]

    def _approach(
        self, chosen: HandoverChoice, met: _Meeting, budget: int
    ) -> np.ndarray:
        self._put_receiver_to_take(chosen, met.q_giver)
        pre = met.take_pre[None]
        return self.receiver.reach(pre, "reach for the object", budget)[0]

    def _way_home(
        self, chosen: HandoverChoice, meetings: list[_Meeting], budget: int
    ) -> tuple[_Meeting, np.ndarray]:
        """Return the giver's way home, and where it begins."""
        self._put_giver_to_leave(chosen, meetings[0].q_receiver)
        begin = np.array([met.leave_pre for met in meetings])
        path, k = self.giver.reach(begin, "the giver's way home", budget)
        return meetings[k], path

    def _place(
        self, chosen: HandoverChoice, met: _Meeting, goal: _Goal, budget: int
    ) -> list[Piece]:
        """Receiver: bring the object to the goal; let go where that carries it."""
        g = chosen.grasp_receiver
        self._put_receiver_to_carry(g)
        end = chosen.q_goal if goal.down is None else goal.down[0]
        path, _, _ = self.receiver.between(
            met.q_receiver[None], end[None], "place", budget
        )
        if goal.down is None:
            return [Piece("place", "receiver", path, True)]
        back = self._searched(
            ("home", g), budget, lambda: self._home_from_goal(goal, budget)
        )
        return [
            Piece("place", "receiver", np.vstack([path, goal.down[1:]]), True),
            Piece("let go", "receiver", goal.opening, False),
            Piece(
                "retreat", "receiver", np.vstack([goal.line[::-1], back[::-1][1:]]),
                False,
            ),
        ]  # fmt: skip

    def _home_from_goal(self, goal: _Goal, budget: int) -> np.ndarray:
        self.pair.receiver.stand(self.giver.home, self.scene.T_world_goal)
        return self.receiver.reach(goal.pre[None], "the receiver's way home", budget)[0]

    # --- who stands where -------------------------------------------------------------

    def _put_giver_at_start(self, touching: bool = False) -> None:
        self.pair.giver.stand(self.receiver.home, self.scene.T_world_start, touching)

    def _put_giver_to_carry(self, g: int) -> None:
        T_palm_object = np.linalg.inv(self.pair.of_giver.T_object_palm[g])
        self.pair.giver.carry(self.receiver.home, T_palm_object)

    def _put_receiver_to_carry(self, g: int) -> None:
        T_palm_object = np.linalg.inv(self.pair.of_receiver.T_object_palm[g])
        self.pair.receiver.carry(self.giver.home, T_palm_object)

    def _put_receiver_to_take(
        self, chosen: HandoverChoice, q_giver: np.ndarray, touching: bool = False
    ) -> None:
        self.pair.receiver.stand(q_giver, chosen.T_world_handover, touching)

    def _put_giver_to_leave(
        self, chosen: HandoverChoice, q_receiver: np.ndarray, touching: bool = False
    ) -> None:
        self.pair.giver.stand(q_receiver, chosen.T_world_handover, touching)

    # --- what is known ----------------------------------------------------------------

    def _once(self, key: tuple, work: Callable) -> object:
        """Return what `work` returns or raises; it is done once."""
        if key not in self._known:
            try:
                self._known[key] = work()
            except Blocked as blocked:
                self._known[key] = blocked
        known = self._known[key]
        if isinstance(known, Blocked):
            raise known
        return known

    @staticmethod
    def _some(every: Iterator) -> Kept:
        """Return what an iterator yields; the first is made, or raises, at once."""
        kept = Kept(every)
        kept.first(1)
        return kept

    def _searched(self, key: tuple, budget: int, work: Callable) -> np.ndarray:
        """Return a path that was found once; a search is repeated with more budget."""
        path, spent, trouble = self._known.get(key, (None, 0, None))
        if path is not None:
            return path
        if trouble is not None and (budget <= spent or not trouble.searched):
            raise trouble
        try:
            path = work()
        except Blocked as blocked:
            self._known[key] = None, budget, blocked
            raise
        self._known[key] = path, budget, None
        return path


def _put_before(
    every: Iterator[np.ndarray], most: int, put: Callable[..., None]
) -> Iterator[np.ndarray]:
    """Yield so many of some postures; before each, all else is put where it is."""
    for _ in range(most):
        put(touching=True)
        if (q := next(every, None)) is None:
            return
        yield q


def _grasped(
    paths: Paths,
    q: np.ndarray,
    held: tuple[GraspSet, int],
    what: str,
    who: str,
    put: Callable[..., None],
    slanted: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Return where the straight line to a grasp begins, and line and closing hand.

    `put` puts all else where it is, and says whether the hand may touch the object.
    """
    limb, (grasps, g) = paths.mover.limb, held
    q_open = _with_hand(limb, q, grasps.preshape[g])
    put()
    pre, line = paths.line_to(q_open, what, held, slanted)
    put(touching=True)
    close = _closing(limb, q_open, q)
    paths.prove(close, f"closing the {who}'s hand")
    return pre, np.vstack([line, close[1:]])


def _closing(limb: Limb, q_open: np.ndarray, q_shut: np.ndarray) -> np.ndarray:
    """Return corners of a hand that closes as its grasp was made.

    All fingers at once, in each the joints one after the other, base first: on that way
    no finger overlaps the object.
    """
    corners, at = [q_open], limb.joints.index
    for k in range(max(len(finger) for finger in limb.spec.fingers)):
        q = corners[-1].copy()
        for finger in limb.spec.fingers:
            if k < len(finger):
                q[at(finger[k])] = q_shut[at(finger[k])]
        corners.append(q)
    corners.append(q_shut)
    path = np.array(corners)
    moves = np.abs(np.diff(path, axis=0)).max(axis=1) > SAME
    return path[np.r_[True, moves]] if moves.any() else path[[0, -1]]


def home_of(placed: PlacedAgent, limb: Limb) -> np.ndarray:
    """Return where an arm and its hand wait, (dof,)."""
    return np.clip(placed.values(limb.joints), limb.lower, limb.upper)


def _with_hand(limb: Limb, q: np.ndarray, fingers: np.ndarray) -> np.ndarray:
    return np.concatenate([q[: limb.n_arm], fingers])


def timed(pieces: list[Piece], pair: Pair) -> tuple[PlannedMotion, ...]:
    """Time pieces one after the other, within all limits of their joints.

    The arm stops in every corner, so that what is executed is what was proved.
    """
    begin, motions = 0.0, []
    for piece in pieces:
        limb = (pair.giver if piece.who == "giver" else pair.receiver).limb
        limits = SimpleNamespace(  # what timing reads of a robot
            name=limb.model.description.name, joint_names=limb.joints, dof=limb.dof,
            lower=limb.lower, upper=limb.upper, continuous=np.zeros(limb.dof, bool),
            max_velocity=limb.max_velocity, max_acceleration=limb.max_acceleration,
            max_jerk=limb.max_jerk,
        )  # fmt: skip
        motion = time_path(limits, piece.path, blend=0.0)
        named = piece.name, piece.who, limb.joints
        motions.append(PlannedMotion(*named, motion, begin, piece.holds))
        begin += motion.duration
    return tuple(motions)
