"""Obstacles of a frame as shapes and points, written in place by the caller."""

from collections.abc import Iterable, Mapping, Sequence, Sized
from functools import lru_cache
from operator import attrgetter
from typing import Any

import numpy as np

from odm._groups import new
from odm.checks import check_classes, check_points
from odm.obstacles import _solid_samples as kernels
from odm.obstacles import shapes as solid
from odm.obstacles._solid_samples import KEPT, WIDTHS, Patterns
from odm.obstacles._solids import MESH, Solids
from odm.obstacles.mesh_surface import FRAME_FINE, sample_closed_mesh
from roadmap.arrays import as_floats, writable
from roadmap.errors import BadInput
from roadmap.geometry.solids import hull_facets
from roadmap.ranges import check_kind, check_number, told

KINDS = ("capsules", "spheres", "cylinders", "boxes", "meshes")
_ONE = ("capsule", "sphere", "cylinder", "box", "mesh")
_ROWS = {
    "capsules": "[ax ay az bx by bz r]",
    "spheres": "[x y z r]",
    "cylinders": "[ax ay az bx by bz r]",
    "boxes": "pose (3, 4) row by row, then three edge lengths",
    "meshes": "poses (3, 4) row by row",
}
MOST_SHAPES = 1_000_000  # of a kind; a frame takes fewer
_NO_POINTS = np.zeros((0, 3))
_WRONG = {
    kernels.NOT_FINITE: "is not finite, so it may be anywhere; check the sensor",
    kernels.NO_RADIUS: "has a radius that is not above 0; give its true radius",
    kernels.NO_LENGTH: "has two equal ends and so no direction; give a sphere",
    kernels.NO_SIZE: "has an edge length that is not above 0; give its true size",
    kernels.NO_POSE: "has a pose that is no rigid motion; give a rotation",
    kernels.TOO_ROUND: f"has a radius above {kernels.WIDEST:g} m; give metres",
    kernels.TOO_LARGE: f"is larger than {kernels.LARGEST:g} m; give metres",
}


def _written_in_place(kind: str, row: str) -> Any:  # noqa: ANN401 (a property)
    """Return the rows of one kind of shape; setting them writes into the array."""
    return property(
        attrgetter("_" + kind),  # in C: a frame reads them
        lambda self, rows: self._write(kind, rows),
        doc=f"{row} [m]; setting it writes into the array.",
    )


