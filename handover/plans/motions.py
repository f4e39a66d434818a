"""From a tuple of H to motions: who moves how, proved over their whole length."""

from dataclasses import dataclass

import numpy as np

from handover.grasps.grasp_set import GraspSet
from handover.plans import _connect as kernels
from handover.plans.choose import Pair, Tuple
from handover.plans.limb import Limb
from handover.plans.mover import TOLERANCE, Mover
from handover.plans.settings import PlanSettings
from handover.scenes.scene import PlacedAgent, Scene
from roadmap.errors import PlanningError
from roadmap.kinematics._inverse import descend
from roadmap.kinematics.tool_chain import descent_of
from roadmap.motion.motion import Motion, time_path

_BRANCHES, _CORNERS = 4000, 400
_SCALE = np.array([0.1, 0.1])  # [m or rad] that counts as 1 in a descent
_ERROR = 1e-6  # of that: 0.1 um
_SHORTER = (
    1.0,
    0.6,
    0.35,
)  # of the straight line to a grasp, where the whole is blocked
_SAME = 1e-9  # [rad or m]


class Blocked(PlanningError):
    """A motion was not found; says which and what is in the way."""


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
        T_palm_object: (4, 4) then.
    """

    name: str
    who: str
    joints: tuple[str, ...]
    motion: Motion
    begin: float
    holds: bool
    T_palm_object: np.ndarray | None

    @property
    def end(self) -> float:
        """When it ends [s]."""
        return self.begin + self.motion.duration


@dataclass(frozen=True, eq=False)
class _Piece:
    name: str
    who: str
    path: np.ndarray
    holds: bool


class MotionPlanner:
    """Looks for the motions of tuples in a scene.

    Args:
        scene: The scene.
        pair: Both arms.
        settings: See PlanSettings.
    """

    def __init__(self, scene: Scene, pair: Pair, settings: PlanSettings) -> None:
        """Lay out memory of the searches."""
        self.scene, self.pair, self.settings = scene, pair, settings
        self.home = {
            "giver": home_of(scene.giver, pair.giver.limb),
            "receiver": home_of(scene.receiver, pair.receiver.limb),
        }
        self._trees = {
            who: _trees(mover.limb.dof)
            for who, mover in (("giver", pair.giver), ("receiver", pair.receiver))
        }
        self.tested = 0

    def of(self, chosen: Tuple) -> list[_Piece]:
        """Return the pieces of a tuple's motions, in order.

        Raises:
            Blocked: One of them was not found.
        """
        pieces = self._pick(chosen)
        pieces += self._take(chosen)
        pieces += self._leave(chosen)
        return pieces + self._place(chosen)

    # --- the four parts -----------------------------------------------------------

    def _pick(self, chosen: Tuple) -> list[_Piece]:
        """Giver: reach, pick, carry, offer."""
        giver, scene, home = self.pair.giver, self.scene, self.home["giver"]
        grasps, g = self.pair.of_giver, chosen.grasp_giver
        giver.put_other(self.home["receiver"])
        giver.put_object(scene.T_world_start)
        q_open = _with_hand(giver.limb, chosen.q_start, grasps.preshape[g])
        pre, line = self._line_to(giver, q_open, "the pick")
        giver.put_object(scene.T_world_start)
        reach = self._reach("giver", giver, home, pre, "reach")
        close = np.array([q_open, chosen.q_start])
        giver.put_object(scene.T_world_start)
        giver.let_touch()
        self._prove(giver, close, "closing the giver's hand")
        T_palm_object = np.linalg.inv(grasps.T_object_palm[g])
        giver.hold(T_palm_object)
        up = self._lift(giver, chosen.q_start)
        self._prove(giver, up, "lifting the object")
        carry = self._between("giver", giver, up[-1], chosen.q_giver, "carry")
        cut = max(1, len(carry) - 2)
        if len(carry) == 2:
            carry = np.array([carry[0], 0.5 * (carry[0] + carry[1]), carry[1]])
        self._prove(giver, carry, "carry")
        return [
            _Piece("reach", "giver", reach, False),
            _Piece("pick", "giver", np.vstack([line, close[1:]]), False),
            _Piece("lift", "giver", up, True),
            _Piece("carry", "giver", carry[: cut + 1], True),
            _Piece("offer", "giver", carry[cut:], True),
        ]

    def _take(self, chosen: Tuple) -> list[_Piece]:
        """Receiver: reach for the object that the giver holds, and grasp it."""
        receiver, grasps = self.pair.receiver, self.pair.of_receiver
        receiver.put_other(chosen.q_giver)
        receiver.put_object(chosen.T_world_handover)
        shut = chosen.q_receiver
        q_open = _with_hand(receiver.limb, shut, grasps.preshape[chosen.grasp_receiver])
        pre, line = self._line_to(receiver, q_open, "the take")
        home = self.home["receiver"]
        receiver.put_object(chosen.T_world_handover)
        reach = self._reach("receiver", receiver, home, pre, "reach for the object")
        receiver.put_object(chosen.T_world_handover)
        receiver.let_touch()
        close = np.array([q_open, shut])
        self._prove(receiver, close, "closing the receiver's hand")
        return [
            _Piece("approach", "receiver", reach, False),
            _Piece("take", "receiver", np.vstack([line, close[1:]]), False),
        ]

    def _leave(self, chosen: Tuple) -> list[_Piece]:
        """Giver: open the hand, back, home."""
        giver, grasps = self.pair.giver, self.pair.of_giver
        giver.put_other(chosen.q_receiver)
        giver.put_object(chosen.T_world_handover)
        q_open = _with_hand(
            giver.limb, chosen.q_giver, grasps.preshape[chosen.grasp_giver]
        )
        return self._let_go("giver", giver, chosen.q_giver, q_open, "release")

    def _place(self, chosen: Tuple) -> list[_Piece]:
        """Receiver: bring the object to the goal; let go where that carries it."""
        receiver, grasps = self.pair.receiver, self.pair.of_receiver
        g, scene = chosen.grasp_receiver, self.scene
        receiver.put_other(self.home["giver"])
        receiver.hold(np.linalg.inv(grasps.T_object_palm[g]))
        if scene.goal_held:
            path = self._between(
                "receiver", receiver, chosen.q_receiver, chosen.q_goal, "place"
            )
            return [_Piece("place", "receiver", path, True)]
        down = self._lift(receiver, chosen.q_goal)[::-1]
        self._prove(receiver, down, "putting the object down")
        path = self._between("receiver", receiver, chosen.q_receiver, down[0], "place")
        receiver.put_object(scene.T_world_goal)
        q_open = _with_hand(receiver.limb, chosen.q_goal, grasps.preshape[g])
        last = self._let_go("receiver", receiver, chosen.q_goal, q_open, "let go")
        return [_Piece("place", "receiver", np.vstack([path, down[1:]]), True), *last]

    def _let_go(
        self, who: str, mover: Mover, shut: np.ndarray, q_open: np.ndarray, name: str
    ) -> list[_Piece]:
        T = mover.T_world_object
        mover.let_touch()
        opening = np.array([shut, q_open])
        self._prove(mover, opening, f"opening the {who}'s hand")
        pre, line = self._line_to(mover, q_open, f"the {who}'s retreat")
        mover.put_object(T)
        back = self._reach(who, mover, self.home[who], pre, f"the {who}'s way home")
        return [
            _Piece(name, who, opening, False),
            _Piece("retreat", who, np.vstack([line[::-1], back[::-1][1:]]), False),
        ]

    # --- pieces -------------------------------------------------------------------

    def _line_to(
        self, mover: Mover, q_open: np.ndarray, what: str
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return where a straight line of the palm to q begins, and its corners.

        The hand may touch the object on the line, and not where it begins.
        """
        T, trouble = mover.T_world_object, ""
        away = -mover.palm(q_open)[:3, 2]
        for share in _SHORTER:
            line = self._line(mover, q_open, away, share * self.settings.back)
            if line is None:
                trouble = "the arm cannot follow it"
                continue
            mover.put_object(T)
            trouble = mover.why(line[-1])
            if trouble is None:
                mover.let_touch()
                trouble = self._blocked(mover, line)
                if trouble is None:
                    return line[-1], line[::-1]
        raise Blocked(f"no straight line for {what}: {trouble}")

    def _line(
        self, mover: Mover, q: np.ndarray, direction: np.ndarray, distance: float
    ) -> np.ndarray | None:
        """Follow a straight line of the palm from q; None: the arm cannot."""
        limb, n = mover.limb, mover.limb.n_arm
        arrays, work = limb.chain.arrays, descent_of(limb.chain.arrays)
        trial, T = np.zeros(n), mover.palm(q)
        steps = max(1, int(np.ceil(distance / self.settings.line)))
        corners = [np.array(q, float)]
        for k in range(1, steps + 1):
            at = T.copy()
            at[:3, 3] += direction * distance * k / steps
            work.q[:] = corners[-1][:n]
            goal = _ERROR, 30.0
            if not descend(arrays, mover.target(at), _SCALE, goal, work, trial):
                return None
            if np.abs(work.q - corners[-1][:n]).max() > 0.35:
                return None
            corners.append(np.concatenate([work.q, q[n:]]))
        return np.array(corners)

    def _lift(self, mover: Mover, q: np.ndarray) -> np.ndarray:
        """Return the corners of a lift straight up from q."""
        up = np.array([0.0, 0.0, 1.0])
        for share in _SHORTER:
            line = self._line(mover, q, up, share * self.settings.lift)
            if line is not None and self._blocked(mover, line) is None:
                return line
        raise Blocked("the object cannot be lifted from, or put on, what carries it")

    def _reach(
        self, who: str, mover: Mover, home: np.ndarray, pre: np.ndarray, what: str
    ) -> np.ndarray:
        """Return a path from where an arm waits: first the hand, then the arm."""
        ready = _with_hand(mover.limb, home, pre[mover.limb.n_arm :])
        path = self._between(who, mover, ready, pre, what)
        if np.abs(ready - home).max() > _SAME:
            self._prove(mover, np.array([home, ready]), what)
            path = np.vstack([home, path])
        return path

    def _between(
        self, who: str, mover: Mover, q_from: np.ndarray, q_to: np.ndarray, what: str
    ) -> np.ndarray:
        """Return a proved path between two postures."""
        limb, trees, settings = mover.limb, self._trees[who], self.settings
        for q in (q_from, q_to):
            trouble = mover.why(q)
            if trouble:
                raise Blocked(f"{what}: an end of it is blocked, {trouble}")
        limits = np.stack([limb.lower, limb.upper], axis=1)
        found = kernels.connect(
            mover.space, trees, q_from, q_to, limits, limb.n_arm, settings.budget,
            TOLERANCE, mover.scratch,
        )  # fmt: skip
        self.tested += int(trees.tests[0])
        if not found:
            raise Blocked(f"{what}: no path within {settings.budget} motions")
        kernels.shorten(mover.space, trees, settings.shorten, TOLERANCE, mover.scratch)
        path = trees.route[: trees.corners[0]].copy()
        keep = np.r_[True, np.abs(np.diff(path, axis=0)).max(axis=1) > _SAME]
        path = path[keep]
        if len(path) == 1:
            path = np.vstack([path, path])
        self._prove(mover, path, what)
        return path

    def _blocked(self, mover: Mover, path: np.ndarray) -> str | None:
        for a, b in zip(path[:-1], path[1:], strict=True):
            self.tested += 1
            trouble = mover.motion_blocked(a, b)
            if trouble:
                return trouble
        return None

    def _prove(self, mover: Mover, path: np.ndarray, what: str) -> None:
        trouble = self._blocked(mover, path)
        if trouble:
            raise Blocked(f"{what}: {trouble}")


