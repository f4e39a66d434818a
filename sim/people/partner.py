"""The person of a hand-over, scripted: reaches, pulls, holds out, lets go, withdraws.

Unlike the blind scripts of `sim.people` this person sees what the robot holds out, or
whether it has grasped. Nothing else of the robot: nobody steps aside for it.
"""

from dataclasses import dataclass, replace

import numpy as np

from handover.human.body import ARM_LABELS, LEG_LABELS
from handover.human.human import Human
from handover.meet.constraints import ClearOf
from handover.meet.held_object import HeldObject
from roadmap.geometry.gaps import ball_gaps, least_gap, moved_rods
from sim.people.arm_path import minimum_jerk

SLOWEST = 0.25  # [s] no reach is quicker
_TRIES = 0.15  # [s] between two attempts to find joints for a grasp
_MOVED = 0.04  # [m] the hand's aim is chosen anew when the object has moved by this
_BACK = 0.15  # [m] a hand is drawn back from what was handed over
_BACKS = (0.30, 0.20, 0.15)  # [m] ... and waits there
_LOOKED_AT = 40  # grasps that are looked at in one attempt, nearest first
_KEEPS = 0.0  # [m] from the cover, which is 2 cm thicker than the robot
_CLEARS = 0.03  # [m] of what was given to the robot, where the arm comes to rest
_PULLS_AFTER = 0.3  # [s] from the first touch to the pull
_STILL = 0.002  # [m] between two looks
_AT = 0.004  # [rad] an arm is there
_WALKS = 0.6  # [m/s] away from the robot


@dataclass(frozen=True)
class PartnerTraits:
    """How somebody behaves, drawn for each run."""

    hand_speed: float = 0.7  # peak of the hand's speed [m/s]
    delay_s: float = 0.4  # from seeing that it is time to moving [s]
    pull: float = 10.0  # force of the pull [N]; 0: never pulls
    pull_ramp: float = 25.0  # how quickly it grows [N/s]
    bump: float = 25.0  # of the first touch [N], for 40 ms
    noise: float = 0.4  # of the wrist's sensor, one sigma [N]
    tremble: float = 0.003  # amplitude of the joints' tremor [rad]
    # share of the reach at which the hand is drawn back once; 0: not
    withdraws_at: float = 0.0
    withdrawn_s: float = 1.5  # for how long it stays back [s]
    leaves_s: float = np.inf  # when the person walks off [s]; infinite: not
    # when somebody knocks the object out of the fingers [s]; infinite: not
    drops_s: float = np.inf
    # "when held", "early" or "never", of what is given to the robot
    lets_go: str = "when held"
    # a receiver stops pulling as the fingers begin to open, for so long [s]
    slack_s: float = 0.0
    # whether a receiver grabs the object while the robot still moves
    pulls_early: bool = False

    def pull_after(self, held_s: float) -> float:
        """Return how hard the object is pulled [N] so long after it was touched [s]."""
        return min(self.pull, max(0.0, (held_s - _PULLS_AFTER) * self.pull_ramp))

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> "PartnerTraits":
        """Return traits as people have them: hands up to 1 m/s, some withdraw once."""
        withdraws = rng.uniform(0.3, 0.9) if rng.uniform() < 0.25 else 0.0
        return cls(
            hand_speed=rng.uniform(0.3, 1.0),
            delay_s=rng.uniform(0.2, 0.8),
            pull=rng.uniform(7.0, 20.0),
            pull_ramp=rng.uniform(15.0, 40.0),
            bump=rng.uniform(0.0, 40.0),
            noise=rng.uniform(0.1, 0.6),
            tremble=rng.uniform(0.0, 0.005),
            withdraws_at=withdraws,
            withdrawn_s=rng.uniform(0.5, 2.0),
        )


