"""Scenes of other programs: MoveIt's `.scene` files, and URDFs as scenery."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from odm.obstacles.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from roadmap.builds.unfinished import beside
from roadmap.errors import BadInput, BadRobot
from roadmap.loading.body_tree import link_poses
from roadmap.ranges import check_path
from roadmap.robot.description import Joint, read_description
from roadmap.robot.meshes import find_mesh, unit_of
from roadmap.transforms import pose_with, rotation_to_z

KINDS = (".scene", ".urdf", ".xml")
PLATE = (6.0, 6.0, 1.0)  # [m] that stands for a plane, beneath it
_SIDES = 32  # of the pyramid around a cone
_MOST_NUMBERS = 3_000_000  # of one mesh in a .scene file

Object = tuple[str, list[Shape], np.ndarray]


def read_scene(path: str | Path) -> list[Object]:
    """Read the objects of a scene file.

    Of a `.scene` file: boxes, spheres, cylinders and meshes as they are; a cone counts
    as a pyramid of 32 sides around it; a plane as a plate of 6 x 6 x 1 m on the side
    where the origin is not (through the origin: where its normal does not point).
    Of a URDF: the collision shapes of each link with its joints at 0, or as near to 0
    as their limits allow, followers (<mimic>) where those put them; a link without any
    is left out. The unit that a COLLADA mesh states is applied, as to robots.

    Args:
        path: A `.scene` file, or a URDF (`.urdf`, `.xml`).

    Returns:
        (name, shapes in the object's frame, (4, 4) pose of the object in the file's
        world) of each object, in the order of the file.

    Raises:
        BadInput: The file is not there, is of another kind, or is broken (names the
            line).
    """
    path = check_path("a scene", path)
    if path.suffix.lower() not in KINDS:
        ends = (
            f"its name ends in {path.suffix!r}" if path.suffix else "it has no ending"
        )
        raise BadInput(
            f"{path} is no scene: {'it is a folder' if path.is_dir() else ends}; give "
            "a MoveIt .scene file or a .urdf"
        )
    if not path.is_file():
        raise BadInput(f"scene file {path} does not exist; check the path")
    if path.suffix.lower() == ".scene":
        return _moveit_objects(path)
    try:
        return _urdf_objects(path)
    except BadRobot as error:
        raise BadInput(str(error)) from error


def write_scene(path: str | Path, objects: Sequence[Object]) -> Path:
    """Write objects as a MoveIt `.scene` file, which `read_scene` and RViz read.

    A capsule is written as a cylinder and two spheres, which are together as large.

    Args:
        path: Its name ends in `.scene`; an old file is replaced, whole or not at all.
        objects: As `read_scene` returns them.

    Raises:
        BadInput: The path, or something that no such file can hold.
    """
    path = check_path("a scene", path)
    if path.suffix.lower() != ".scene":
        raise BadInput(f"{path} would be no scene file; give a name ending in .scene")
    words = ["scene"]
    for name, shapes, T in objects:
        parts = [part for shape in shapes for part in _written(shape, name)]
        words += [f"* {name}", *_pose_lines(T), str(len(parts))]
        for lines, pose in parts:
            words += [*lines, *_pose_lines(pose), "0 0 0 0"]
        words.append("0")
    text = "\n".join([*words, "."]) + "\n"
    try:
        with beside(path) as made:
            made.write_text(text, encoding="utf-8")
            made.replace(path)
    except OSError as error:
        raise BadInput(
            f"the scene {path} cannot be written ({error.strerror or error}); choose "
            "another folder"
        ) from error
    return path


def _written(shape: Shape, name: str) -> list[tuple[list[str], np.ndarray]]:
    """Return (lines, pose) of the shapes that stand for one."""
    T = np.asarray(getattr(shape, "T_base_shape", np.eye(4)))
    if isinstance(shape, Box):
        return [(["box", _row(shape.size)], T)]
    if isinstance(shape, Sphere):
        return [(["sphere", _row([shape.radius])], T)]
    if isinstance(shape, Cylinder):
        return [(["cylinder", _row([shape.radius, shape.length])], T)]
    if isinstance(shape, Capsule):
        found = []
        if shape.length > 0.0:
            found.append((["cylinder", _row([shape.radius, shape.length])], T))
        for end in shape.ends():
            found.append((["sphere", _row([shape.radius])], T.copy()))
            found[-1][1][:3, 3] = end
        return found
    if isinstance(shape, Mesh):
        sizes = f"{len(shape.vertices)} {len(shape.faces)}"
        corners = [" ".join(map(str, row)) for row in shape.faces.tolist()]
        return [(["mesh", sizes, *map(_row, shape.vertices), *corners], T)]
    raise BadInput(
        f"{name!r} holds a {type(shape).__name__}, which a .scene file cannot; leave "
        "it out, or make it of shapes"
    )


def _row(values: object) -> str:
    return " ".join(repr(float(v)) for v in values)  # type: ignore[attr-defined]


def _pose_lines(T: np.ndarray) -> list[str]:
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(np.asarray(T)[:3, :3]).as_quat()
    return [_row(np.asarray(T)[:3, 3]), _row(turn)]


# --- MoveIt ------------------------------------------------------------------------


class _Words:
    """The words of a text file, with the line that each stands in."""

    def __init__(self, path: Path) -> None:
        try:
            self.lines = path.read_text(encoding="utf-8").splitlines()
        except UnicodeDecodeError as error:
            raise BadInput(f"scene file {path} is no text; export it again") from error
        self.path, self.at = path, 0
        self._rest: list[str] = []

    def line(self) -> str | None:
        """Return the next whole line, None at the end; what was left of one is lost."""
        self._rest = []
        if self.at >= len(self.lines):
            return None
        self.at += 1
        return self.lines[self.at - 1].strip()

    def word(self, what: str) -> str:
        while not self._rest:
            line = self.line()
            if line is None:
                raise self.wrong(f"ends where {what} should stand")
            self._rest = line.split()
        return self._rest.pop(0)

    def numbers(self, n: int, what: str) -> list[float]:
        found = []
        for _ in range(n):
            word = self.word(what)
            try:
                value = float(word)
            except ValueError:
                value = math.nan
            if not math.isfinite(value):
                raise self.wrong(f"has {word!r} where {what} should stand")
            found.append(value)
        return found

    def count(self, what: str, most: int) -> int:
        (value,) = self.numbers(1, what)
        if value != int(value) or not 0 <= value <= most:
            raise self.wrong(f"has {value:g} where {what} should stand (0 to {most})")
        return int(value)

    def wrong(self, what: str) -> BadInput:
        return BadInput(
            f"scene file {self.path} {what}, in line {self.at}; export it again"
        )


def _moveit_objects(path: Path) -> list[Object]:
    words, found, ended = _Words(path), [], False
    words.line()  # the name of the scene
    moved = _has_poses(words.lines)
    while (line := words.line()) is not None:
        if line.startswith("*"):
            found.append(_moveit_object(words, line[1:].strip(), moved))
        elif line == ".":
            ended = True
            break
        elif line:
            raise words.wrong(f"has {line[:40]!r} where '* name' or '.' should stand")
    if not ended:
        raise words.wrong("ends without its last line '.'")
    return found


def _has_poses(lines: list[str]) -> bool:
    """Return whether objects have poses, and subframes: since MoveIt 1.1 (2020)."""
    for k, line in enumerate(lines[1:-1], 1):
        if line.startswith("*"):
            return " " in lines[k + 1].strip()
    return False


def _moveit_object(words: _Words, name: str, moved: bool) -> Object:
    if not name:
        raise words.wrong("has an object without a name")
    T = _moveit_pose(words) if moved else np.eye(4)
    shapes = []
    for _ in range(words.count("the number of shapes", 100_000)):
        make = _moveit_shape(words)
        pose = _moveit_pose(words)
        words.numbers(4, "a colour")
        shapes.append(make.moved(pose) if not callable(make) else make(T @ pose, T))
    if moved:
        for _ in range(words.count("the number of subframes", 100_000)):
            while words.line() == "":  # its name
                pass
            _moveit_pose(words)
    return name, shapes, T


def _moveit_pose(words: _Words) -> np.ndarray:
    """Read a position, and a quaternion x y z w."""
    from scipy.spatial.transform import Rotation

    position = words.numbers(3, "a position")
    turn = np.array(words.numbers(4, "a quaternion"))
    if not 0.9 < math.hypot(*turn) < 1.1:
        raise words.wrong(f"has the quaternion {turn.tolist()}, which is no rotation")
    return pose_with(Rotation.from_quat(turn).as_matrix(), position)


def _moveit_shape(words: _Words):  # noqa: ANN202 (a shape, or what makes a plane's)
    kind = words.word("a shape")
    try:
        if kind == "box":
            return Box(np.array(words.numbers(3, "the size of a box")))
        if kind == "sphere":
            (radius,) = words.numbers(1, "a radius")
            return Sphere(radius)
        if kind == "cylinder":
            radius, length = words.numbers(2, "radius and length of a cylinder")
            return Cylinder(radius, length)
        if kind == "cone":
            return _pyramid(*words.numbers(2, "radius and length of a cone"))
        if kind == "plane":
            return _plate(words.numbers(4, "the four numbers of a plane"), words)
        if kind == "mesh":
            return _moveit_mesh(words)
    except BadInput as error:
        if str(error).startswith("scene file"):
            raise
        raise words.wrong(f"holds a shape that cannot be: {error}") from error
    raise words.wrong(
        f"has a shape {kind!r}; known are box, sphere, cylinder, cone, plane and mesh"
    )


def _moveit_mesh(words: _Words) -> Mesh:
    n = words.count("the number of vertices", _MOST_NUMBERS // 3)
    m = words.count("the number of triangles", _MOST_NUMBERS // 3)
    vertices = np.reshape(words.numbers(3 * n, "a vertex"), (n, 3))
    return Mesh(vertices, np.reshape(words.numbers(3 * m, "a triangle"), (m, 3)))


def _pyramid(radius: float, length: float) -> Mesh:
    """Return a mesh around a cone: its tip on +z, the origin half way up."""
    from trimesh.creation import cone

    Cylinder(radius, length)  # refuses sizes that cannot be
    solid = cone(radius / np.cos(np.pi / _SIDES), length, _SIDES)
    return Mesh(solid.vertices - [0.0, 0.0, 0.5 * length], solid.faces)


def _plate(numbers: list[float], words: _Words):  # noqa: ANN202
    normal, d = np.array(numbers[:3]), numbers[3]
    length = float(np.linalg.norm(normal))
    if not length > 1e-9:
        raise words.wrong(f"has a plane whose normal {numbers[:3]} is no direction")

    def make(T_world_plane: np.ndarray, T_world_object: np.ndarray) -> Box:
        n = T_world_plane[:3, :3] @ normal / length
        offset = -d / length + float(n @ T_world_plane[:3, 3])  # n . x = offset
        up = n if offset <= 0.0 else -n  # where the origin is
        T = pose_with(rotation_to_z(up), offset * n - 0.5 * PLATE[2] * up)
        return Box(np.array(PLATE), np.linalg.inv(T_world_object) @ T)

    return make


# --- URDF --------------------------------------------------------------------------


def _urdf_objects(path: Path) -> list[Object]:
    description = read_description(path)
    found = []
    standing = {name: _standing(joint) for name, joint in description.joints.items()}
    for name, T in link_poses(description, standing).items():
        shapes: list[Shape] = []
        for shape in description.links[name].collisions:
            size, pose = shape.size, shape.T_link_shape
            if shape.kind == "box":
                shapes.append(Box(np.array(size), pose))
            elif shape.kind == "sphere":
                shapes.append(Sphere(float(size[0]), pose))
            elif shape.kind == "cylinder":
                shapes.append(Cylinder(float(size[0]), float(size[1]), pose))
            else:
                file = find_mesh(shape.filename, path, (), name)
                mesh = Mesh.from_file(file, scale=unit_of(file) * np.array(size))
                shapes.append(Mesh(mesh.vertices, mesh.faces, pose))
        if shapes:
            found.append((name, shapes, T))
    if not found:
        raise BadInput(
            f"no link of {path} has a <collision>, so nothing would stand there; give "
            "its links collision shapes"
        )
    return found


def _standing(joint: Joint) -> float:
    """Return where a joint stands: at 0, clipped into its limits [rad or m]."""
    if joint.kind == "fixed":
        return 0.0  # whatever limits it has
    low = -math.inf if joint.lower is None else joint.lower
    high = math.inf if joint.upper is None else joint.upper
    return min(max(0.0, low), high)
