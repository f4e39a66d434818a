"""The quickest stop along the path of a motion."""

from roadmap.motion.blended_path import NEAR, BlendedPath
from roadmap.motion.timing import (
    NoProfile,
    Phase,
    ProfileBuilder,
    SpeedProfile,
    State,
    after,
    passing,
)

_OVER = 4  # pieces that a stop may lead over
_LATER = 1e-6  # [s] a stop that ends so little later than as planned is taken


def quickest_stop(path: BlendedPath, profile: SpeedProfile, t: float) -> SpeedProfile:
    """Return a stop from time `t` of a profile on; at worst where it rests as planned.

    It begins and ends on one piece of the path; or leads over some more, by the least
    of their limits; or goes on as planned to the end of a piece, or to where the
    profile rests next. The shortest is taken.
    """
    begin = profile.state(t)
    here = path.pieces[path.index_of(begin)].end if path.pieces else begin.s
    found = []
    for over in (False, True):
        try:
            builder = _stopped(path, profile, t, begin, over)
        except NoProfile:
            continue
        found.append(builder)
        if builder.state.s <= here:
            break
    quickest = min(found, key=lambda builder: builder.t, default=None)
    if quickest is not None and t + quickest.t <= profile.rest_after(t) + _LATER:
        return quickest.profile()
    builder = ProfileBuilder(begin)
    builder.finish(profile, t)
    return builder.profile()


def stop_later(
    path: BlendedPath, profile: SpeedProfile, t: float, begin: float
) -> SpeedProfile:
    """Return the profile from `t` on that goes on as planned, and stops at `begin`."""
    stop = quickest_stop(path, profile, begin)
    phases = []
    ends = [phase.t for phase in profile.phases[1:]] + [begin]
    for phase, end in zip(profile.phases, ends, strict=True):
        end = min(end, begin)
        here = max(t, phase.t)
        if here < end:
            phases.append(Phase(here - t, *after(phase, here - phase.t), phase.j))
    phases += [p._replace(t=p.t + begin - t) for p in stop.phases]
    return SpeedProfile(tuple(phases), begin - t + stop.duration, stop.end)


def _stopped(
    path: BlendedPath, profile: SpeedProfile, t: float, begin: State, over: bool
) -> ProfileBuilder:
    """Return a stop from the state at time t, by the limits of the pieces on its path.

    With `over` it may begin on one piece and end on a later one; else it goes on as
    planned to the end of a piece that is too short.
    """
    builder = ProfileBuilder(begin)
    while builder.state.v > 0.0 or builder.state.a != 0.0:
        k = path.index_of(builder.state)
        if _stop_within(path, builder, k, k, profile.end):
            break
        if path.pieces[k].end >= profile.end - NEAR:
            builder.finish(profile, t + builder.t)
            break
        if over and _stop_over(path, builder, k, profile.end):
            break
        builder.repeat(profile, t + builder.t, path.pieces[k].end)
        if path.index_of(builder.state) <= k:
            raise NoProfile(f"the end of piece {k} leads to no further one")
    return builder


def _stop_over(path: BlendedPath, builder: ProfileBuilder, k: int, end: float) -> bool:
    """Stop from piece k on behind its end; False where a limit forbids it."""
    for last in range(k + 1, min(k + 1 + _OVER, len(path.pieces))):
        if path.stops[last]:
            return False
        if _stop_within(path, builder, k, last, end):
            return True
    return False


def _stop_within(
    path: BlendedPath, builder: ProfileBuilder, k: int, last: int, end: float
) -> bool:
    """Stop by what all of the pieces k..last allow, if that is on them."""
    begun, state, n = builder.t, builder.state, len(builder.phases)
    j = min(path.j[k : last + 1].tolist())
    fastest = state.v + max(state.a, 0.0) ** 2 / (2.0 * j)
    slowing = [path.slowing(piece, fastest) for piece in range(k, last + 1)]
    builder.to_rest(min(slowing), j)
    end = min(path.pieces[last].end, end) + NEAR
    if builder.state.s <= end and _enters(path, builder.phases[n:], k, slowing):
        return True
    builder.t, builder.state = begun, state
    del builder.phases[n:]
    return False


def _enters(
    path: BlendedPath, phases: list[Phase], k: int, slowing: list[float]
) -> bool:
    """Whether phases come into the pieces behind k within their limits."""
    for piece, most in enumerate(slowing[1:], k + 1):
        v, a = passing(phases, path.pieces[piece].begin)
        fastest = path.fastest(piece)
        if v > (1.0 + 1e-9) * fastest or abs(a) > (1.0 + 1e-9) * most:
            return False
    return True