class Obstacles:
    """Shapes and points around the robot: what `planner.step` takes each frame.

    Made once, for so many shapes of each kind; then the caller writes where they are
    into its arrays, frame by frame: `obstacles.capsules[:] = ...`. All numbers are in
    metres, in the base frame, or in the world's after `set_base`. The close test takes
    the shapes' exact distances, and their cells are found inside the compiled frame.
    Rows that were never written are NaN, and hold the robot. Where another number of
    shapes is seen, another object is given.

    Args:
        capsules: (k, 7) ends a and b and radius, or k. A zero length is a sphere.
        spheres: (k, 4) centre and radius, or k.
        boxes: (k, 15) the pose (3, 4) of the centre, row by row, and three full edge
            lengths; or k.
        cylinders: (k, 7) centres a and b of the end discs and radius; or k.
        meshes: Closed meshes as `odm.Mesh`; each counts as its convex hull.
        points: (n, 3) points beside them, as `step` takes them; None for none.
        labels: Names of the shapes by kind, told where one is in the way:
            `{"capsules": ["upper arm", "forearm"]}`.
        classes: By kind, or "points": odm.AVOID, CONTACT or OBJECT of each.

    Attributes:
        capsules, spheres, cylinders, boxes: Arrays to be written into.
        poses: (k, 3, 4) poses of the meshes.

    Raises:
        BadInput: An array of another shape, or a name or class too many.
    """

    # no others: a name with a slip, written to each frame, would be read by nobody
    __slots__ = (
        "_boxes", "_capsules", "_counts", "_cylinders", "_data", "_hulls", "_labels",
        "_meshes", "_points", "_poses", "_shape_classes", "_size", "_spheres",
        "classes",
    )  # fmt: skip

    def __init__(
        self,
        *,
        capsules: np.ndarray | int = 0,
        spheres: np.ndarray | int = 0,
        cylinders: np.ndarray | int = 0,
        boxes: np.ndarray | int = 0,
        meshes: Sequence[solid.Mesh] = (),
        points: np.ndarray | None = None,
        labels: Mapping[str, Sequence[str]] | None = None,
        classes: Mapping[str, Sequence[int]] | None = None,
    ) -> None:
        if (
            spheres is cylinders is boxes is _NONE
            and points is labels is classes is None
        ):
            if type(meshes) is tuple and not meshes:
                self._hold_capsules(capsules)  # a frame makes several of these
                return
        if type(meshes) is not tuple and not isinstance(meshes, Sequence):
            raise BadInput(f"meshes are a {type(meshes).__name__}; give a list of them")
        self._hulls = tuple(hull_of(mesh, k) for k, mesh in enumerate(meshes))
        poses = [mesh.T_base_shape[:3].ravel() for mesh in meshes]
        given = {
            "capsules": capsules,
            "spheres": spheres,
            "cylinders": cylinders,
            "boxes": boxes,
            "meshes": np.array(poses).reshape(-1, 12) if poses else _NONE,
        }
        rows = [
            _NO_ROWS[k] if part is _NONE else _rows(kind, part, WIDTHS[k])
            for k, (kind, part) in enumerate(given.items())
        ]
        self._counts = np.array([len(part) for part in rows])
        self._data = np.concatenate([part.ravel() for part in rows])
        self._lay_out()
        self._points = _NO_POINTS
        if points is not None:
            self.points = points
        self._shape_classes: np.ndarray | None = None
        self.labels = labels
        self.classes: np.ndarray | None = None
        if classes is not None:
            self._classify(self._by_kind("classes", classes, (*KINDS, "points")))

    def _lay_out(self) -> None:
        """Let the rows of each kind be views of the array that a frame reads."""
        at = 0
        for kind, n, width in zip(KINDS, self._counts.tolist(), WIDTHS, strict=True):
            setattr(self, "_" + kind, self._data[at : at + n * width].reshape(n, width))
            at += n * width
        self._size = int(self._counts.sum())
        self._poses = self._meshes.reshape(-1, 3, 4)

    def __setstate__(self, state: tuple[None, dict]) -> None:
        """Take up what was copied or pickled: each array by itself, no more a view."""
        for name, value in state[1].items():
            setattr(self, name, value)
        self._counts, self._data = writable(self._counts), writable(self._data)
        self._lay_out()

    def _hold_capsules(self, capsules: np.ndarray | int) -> None:
        _, self._spheres, self._cylinders, self._boxes, self._meshes = _NO_ROWS
        self._poses, self._points = _NO_POSES, _NO_POINTS
        self._capsules = rows = np.array(_rows("capsules", capsules, WIDTHS[0]))
        self._size = n = len(rows)
        self._counts = np.array([n, 0, 0, 0, 0])
        self._hulls, self._data = (), rows.ravel()
        self._shape_classes = None
        self._labels: dict[str, Sequence[str]] = {}
        self.classes = None

    def __repr__(self) -> str:
        counts = [*zip(self._counts.tolist(), KINDS, strict=True)]
        told = [f"{n} {k}" for n, k in (*counts, (len(self.points), "points")) if n]
        return f"Obstacles({', '.join(told)})"

    def _classify(self, classes: dict) -> None:
        """Keep the classes of points and of all shapes."""
        if "points" in classes:
            self.classes = np.asarray(classes["points"])
        ends = np.cumsum(self._counts).tolist()
        for kind, n, end in zip(KINDS, self._counts.tolist(), ends, strict=True):
            if kind in classes:
                checked = np.asarray(check_classes(classes[kind], n))
                self.shape_classes[end - n : end] = checked

    @classmethod
    def of(
        cls, shapes: Sequence[solid.Shape], points: np.ndarray | None = None
    ) -> "Obstacles":
        """Return obstacles that hold these shapes, where they are, and points.

        Args:
            shapes: Spheres, capsules, cylinders, boxes and meshes of `odm`.
            points: (n, 3), None for none [m].
        """
        check_kind("shapes", shapes, Iterable, "give a list of shapes")
        if isinstance(shapes, np.ndarray):  # maybe of no dimension
            shapes = shapes.ravel().tolist()
        rows: dict[str, list] = {kind: [] for kind in KINDS}
        for shape in shapes:
            if isinstance(shape, solid.Mesh):
                rows["meshes"].append(shape)
            elif isinstance(shape, solid.Sphere):
                rows["spheres"].append([*shape.T_base_shape[:3, 3], shape.radius])
            elif isinstance(shape, solid.Box):
                pose = shape.T_base_shape[:3].ravel()
                rows["boxes"].append([*pose, *shape.size])
            elif isinstance(shape, solid.Capsule | solid.Cylinder):
                kind = "capsules" if isinstance(shape, solid.Capsule) else "cylinders"
                rows[kind].append(np.concatenate([*shape.ends(), [shape.radius]]))
            else:
                raise BadInput(
                    f"a {type(shape).__name__} is no shape; give a Sphere, Capsule, "
                    "Cylinder, Box or Mesh"
                )
        plain: dict[str, Any] = {
            k: np.array(r) if r else 0 for k, r in rows.items() if k != "meshes"
        }
        return cls(**plain, meshes=rows["meshes"], points=points)

    def __len__(self) -> int:
        return self._size

    capsules = _written_in_place("capsules", "(k, 7) ends a and b and radius")
    spheres = _written_in_place("spheres", "(k, 4) centre and radius")
    cylinders = _written_in_place("cylinders", "(k, 7) ends of the axis and radius")
    boxes = _written_in_place("boxes", "(k, 15) pose (3, 4) and edge lengths")
    poses = _written_in_place("poses", "(k, 3, 4) poses of the meshes")

    points = property(
        attrgetter("_points"),
        lambda self, rows: self._take_points(rows),
        doc="(n, 3) points beside the shapes [m]; any other array may take its place.",
    )
    labels = property(
        attrgetter("_labels"),
        lambda self, names: self._take_labels(names),
        doc="Names of the shapes by kind; a mapping, or None for none.",
    )
    shape_classes = property(
        lambda self: self._lend_classes(),
        lambda self, classes: self._take_classes(classes),
        doc="(k,) int8 classes of all shapes, kind after kind; may be written into.",
    )
    told_classes = property(
        attrgetter("_shape_classes"),
        doc="The same; None where nobody has asked for them: all are AVOID.",
    )
    meshes = property(
        attrgetter("_hulls"), doc="The meshes as `Hull`, each in its own frame."
    )

    def name(self, k: int) -> str:
        """Return what shape k is called: its kind and number, and its label.

        Shapes are counted from 0, kind after kind, as `KINDS` has them.

        Raises:
            BadInput: k is no whole number of at least 0.
        """
        check_number("the number of a shape", k, 0, np.inf, whole=True)
        for kind, one, n in zip(KINDS, _ONE, self._counts.tolist(), strict=True):
            if k < n:
                labels = self.labels.get(kind)
                label = labels[k] if labels else ""
                return f"{one} {k}" + (f" ({label})" if label else "")
            k -= n
        return f"shape {k}"

    def trouble(self, code: int, kind: int, k: int) -> str:
        """Return what is wrong with shape k of a kind; see `_solid_samples`."""
        k += int(self._counts[:kind].sum())
        return f"{self.name(k)} {_WRONG[code]}"

    def _take_points(self, points: np.ndarray) -> None:
        self._points = check_points(points, None, None, np.inf)

    def _take_labels(self, labels: object) -> None:
        self._labels = self._by_kind("labels", labels, KINDS)

    def _lend_classes(self) -> np.ndarray:
        if self._shape_classes is None:
            self._shape_classes = np.zeros(self._size, np.int8)
        return self._shape_classes

    def _take_classes(self, classes: object) -> None:
        self._shape_classes = check_classes(classes, self._size)

    def _write(self, kind: str, rows: np.ndarray) -> None:
        there = getattr(self, "_" + kind)
        rows = as_floats(kind, rows)
        if rows.shape != there.shape:
            raise BadInput(
                f"{kind} have shape {rows.shape}, but these obstacles were made for "
                f"{there.shape}; make others for another number"
            )
        there[...] = rows

    def _by_kind(self, what: str, given: object, kinds: tuple[str, ...]) -> dict:
        if given is None:
            return {}
        if not isinstance(given, Mapping) or not set(given) <= set(kinds):
            raise BadInput(
                f"{what} are {told(given)}; give a mapping from some of "
                f"{', '.join(kinds)} "
                "to one for each"
            )
        given = {kind: values for kind, values in given.items() if values is not None}
        for kind, values in given.items():
            n = len(getattr(self, "_" + kind))
            alone = getattr(values, "ndim", 1) == 0  # an array of no dimension
            counted = () if alone else Sized
            check_kind(f"{what} of {kind}", values, counted, "give one for each")
            if len(values) != n:
                raise BadInput(
                    f"{len(values)} {what} of {kind} were given for {n}; give one for "
                    "each"
                )
        return given


