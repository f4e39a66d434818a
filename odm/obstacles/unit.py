"""Whether points can be places in metres; if not, why a frame of them is of no use.

Numbers in a wrong unit look like an empty room, since all of them lie outside the grid,
and so do those of a camera that gives nothing. Asked of a frame's points by
`odm/frame/sensor_watch.py`, and of a cloud's before its crop by `point_cloud.py`.
"""

from collections.abc import Callable

import numpy as np

MAX_RANGE_M = 20.0  # nothing of a robot's cell is farther away
# from so far a median distance on [m] it looks like these, and this many make a metre
_UNITS = ((200.0, "millimetres", 1000), (20.0, "centimetres", 100))
FROM_BASE = "from the robot's base"


def not_finite(n: int) -> str:
    """Return the sentence about `n` points that are NaN or infinite."""
    return (
        f"{n} obstacle points are NaN or infinite, so the person may be "
        "anywhere; check the sensor"
    )


def largest_coordinates(points: np.ndarray) -> np.ndarray:
    """Return how far each of (n, 3) points is away along an axis, (n,) [m]."""
    return np.abs(points).max(axis=1)


def too_far_off(
    n: int,
    n_beyond: int,
    limit: float,
    middle: Callable[[], float],
    whence: str = FROM_BASE,
) -> str | None:
    """Return why points are no places in metres of a robot's cell, or None.

    No more than half of the n points may be farther off than `limit` [m]; n_beyond are,
    from `whence`. `middle` returns their median distance [m], where it is asked.
    """
    if 2 * n_beyond <= n:
        return None
    far = middle()
    for least, unit, many in _UNITS:
        if far >= least:
            unit = f"these look like {unit}: divide by {many}"
            break
    else:
        unit = "give metres"
    return (
        f"most of the {n} obstacle points are more than {limit:g} m {whence}, "
        f"{far:.3g} m in the middle; {unit}, or raise max_range_m"
    )