class Partner:
    """A standing person whose one arm takes part; one `step` a frame.

    Args:
        body: Who stands there, arms at rest; base frame.
        side: The arm that takes part.
        obj: What is handed over.
        traits: See PartnerTraits.
        gives: Whether the person has the object, and gives it.
        arm_q: (7,) joints with which a giver holds it out.
        grasp: (4, 4) T_object_hand of a giver.
        clear: What stands about, through which nobody reaches for an object; None:
            nothing.

    Attributes:
        human: The person now.
        holds: Whether the person's hand holds the object.
        pull: The force of the person on the object now [N].
        bump_at: When the hand first touched the object [s]; infinite: not yet.
        balls: (n, 4) the robot as the person sees it: centres and radii [m].
    """

    def __init__(
        self,
        body: Human,
        side: str,
        obj: HeldObject,
        traits: PartnerTraits,
        gives: bool = False,
        arm_q: np.ndarray | None = None,
        grasp: np.ndarray | None = None,
        clear: ClearOf | None = None,
    ) -> None:
        self._clear = clear
        self.body, self.side, self.obj, self.traits = body, side, obj, traits
        self.gives, self.holds, self.pull = gives, gives, 0.0
        self.grasp = np.array(obj.hand_grasps[0] if grasp is None else grasp)
        self._rest = np.array(body.arms[side])
        self._offered = self._rest if arm_q is None else np.array(arm_q)
        self.arm = np.array(self._rest)
        self.balls = np.zeros((0, 4))
        self.human = body
        self._leg = (0.0, 0.0, self._rest, self._rest)  # begin, end [s], from, to
        self._then: np.ndarray | None = None  # (7,) where the arm goes next
        self._aim: np.ndarray | None = None  # (3,) object's place the reach is for
        self._next_try, self._ready = 0.0, np.inf
        self._back_until: float | None = None
        self.bump_at, self._slack_from = np.inf, np.inf
        self._done = False
        self._walked = 0.0  # how far [m]
        self._now = 0.0  # of the last step [s]
        self._given = np.zeros((0, 7))  # what was given to the robot, and where it is
        self._was = self._given  # the same at the last look
        self._waits = False  # with the hand drawn back, until that is out of the way

    def tracked(self, now: float) -> tuple[None, None]:
        """Return nothing: all of the person is seen, and where `human` says."""
        return None, None

    @property
    def T_world_object(self) -> np.ndarray:
        """(4, 4) the object in the person's hand [m]."""
        return self.human.T_world_hand(self.side) @ np.linalg.inv(self.grasp)

    def step(
        self, now: float, T_object: np.ndarray, offered: bool, fingers: str, held: bool
    ) -> Human:
        """Move on to a moment and return the person; `balls` are where the robot is.

        Args:
            now: The time [s].
            T_object: (4, 4) where the object is [m].
            offered: Whether the robot stands and holds the object out.
            fingers: What the robot's fingers do: "open" or "closed".
            held: Whether the robot's fingers hold the object.
        """
        t = self.traits
        if self.gives and held:
            self._given = moved_rods(self.obj.capsules, T_object)
        elif len(self._given):
            self._given = np.zeros((0, 7))
        if now >= t.leaves_s:
            self._walk(now, max(0.0, now - self._now))
        elif self.gives:
            self._give(now, fingers, held)
        else:
            self._receive(now, T_object, offered, fingers, held)
        self._now = now
        if now >= self._leg[1] and self._then is not None:
            then, self._then = self._then, None
            self._go(now, then)
        begin, end, a, b = self._leg
        share = 1.0 if now >= end else (now - begin) / (end - begin)
        self.arm = a + minimum_jerk(max(0.0, share)) * (b - a)
        shake = t.tremble * np.sin(2.0 * np.pi * 5.0 * now + np.arange(7))
        still = self.holds and held  # what both hold does not tremble
        self.human = self.body.with_arm(self.side, self.arm + (0 if still else shake))
        return self.human

    # --- what it does -------------------------------------------------------------

    def _receive(self, now, T_object, offered, fingers, held) -> None:
        t = self.traits
        if self._done:
            return
        if self.holds:  # both hold it, until the robot lets go
            self._pulling(now, fingers)
            if not held:
                self._done, self.pull = True, 0.0
                self._withdraw(now)
            return
        if self._back_until is not None:
            if now < self._back_until:
                return
            self._back_until, self._ready = None, now
        if not (offered or t.pulls_early):
            self._ready = np.inf
            if self._aim is not None:
                self._aim = None
                self._go(now, self._rest)
            return
        self._ready = min(self._ready, now + t.delay_s)
        if now < self._ready:
            return
        aim = T_object[:3, 3]
        if self._aim is None or np.linalg.norm(aim - self._aim) > _MOVED:
            self._reach(now, T_object)
        begin, end, _, target = self._leg
        if self._aim is None:
            return
        if t.withdraws_at and now - begin > t.withdraws_at * (end - begin):
            self.traits = replace(t, withdraws_at=0.0)  # once
            self._aim, self._back_until = None, now + t.withdrawn_s
            self._withdraw(now)
            return
        there = now >= end and self._then is None
        if there and np.abs(self.arm - target).max() < _AT:
            self.holds, self.bump_at = True, now
            self._pulling(now, fingers)

    def _pulling(self, now: float, fingers: str) -> None:
        t = self.traits
        if t.slack_s and fingers == "open" and self._slack_from == np.inf:
            self._slack_from = now
        self.pull = t.pull_after(now - self.bump_at)
        if self._slack_from <= now < self._slack_from + t.slack_s:
            self.pull = 0.0

    def _give(self, now: float, fingers: str, held: bool) -> None:
        t = self.traits
        if self._done:
            self._wait(now)
            return
        if self._ready == np.inf:
            self._ready = now + t.delay_s
        if self._aim is None and now >= self._ready and self._back_until is None:
            self._aim = np.zeros(3)
            self._go(now, self._offered)
        begin, end, *_ = self._leg
        if self._aim is not None and t.withdraws_at and now > end + t.withdraws_at:
            self.traits = replace(t, withdraws_at=0.0)
            self._aim, self._back_until = None, now + t.withdrawn_s
            self._withdraw(now)
        if self._back_until is not None and now >= self._back_until:
            self._back_until = None
        if t.lets_go == "early" and fingers == "closed" and not held and self.holds:
            self._let_go(now)
        if held and self.holds:
            if self.bump_at == np.inf:
                self.bump_at = now
            self.pull = 1.5  # a hand that holds on weighs a little
            if t.lets_go == "never":
                self.pull = 8.0
            elif now > self.bump_at + t.delay_s:
                self._let_go(now)

    def _let_go(self, now: float) -> None:
        self.holds, self._done, self.pull = False, True, 0.0
        self._withdraw(now)

    def _withdraw(self, now: float) -> None:
        """Draw the hand back to the body, then let the arm hang, round the robot.

        Where the arm would hang in what was given the hand waits, drawn back.
        """
        T, paths = self.human.T_world_hand(self.side), [[self._rest]]
        for back in (2.0 * _BACK, _BACK):
            before = self._drawn_back(T, self.arm, back)
            if len(before):
                paths.insert(0, [before[0], self._rest])
        able = [w for w in paths if self._passes(w)]
        path = next((w for w in able if self._clears(w)), None)
        self._waits = path is None
        if path is None:
            parts = ([q] for far in _BACKS for q in self._drawn_back(T, self.arm, far))
            good = (w for w in parts if self._passes(w) and self._clears(w))
            path = next(good, (able or paths)[0])
        first, *then = path
        self._go(now, first)
        self._then = then[0] if then else None

    def _wait(self, now: float) -> None:
        """Let the arm hang once what was given is out of its way."""
        if not self._waits or now < max(self._next_try, self._leg[1]):
            return
        self._next_try, before, self._was = now + _TRIES, self._was, self._given
        same = before.shape == self._given.shape
        if same and np.abs(before - self._given).max(initial=0.0) > _STILL:
            return  # nobody knows yet where the robot takes it
        if self._passes([self._rest]) and self._clears([self._rest]):
            self._waits = False
            self._go(now, self._rest)

    def _clears(self, legs: list[np.ndarray]) -> bool:
        """Whether the arm comes to rest clear of what was given to the robot.

        And gets there round it: no leg comes nearer to it than it begins, or than that.
        """
        begin = self.arm
        for q in legs:
            least = min(_CLEARS, self._gap_from_given(begin) - 0.002)
            for share in np.linspace(0.1, 1.0, 10):
                if self._gap_from_given(begin + share * (q - begin)) < least:
                    return False
            begin = q
        return self._gap_from_given(begin) >= _CLEARS

    def _gap_from_given(self, q: np.ndarray) -> float:
        """Return how far what was given is from the arm at q (7,) [m]."""
        return least_gap(self._arm_at(q), self._given)

    def _drawn_back(
        self, T_world_hand: np.ndarray, q: np.ndarray, back_m: float = _BACK
    ) -> np.ndarray:
        """Return (k, 7) with the hand nearer the shoulder, those nearest to q first."""
        T = np.array(T_world_hand)
        back = self.body.T_world_shoulder(self.side)[:3, 3] - T[:3, 3]
        T[:3, 3] += back_m * back / np.linalg.norm(back)
        found = self.body.arm_ik(self.side, T).q
        return found[np.abs(found - q).max(axis=1).argsort(kind="stable")]

    def _reach(self, now: float, T_object: np.ndarray) -> None:
        """Aim the hand at a grasp of the object: the nearest one, round the robot."""
        if now < self._next_try:
            return
        self._next_try = now + _TRIES
        found = []
        for grasp in self.obj.hand_grasps:
            joints = self.body.arm_ik(self.side, T_object @ grasp).q
            for q in joints[self._have_room(joints)]:
                found.append((float(np.abs(q - self.arm).max()), np.array(q), grasp))
        found.sort(key=lambda one: one[0])
        for _, q, grasp in found[:_LOOKED_AT]:
            legs = [*self._drawn_back(T_object @ grasp, q)[:1], q]
            if not self._passes(legs):
                continue
            self._aim, self.grasp = T_object[:3, 3].copy(), np.array(grasp)
            self._go(now, legs[0])  # round what holds the object, from one's own side
            self._then = q if len(legs) > 1 else None
            return

    def _passes(self, legs: list[np.ndarray]) -> bool:
        """Whether the arm keeps off the robot, as it stands, on its way.

        Where it is nearer than that already, as beside the fingers that hold what it
        has taken, it must not come nearer.
        """
        begin = self.arm
        least = min(_KEEPS, self._gap_at(begin) - 0.002)
        for q in legs:
            for share in np.linspace(0.1, 1.0, 10):
                if self._gap_at(begin + share * (q - begin)) < least:
                    return False
            begin = q
        return True

    def _have_room(self, joints: np.ndarray) -> np.ndarray:
        """Return (n,) bool: where hand and forearm are not in what stands about."""
        if self._clear is None:
            return np.ones(len(joints), bool)
        arms = self.body.arm_capsules(self.side, joints)
        return self._clear.allows_arms(arms[:, :2])

    def _gap_at(self, q: np.ndarray) -> float:
        """Return how far the robot is from the arm at q (7,) [m]."""
        if not len(self.balls):
            return np.inf
        return float(ball_gaps(self.balls, self._arm_at(q)).min())

    def _arm_at(self, q: np.ndarray) -> np.ndarray:
        """Return (k, 7) the capsules of the arm at q (7,) [m]."""
        return self.body.arm_capsules(self.side, q[None])[0]

    def _go(self, now: float, q: np.ndarray) -> None:
        """Move the arm so that the hand's speed has the peak that was drawn."""
        steps = self.arm + np.linspace(0.0, 1.0, 9)[:, None] * (q - self.arm)
        hands = [
            self.body.with_arm(self.side, s).T_world_hand(self.side)[:3, 3]
            for s in steps
        ]
        length = np.linalg.norm(np.diff(hands, axis=0), axis=1)
        fastest = 8.0 * length.max(initial=0.0)  # of a motion that takes one second
        took = max(SLOWEST, 1.875 * fastest / self.traits.hand_speed)
        self._then = None
        self._leg = now, now + took, np.array(self.arm), np.array(q)

    def _walk(self, now: float, passed: float) -> None:
        """Walk backwards for so long [s], away from the robot, the arm at rest."""
        if self._walked == 0.0:
            self._go(now, self._rest)
        step = _WALKS * passed
        self._walked += step
        self.pull, self._done = 0.0, True
        if not self.gives:
            self.holds = False
        T = self.body.T_world_pelvis.copy()
        if self._walked < 2.0:
            T[:3, 3] -= step * T[:3, 0]
            self.body = self.body.moved(T)