# the rows of the shapes, kind after kind, and (5,) how many there are of each kind:
# compiled loops read them unchecked, so nobody else gets hold of them
lent_arrays = attrgetter("_data", "_counts")


class Hull:
    """A convex hull in its own frame, as the close test takes it.

    Attributes:
        faces: (f, 13) outward normal, offset and three corners of each [m].
        ball: (4,) centre and radius of a ball around it [m].
    """

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray) -> None:
        """Compute the planes; the offset holds all vertices whatever rounding does."""
        self.vertices, self.triangles = vertices, triangles
        a, b, c = (vertices[triangles[:, i]] for i in range(3))
        normal = np.cross(b - a, c - a)
        size = np.linalg.norm(normal, axis=1)
        keep = size > 1e-12
        normal = normal[keep] / size[keep, None]
        offset = (normal @ vertices.T).max(axis=1)
        parts = [normal, offset[:, None], a[keep], b[keep], c[keep]]
        self.faces = np.ascontiguousarray(np.hstack(parts))
        center = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
        far = np.linalg.norm(vertices - center, axis=1).max()
        self.ball = np.append(center, far * (1.0 + 1e-12))
        for array in (vertices, triangles, self.faces, self.ball):
            array.flags.writeable = False  # one hull serves all who have the mesh
        self._samples: tuple[float, np.ndarray] | None = None

    def samples(self, spacing: float) -> np.ndarray:
        """Return points (n, 3) that cover the surface within `spacing` [m]."""
        if self._samples is None or self._samples[0] != spacing:
            mesh = self.vertices, self.triangles
            points, _ = sample_closed_mesh(*mesh, spacing, FRAME_FINE)
            points.flags.writeable = False
            self._samples = spacing, points
        return self._samples[1]


