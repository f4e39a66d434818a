"""What enters a frame is checked here, once, and politely."""

from collections.abc import Sequence

import numpy as np

from roadmap.arrays import as_floats, shown
from roadmap.errors import BadConfiguration, BadInput
from roadmap.kinematics._limits import MOST_TURNED
from roadmap.ranges import is_between, is_real, told
from roadmap.robot.joint_values import looks_like_degrees, slides
from roadmap.robot.robot import Robot

MAX_GOALS = 32
AVOID, CONTACT, OBJECT = 0, 1, 2  # classes of points
CLASSES = ("avoid", "contact", "object")
_LEAST_BYTES = 4  # of a whole number; those read from lists have 8
FLOAT = np.dtype(np.float64)  # mostly the very object that arrays have: compared first


def check_points(
    points: np.ndarray,
    labels: np.ndarray | None,
    covering_radius: float | None,
    rho: float,
) -> np.ndarray:
    """Return points as C-contiguous (n, 3) float64; NaN is not looked for here."""
    kind = getattr(points, "dtype", None)
    if type(points) is not np.ndarray or (kind is not FLOAT and kind != FLOAT):
        points = point_floats(points)
    if points.ndim != 2 or points.shape[1] != 3:
        raise BadInput(
            f"points have shape {points.shape}; give an (n, 3) array, (0, 3) for none"
        )
    # a read-only or unaligned array is another type to the compiled frame: never
    # compile in it
    if not points.flags.carray:
        points = points.copy(order="C")
    if labels is not None and _length("labels", labels) != (len(points),):
        raise BadInput(
            f"labels have shape {np.shape(labels)} for {len(points)} points; give one "
            "label for each point"
        )
    if covering_radius is not None and not is_between(covering_radius, 0.0, rho):
        raise BadInput(
            f"a covering radius of {covering_radius} m lies outside 0 to {rho} m, the "
            "rho of the map; sample more densely or build a map with a larger rho"
        )
    return points


def check_classes(classes: object, n: int) -> np.ndarray | None:
    """Return the classes of n points as (n,) int8, None for `avoid` alone."""
    if classes is None:
        return None
    try:
        array = np.asarray(classes)
    except ValueError:
        array = np.empty(0, object)  # rows of unequal length
    if array.shape != (n,) or array.dtype.kind not in "iu":
        raise BadInput(
            f"classes have shape {array.shape} and dtype {array.dtype} for {n} points; "
            "give one integer for each: odm.AVOID, odm.CONTACT or odm.OBJECT"
        )
    if n and not (0 <= array.min() and array.max() < len(CLASSES)):
        bad = array[(array < 0) | (array >= len(CLASSES))][0]
        raise BadInput(
            f"a point has class {bad}; the classes are 0 (avoid), 1 (contact) and 2 "
            "(object)"
        )
    return array.astype(np.int8)


def point_floats(points: object) -> np.ndarray:
    """Return points as `as_floats` does; few bits hold no places in metres."""
    kind = getattr(points, "dtype", None)
    whole = isinstance(kind, np.dtype) and kind.kind in "iu"
    if whole and kind.itemsize < _LEAST_BYTES:
        raise BadInput(
            f"points are whole numbers of dtype {kind}, which holds no places in "
            "metres; give metres as float64"
        )
    return as_floats("points", points)


def _length(name: str, values: object) -> tuple[int, ...]:
    try:
        return np.shape(values)
    except ValueError as error:
        raise BadInput(
            f"{name} have rows of unequal length; give one number for each"
        ) from error


def check_configuration(
    robot: Robot, q: np.ndarray, dq: np.ndarray | None
) -> np.ndarray:
    """Return q as (dof,) float64; values are judged later, shapes now."""
    kind = getattr(q, "dtype", None)
    if type(q) is not np.ndarray or (kind is not FLOAT and kind != FLOAT):
        q = as_floats("q", q)
    if q.ndim != 1 or len(q) != robot.dof:
        raise BadInput(
            f"q has shape {q.shape}, but {robot.name} has {robot.dof} moving joints: "
            f"{', '.join(robot.joint_names)}"
        )
    if not q.flags.carray:
        q = q.copy(order="C")
    if dq is not None and _length("dq", dq) != (robot.dof,):
        raise BadInput(f"dq has shape {np.shape(dq)}; give ({robot.dof},) velocities")
    return q


