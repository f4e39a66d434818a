"""From a motion in use to another path: without a step, at best without a stop."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from roadmap.errors import BadInput
from roadmap.kinematics.forward import difference
from roadmap.motion.stopping import settled
from roadmap.motion.timed_path import NEAR, check_scale, unwound
from roadmap.motion.timing import NoProfile, State
from roadmap.robot.robot import Robot

if TYPE_CHECKING:
    from roadmap.motion.motion import Motion


class Commit(NamedTuple):
    """A place ahead on a motion at which another path may begin.

    Attributes:
        q: (dof,) configuration.
        s: Its arc length on the motion's way.
        begin: When the motion must begin to stop in order to stand there [s].
    """

    q: np.ndarray
    s: float
    begin: float = 0.0


def joined(
    motion: "Motion",
    t: float,
    commit: Commit,
    path: np.ndarray,
    blend: float,
    speed_scale: float | None,
) -> "Motion":
    """Return the motion that leaves another one for a path; see `Motion.join`.

    The way is kept up to the last corner that both have in common.
    """
    present = motion._way
    path = _from_commit(present.robot, commit, path)
    state = motion._state(t)
    scale = motion.speed_scale if speed_scale is None else speed_scale
    check_scale(scale)
    kept, corner_s = present.along(commit.s, path)
    if kept and kept + 1 == len(path) and corner_s == present.turns[-1].s:
        return motion.rescaled(t, scale)
    # a little of what is behind stays: the state must lie on a piece of its own
    behind = state.s - 10.0 * NEAR
    if kept:
        before, path = present.to_corner(behind, corner_s), path[kept:]
        same = before.pieces[-1].begin
    else:
        before, same = present.part(behind, commit.s), commit.s
    room = corner_s - settled(present, state) if before.pieces else 0.0
    for share in (1.0, 0.0):
        way = before.joined(path, corner_s, blend, share * room)
        try:
            return motion._go_on(t, way, scale, same)
        except NoProfile:
            continue
    # no way on without a stop: at the commit point or before, then on from rest
    halt = motion._stop_later(t, max(t, commit.begin))
    if halt._end > commit.s + 1e-6:
        halt = motion.stop(t)
    rest = State(min(halt._end, commit.s), 0.0, 0.0)
    way = before.joined(path, corner_s, blend, corner_s - rest.s)
    return halt._then(motion._timed(way, rest, scale), way)


def _from_commit(robot: Robot, commit: Commit, path: np.ndarray) -> np.ndarray:
    """Return the path checked, unwound, and begun at the very commit point."""
    path = unwound(robot, path)
    path = path + (commit.q - difference(robot, commit.q, path[0]) - path[0])
    off = np.abs(path[0] - commit.q).max()
    if off > 1e-6:
        raise BadInput(
            f"the path begins {off:g} rad or m beside the commit point; "
            "plan it from there"
        )
    path[0] = commit.q
    return path
