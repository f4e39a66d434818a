"""Where a robot that shares its space works, and where it waits."""

import numpy as np

from odm.planner.planner import ReactivePlanner
from roadmap.errors import BadInput, PlanningError
from roadmap.kinematics.forward import difference
from sim.loop.work_places import work_places

SPARE = 0.05  # kept beyond what the planner calls free, while waiting [m]


def places_beside(planner: ReactivePlanner) -> np.ndarray:
    """Return two free work places (2, dof) of a planner whose scenery is set.

    Raises:
        BadInput: What stands there leaves none.
    """
    roadmap = planner.cell_map.roadmap
    try:
        return work_places(planner.robot, roadmap, planner.is_free)
    except PlanningError as error:
        raise BadInput(
            f"beside the other robot's base {planner.robot.name} has no two places to "
            f"work at ({error}); move the second base away"
        ) from error


def waiting_place(
    planner: ReactivePlanner, places: np.ndarray, busy: np.ndarray
) -> np.ndarray:
    """Return the roadmap node nearest to the places that is out of the other's way.

    Args:
        planner: The planner of the robot that waits.
        places: (n, dof) its work places.
        busy: (m, 3) points of the other robot at all of its places [m].

    Raises:
        BadInput: The other robot is in the way everywhere.
    """
    nodes = planner.cell_map.roadmap.nodes
    planner.step(busy, q=nodes[0].copy())
    far = np.abs(difference(planner.robot, nodes[:, None], places[None])).max(axis=2)
    order = np.argsort(far.max(axis=1), kind="stable")
    keep = planner.keep + SPARE
    for node in order:
        q = nodes[node].copy()
        if planner.separation(q) > keep and planner.is_free(q, q):
            planner.reset()
            return q
    raise BadInput(
        f"{planner.robot.name} has no place to wait that is out of the other robot's "
        "way; move the second base away"
    )