def check_numbers(robot: Robot, q: np.ndarray, name: str = "q") -> np.ndarray:
    """Return a q that is asked about as (dof,) float64; it must be finite."""
    q = check_configuration(robot, q, None)
    if not np.isfinite(q).all():
        raise BadInput(f"{name} holds NaN or infinity: {q}; give numbers")
    return q


def check_path(robot: Robot, path: np.ndarray) -> np.ndarray:
    """Return corners as C-contiguous (k, dof) float64, k >= 1, finite or not."""
    path = as_floats("the path", path)
    if path.ndim != 2 or not len(path) or path.shape[1] != robot.dof:
        raise BadInput(
            f"a path of shape {path.shape} is none; give (k, {robot.dof}) corners, at "
            "least one"
        )
    return path


def check_distance(extra: object) -> None:
    """Refuse what is no distance to keep besides; NaN is one that is not known."""
    if is_real(extra):
        return
    kind = getattr(extra, "dtype", None)
    if getattr(extra, "ndim", 0) > 0:
        raise BadInput("extra is an array; give metres, and points after it")
    if kind is None or kind.kind not in "fiu":
        raise BadInput(f"extra is {told(extra)}; give metres, 0 for none")


def outside_limits(robot: Robot, q: np.ndarray, tolerance: float) -> str | None:
    """Name the joint that is farthest outside its limits, or None."""
    lower = np.where(robot.continuous, -MOST_TURNED, robot.lower)
    upper = np.where(robot.continuous, MOST_TURNED, robot.upper)
    over = np.maximum(lower - q, q - upper)
    worst = int(np.argmax(over))
    if not over[worst] > tolerance:
        return None
    low, high, value = lower[worst], upper[worst], float(q[worst])
    prismatic = slides(robot, worst)
    degrees = not robot.continuous[worst] and looks_like_degrees(value, prismatic)
    return (
        f"{robot.joint_names[worst]} = {value:.4g} lies outside its limits "
        f"{low:.4g} to {high:.4g} by {over[worst]:.2g} {'m' if prismatic else 'rad'}"
        f"{', which looks like degrees, not radians' if degrees else ''}"
    )


def goals_of(
    robot: Robot, goals: Sequence[np.ndarray], costs: Sequence[float] | None
) -> tuple[np.ndarray, np.ndarray | None]:
    """Return goals as (g, dof) and costs as (g,), or raise BadConfiguration."""
    wanted = f"give 1 to {MAX_GOALS} configurations of {robot.dof} joint values"
    if _is_empty(goals):
        raise BadConfiguration(f"no goals were given; {wanted}, the best first")
    try:
        goals = np.array(as_floats("goals", goals), ndmin=2)
    except BadInput as error:
        raise BadConfiguration(f"{_bad_goal(goals)}; {wanted}") from error
    if goals.ndim != 2 or goals.shape[1] != robot.dof:
        raise BadConfiguration(f"goals have shape {goals.shape}; {wanted}")
    if len(goals) > MAX_GOALS:
        raise BadConfiguration(
            f"{len(goals)} goals were given, at most {MAX_GOALS} are ranked; leave the "
            "worst out"
        )
    if costs is None:
        return goals, None
    try:
        values = np.array(as_floats("costs", costs))
    except BadInput as error:
        raise BadConfiguration(str(error)) from error
    if values.shape != (len(goals),) or not (values >= 0).all():
        raise BadConfiguration(
            f"costs {values} must be {len(goals)} numbers of at least 0; give one for "
            "each goal"
        )
    return goals, values


def _is_empty(values: object) -> bool:
    try:
        return values is None or len(values) == 0
    except TypeError:  # no sequence at all: told by who reads its numbers
        return False


def _bad_goal(goals: object) -> str:
    """Say which goal is no row of numbers, or that all differ in length."""
    rows = list(goals) if np.iterable(goals) and not isinstance(goals, str) else [goals]
    lengths = []
    for k, row in enumerate(rows):
        try:
            lengths.append(as_floats("it", row).shape)
        except BadInput:
            return f"goal {k} is no row of numbers but {shown(row)}"
    return f"the goals have rows of unequal shapes: {', '.join(map(str, lengths[:4]))}"
