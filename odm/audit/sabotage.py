"""Maps with one safety term taken away: the audit of the audit."""

from dataclasses import replace

import numpy as np

from odm.audit.audit_targets import audit_solids
from odm.cell_map.cell_map import CellMap
from odm.cell_map.sweep import sweep_roadmap
from odm.close_test._arm import Arm
from odm.close_test.arm import arm_of, moving_order
from roadmap.errors import BadInput
from roadmap.graph.roadmap import Roadmap
from roadmap.robot.robot import Robot

TERMS = ("rho", "mu", "sphere")
_NODES = 150
_BELIEF = 0.0  # what is left of the motion bound under "mu"


def spoiled(cell_map: CellMap, term: str, nodes: int = _NODES) -> CellMap:
    """Return a small copy of a map whose cells lack one term of the safety argument.

    Args:
        cell_map: A sound map; it gives robot, roadmap, grid and declared terms.
        term: "rho": cells are grown by the clearance only. "mu": the motion
            bound says that nothing moves, so an edge is its two ends. "sphere": the
            sphere of the cover that the solids need most is left out.
        nodes: Size of the copy.

    Returns:
        A map that still claims the terms it lacks.
    """
    if term not in TERMS:
        known = ", ".join(TERMS)
        raise BadInput(f"sabotage {term!r} is unknown: choose one of {known}")
    roadmap = part_of(cell_map.roadmap, nodes)
    robot, arm, safety = cell_map.robot, arm_of(cell_map.robot), cell_map.safety
    if term == "rho":
        safety = replace(safety, rho=0.0)
    elif term == "mu":
        arm = arm._replace(reach=arm.reach * _BELIEF)
    else:
        arm = without_sphere(arm, most_needed_sphere(robot)[0], cell_map)
    cells = sweep_roadmap(robot, arm, roadmap, cell_map.grid, safety)
    return replace(cell_map, roadmap=roadmap, arm_cells=cells, payload=None, hash="")


def part_of(roadmap: Roadmap, nodes: int) -> Roadmap:
    """Return the subgraph of the first `nodes` nodes met from node 0 on."""
    seen, queue = {0}, [0]
    while queue and len(seen) < nodes:
        node = queue.pop(0)
        row = slice(roadmap.adj_ptr[node], roadmap.adj_ptr[node + 1])
        for other in roadmap.adj_node[row].tolist():
            if other not in seen and len(seen) < nodes:
                seen.add(other)
                queue.append(other)
    kept = np.array(sorted(seen))
    place = np.full(roadmap.n_nodes, -1)
    place[kept] = np.arange(len(kept))
    inside = (place[roadmap.edges] >= 0).all(axis=1)
    return Roadmap(
        roadmap.nodes[kept],
        place[roadmap.edges[inside]],
        roadmap.lengths[inside],
        roadmap.weights,
        roadmap.landmarks[kept],
    )


def most_needed_sphere(robot: Robot) -> tuple[int, float]:
    """Return the moving sphere without which most of the solids is uncovered.

    Returns:
        Its index in `robot.spheres`, and the largest depth by which the surface of a
        solid then sticks out of all other spheres of its body [m].
    """
    solids = audit_solids(robot, np.random.default_rng(0))
    T = robot.solid_pose[solids.target_part]
    points = np.einsum("nij,nj->ni", T[:, :3, :3], solids.targets[:, :3]) + T[:, :3, 3]
    owner = solids.body[solids.target_part]
    best, depth = -1, 0.0
    for body in np.unique(owner):
        of_body = np.flatnonzero(robot.sphere_body == body)
        away = points[owner == body][:, None] - robot.spheres[of_body, :3]
        outside = np.linalg.norm(away, axis=2) - robot.spheres[of_body, 3]
        for k in range(len(of_body)):
            others = np.delete(outside, k, axis=1)
            # the loss of an only sphere takes the whole link away: too easy to find
            bare = others.min(axis=1).max() if len(of_body) > 1 else 0.0
            if bare > depth:
                best, depth = int(of_body[k]), float(bare)
    return best, depth


def without_sphere(arm: Arm, sphere: int, cell_map: CellMap) -> Arm:
    """Return the arm with a sphere of the robot shrunk to nothing, margins included."""
    row = int(np.flatnonzero(moving_order(cell_map.robot) == sphere)[0])
    spheres = arm.spheres.copy()
    spheres[row, 3] = -(cell_map.safety.rho + cell_map.safety.m)
    return arm._replace(spheres=spheres)
