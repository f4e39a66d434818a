"""Recorded obstacle frames: what `odm replay` reads, checked before anything runs."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from odm import CellMap, sample_capsules
from odm.checks import outside_limits
from roadmap.arrays import freeze
from roadmap.errors import BadInput
from sim.terminal.npz import TooLarge, array_of, read_members

SPACING = 0.03  # of samples on capsules [m], where the map allows it
MOST_POINTS = 1_000_000  # of a frame: 500 people


class BadRecording(BadInput):
    """A file of recorded frames cannot be played; says which value is wrong."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Obstacle points over time, and from where to where the robot goes."""

    points: np.ndarray  # (n, 3) points of all frames [m]
    offsets: np.ndarray  # (F + 1,) frame i owns points[offsets[i]:offsets[i + 1]]
    # (dof,) configurations [rad or m]
    q_start: np.ndarray
    q_goal: np.ndarray
    rate_hz: float  # frames per second
    # declared for raw points [m]; None for closed capsules
    covering_radius: float | None
    # (F,) smallest radius of each frame's capsules [m]; None for points
    rounding: np.ndarray | None = None

    def __post_init__(self) -> None:
        freeze(self, points=float, offsets=np.int64, q_start=float, q_goal=float)
        if self.rounding is not None:
            freeze(self, rounding=float)

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.offsets) - 1

    def frame(self, i: int) -> np.ndarray:
        """Return the (n, 3) points of frame i [m], a copy that may be written to."""
        return self.points[self.offsets[i] : self.offsets[i + 1]].copy()

    def rounding_of(self, i: int) -> float | None:
        """Return the smallest radius of frame i's capsules [m]; None: not known."""
        if self.rounding is None or self.offsets[i] == self.offsets[i + 1]:
            return None
        return float(self.rounding[i])


def read_recording(
    path: str | Path, cell_map: CellMap, spacing: float | None = None
) -> Recording:
    """Read an `.npz` of frames for the robot of a map, or raise BadRecording.

    It holds `capsules` (F, K, 7), sampled `spacing` apart [m], or `points` (sum, 3) and
    `offsets` (F + 1,); further `q_start`, `q_goal` (dof,), `rate_hz`; with points also
    `covering_radius` [m], the map's rho where it is left out.
    """
    arrays = _load(Path(path))
    start, goal = (_configuration(arrays, n, cell_map) for n in ("q_start", "q_goal"))
    rate = _number(arrays, "rate_hz")
    if not 0 < rate < 1e5:
        raise BadRecording(
            f"rate_hz is {rate:g}; give frames per second, above 0 and below 100000"
        )
    rho = cell_map.safety.rho
    if "capsules" in arrays and "points" in arrays:
        raise BadRecording(
            f"{path} holds both 'capsules' and 'points'; keep one of them"
        )
    if "capsules" in arrays:
        capsules = arrays["capsules"]
        points, offsets = _sampled(capsules, spacing or min(SPACING, rho))
        radius, rounding = None, capsules[:, :, 6].min(axis=1, initial=np.inf)
    else:
        (points, offsets), rounding = _raw(arrays), None
        radius = (
            _number(arrays, "covering_radius") if "covering_radius" in arrays else rho
        )
    return Recording(points, offsets, start, goal, rate, radius, rounding)


def _load(path: Path) -> dict[str, np.ndarray]:
    if not path.is_file():
        raise BadRecording(f"there is no file {path}; give an .npz of recorded frames")
    try:
        members = read_members(path).items()
        return {name.removesuffix(".npy"): array_of(data) for name, data in members}
    except TooLarge as error:
        raise BadRecording(str(error)) from error
    except (ValueError, OSError) as error:
        raise BadRecording(
            f"{path} cannot be read as .npz ({error}); write it with numpy.savez"
        ) from error


