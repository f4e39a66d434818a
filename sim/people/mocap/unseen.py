"""What is known of a joint or a capsule while it is not seen: memory, then growth."""

import numpy as np

BRIDGE_S = 0.1  # gaps up to this are crossed on a straight line [s]
GROW_LIMIT = 0.30  # most a remembered capsule grows with age [m]
WALKING = 1.6  # speed of an unseen person at least [m/s] [ISO 13855]


def bridge(place: np.ndarray, rate_hz: float) -> np.ndarray:
    """Return the track with its gaps of up to `BRIDGE_S` crossed on straight lines.

    Args:
        place: (F, 3) [m], NaN where it is not seen.
        rate_hz: Frames per second.
    """
    filled = place.copy()
    seen = np.flatnonzero(np.isfinite(place[:, 0]))
    longest = int(BRIDGE_S * rate_hz + 1e-6)
    for a, b in zip(seen[:-1], seen[1:], strict=True):
        if 1 < b - a <= longest + 1:
            share = (np.arange(a + 1, b) - a)[:, None] / (b - a)
            filled[a + 1 : b] = place[a] + share * (place[b] - place[a])
    return filled


def smooth(place: np.ndarray, rate_hz: float, window_s: float) -> np.ndarray:
    """Return a track (F, 3) averaged over a window, centred, shorter beside gaps.

    Places [m] are NaN where not seen; a window under three frames long does nothing.
    """
    reach = int(window_s * rate_hz / 2)
    seen = np.isfinite(place[:, 0])
    known = np.flatnonzero(seen)
    if reach < 1 or not len(known):
        return place
    edges = np.flatnonzero(np.diff(np.r_[False, seen, False].astype(int)))
    run = np.searchsorted(edges, known, side="right") - 1
    half = np.minimum(known - edges[run], edges[run + 1] - 1 - known).clip(max=reach)
    total = np.cumsum(
        np.r_[np.zeros((1, 3)), np.where(seen[:, None], place, 0)], axis=0
    )
    averaged = place.copy()
    sums = total[known + half + 1] - total[known - half]
    averaged[known] = sums / (2 * half + 1)[:, None]
    return averaged


def remember(
    place: np.ndarray, rate_hz: float, round_trip: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give a joint that is seen at least once a place in every frame (F, 3) [m].

    Returns where it was seen last, (F, 3) [m]; the same with gaps crossed on straight
    lines; and the time since it was seen, (F,) [s]. Before the first sight, the place
    that comes stands for it. In a round trip the frame after the last is the first one.
    """
    n = len(place)
    if round_trip:  # the round before is what it remembers at the start
        place = np.concatenate([place, place, place])
    seen = np.flatnonzero(np.isfinite(place[:, 0]))
    frames = np.arange(len(place))
    guess = np.stack([np.interp(frames, seen, place[seen, k]) for k in range(3)], 1)
    last = seen[np.maximum(np.searchsorted(seen, frames, side="right") - 1, 0)]
    age = np.abs(frames - last) / rate_hz
    middle = slice(n, 2 * n) if round_trip else slice(0, n)
    return place[last][middle], guess[middle], age[middle]


def displacement(capsules: np.ndarray, round_trip: bool) -> np.ndarray:
    """Return (F, k) or (F - 1, k) how far an end of each capsule goes to the next [m].

    Args:
        capsules: (F, k, 7) ends a, b, radius [m].
        round_trip: The frame after the last is the first one.
    """
    ends = capsules[:, :, :6].reshape(*capsules.shape[:2], 2, 3)
    after = np.concatenate([ends[1:], ends[:1]]) if round_trip else ends[1:]
    before = ends if round_trip else ends[:-1]
    return np.linalg.norm(after - before, axis=3).max(axis=2)


def growth(
    age_s: np.ndarray, moved: np.ndarray, rate_hz: float, speed: float
) -> np.ndarray:
    """Return how much each capsule is grown in each frame, (F, k) [m].

    By age times speed up to `GROW_LIMIT`, and at least so much that the capsule holds
    the place where it is seen next: no capsule then advances faster than `speed`.

    Args:
        age_s: (F, k) age of the oldest joint that places the capsule [s].
        moved: From `displacement`: (F, k) on a round trip, else (F - 1, k) [m].
        rate_hz: Frames per second.
        speed: Speed bound of the person [m/s].
    """
    grown = np.minimum(age_s * speed, GROW_LIMIT)
    n, n_moves = len(grown), len(moved)
    excess = moved - speed / rate_hz
    for i in range(2 * n_moves - 1, -1, -1) if n_moves == n else range(n - 2, -1, -1):
        i %= n
        after = grown[(i + 1) % n]
        grown[i] = np.maximum(grown[i], after + excess[i])
    return grown
