"""The quickest stop along the way of a motion."""

from typing import TYPE_CHECKING

from roadmap.motion.timed_path import NEAR, Way
from roadmap.motion.timing import NoProfile, Phase, Profiles, State, passing

if TYPE_CHECKING:
    from roadmap.motion.motion import Motion

_OVER = 4  # pieces that a stop may lead over


def quickest_stop(motion: "Motion", t: float) -> Profiles:
    """Return the profiles of a stop from time `t` on; at worst as planned to the end.

    It begins and ends on one piece of the way; or leads over some more, by the least of
    their limits; or goes on as planned to the end of a piece. The shortest is taken.
    """
    way, begin = motion._way, motion._state(t)
    found = []
    for over in (False, True):
        try:
            profiles = _stopped(motion, t, over)
        except NoProfile:
            continue
        found.append(profiles)
        k = way.index_of(begin)
        if not way.pieces or profiles.state.s <= way.pieces[k].end:
            break
    if found:
        return min(found, key=_ends)
    profiles = Profiles(begin)
    motion._finish(profiles, t)
    return profiles


def _stopped(motion: "Motion", t: float, over: bool) -> Profiles:
    """Return a stop by the limits of the pieces on the way.

    With `over` it may begin on one piece and end on a later one; else it goes on as
    planned to the end of a piece that is too short.
    """
    way, end = motion._way, motion._end
    profiles = Profiles(motion._state(t))
    while profiles.state.v > 0.0 or profiles.state.a != 0.0:
        k = way.index_of(profiles.state)
        if _stop_within(way, profiles, k, k, end):
            break
        if way.pieces[k].end >= end - NEAR:
            motion._finish(profiles, t + profiles.t)
            break
        if over and _stop_over(way, profiles, k, end):
            break
        motion._repeat(profiles, t + profiles.t, way.pieces[k].end)
        if way.index_of(profiles.state) <= k:
            raise NoProfile(f"the end of piece {k} leads to no further one")
    return profiles


def _stop_over(way: Way, profiles: Profiles, k: int, end: float) -> bool:
    """Stop from piece k on behind its end; False where a limit forbids it."""
    for last in range(k + 1, min(k + 1 + _OVER, len(way.pieces))):
        if way.corners[last]:
            return False
        if _stop_within(way, profiles, k, last, end):
            return True
    return False


def _stop_within(way: Way, profiles: Profiles, k: int, last: int, end: float) -> bool:
    """Stop by what all of the pieces k..last allow, if that is on them."""
    begun, state, n = profiles.t, profiles.state, len(profiles.phases)
    j = way.j[k] if k == last else min(way.j[k : last + 1])
    fastest = state.v + max(state.a, 0.0) ** 2 / (2.0 * j)
    slowing = [way.slowing(piece, fastest) for piece in range(k, last + 1)]
    profiles.to_rest(min(slowing), j)
    end = min(way.pieces[last].end, end) + NEAR
    if profiles.state.s <= end and _enters(way, profiles.phases[n:], k, slowing):
        return True
    profiles.t, profiles.state = begun, state
    del profiles.phases[n:]
    return False


def _enters(way: Way, phases: list[Phase], k: int, slowing: list[float]) -> bool:
    """Whether phases come into the pieces behind k within their limits."""
    for piece, most in enumerate(slowing[1:], k + 1):
        v, a = passing(phases, way.pieces[piece].begin)
        fastest = min(way.swift[piece], way.turning[piece])
        if v > (1.0 + 1e-9) * fastest or abs(a) > (1.0 + 1e-9) * most:
            return False
    return True


def settled(way: Way, state: State) -> float:
    """Return the arc length at which the acceleration of a state has ended."""
    k = way.index_of(state)
    profiles = Profiles(state)
    natural = state.v + state.a * abs(state.a) / (2.0 * way.j[k])
    profiles.to_speed(max(natural, 0.0), way.a[k], way.j[k])
    return profiles.state.s


def _ends(profiles: Profiles) -> float:
    return profiles.t
