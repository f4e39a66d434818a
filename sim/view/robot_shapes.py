"""The robot's shapes for a picture: its visual meshes, else its collision solids."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh

from odm.obstacles.robot_surface import solids_of
from roadmap.errors import PlanningError
from roadmap.kinematics.forward import body_frames
from roadmap.loading.body_tree import link_poses, standing_values
from roadmap.robot.description import Description, Shape, read_description
from roadmap.robot.known import known_robot, robot_file
from roadmap.robot.meshes import find_mesh
from roadmap.robot.robot import Robot
from sim.draw.surroundings import triangles_of

MOST_FACES = 400_000  # of all visual meshes; a page has to stay quick
# Faces that are drawn of all visual meshes: a picture of 100 000 took a processor that
# draws itself 0.2 s longer than one of 30 000 (docs/decisions/0068).
DRAWN_FACES = 20_000
_FINEST, _COARSER = 0.002, 1.25  # first cell in which corners become one [m], its steps
_SAME = 1e-6  # a link belongs to the body it moves with; [m] and in rotations
_TRIES = 3


@dataclass(frozen=True, eq=False)
class Part:
    """One mesh of the robot."""

    body: int  # body of the robot that carries it
    mesh: trimesh.Trimesh  # in the frame of that body [m]
    # (3,) of its own, 0 to 255; None: it has none
    colour: tuple[int, int, int] | None = None


def robot_parts(
    robot: Robot, source: str = "", locked: Mapping[str, float] | None = None
) -> tuple[list[Part], str]:
    """Return the meshes of a robot, and a sentence about what was not found.

    `source` is its URDF or name, as in the recipe of its map; `locked` are joints that
    stand still, and where [rad or m].
    """
    try:
        return drawn_parts(visual_parts(robot, source, locked or {})), ""
    except (PlanningError, OSError, ValueError, KeyError) as error:
        why = str(error).split(";")[0]
        return solid_parts(robot), f"the robot is drawn by its collision solids: {why}"


def lowest_of_robot(robot: Robot, parts: list[Part], qs: np.ndarray) -> float:
    """Return how low a robot of such meshes comes at qs (n, dof) [m], at most 0."""
    lowest = 0.0
    for q in qs:
        frames = body_frames(robot, q)
        for part in parts:
            z = part.mesh.vertices @ frames[part.body, 2, :3]
            lowest = min(lowest, np.min(z, initial=np.inf) + frames[part.body, 2, 3])
    return float(lowest)


def drawn_parts(parts: list[Part], most: int = DRAWN_FACES) -> list[Part]:
    """Return meshes with at most `most` faces in all, as they are if they have few.

    Corners that lie in one cell become one of them; cells grow until it is enough.
    For a picture only: no corner moves farther than the diagonal of a cell.
    """
    cell, drawn = _FINEST, parts
    while sum(len(part.mesh.faces) for part in drawn) > most:
        drawn = [replace(part, mesh=_clustered(part.mesh, cell)) for part in parts]
        cell *= _COARSER
    return drawn


def _clustered(mesh: trimesh.Trimesh, cell: float) -> trimesh.Trimesh:
    """Return a mesh whose corners in a cell of so many metres are one; maybe empty."""
    found = trimesh.Trimesh(mesh.vertices / cell, mesh.faces, process=False)
    found.merge_vertices(merge_tex=True, merge_norm=True, digits_vertex=0)
    a, b, c = found.faces.T
    found.update_faces((a != b) & (b != c) & (c != a) & found.unique_faces())
    return found.apply_scale(cell)


def solid_parts(robot: Robot) -> list[Part]:
    """Return the exact solids of a robot as meshes; no file is needed."""
    bodies = robot.link_body[robot.solid_link].tolist()
    drawn = [trimesh.triangles.to_kwargs(triangles_of(s)) for s in solids_of(robot)]
    return [Part(b, trimesh.Trimesh(**d)) for b, d in zip(bodies, drawn, strict=True)]


def visual_parts(robot: Robot, source: str, locked: Mapping[str, float]) -> list[Part]:
    """Return the visual meshes that the URDF of a robot names.

    Which body carries a link is found by moving both: it is the one that the link
    stands still in.

    Raises:
        BadRobot: There is no URDF, or no mesh.
        ValueError: A link that moves with no body, no visual geometry, or too much.
    """
    path = Path(robot_file(source))
    description = read_description(path)
    known = known_robot(source)
    locked = {**(known.locked if known else {}), **locked}
    rng = np.random.default_rng(0)
    tries = rng.uniform(robot.lower, robot.upper, (_TRIES, robot.dof))
    links = [link_frames(description, robot, q, locked) for q in tries]
    bodies = [body_frames(robot, q) for q in tries]
    parts = []
    for name, link in description.links.items():
        if not link.visuals:
            continue
        body, T_body_link = _carrier([f[name] for f in links], bodies, name)
        for shape in link.visuals:
            T = T_body_link @ shape.T_link_shape
            for colour, mesh in _visual(shape, path, name):
                parts.append(Part(body, mesh.apply_transform(T), colour))
    faces = sum(len(part.mesh.faces) for part in parts)
    if not parts or faces > MOST_FACES:
        told = f"{faces:,} triangles" if parts else "no visual geometry"
        raise ValueError(f"its URDF has {told}")
    return parts


def _carrier(
    frames: list[np.ndarray], bodies: list[np.ndarray], name: str
) -> tuple[int, np.ndarray]:
    """Return the body in which a link stands still, and T_body_link."""
    inside = [np.linalg.inv(b) @ f for b, f in zip(bodies, frames, strict=True)]
    off = np.max([np.abs(one - inside[0]).max(axis=(1, 2)) for one in inside], axis=0)
    body = int(off.argmin())
    if off[body] > _SAME:
        raise ValueError(f"its link {name} moves otherwise than in the URDF")
    return body, inside[0][body]


def link_frames(
    description: Description, robot: Robot, q: np.ndarray, locked: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Return T_root_link of every link of a URDF at `q` (dof,)."""
    values = dict(zip(robot.joint_names, q.tolist(), strict=True))
    values |= standing_values(description, robot.joint_names, locked)
    return link_poses(description, values)