def hull_of(mesh: object, k: int = 0) -> Hull:
    """Return the convex hull of mesh number k, in the mesh's own frame."""
    if not isinstance(mesh, solid.Mesh):
        raise BadInput(f"mesh {k} is a {type(mesh).__name__}; give an odm.Mesh")
    hull = _hull_of_vertices(np.ascontiguousarray(mesh.vertices).tobytes())
    if hull is None:
        raise BadInput(f"mesh {k} is flat; give a solid")
    return hull


@lru_cache(maxsize=256)
def _hull_of_vertices(vertices: bytes) -> Hull | None:
    """Return the hull of vertices (n, 3), which keeps its samples; None: it is flat.

    Who makes obstacles anew each frame has the same meshes in them, as a rule: their
    samples take 4 to 100 ms, by their size; to know them again takes microseconds.
    """
    from scipy.spatial import QhullError

    corners = np.frombuffer(vertices).reshape(-1, 3)
    try:
        facets = hull_facets(corners)
    except QhullError:
        return None
    used, triangles = np.unique(facets, return_inverse=True)
    return Hull(np.ascontiguousarray(corners[used]), triangles.reshape(-1, 3))


_NONE = 0  # of the default; most frames have capsules and nothing else
_NO_ROWS = [np.zeros((0, w)) for w in WIDTHS]  # as in `KINDS`
_NO_POSES = np.zeros((0, 3, 4))
_WHOLE = (int, np.integer)


def _rows(kind: str, given: object, width: int) -> np.ndarray:
    if isinstance(given, _WHOLE) and not isinstance(given, bool):
        if not 0 <= given <= MOST_SHAPES:
            raise BadInput(
                f"{told(given)} {kind} were asked for; give 0 to {MOST_SHAPES}"
            )
        return np.full((int(given), width), np.nan)
    rows = as_floats(kind, given)
    if rows.ndim != 2 or rows.shape[1] != width:
        raise BadInput(
            f"{kind} have shape {rows.shape}; give (k, {width}): {_ROWS[kind]}, or how "
            "many there will be"
        )
    return rows


