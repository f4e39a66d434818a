"""Set-points as plain data for other programs: CSV, and the layout of ROS messages.

Neither ROS nor its message classes are needed: `json.dumps` or `yaml.safe_dump` write
the data as it is.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from roadmap.builds.unfinished import beside
from roadmap.errors import BadInput
from roadmap.ranges import check_path, is_between

_MOST = 10_000_000  # rows


def sample_times(duration: float, rate_hz: float) -> np.ndarray:
    """Return (n,) times [s] from 0 to the end, evenly but for the last step."""
    if not is_between(rate_hz, 1e-6, 1e6):
        raise BadInput(
            f"the rate is {rate_hz!r} Hz, but must be a number from 1e-06 to 1e+06; "
            "give the rate of the controller, such as 100"
        )
    # the end is a row of its own, unless a row falls on it
    n = math.ceil(duration * rate_hz - 1e-9)
    if n >= _MOST:
        raise BadInput(
            f"{duration:.1f} s at {rate_hz:g} Hz are {n} rows, more than {_MOST}; "
            "give a lower rate"
        )
    return np.append(np.arange(n) / rate_hz, duration)


def as_joint_trajectory(
    joint_names: Sequence[str], times: np.ndarray, points: Sequence[np.ndarray]
) -> dict:
    """Return set-points in the layout of ROS's trajectory_msgs/JointTrajectory.

    Arguments as of `write_csv`; the result as of `Motion.to_joint_trajectory`.
    """
    listed = []
    for t, *rows in zip(times.tolist(), *points, strict=True):
        names = ("positions", "velocities", "accelerations")
        point = {k: row.tolist() for k, row in zip(names, rows, strict=True)}
        sec, nanosec = divmod(round(t * 1e9), 10**9)
        listed.append(point | {"time_from_start": {"sec": sec, "nanosec": nanosec}})
    return {"joint_names": list(joint_names), "points": listed}


def write_csv(
    file: str | Path,
    joint_names: Sequence[str],
    times: np.ndarray,
    points: Sequence[np.ndarray],
) -> Path:
    """Write set-points as CSV: time_s, then each joint's q, dq and ddq.

    Args:
        file: The file; what stood there is replaced when the new one is whole.
        joint_names: (dof,) names.
        times: (n,) seconds from the start.
        points: Positions, velocities and accelerations, (n, dof) each [rad or m].

    Returns:
        The file.

    Raises:
        BadInput: It cannot be written.
    """
    file = check_path("a file", file)
    names = [f"{k}_{name}" for k in ("q", "dq", "ddq") for name in joint_names]
    table = np.concatenate([times[:, None], *points], axis=1)
    rows = [",".join(["time_s", *names])]
    rows += [",".join(map(repr, values)) for values in table.tolist()]
    try:
        with beside(file) as made:
            made.write_text("\n".join(rows) + "\n", encoding="utf-8")
            made.replace(file)
    except OSError as error:
        raise BadInput(
            f"{file} cannot be written: {error.strerror}; give another file"
        ) from error
    return file