def _visual(
    shape: Shape, urdf: Path, link: str
) -> list[tuple[tuple[int, int, int] | None, trimesh.Trimesh]]:
    """Return (colour, mesh) of a visual shape, one for each of its colours."""
    if shape.kind == "box":
        return [(None, trimesh.creation.box(shape.size))]
    if shape.kind == "cylinder":
        radius, length = shape.size
        return [(None, trimesh.creation.cylinder(radius, length, sections=32))]
    if shape.kind == "sphere":
        return [(None, trimesh.creation.icosphere(3, shape.size[0]))]
    file = find_mesh(shape.filename, urdf, (), link)
    by_colour: dict[object, list[trimesh.Trimesh]] = {}
    for mesh in trimesh.load_scene(file, process=False).dump():
        by_colour.setdefault(_colour(mesh), []).append(mesh)
    found = []
    for colour, meshes in by_colour.items():
        triangles = [(m.vertices, m.faces) for m in meshes]
        vertices, faces = trimesh.util.append_faces(*zip(*triangles, strict=True))
        whole = trimesh.Trimesh(vertices, faces, process=False)
        found.append((colour, whole.apply_scale(shape.size)))
    return found


def _colour(mesh: trimesh.Trimesh) -> tuple[int, int, int] | None:
    """Return the colour of a mesh that a file gives one to."""
    look = getattr(mesh.visual, "material", mesh.visual)
    defined = getattr(mesh.visual, "defined", True)
    colour = getattr(look, "main_color", None)
    return None if colour is None or not defined else tuple(int(c) for c in colour[:3])
