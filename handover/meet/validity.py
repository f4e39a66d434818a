"""Validity test of a configuration: one interface for planner, function or robot."""

from collections.abc import Callable

import numpy as np

from odm.planner.planner import ReactivePlanner
from roadmap.errors import BadInput
from roadmap.kinematics.forward import difference

Validity = Callable[[np.ndarray], tuple[bool, str]]


class PlannerValidity:
    """Validity by a planner: free in its last frame, and joined to the roadmap.

    Args:
        planner: Its scenery and last frame count.
        joined: From one of so many nearest nodes a straight free motion must lead to
            the configuration, as the attachment of a goal needs it; 0: not asked for.
    """

    def __init__(self, planner: ReactivePlanner, joined: int = 8) -> None:
        self.planner, self.joined = planner, joined

    def __call__(self, q: np.ndarray) -> tuple[bool, str]:
        """Return whether q may be a goal, and why not."""
        planner = self.planner
        here = planner.is_free(q, q)
        if not here:
            return False, f"{here.failed}: {here.reason}"
        if not self.joined:
            return True, ""
        roadmap = planner.cell_map.roadmap
        away = difference(planner.robot, roadmap.nodes, q) * roadmap.weights
        far = np.linalg.norm(away, axis=1)
        for node in np.argsort(far, kind="stable")[: self.joined]:
            if planner.is_free(roadmap.nodes[node], q):
                return True, ""
        return False, (
            f"attachment: no free motion leads there from the {self.joined} nearest "
            "nodes of the roadmap"
        )


def validity_of(is_valid: object) -> Validity:
    """Return a test in one form: q -> (valid, why not).

    `is_valid` is a planner, or q -> bool, (bool, reason) or an `odm.Freedom`; anything
    else is refused, at once or when it answers.
    """
    if hasattr(is_valid, "is_free") and hasattr(is_valid, "cell_map"):
        return PlannerValidity(is_valid)
    if not callable(is_valid):
        raise BadInput(
            f"is_valid is {is_valid!r}; give a planner, or a function of q that "
            "returns a bool or (bool, reason)"
        )
    if isinstance(is_valid, PlannerValidity):
        return is_valid

    def valid(q: np.ndarray) -> tuple[bool, str]:
        return _read(is_valid(q))

    return valid


def _read(said: object) -> tuple[bool, str]:
    if isinstance(said, (bool, np.bool_)):
        return bool(said), "" if said else "not valid"
    if hasattr(said, "free") and hasattr(said, "reason"):
        return bool(said.free), str(said.reason)
    if isinstance(said, tuple) and len(said) == 2:
        if isinstance(said[0], (bool, np.bool_)):
            return bool(said[0]), str(
                said[1] or "" if said[0] else said[1] or "not valid"
            )
    raise BadInput(
        f"is_valid answered {said!r}; it must answer a bool, (bool, reason) or an "
        "odm.Freedom"
    )
