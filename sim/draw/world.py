"""The pybullet DIRECT world: draws robot and person."""

import contextlib
import ctypes
import os
import re
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType

import numpy as np
from scipy.spatial.transform import Rotation

from roadmap.errors import BadRobot, PlanningError
from roadmap.loading.body_tree import driven_by, standing_values
from roadmap.robot.description import read_description, well_formed
from roadmap.robot.known import known_robot, robot_file
from roadmap.robot.meshes import find_mesh
from roadmap.robot.robot import Robot
from roadmap.transforms import rotation_to_z
from sim.draw.style import FURNITURE, LOAD, person_colours
from sim.draw.surroundings import capsule_mesh, normals_of
from sim.draw.viewpoint import Camera
from sim.loop.carried import ball_rows

_MOST_TRIANGLES = 10_000  # of one body
# what the library says when it is imported or connected, and of links without masses
GREETING = re.compile(rb"(pybullet build time|argv\[0\]=)[^\n]*\n?")
INERTIA = re.compile(
    rb"b3Warning\[[^\]]*\]:\s*No inertial data for link.*?inertial frame\s*"
    rb"b3Warning\[[^\]]*\]:\s*\S*?\s*(?=b3Warning|\Z|\n)",
    re.DOTALL,
)
LIGHT = {
    "lightDirection": [1.0, -1.2, 2.4],
    "lightColor": [1.0, 1.0, 1.0],
    "lightAmbientCoeff": 0.62,
    "lightDiffuseCoeff": 0.44,
    "lightSpecularCoeff": 0.08,
}


class SimulatorMissing(PlanningError):
    """pybullet is not installed; everything but its pictures works without it."""

    def __init__(self) -> None:
        super().__init__(
            "pybullet is not installed (its wheels are for Python 3.11 only): use "
            "Python 3.11 and `pip install pybullet`, or go without; the loop, its "
            "exact audit and simpler pictures do not need it"
        )


