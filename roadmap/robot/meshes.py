"""Find and read the mesh files that a robot description names."""

import io
import os
from contextlib import suppress
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from roadmap.errors import BadRobot
from roadmap.transforms import moved_points

_FARTHEST = 1e6  # [m] beyond it a hull has no digits left; `sizes` asks for far less


def find_mesh(filename: str, urdf: Path, package_dirs: tuple, link: str) -> Path:
    """Return the file that `filename` of a URDF means.

    `package://name/rest` is looked up in `package_dirs`, in ROS_PACKAGE_PATH, and in
    the folder of the URDF and each folder above it, with and without `name`.
    """
    folder = urdf.resolve().parent
    remedy = "correct the file's name, which starts at the folder of the URDF"
    if filename.startswith("package://"):
        remedy = "set ROS_PACKAGE_PATH to the folder that holds the package"
        candidates = _in_packages(filename[len("package://") :], folder, package_dirs)
    else:
        plain = filename[len("file://") :] if filename.startswith("file://") else ""
        path = Path(unquote(plain) if plain else filename)
        candidates = [path] if path.is_absolute() else [folder / path]
        candidates += [Path(d) / path for d in package_dirs]
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    places = ", ".join(dict.fromkeys(str(c.parent) for c in candidates[:4]))
    raise BadRobot(
        f"the mesh {filename!r} of link {link!r} is not there (looked in {places}"
        f"{', ...' if len(candidates) > 4 else ''}); {remedy}"
    )


def _in_packages(rest: str, folder: Path, package_dirs: tuple) -> list[Path]:
    name, _, inside = rest.partition("/")
    ros = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
    roots = [Path(d) for d in (*package_dirs, *ros) if str(d)]
    candidates = []
    for root in [*roots, folder, *folder.parents]:
        candidates += [root / rest, root / inside]
        if root.name == name:
            candidates.append(root / inside)
    return candidates


def read_vertices(path: Path, scale: tuple[float, ...], link: str) -> np.ndarray:
    """Return the scaled vertices (n, 3) of all parts of a mesh file [m].

    A COLLADA file's unit is applied, its up axis is not: ROS reads them that way.
    """
    try:
        points = _load(path)
    except Exception as error:
        raise BadRobot(
            f"the mesh {str(path)!r} of link {link!r} cannot be read: "
            f"{type(error).__name__}: {error}; {_remedy(path)}"
        ) from error
    points = np.asarray(points, float).reshape(-1, 3)
    if len(points) == 0 or not np.isfinite(points).all():
        raise BadRobot(
            f"the mesh {str(path)!r} of link {link!r} holds no finite triangles; "
            f"{_remedy(path)}"
        )
    points = points * np.asarray(scale)
    farthest = np.abs(points).max()
    if farthest > _FARTHEST:
        raise BadRobot(
            f"the mesh {str(path)!r} of link {link!r} reaches {farthest:.3g} m far, "
            f"but at most {_FARTHEST:g} m can be read; correct its corners, or its "
            "scale"
        )
    return points


def unit_of(path: Path) -> float:
    """Return the unit [m] that a COLLADA file states; 1 for any other file."""
    return _dae_unit(path.read_bytes()) if path.suffix.lower() == ".dae" else 1.0


def _remedy(path: Path) -> str:
    """Return what to do about a mesh file that holds none."""
    with suppress(OSError):
        if path.read_bytes().startswith(b"version https://git-lfs"):
            return (
                "it is only the pointer of Git LFS: run git lfs pull in its repository"
            )
    return "export it again as STL, OBJ or DAE"


def _load(path: Path) -> np.ndarray:
    import trimesh

    kind, data = path.suffix.lower().lstrip("."), path.read_bytes()
    if kind == "obj":
        return _obj_vertices(data)
    scene = trimesh.load_scene(io.BytesIO(data), file_type=kind, process=False)
    points = [np.empty((0, 3))]
    for node in scene.graph.nodes_geometry:
        T_scene_mesh, name = scene.graph[node]
        mesh = scene.geometry[name]
        used = mesh.vertices[np.unique(mesh.faces)]
        points.append(moved_points(used, T_scene_mesh))
    return np.concatenate(points) * (_dae_unit(data) if kind == "dae" else 1.0)


def _obj_vertices(data: bytes) -> np.ndarray:
    """Read the vertices that faces use; bytes, since comments may be in any code."""
    vertices: list[list[float]] = []
    used: set[int] = set()
    for line in data.splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == b"v":
            vertices.append([float(w) for w in words[1:4]])
        elif words[0] == b"f":
            ids = [int(w.split(b"/")[0]) for w in words[1:]]
            used.update(i - 1 if i > 0 else len(vertices) + i for i in ids)
    return np.array(vertices)[sorted(used)] if used else np.empty((0, 3))


def _dae_unit(data: bytes) -> float:
    from lxml import etree

    root = etree.fromstring(data, etree.XMLParser(recover=True))
    for unit in root.iter("{*}unit"):
        return float(unit.get("meter", 1.0))
    return 1.0
