"""Points on a closed triangle mesh, and the covering radius computed for them."""

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from odm.obstacles._surfaces import cover_lists, greedy_cover
from roadmap.errors import BadInput

if TYPE_CHECKING:
    import trimesh

_FINE = 6.0  # triangles are cut to a sixth of the spacing before points are chosen
FRAME_FINE = 4.0  # ... of a mesh first seen in a frame: 9 % more points, in a third
MOST_FACES = 200  # of a convex mesh that is held exactly, by its planes
_MAX_PAIRS = 1e6  # of neighbouring triangles: bounds memory and time
_MOST_PAIRS = 1e7  # of a mesh that is finer itself, before triangles are put together
_SOME = 8  # of so many triangles the pairs of one are counted first


def sample_closed_mesh(
    vertices: np.ndarray, faces: np.ndarray, spacing: float, parts: float = _FINE
) -> tuple[np.ndarray, float]:
    """Choose few points of a closed mesh that cover its whole surface.

    Triangles are halved until the smallest circle around each is small; a triangle
    is covered by a point when its circle's centre is near enough for the whole circle
    to lie within `spacing`. Points are chosen greedily by the area they newly cover.

    Args:
        vertices: (n, 3) [m].
        faces: (m, 3) vertex indices.
        spacing: Bound on the covering radius [m].
        parts: Triangles are cut to this part of the spacing, from 2 on. Fewer take less
            time, by the fourth power, and more points.

    Returns:
        (k, 3) points on the mesh and the covering radius proved for them [m].

    Raises:
        BadInput: The mesh is not closed, or too large for the spacing.
    """
    points, radius = _sampled(
        np.ascontiguousarray(vertices, np.float64).tobytes(),
        np.ascontiguousarray(faces, np.int64).tobytes(),
        float(spacing),
        float(parts),
    )
    return points.copy(), radius


@lru_cache(maxsize=64)
def _sampled(
    vertices: bytes, faces: bytes, spacing: float, parts: float
) -> tuple[np.ndarray, float]:
    """Choose the points of `sample_closed_mesh`; the same meshes come often."""
    corners = closed_triangles(
        np.frombuffer(vertices).reshape(-1, 3),
        np.frombuffer(faces, np.int64).reshape(-1, 3),
    )
    area = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    # a halved triangle converges to half a square, of area (circle radius)^2
    finest = (np.pi * area.sum() * spacing**2 / _MAX_PAIRS) ** 0.25
    fine = max(spacing / parts, finest)
    if fine > 0.5 * spacing:
        least = np.sqrt(16.0 * np.pi * area.sum() / _MAX_PAIRS)
        raise BadInput(
            f"a mesh of {area.sum():.3g} m2 is too large for spacing {spacing} m: "
            f"use at least {least:.3g} m, or cut the mesh into closed parts"
        )
    centers, radii, area = _cut(corners, fine)
    one, reach, whole = _patches(centers, radii, area, spacing, fine)
    keep = one[_choose(centers[one], reach, whole, spacing)]
    return centers[keep], _proved_radius(centers, radii, keep)


def cover_densely(vertices: np.ndarray, faces: np.ndarray, radius: float) -> np.ndarray:
    """Return many points of a closed mesh with covering radius at most `radius` [m]."""
    return _cut(closed_triangles(vertices, faces), radius)[0]