def home_of(placed: PlacedAgent, limb: Limb) -> np.ndarray:
    """Return where an arm and its hand wait, (dof,)."""
    q = np.array([placed.joints[name] for name in limb.joints])
    return np.clip(q, limb.lower, limb.upper)


def _with_hand(limb: Limb, q: np.ndarray, fingers: np.ndarray) -> np.ndarray:
    return np.concatenate([q[: limb.n_arm], fingers])


def _trees(dof: int) -> kernels.Trees:
    return kernels.Trees(
        q=np.zeros((2, _BRANCHES, dof)),
        parent=np.zeros((2, _BRANCHES), np.int64),
        count=np.zeros(2, np.int64),
        route=np.zeros((_CORNERS, dof)),
        corners=np.zeros(1, np.int64),
        tests=np.zeros(1, np.int64),
        sample=np.zeros((3, dof)),
    )


@dataclass(frozen=True, eq=False)
class _Limits:
    """What timing reads of a robot."""

    name: str
    joint_names: tuple[str, ...]
    dof: int
    lower: np.ndarray
    upper: np.ndarray
    continuous: np.ndarray
    max_velocity: np.ndarray
    max_acceleration: np.ndarray
    max_jerk: np.ndarray


def timed(
    pieces: list[_Piece], pair: Pair, chosen: Tuple, begin: float = 0.0
) -> tuple[PlannedMotion, ...]:
    """Time pieces one after the other, within all limits of their joints.

    The arm stops in every corner, so that what is executed is what was proved.
    """
    motions, held = [], {
        "giver": _inverse(pair.of_giver, chosen.grasp_giver),
        "receiver": _inverse(pair.of_receiver, chosen.grasp_receiver),
    }  # fmt: skip
    for piece in pieces:
        limb = (pair.giver if piece.who == "giver" else pair.receiver).limb
        limits = _Limits(
            limb.model.description.name, limb.joints, limb.dof, limb.lower, limb.upper,
            np.zeros(limb.dof, bool), limb.max_velocity, limb.max_acceleration,
            limb.max_jerk,
        )  # fmt: skip
        motion = time_path(limits, piece.path, blend=0.0)
        T = held[piece.who] if piece.holds else None
        motions.append(
            PlannedMotion(
                piece.name, piece.who, limb.joints, motion, begin, piece.holds, T
            )
        )
        begin += motion.duration
    return tuple(motions)


def _inverse(grasps: GraspSet, g: int) -> np.ndarray:
    return np.linalg.inv(grasps.T_object_palm[g])