def room_for(
    obstacles: Obstacles,
    solids: Solids,
    patterns: Patterns,
    more: int = 0,
    sampled: bool = True,
) -> tuple[Solids, Patterns] | None:
    """Return larger groups where these are too small for the obstacles, or None.

    `more` rows of patterns are needed; `sampled`: samples of meshes, too.
    """
    faces = sum(len(hull.faces) for hull in obstacles.meshes)
    spacing, samples = float(patterns.rho[0]), 0
    if sampled:
        samples = sum(len(hull.samples(spacing)) for hull in obstacles.meshes)
    needed = {
        "shapes": (len(solids.kind), len(obstacles)),
        "faces": (len(solids.faces), faces),
        "patterns": (len(patterns.rows), more),
        "samples": (len(patterns.samples), samples),
    }
    if all(there >= need for there, need in needed.values()):
        return None
    sizes = {k: max(there, 2 * need) for k, (there, need) in needed.items()}
    kept = {name: getattr(patterns, name) for name in KEPT}
    return new(Solids, sizes), new(Patterns, sizes, **kept)


def write_meshes(
    obstacles: Obstacles, solids: Solids, patterns: Patterns, sampled: bool = True
) -> None:
    """Write the faces and samples of the obstacles' meshes, for which there is room."""
    face = sample = 0
    for k, hull in enumerate(obstacles.meshes):
        points = hull.samples(float(patterns.rho[0])) if sampled else _NO_POINTS
        ends = face + len(hull.faces), sample + len(points)
        solids.faces[face : ends[0]] = hull.faces
        patterns.samples[sample : ends[1]] = points
        patterns.mesh[k] = face, ends[0], sample, ends[1]
        patterns.ball[k] = hull.ball
        face, sample = ends


def some_of(solids: Solids, chosen: np.ndarray) -> Solids:
    """Return those of the shapes where `chosen` (n,) is True."""
    n = solids.count[0]
    rows = solids.rows[:n][chosen]  # a copy
    return Solids(rows, solids.kind[:n][chosen], np.array([len(rows)]), solids.faces)


def together(groups: Sequence[Solids]) -> tuple[Solids, np.ndarray]:
    """Return copies of all groups' shapes, and (groups + 1,) where each begins."""
    counts = [group.count.item() for group in groups]
    ptr = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])
    pairs = list(zip(groups, counts, strict=True))
    solids = new(Solids, {"shapes": int(ptr[-1]), "faces": 0})
    faces, before = [solids.faces], 0
    for (group, n), at in zip(pairs, ptr[:-1].tolist(), strict=True):
        rows, kind = solids.rows[at : at + n], solids.kind[at : at + n]
        rows[...], kind[...] = group.rows[:n], group.kind[:n]
        if len(group.faces):
            rows[kind == MESH, 12:14] += before
            faces.append(group.faces)
            before += len(group.faces)
    solids.count[0] = ptr[-1]
    return solids._replace(faces=np.concatenate(faces)), ptr


class SolidRoom:
    """Room for obstacles that are no frame's: shapes as solids, without samples."""

    def __init__(self) -> None:
        sizes = {"shapes": 0, "faces": 0, "patterns": 0, "samples": 0}
        self._solids, self._patterns = new(Solids, sizes), new(Patterns, sizes)

    def of(self, obstacles: Obstacles, T: np.ndarray) -> Solids | None:
        """Return the shapes as solids, moved by T (4, 4); None where one is wrong.

        Those before are overwritten.
        """
        # what has no meshes needs rows alone
        if obstacles.meshes or len(obstacles) > len(self._solids.kind):
            larger = room_for(obstacles, self._solids, self._patterns, sampled=False)
            if larger is not None:
                self._solids, self._patterns = larger
            write_meshes(obstacles, self._solids, self._patterns, sampled=False)
        solids, patterns = self._solids, self._patterns
        arrays = lent_arrays(obstacles)
        code = kernels.take_solids(*arrays, T, solids, patterns)
        return solids if code == kernels.FINE else None