def _wanted(arrays: dict[str, np.ndarray], name: str) -> np.ndarray:
    if name not in arrays:
        held = ", ".join(sorted(arrays)) or "nothing"
        raise BadRecording(
            f"the key {name!r} is missing; the file holds {held}, but needs q_start, "
            "q_goal, rate_hz and capsules, or points with offsets"
        )
    array = arrays[name]
    if array.dtype.kind not in "fiu":
        raise BadRecording(f"{name} has the dtype {array.dtype}; give real numbers")
    return array


def _number(arrays: dict[str, np.ndarray], name: str) -> float:
    array = _wanted(arrays, name)
    if array.size != 1:
        raise BadRecording(f"{name} has the shape {array.shape}; give one number")
    return float(array.reshape(-1)[0])


def _configuration(arrays: dict, name: str, cell_map: CellMap) -> np.ndarray:
    q, robot = _wanted(arrays, name), cell_map.robot
    if q.shape != (robot.dof,):
        raise BadRecording(
            f"{name} has the shape {q.shape}, but {robot.name} has {robot.dof} moving "
            f"joints: {', '.join(robot.joint_names)}"
        )
    if not np.isfinite(q).all():
        raise BadRecording(f"{name} holds NaN or infinity: {q.tolist()}; give numbers")
    trouble = outside_limits(robot, q, 0.0)
    if trouble is not None:
        raise BadRecording(f"{name} is out of limits: {trouble}; move it inside")
    return q.astype(float)


def _sampled(capsules: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    if capsules.dtype.kind not in "fiu" or capsules.ndim != 3 or capsules.shape[2] != 7:
        raise BadRecording(
            f"capsules have the shape {capsules.shape} and dtype {capsules.dtype}; "
            "give (F, K, 7) real numbers: end a, end b, radius [m]"
        )
    frames = []
    for i, rows in enumerate(capsules.astype(float)):
        _check_surface(i, rows, spacing)
        try:
            frames.append(sample_capsules(rows, spacing))
        except BadInput as error:
            raise BadRecording(f"frame {i}: {error}") from error
    return _joined(frames)


def _check_surface(i: int, rows: np.ndarray, spacing: float) -> None:
    """Refuse capsules that would take more points than a frame can have."""
    radius = np.abs(rows[:, 6])
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(rows[:, 3:6] - rows[:, :3], axis=1)
        area = float((2 * np.pi * radius * (length + 2 * radius)).sum())
    if np.isfinite(rows).all() and not area <= MOST_POINTS * spacing**2:
        raise BadRecording(
            f"the capsules of frame {i} have a surface of {area:.3g} "
            f"m\N{SUPERSCRIPT TWO}, which takes more than {MOST_POINTS} points; "
            "give metres, or fewer capsules"
        )


def _joined(frames: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    if not frames:
        raise BadRecording("there are no frames; record at least one")
    sizes = [len(points) for points in frames]
    return np.concatenate(frames), np.concatenate([[0], np.cumsum(sizes)])


def _raw(arrays: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    if "points" not in arrays and "offsets" not in arrays:
        _wanted(arrays, "capsules")
    points, offsets = _wanted(arrays, "points"), _wanted(arrays, "offsets")
    if points.ndim != 2 or points.shape[1] != 3:
        raise BadRecording(f"points have the shape {points.shape}; give (sum, 3) [m]")
    if offsets.ndim != 1 or len(offsets) < 2 or offsets.dtype.kind not in "iu":
        raise BadRecording(
            f"offsets have the shape {offsets.shape} and dtype {offsets.dtype}; give "
            "(F + 1,) whole numbers"
        )
    offsets = offsets.astype(np.int64)
    falls = np.flatnonzero(np.diff(offsets) < 0)
    if len(falls):
        raise BadRecording(
            f"offsets fall from {offsets[falls[0]]} to {offsets[falls[0] + 1]} after "
            f"frame {falls[0]}; they must ascend"
        )
    if offsets[0] != 0 or offsets[-1] != len(points):
        raise BadRecording(
            f"offsets run from {offsets[0]} to {offsets[-1]}, but must run from 0 to "
            f"the number of points, {len(points)}"
        )
    return points.astype(float), offsets
