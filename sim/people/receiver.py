"""The receiver of a hand-over plan as a person of the loop: moves as the plan says."""

from collections.abc import Mapping

import numpy as np

from handover.plans.limb import AgentModel, Part, agent_model
from roadmap.errors import BadInput
from roadmap.transforms import moved_points, rotation_rpy

REACH = "approach"  # the motion that brings the receiver's hand to the object
_TURN = np.radians(1.0) / 0.01  # [rad/m] that it is turned where it stands elsewhere
_RATE_HZ = 100.0  # at which the speed of the surface is looked at
_FASTER = 1.05  # than between two such looks, at most
_SHORTEST, _AFTER = 10.0, 5.0  # [s] a run, and what follows the receiver's reach


class PlannedReceiver:
    """The receiver's bodies as closed capsules; a `HumanMotion` in the giver's frame.

    Its clock begins when the plan's giver begins to carry. It reaches for the object as
    the plan says, and waits where its hand begins to close in: to take is contact by
    intent.

    Args:
        record: The plan, see `handover.scenes.plan_file`.
        early_s: It reaches by so much sooner than planned [s]; negative: later.
        aside: It stands elsewhere, by up to so much along the floor [m], and is turned
            by up to a degree for each centimetre of that.
        seed: What place and turn are drawn with.

    Attributes:
        name: Of the motion.
        max_speed: No point of the surface moves faster [m/s].
        duration_s: A run of it [s].
        reach_s: When it begins to reach, and when its hand is there [s].
        notes: What a reader should know.

    Raises:
        BadInput: A plan whose receiver does not reach, or whose giver does not carry.
    """

    def __init__(
        self, record: Mapping, early_s: float = 0.0, aside: float = 0.0, seed: int = 0
    ) -> None:
        receiver = record["receiver"]
        self._model = agent_model(receiver["urdf"])
        self._joints = dict(receiver["joints"])
        moves = motion_of(record, "receiver", REACH)
        self._names, self._times = tuple(moves["joints"]), np.array(moves["times"])
        self._rows = np.array(moves["positions"], float)
        carry = motion_of(record, "giver", "carry")
        self._begin = carry["times"][0] + early_s  # of the run, on the plan's clock
        T_world_base = np.array(receiver["T_world_base"])
        stands = elsewhere(T_world_base, aside, seed)
        T_giver = np.array(record["giver"]["T_world_base"])
        self._T = np.linalg.inv(T_giver) @ stands
        self._a, self._b, self._radius = capsules_of(self._model)
        self._body = np.array([part.body for part in self._model.parts])
        self.name = f"plan {record['scene']['name']} {record['scene']['seed']}"
        begin, end = self._times[[0, -1]] - self._begin
        self.reach_s = max(0.0, float(begin)), max(0.0, float(end))
        self.duration_s = max(_SHORTEST, self.reach_s[1] + _AFTER)
        self.notes = _notes(early_s, stands, T_world_base)
        self.max_speed = self._fastest()

    def capsules(self, t: float) -> np.ndarray:
        """Return the receiver at time `t` [s] as (k, 7) capsules a, b, radius [m]."""
        now, times = t + self._begin, self._times
        k = int(np.clip(np.searchsorted(times, now), 1, len(times) - 1))
        share = np.clip((now - times[k - 1]) / (times[k] - times[k - 1]), 0.0, 1.0)
        row = self._rows[k - 1] + share * (self._rows[k] - self._rows[k - 1])
        joints = self._joints | dict(zip(self._names, row.tolist(), strict=True))
        frames = self._model.frames(joints)[self._body]
        R = self._T[:3, :3] @ frames[:, :9].reshape(-1, 3, 3)
        p = moved_points(frames[:, 9:], self._T)
        ends = [(R @ x[:, :, None])[:, :, 0] + p for x in (self._a, self._b)]
        return np.hstack([*ends, self._radius[:, None]])

    def _fastest(self) -> float:
        """Return a bound on the speed of the surface [m/s].

        Both ends of a capsule move by more than any point between them.
        """
        begin, end = self.reach_s
        times = np.arange(begin, end + 1.0 / _RATE_HZ, 1.0 / _RATE_HZ)
        rows = np.array([self.capsules(t)[:, :6] for t in times])
        rows = rows.reshape(len(times), -1, 3)
        far = np.linalg.norm(np.diff(rows, axis=0), axis=2).max(initial=0.0)
        return float(_FASTER * far * _RATE_HZ)


def motion_of(record: Mapping, who: str, name: str) -> Mapping:
    """Return a motion of a plan's record, of an agent, by name."""
    for motion in record["motions"]:
        if (motion["who"], motion["name"]) == (who, name):
            return motion
    there = ", ".join(m["name"] for m in record["motions"] if m["who"] == who)
    raise BadInput(
        f"the plan's {who} has no motion {name!r}, only {there or 'none'}; make the "
        "plan with `odm handover plan SCENE --json FILE`"
    )


def elsewhere(T_world_base: np.ndarray, aside: float, seed: int) -> np.ndarray:
    """Return where somebody stands who is drawn elsewhere, (4, 4) [m].

    They are moved by up to `aside` along x and y [m], and turned by up to a degree for
    each centimetre of that.
    """
    x, y, turn = np.random.default_rng(seed).uniform(-aside, aside, 3)
    T = np.array(T_world_base, float)
    T[:3, :3] = rotation_rpy(0.0, 0.0, _TURN * turn) @ T[:3, :3]
    T[:2, 3] += x, y
    return T


def capsules_of(model: AgentModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return ends (k, 3), (k, 3) and radii (k,) of capsules round an agent's parts [m].

    Balls and capsules are what they are; other parts lie within theirs. Body frames.
    """
    found = [_round(part) for part in model.parts]
    a, b, radius = (np.array(some, float) for some in zip(*found, strict=True))
    return a, b, radius


def _round(part: Part) -> tuple[np.ndarray, np.ndarray, float]:
    points = part.points
    if len(points) <= 2:
        return points[0], points[-1], part.radius
    center = points.mean(axis=0)
    axis = np.linalg.svd(points - center)[2][0]
    along = (points - center) @ axis
    off = np.linalg.norm(points - center - np.outer(along, axis), axis=1).max()
    low, high = along.min() + off, along.max() - off
    if low > high:
        low = high = 0.5 * (low + high)
    near = np.clip(along, low, high)[:, None] * axis + center
    radius = np.linalg.norm(points - near, axis=1).max() + part.radius
    return center + low * axis, center + high * axis, float(radius) + 1e-9


def _notes(early_s: float, stands: np.ndarray, planned: np.ndarray) -> tuple[str, ...]:
    notes = []
    if early_s:
        notes.append(
            f"the receiver reaches {abs(early_s):g} s "
            f"{'sooner' if early_s > 0 else 'later'} than planned"
        )
    moved = 100.0 * float(np.linalg.norm(stands[:2, 3] - planned[:2, 3]))
    if moved:
        notes.append(f"the receiver stands {moved:.1f} cm from where it was planned")
    return tuple(notes)
