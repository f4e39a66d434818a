"""From a motion in use to another speed or path: no step, at best no stop."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from roadmap.errors import BadInput
from roadmap.kinematics.forward import difference
from roadmap.motion.blended_path import NEAR, BlendedPath, unwound
from roadmap.motion.retiming import retimed, timed
from roadmap.motion.stopping import quickest_stop, stop_later
from roadmap.motion.timing import NoProfile, ProfileBuilder, SpeedProfile, State
from roadmap.robot.robot import Robot


class Commit(NamedTuple):
    """A place ahead on a motion at which another path may begin.

    Attributes:
        q: (dof,) configuration.
        s: Its arc length on the motion's path [rad or m of joint space].
        begin: When the motion must begin to stop in order to stand there [s].
    """

    q: np.ndarray
    s: float
    begin: float = 0.0


def rescaled(
    path: BlendedPath, profile: SpeedProfile, t: float, scale: float
) -> SpeedProfile:
    """Return the rest of a profile from `t` on at another share of the speed limits."""
    try:
        return retimed(profile, t, path, scale)
    except NoProfile:  # from rest it always goes on
        stop = quickest_stop(path, profile, t)
        return stop.then(timed(path, State(stop.end, 0.0, 0.0), scale))


def joined(
    present: BlendedPath,
    profile: SpeedProfile,
    t: float,
    commit: Commit,
    corners: np.ndarray,
    blend: float,
    scale: float,
    robot: Robot | None = None,
) -> tuple[BlendedPath, SpeedProfile]:
    """Return path and profile that leave a motion for new corners; see `Motion.join`.

    The present path is kept up to the last corner that both have in common, but no
    corner that was rounded for a robot with something else in its hand.
    """
    corners = _from_commit(present.robot, commit, corners)
    state = profile.state(t)
    kept, corner_s = present.along(commit.s, corners)
    if robot is not None and robot is not present.robot:
        present, kept, corner_s = replace(present, robot=robot), 0, commit.s
    if kept and kept + 1 == len(corners) and corner_s == present.corners[-1].s:
        return present, rescaled(present, profile, t, scale)
    # a little of what is behind stays: the state must lie on a piece of its own
    behind = state.s - 10.0 * NEAR
    if kept:
        before, corners = present.to_corner(behind, corner_s), corners[kept:]
        same_until = before.pieces[-1].begin
    else:
        before, same_until = present.part(behind, commit.s), commit.s
    available = corner_s - _steady_from(present, state) if before.pieces else 0.0
    for share in (1.0, 0.0):
        path = before.joined(corners, corner_s, blend, share * available)
        try:
            return path, retimed(profile, t, path, scale, same_until)
        except NoProfile:
            continue
    # not without a stop: at the commit point or before, then on from rest
    stop = stop_later(present, profile, t, max(t, commit.begin))
    if stop.end > commit.s + 1e-6:
        stop = quickest_stop(present, profile, t)
    rest = State(min(stop.end, commit.s), 0.0, 0.0)
    path = before.joined(corners, corner_s, blend, corner_s - rest.s)
    return path, stop.then(timed(path, rest, scale))


def _from_commit(robot: Robot, commit: Commit, corners: np.ndarray) -> np.ndarray:
    """Return the corners checked, unwound, and begun at the very commit point."""
    corners = unwound(robot, corners)
    shift = commit.q - difference(robot, commit.q, corners[0]) - corners[0]
    corners = corners + shift
    off = np.abs(corners[0] - commit.q).max()
    if off > 1e-6:
        raise BadInput(
            f"the path begins {off:g} rad or m beside the commit point; "
            "plan it from there"
        )
    corners[0] = commit.q
    return corners


def _steady_from(path: BlendedPath, state: State) -> float:
    """Return the arc length at which the acceleration of a state has ended."""
    k = path.index_of(state)
    builder = ProfileBuilder(state)
    builder.to_speed(max(path.steady_speed(state), 0.0), path.a[k], path.j[k])
    return builder.state.s
