"""Goals that are set on a planner are checked here."""

from typing import TYPE_CHECKING

import numpy as np

from odm.checks import outside_limits
from roadmap.errors import BadConfiguration

if TYPE_CHECKING:
    from odm.planner.planner import ReactivePlanner


def check_goals(planner: "ReactivePlanner", goals: np.ndarray) -> None:
    """Raise BadConfiguration where a goal can never be reached in this place."""
    for k, q in enumerate(goals):
        check_valid(planner, q, f"goal {k}")


def check_valid(planner: "ReactivePlanner", q: np.ndarray, name: str) -> None:
    """Raise BadConfiguration where q can never be a goal in this place."""
    if not np.isfinite(q).all():
        raise BadConfiguration(f"{name} holds NaN or infinity: {q}; give numbers")
    trouble = outside_limits(planner.robot, q, 0.0)
    if trouble is not None:
        raise BadConfiguration(f"{name} is out of limits: {trouble}; move it inside")
    why = planner.static.why(q, np.zeros_like(q))
    if why is not None:
        raise BadConfiguration(f"{name} is not free: {why}; choose another one")