class World(contextlib.AbstractContextManager):
    """A robot and a person of capsules, both moved by hand.

    Args:
        urdf: Path of the robot's URDF, or a known name such as "panda".
        robot: Names and order of the joints.
        locked: Joint name -> value of joints that stand still [rad or m]; a known
            robot's own count, too, and others stand at 0 or the limit next to it.

    Raises:
        SimulatorMissing: pybullet is not installed.
        BadRobot: There is no such file.
    """

    def __init__(
        self, urdf: str | Path, robot: Robot, locked: Mapping[str, float] | None = None
    ) -> None:
        import_pybullet()
        path = str(robot_file(urdf))
        self._bullet = connected()
        try:
            with _without(INERTIA), tempfile.TemporaryDirectory() as folder:
                drawn = _lit(path, Path(folder))
                self._robot = self._bullet.loadURDF(drawn, useFixedBase=True)
        except self._bullet.error as error:  # such as a visual mesh that is not there
            self.close()
            raise BadRobot(f"pybullet cannot draw {path}: {error}") from error
        count = self._bullet.getNumJoints(self._robot)
        infos = [self._bullet.getJointInfo(self._robot, j) for j in range(count)]
        index = {info[1].decode(): info[0] for info in infos}
        description = read_description(path)
        followers = [driven_by(description, name) for name in robot.joint_names]
        self._joints = [[(index[n], f, o) for n, f, o in row] for row in followers]
        known = known_robot(urdf)
        locked = {**(known.locked if known else {}), **(locked or {})}
        values = standing_values(description, robot.joint_names, locked)
        for driver, value in values.items():  # what no `place` moves; fingers, too
            self._turn(
                [(index[n], f, o) for n, f, o in driven_by(description, driver)], value
            )
        self._person: list[int] = []
        self._sizes, self._things = np.zeros((0, 2)), 0
        self._arm, self._held = robot, np.zeros((0, 4))

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Disconnect from pybullet."""
        self._bullet.disconnect()

    def place(self, q: np.ndarray, capsules: np.ndarray, things: int = 0) -> None:
        """Set the robot to `q` (dof,) and the person to (k, 7) capsules [m].

        The last `things` of them are an object, and are drawn as one.
        """
        things += len(self._held)
        if len(self._held):
            capsules = np.vstack([capsules, ball_rows(self._arm, self._held, q)])
        for row, value in zip(self._joints, q, strict=True):
            self._turn(row, value)
        length = np.linalg.norm(capsules[:, 3:6] - capsules[:, :3], axis=1)
        sizes = np.column_stack([length, capsules[:, 6]])
        same = sizes.shape == self._sizes.shape and things == self._things
        if not same or not np.allclose(sizes, self._sizes):
            self._remake_person(sizes, things)
        for body, row in zip(self._person, capsules, strict=True):
            middle, quat_xyzw = (row[:3] + row[3:6]) / 2, turn_z_to(row[3:6] - row[:3])
            self._bullet.resetBasePositionAndOrientation(body, middle, quat_xyzw)

    def carry(self, spheres: np.ndarray) -> None:
        """Draw spheres (n, 4) of the tool frame in the robot's hand, too [m]."""
        self._held = spheres

    def stand(self, triangles: np.ndarray) -> None:
        """Draw triangles (n, 3, 3) of what stands around, too [m]."""
        for i in range(0, len(triangles), _MOST_TRIANGLES):
            some = triangles[i : i + _MOST_TRIANGLES]
            visual = self._bullet.createVisualShape(
                self._bullet.GEOM_MESH,
                vertices=some.reshape(-1, 3).tolist(),
                normals=np.repeat(normals_of(some), 3, axis=0).tolist(),
                indices=list(range(3 * len(some))),
                rgbaColor=(*FURNITURE, 1.0),
                specularColor=[0.05, 0.05, 0.05],
            )
            self._bullet.createMultiBody(0, -1, visual)

    def picture(self, camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Draw the world.

        Returns:
            (h, w, 3) uint8 colours, (h, w) distance along the view [m] and (h, w)
            bool, where nothing is seen.
        """
        _, _, colour, depth, body = self._bullet.getCameraImage(
            camera.width,
            camera.height,
            camera.view().T.ravel().tolist(),
            camera.projection().T.ravel().tolist(),
            shadow=0,
            renderer=self._bullet.ER_TINY_RENDERER,
            **LIGHT,
        )
        shape = (camera.height, camera.width)
        colour = np.reshape(colour, (*shape, 4))[..., :3].astype(np.uint8)
        empty = np.reshape(body, shape) < 0
        return colour, camera.metres(np.reshape(depth, shape)), empty

    def _turn(self, driven: list[tuple[int, float, float]], value: float) -> None:
        """Put all joints that one value drives where it says [rad or m]."""
        for joint, factor, offset in driven:
            at = float(factor * value + offset)
            self._bullet.resetJointState(self._robot, joint, at)

    def _remake_person(self, sizes: np.ndarray, things: int) -> None:
        for body in self._person:
            self._bullet.removeBody(body)
        self._sizes, self._things = sizes, things
        clad = person_colours(len(sizes) - things).tolist()
        colours = [(*colour, 1.0) for colour in (*clad, *[LOAD] * things)]
        self._person = [
            self._capsule(*size, colour)
            for size, colour in zip(sizes, colours, strict=True)
        ]

    def _capsule(self, length: float, radius: float, colour: tuple) -> int:
        solid = self._bullet.createCollisionShape(
            self._bullet.GEOM_CAPSULE, radius=radius, height=length
        )
        mesh = capsule_mesh(length, radius)
        visual = self._bullet.createVisualShape(
            self._bullet.GEOM_MESH,
            vertices=mesh.vertices.tolist(),
            normals=mesh.vertex_normals.tolist(),
            indices=mesh.faces.ravel().tolist(),
            rgbaColor=colour,
            specularColor=[0.1, 0.1, 0.1],
        )
        return self._bullet.createMultiBody(0, solid, visual)


def import_pybullet() -> ModuleType:
    """Return pybullet, whose greeting is dropped, or raise SimulatorMissing."""
    try:
        if "pybullet" not in sys.modules:
            with _without(GREETING):
                import pybullet
        import pybullet
    except ImportError as error:
        raise SimulatorMissing from error
    return pybullet


def connected() -> object:
    """Return pybullet with a simulation of its own, or raise SimulatorMissing."""
    direct = import_pybullet().DIRECT
    from pybullet_utils.bullet_client import BulletClient

    with _without(GREETING):
        return BulletClient(direct)


@contextlib.contextmanager
def _without(noise: re.Pattern) -> Iterator[None]:
    """Drop what the library says below Python that no user can do anything about.

    It writes to the process's own output. All else that is said meanwhile is said
    afterwards, to stderr.
    """
    with tempfile.TemporaryFile() as heard:
        ctypes.CDLL(None).fflush(None)  # what C said before is not ours to keep
        kept = _redirected(heard.fileno())
        try:
            yield
        finally:
            ctypes.CDLL(None).fflush(None)
            for stream, copy in kept.items():
                os.dup2(copy, stream)
                os.close(copy)
            heard.seek(0)
            said = noise.sub(b"", heard.read())
            sys.stderr.write(said.decode(errors="replace"))


def _lit(path: str, folder: Path) -> str:
    """Return a copy of a URDF in `folder`, in UTF-8, with meshes that light falls on.

    Some STL files hold no normals, and such meshes would be drawn black; and the
    library reads no UTF-16.
    """
    text, names = well_formed(Path(path)).decode(), {}
    for name in sorted(set(re.findall(r'filename\s*=\s*"([^"]+)"', text))):
        try:
            names[name] = find_mesh(name, Path(path), (), "it")
        except BadRobot:
            return path  # the library says which it misses, or knows where it is
    for k, (name, file) in enumerate(names.items()):
        if file.suffix.lower() == ".stl":
            file = _with_normals(file, folder / f"{k}.stl")
        text = text.replace(f'"{name}"', f'"{file.absolute()}"')
    copy = folder / Path(path).name
    copy.write_text(text, encoding="utf-8")
    return str(copy)


def _with_normals(file: Path, target: Path) -> Path:
    """Write an STL file with its normals; return where it is, if it can be read."""
    import trimesh

    with contextlib.suppress(Exception):  # else the library says what is wrong
        mesh = trimesh.load_mesh(file, process=False)
        bare = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        bare.export(target)
        return target
    return file


def _redirected(target: int) -> dict[int, int]:
    """Send stdout and stderr to a file descriptor; return {stream: its copy}."""
    kept = {}
    for stream in (1, 2):
        with contextlib.suppress(OSError):  # one that is closed stays so
            kept[stream] = os.dup(stream)
            os.dup2(target, stream)
    return kept


def turn_z_to(direction: np.ndarray) -> list[float]:
    """Return the quaternion x, y, z, w that turns the z axis to a direction (3,)."""
    length = np.linalg.norm(direction)
    R = rotation_to_z(direction / length) if length > 1e-9 else np.eye(3)
    return Rotation.from_matrix(R).as_quat().tolist()