class RecordedPartner:
    """Somebody out of a recording, who does not know of the robot.

    Where a recorded hand comes near to what is held out, it takes it and pulls.

    Args:
        person: With `human(t)`, a `sim.people.whole_person.RecordedPerson`.
        side: The hand that is expected to; `side` is the one that does.
        obj: What is handed over.
        traits: How it pulls.

    Attributes:
        human, holds, pull, bump_at: As of `Partner`.
    """

    NEAR = 0.08  # [m] from the hand to the middle of the object

    def __init__(
        self, person: object, side: str, obj: HeldObject, traits: PartnerTraits
    ) -> None:
        self.person, self.side, self.obj, self.traits = person, side, obj, traits
        self.human = person.human(0.0)
        self.holds, self.pull, self.bump_at = False, 0.0, np.inf
        self._T_hand_object = np.eye(4)

    @property
    def T_world_object(self) -> np.ndarray:
        """(4, 4) the object in the person's hand [m]."""
        return self.human.T_world_hand(self.side) @ self._T_hand_object

    def tracked(self, now: float) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Return capsules (k, 7), base frame [m], and labels (k,), as tracked.

        Parts that are not seen stand where they were, grown by their age. Nobody is
        without legs: where no tracker follows them they are below the hip, as of
        `human`. None, None: nothing is hidden, the person is where `human` says.
        """
        if not hasattr(self.person, "guess"):
            return None, None
        rows, labels = self.person.capsules(now), np.asarray(self.person.labels)
        if np.isin(labels, LEG_LABELS).any():
            return rows, labels
        legs = np.isin(self.human.labels, LEG_LABELS)
        rows = np.concatenate((rows, self.human.capsules()[legs]))
        return rows, np.concatenate((labels, self.human.labels[legs]))

    def step(
        self, now: float, T_object: np.ndarray, offered: bool, fingers: str, held: bool
    ) -> Human:
        """Move on to a moment and return the person; see `Partner.step`."""
        self.human = self.person.human(now)
        if not self.holds and offered:
            for side in (self.side, *ARM_LABELS):
                off = self.human.T_world_hand(side)[:3, 3] - T_object[:3, 3]
                if np.linalg.norm(off) < self.NEAR:
                    self.side, self.holds, self.bump_at = side, True, now
                    break
        if self.holds and held:
            T = self.human.T_world_hand(self.side)
            self._T_hand_object = np.linalg.inv(T) @ T_object
            self.pull = self.traits.pull_after(now - self.bump_at)
        return self.human
