"""The scene: what stands around the robot at this place, by name, at run time."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from odm.close_test.close_test import NO_SOLIDS
from odm.close_test.static import SET_STATIC
from odm.frame.carrying import Carrier
from odm.frame.frame import Frame
from odm.frame.place import ShapeGroup, Standing
from odm.obstacles.scene_files import read_scene, write_scene
from odm.obstacles.scenery import FARTHEST
from odm.obstacles.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from odm.obstacles.surfaces import Surface
from roadmap.arrays import frozen
from roadmap.errors import BadInput
from roadmap.ranges import check_number
from roadmap.transforms import check_pose

LONGEST_NAME = 200
_SHAPES = (Box, Capsule, Cylinder, Mesh, Sphere)


@dataclass(frozen=True, eq=False)
class SceneObject:
    """A thing of the scene.

    Attributes:
        name: What it is called.
        parts: Its shapes and surfaces, each posed in the object's frame.
        T_world_object: (4, 4) where it stands [m].
    """

    name: str
    parts: tuple[Shape | Surface, ...]
    T_world_object: np.ndarray


class Scene:
    """What stands around the robot: objects by name, added, moved and removed.

    They never move by themselves; what does belongs into `step`. Poses are in the
    world, which is the base frame until `set_base`. A change costs what the cells of
    its own object cost: at once, the nodes that are too near are closed, and all edges
    that share a cell with the object. These edges (and nodes beyond the first few
    hundred) are tested one by one between frames, by `ReactivePlanner.improve`, or by
    `test_waiting`, and those found free are opened; until then the object blocks a
    little more than it must, never less.

    Args:
        frame: Base, grid and covering radius count.
        carrier: Its tests and items follow the scene.
        changed: Told of each change: the name of what is new there, None for nothing,
            and whether anything may be new.
    """

    def __init__(
        self,
        frame: Frame,
        carrier: Carrier,
        changed: Callable[[str | None, bool], None],
    ) -> None:
        self._frame, self._carrier, self._changed = frame, carrier, changed
        self._objects: dict[str, SceneObject] = {}
        self._things: dict[str, ShapeGroup] = {}
        self._p_world_static: np.ndarray | None = None
        self.outside = 0  # points that lie outside the grid

    # --- changes -----------------------------------------------------------------

    def add(
        self,
        name: str,
        thing: Shape | Surface | Sequence[Shape | Surface],
        T: np.ndarray | None = None,
    ) -> None:
        """Let a new object stand somewhere.

        Spheres, capsules, cylinders, boxes and convex meshes of up to 200 faces are
        tested by their exact distance; other meshes by points that cover them within
        the map's rho, which costs that much more free space.

        Args:
            name: What it is called in messages and later calls.
            thing: A shape of `odm`, a surface of `odm.surface_of`, or a list of them.
            T: (4, 4) pose of the object in the world [m]; None: its shapes stand where
                their own poses say.

        Raises:
            BadInput: The name is taken, the pose is not rigid, or it is no shape.
        """
        self._frame.memory.owner.check()
        name = self._new_name(name)
        made = ShapeGroup(name, _parts(name, thing), self._frame.rho)
        T = np.array(check_pose(np.eye(4) if T is None else T, "T"))
        standing = _in_reach(self._standing(made, T))
        with self._frame.memory.owner.changing("scene.add"):
            self._put(made, T, standing)

    def move(self, name: str, T: np.ndarray) -> None:
        """Let an object stand elsewhere.

        Args:
            name: Of the object.
            T: (4, 4) its new pose in the world [m].

        Raises:
            BadInput: There is no such object, or the pose is not rigid.
        """
        self._frame.memory.owner.check()
        made = self._things[self[name].name]
        T = np.array(check_pose(T, "T"))
        standing = _in_reach(self._standing(made, T))
        with self._frame.memory.owner.changing("scene.move"):
            self._put(made, T, standing)

    def remove(self, name: str) -> None:
        """Take an object away.

        Raises:
            BadInput: There is no such object.
        """
        with self._frame.memory.owner.changing("scene.remove"):
            del self._objects[self[name].name], self._things[name]
            things = {k: v for k, v in self._carrier.things.items() if k != name}
            self._stand(things, None)

    def clear(self) -> None:
        """Take all objects away; what `set_static` set stays."""
        for name in list(self._objects):
            self.remove(name)

    def load(
        self, path: str | Path, T: np.ndarray | None = None, prefix: str = ""
    ) -> list[str]:
        """Add all objects of a file: a MoveIt `.scene`, or a URDF.

        Args:
            path: The file; see `odm.obstacles.scene_files`.
            T: (4, 4) pose of the file's frame in the world; None: it is the world.
            prefix: Put before every name.

        Returns:
            The names that were added.

        Raises:
            BadInput: The file cannot be read, or a name is taken; nothing is added
                then.
        """
        self._frame.memory.owner.check()
        T = np.array(check_pose(np.eye(4) if T is None else T, "T"))
        read = [(prefix + name, parts, pose) for name, parts, pose in read_scene(path)]
        for name, *_ in read:
            self._new_name(name)
        twice = [name for name, n in Counter(row[0] for row in read).items() if n > 1]
        if twice:
            raise BadInput(
                f"{path} names two objects {twice[0]!r}; give each a name of its own"
            )
        made = [
            ShapeGroup(name, tuple(parts), self._frame.rho) for name, parts, _ in read
        ]
        places = [T @ pose for *_, pose in read]
        for thing, pose in zip(made, places, strict=True):
            _in_reach(self._standing(thing, pose))  # refuses what is too large, too
        with self._frame.memory.owner.changing("scene.load"):
            for thing, pose in zip(made, places, strict=True):
                self._put(thing, pose, self._standing(thing, pose))
        return [thing.name for thing in made]

    def save(self, path: str | Path) -> Path:
        """Write all objects to a MoveIt `.scene` file, which `load` reads back.

        Raises:
            BadInput: The path, or an object that is a surface of points.
        """
        objects = self._objects.values()
        rows = [(o.name, list(o.parts), o.T_world_object) for o in objects]
        return write_scene(path, rows)  # type: ignore[arg-type]

    def set_static(self, p_world: np.ndarray) -> None:
        """Let (n, 3) points of the world be what `ReactivePlanner.set_static` set."""
        self._p_world_static = np.array(p_world) if len(p_world) else None
        self.lay_out()

    def lay_out(self) -> None:
        """Place everything anew: the base, or what must be kept, has changed."""
        things = {}
        if self._p_world_static is not None:
            world = self._frame.world_ahead
            points = np.array(world.points(self._p_world_static))
            things[SET_STATIC] = Standing(SET_STATIC, points, points, NO_SOLIDS)
        for name, one in self._objects.items():
            things[name] = self._standing(self._things[name], one.T_world_object)
        if things or self._carrier.things:
            self.outside = self._carrier.set_place(things, anew=True)
            self._carrier.items.test_waiting()
            self._changed(None, True)

    def test_waiting(self, most: int | None = None) -> int:
        """Test nodes and edges that are closed by an object's cells alone.

        Args:
            most: How many, 10 to 60 us each; None: all.

        Returns:
            How many still wait.
        """
        self._frame.memory.owner.check()
        if most is not None:
            most = check_number("most", most, 0, 10**9, whole=True)
        return self._carrier.items.test_waiting(most)

    def __repr__(self) -> str:
        return f"Scene({', '.join(self._objects)})"

    @property
    def waiting(self) -> int:
        """How many items are closed by an object's cells alone, to be tested yet."""
        return self._carrier.items.waiting

    # --- what stands there ---------------------------------------------------------

    def __len__(self) -> int:
        return len(self._objects)

    def __iter__(self) -> Iterator[str]:
        """Go through the names, in the order in which they were added."""
        return iter(tuple(self._objects))

    def __contains__(self, name: object) -> bool:
        return name in self._objects

    def __getitem__(self, name: str) -> SceneObject:
        """Return an object by name.

        Raises:
            BadInput: There is none.
        """
        found = self._objects.get(name) if isinstance(name, str) else None
        if found is None:
            known = ", ".join(map(repr, self._objects)) or "empty"
            raise BadInput(f"the scene has no object {name!r}; it is: {known}")
        return found

    def shapes(self) -> list[tuple[str, Shape | Surface]]:
        """Return (name, part) of all parts, where they stand in the world."""
        return [
            (one.name, part.moved(one.T_world_object))
            for one in self._objects.values()
            for part in one.parts
        ]

    def identity(self) -> bytes:
        """Return what tells this scene from others, as bytes."""
        static = self._p_world_static
        words = [b"" if static is None else static.tobytes()]
        for name, one in sorted(self._objects.items()):
            words += [name.encode(), one.T_world_object.tobytes()]
            words += [_part_identity(part) for part in one.parts]
        return b"".join(words)

    # --- inside --------------------------------------------------------------------

    def _in_base(self, T_world: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(self._frame.base_world @ T_world)

    def _standing(self, made: ShapeGroup, T_world: np.ndarray) -> Standing:
        return made.at(self._in_base(T_world), self._frame.static)

    def _put(self, made: ShapeGroup, T_world: np.ndarray, standing: Standing) -> None:
        """Let a thing stand there, where it was or for the first time."""
        name, pose = made.name, frozen(T_world, np.float64)
        self._things[name] = made
        self._objects[name] = SceneObject(name, made.parts, pose)
        self._stand({**self._carrier.things, name: standing}, name)

    def _stand(self, things: dict[str, Standing], new: str | None) -> None:
        self.outside = self._carrier.set_place(things)
        self._changed(new, False)

    def _new_name(self, name: str) -> str:
        text = isinstance(name, str) and name.isprintable() and name == name.strip()
        if not text or not 0 < len(name) <= LONGEST_NAME:
            short = isinstance(name, str | int | float | None)
            it = repr(name) if short else f"a {type(name).__name__}"
            raise BadInput(
                f"an object of the scene cannot be called {it}; give its name first, "
                f"a line of 1 to {LONGEST_NAME} characters, no blank at its ends"
            )
        if name in self._objects or name == SET_STATIC:
            raise BadInput(
                f"the scene has an object {name!r} already; move or remove it, or give "
                "another name"
            )
        return name


def _in_reach(standing: Standing) -> Standing:
    """Return it, unless it stands so far away that the unit must be another one."""
    nearest = np.linalg.norm(standing.samples, axis=1).min(initial=np.inf)
    if FARTHEST < nearest < np.inf:
        raise BadInput(
            f"{standing.name!r} would stand {nearest:.0f} m from the robot's base, "
            f"more than {FARTHEST:g} m; give its pose in metres"
        )
    return standing


def _parts(name: str, thing: object) -> tuple[Shape | Surface, ...]:
    parts = tuple(thing) if isinstance(thing, list | tuple) else (thing,)
    for part in parts:
        if not isinstance(part, (*_SHAPES, Surface)):
            raise BadInput(
                f"{name!r} holds a {type(part).__name__}, which is no shape; give an "
                "odm.Box, Sphere, Capsule, Cylinder or Mesh, a surface of "
                "odm.surface_of, or a list of them"
            )
    if not parts:
        raise BadInput(f"{name!r} has no shape; give one or more")
    return parts


def _part_identity(part: Shape | Surface) -> bytes:
    values = [type(part).__name__.encode()]
    for key in sorted(vars(part)):
        value = getattr(part, key)
        array = isinstance(value, np.ndarray)
        values.append(value.tobytes() if array else repr(value).encode())
    return b"".join(values)