def closed_triangles(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the corners (m, 3, 3) of a mesh; refuse one that is not closed."""
    # as it is, or with its equal corners made one: a hull may have corners that are
    # nanometres apart, and to make those one tears it open
    if _open_edges(faces):
        mesh = _merged(vertices, faces)
        if not mesh.is_watertight:
            left = _open_edges(mesh.faces) if len(mesh.faces) else 3 * len(faces)
            raise BadInput(
                f"a mesh of {len(faces)} faces is not closed (watertight): {left} "
                "edges are not between two faces; fill its holes, take its hull, "
                "or give its points with a declared covering radius"
            )
        return np.asarray(mesh.triangles, float)
    return np.asarray(vertices, float)[faces]


def is_inside(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return which points (n, 3) a closed mesh of (m, 3, 3) corners holds, (n,) bool.

    By the solid angle that it takes up around each; not by the loop that the audit asks
    (`roadmap/geometry/_winding.py`), which shares no arithmetic with what it audits.
    """
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    held = ((points > low) & (points < high)).all(axis=1)
    for k in np.flatnonzero(held):
        a, b, c = np.moveaxis(triangles - points[k], 1, 0)
        x, y, z = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
        ab, bc, ca = (np.einsum("mi,mi->m", *two) for two in ((a, b), (b, c), (c, a)))
        volume = np.einsum("mi,mi->m", a, np.cross(b, c))
        half = np.arctan2(volume, x * y * z + ab * z + bc * x + ca * y)
        held[k] = abs(half.sum()) > np.pi
    return held


def require_solid(vertices: np.ndarray, faces: np.ndarray) -> None:
    """Refuse a mesh that is neither closed nor, but for rounding, a small hull."""
    if _open_edges(faces) and not is_small_hull(vertices, faces):
        closed_triangles(vertices, faces)


def turned_alike(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the faces (m, 3) of a solid, turned so that neighbours agree.

    Qhull and some programs turn them either way; then what is inside would count as
    outside. A closed part in which two faces disagree is turned outside out; one in
    which all agree stays as it is: turned inside out, it is a hollow.

    Args:
        vertices: (n, 3) [m].
        faces: (m, 3) vertex indices of a mesh that `require_solid` takes.

    Raises:
        BadInput: Faces without area, which leave nothing to compare.
    """
    joined = faces
    if _open_edges(faces):
        if is_small_hull(vertices, faces):
            return faces
        joined = np.asarray(_merged(vertices, faces).faces, np.int64)
        if len(joined) != len(faces):
            raise BadInput(
                f"{len(faces) - len(joined)} of {len(faces)} faces of a mesh have no "
                "area; remove them"
            )
    ends = np.concatenate([joined[:, [0, 1]], joined[:, [1, 2]], joined[:, [2, 0]]])
    forth = ends[:, 0] < ends[:, 1]
    key = ends.min(axis=1) * (int(ends.max()) + 1) + ends.max(axis=1)
    order = np.argsort(key, kind="stable").reshape(-1, 2)  # each edge has two faces
    clash = forth[order[:, 0]] == forth[order[:, 1]]
    if not clash.any():
        return faces
    return _agreed(vertices, faces, order % len(faces), clash)


def _agreed(
    vertices: np.ndarray, faces: np.ndarray, pairs: np.ndarray, clash: np.ndarray
) -> np.ndarray:
    """Return faces that agree; pairs (e, 2) are neighbours, clash (e,) if they do not.

    A face turns if an odd number of clashes lies on the way to it from another one.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    m, rows = len(faces), np.concatenate([pairs, pairs[:, ::-1]])
    told = np.tile(np.where(clash, 2.0, 1.0), 2)
    kept = np.unique(rows, axis=0, return_index=True)[1]  # two may share two edges
    near = coo_matrix((told[kept], rows[kept].T), (m, m)).tocsr()
    _, part = connected_components(near, directed=False)
    turned, found = np.zeros(m, bool), faces.copy()
    for k in np.unique(part[pairs[clash, 0]]):
        first = int(np.flatnonzero(part == k)[0])
        way, before = breadth_first_order(near, first, directed=False)
        for face in way[1:]:
            turned[face] = turned[before[face]] ^ (near[before[face], face] == 2.0)
        found[way] = np.where(turned[way, None], faces[way, ::-1], faces[way])
        if volume(vertices, found[way]) < 0.0:
            found[way] = found[way, ::-1]
    return found


def is_small_hull(vertices: np.ndarray, faces: np.ndarray) -> bool:
    """Return whether a mesh is convex, but for rounding, and has few faces.

    Then its hull stands for it: it contains the mesh, and has its volume.
    """
    from scipy.spatial import ConvexHull, QhullError

    if len(faces) > MOST_FACES:
        return False
    try:
        whole = ConvexHull(vertices)
    except QhullError:
        return False
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    hole = np.linalg.norm(np.cross(b - a, c - a).sum(axis=0)) / 2.0
    closed = hole <= 1e-6 * whole.area  # the areas of a closed surface add up to 0
    return bool(closed and abs(volume(vertices, faces)) >= (1 - 1e-6) * whole.volume)


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Return the volume within a closed mesh [m3]; below 0 where it is inside out."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    middle = a.mean(axis=0)
    return float(np.einsum("fi,fi->", a - middle, np.cross(b - middle, c - middle)) / 6)


def _merged(vertices: np.ndarray, faces: np.ndarray) -> "trimesh.Trimesh":
    """Return a mesh whose equal corners are made one."""
    import trimesh

    return trimesh.Trimesh(vertices, faces, process=True)


def _open_edges(faces: np.ndarray) -> int:
    """Return how many edges are not between two faces."""
    ends = np.sort(
        np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    )
    key = ends[:, 0] * (int(ends.max()) + 1) + ends[:, 1]
    return int((np.unique(key, return_counts=True)[1] != 2).sum())


def enclosing_circles(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return centres (m, 3) and radii (m,) of the smallest circles around triangles."""
    edges = np.roll(corners, -1, axis=1) - corners
    squared = np.einsum("mij,mij->mi", edges, edges)
    longest = squared.argmax(axis=1)
    rows = np.arange(len(corners))
    centers = corners[rows, longest] + 0.5 * edges[rows, longest]
    a = squared[:, [1, 2, 0]]  # squared length opposite to corner 0, 1, 2
    total = a.sum(axis=1, keepdims=True)
    weights = a * (total - 2.0 * a)
    acute = (total[:, 0] - 2.0 * squared.max(axis=1)) > 1e-12 * total[:, 0]
    w = weights[acute] / weights[acute].sum(axis=1, keepdims=True)
    centers[acute] = np.einsum("mi,mij->mj", w, corners[acute])
    # a circle around all three corners holds the triangle wherever its centre is
    radii = np.linalg.norm(corners - centers[:, None], axis=2).max(axis=1)
    return centers, radii


def _cut(corners, fine):
    done_centers, done_radii, done_area = [], [], []
    while len(corners):
        centers, radii = enclosing_circles(corners)
        small = radii <= fine
        sides = corners[small, 1:] - corners[small, :1]
        normal = np.cross(sides[:, 0], sides[:, 1])
        done_centers.append(centers[small])
        done_radii.append(radii[small])
        done_area.append(0.5 * np.linalg.norm(normal, axis=1))
        corners = _halve(corners[~small])
    joined = (done_centers, done_radii, done_area)
    return tuple(np.concatenate(part) for part in joined)


def _halve(corners):
    edges = np.roll(corners, -1, axis=1) - corners
    longest = np.einsum("mij,mij->mi", edges, edges).argmax(axis=1)
    rows = np.arange(len(corners))
    p = corners[rows, longest]
    q = corners[rows, (longest + 1) % 3]
    r = corners[rows, (longest + 2) % 3]
    middle = 0.5 * (p + q)
    return np.concatenate(
        [np.stack([p, middle, r], axis=1), np.stack([middle, q, r], axis=1)]
    )


def _patches(centers, radii, area, spacing, fine):
    """Return triangles that stand for those around them, where there are too many.

    A mesh may be much finer than its points have to be. Of each cube of diagonal
    `fine` one triangle is kept, whose circle is widened to hold the others.
    """
    from scipy.spatial import cKDTree

    every = np.arange(len(centers))
    tree, some = cKDTree(centers), cKDTree(centers[::_SOME])
    # to count them all takes as long as to choose: only where it may be too many
    if (
        len(centers) ** 2 <= _MOST_PAIRS
        or _SOME * some.count_neighbors(tree, spacing) <= 0.5 * _MOST_PAIRS
        or tree.count_neighbors(tree, spacing) <= _MOST_PAIRS
    ):
        return every, radii, area
    cells = np.floor((centers - centers.min(axis=0)) / (fine / np.sqrt(3.0)))
    _, one, owner = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    owner = owner.ravel()
    apart = np.linalg.norm(centers - centers[one[owner]], axis=1)
    reach, whole = np.zeros(len(one)), np.zeros(len(one))
    np.maximum.at(reach, owner, apart + radii)
    np.add.at(whole, owner, area)
    return one, reach, whole


def _choose(centers, radii, area, spacing):
    from scipy.spatial import cKDTree

    n = len(centers)
    pairs = cKDTree(centers).query_pairs(spacing, output_type="ndarray")
    # a triangle of no area still has to be covered
    weight = np.maximum(area, 1e-9 * area.sum() / n + 1e-30)
    chosen = np.empty(n, np.int64)
    lists = cover_lists(pairs, centers, radii, spacing)
    return chosen[: greedy_cover(*lists, weight, chosen)]


def _proved_radius(centers, radii, keep):
    from scipy.spatial import cKDTree

    nearest, _ = cKDTree(centers[keep]).query(centers)
    return float((nearest + radii).max())
