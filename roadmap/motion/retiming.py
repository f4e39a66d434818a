"""Time along a path: from a state on it, or from a profile in use, without a step."""

import math
from itertools import pairwise

import numpy as np

from roadmap.motion.blended_path import NEAR, SAME, BlendedPath
from roadmap.motion.timing import (
    NoProfile,
    ProfileBuilder,
    SpeedProfile,
    State,
    fill,
    junction_speeds,
)

_SHARES = (1.0, 0.75, 0.5, 0.25, 0.1, 0.0)  # of a speed, tried one after the other


def timed(path: BlendedPath, state: State, scale: float) -> SpeedProfile:
    """Return the quick profile from a state to the end of its path; or NoProfile.

    `scale` is the share of the velocity limits, in (0, 1]. There is none where the
    state is too fast for what lies ahead.
    """
    if not path.pieces:
        return ProfileBuilder(State(state.s, 0.0, 0.0)).profile()
    k = path.index_of(state)
    limits = np.minimum(scale * path.joint_speed, path.turning_speed)[k:].tolist()
    ends = [float(p.end) for p in path.pieces[k:]]
    a, j = path.a[k:].tolist(), path.j[k:].tolist()
    stops = path.stops[k:].tolist()
    stops[0] = False  # the corner behind it is passed
    steady = path.steady_speed(state)
    if max(state.v, steady) > (1.0 + 1e-6) * path.fastest(k):
        raise NoProfile(f"{state.v} is too fast for the piece ahead")
    wanted = max(0.0, min(steady, limits[0]))
    for share in _SHARES:
        builder = ProfileBuilder(state)
        v = share * wanted
        if state.a != 0.0 or abs(v - state.v) > SAME:
            builder.to_speed(v, a[0], j[0])
        s = builder.state.s
        if s > ends[0] + NEAR:
            continue
        left = [s, *(max(end, s) for end in ends)]
        lengths = [end - begin for begin, end in pairwise(left)]
        speeds = junction_speeds(lengths, limits, stops, a, j)
        if v > speeds[0] + SAME:
            continue
        fill(builder, ends, limits, speeds, a, j)
        return builder.profile()
    raise NoProfile(f"the state {state} leaves no time to slow down")


def retimed(
    profile: SpeedProfile,
    t: float,
    path: BlendedPath,
    scale: float,
    same_until: float = math.inf,
) -> SpeedProfile:
    """Time a path anew from the state of a profile at `t`, or from a later piece on.

    `path` is the profile's own up to arc length `same_until` [rad or m of joint space];
    `scale` is the share of the velocity limits, in (0, 1]. NoProfile where it is too
    fast for what lies ahead.
    """
    head = ProfileBuilder(profile.state(t))
    while True:
        try:
            return head.profile().then(timed(path, head.state, scale))
        except NoProfile:
            k = path.index_of(head.state)
            end = path.pieces[k].end
            if end > same_until + SAME:
                raise
            head.repeat(profile, t + head.t, end)
            # the profile may pass there what is a sharp corner of this path
            passes = path.stops[k + 1] and head.state.v > SAME
            if passes or path.index_of(head.state) <= k:
                raise
