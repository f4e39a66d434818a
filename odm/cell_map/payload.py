"""What may be carried: the envelope of a recipe, its layer, and objects that fit."""

from dataclasses import dataclass, replace

import numpy as np

from odm.cell_map._sweep import ItemCells, merge_lists
from odm.cell_map.cell_map import CellMap, PayloadLayer
from odm.cell_map.chunk_work import StaticTestSpec, static_test
from odm.cell_map.lists import packed_lists
from odm.cell_map.recipe import PayloadRecipe, Recipe
from odm.cell_map.sweep import sweep_roadmap
from odm.close_test.arm import arm_of
from odm.obstacles import shapes
from odm.obstacles.grid import WorkspaceGrid
from odm.obstacles.scenery import Scenery
from roadmap.arrays import as_floats, freeze
from roadmap.builds.chunks import Progress, Workers
from roadmap.errors import BadInput, BadRecipe
from roadmap.geometry.kept_covers import kept_cover
from roadmap.geometry.polytope import shell
from roadmap.geometry.solids import Solid, hull_corners
from roadmap.graph.roadmap import Roadmap
from roadmap.kinematics.forward import difference
from roadmap.loading.held_link import polytope_around, with_payload
from roadmap.robot.robot import BOX, CYLINDER, HULL, SPHERE, Robot
from roadmap.transforms import moved_points, pose_of

_ROUNDING = 1e-9  # [m] an object as large as the envelope fits
_EXCESS = 0.01  # [m] how far the spheres of an object may stick out of it
_NO_HAND_HOLDS = 10.0  # [m] larger, and the lengths are in another unit


def envelope_solid(recipe: PayloadRecipe) -> Solid:
    """Return the envelope as a solid, posed in the tool frame."""
    T = pose_of(recipe.position, recipe.rpy)
    if recipe.radius is not None:
        return Solid(SPHERE, 0, T, (recipe.radius, 0.0, 0.0))
    return Solid(BOX, 0, T, recipe.size)


def envelope_robot(robot: Robot, payload: PayloadLayer) -> Robot:
    """Return the robot with the whole envelope in its hand."""
    solid = envelope_solid(payload.recipe)
    return with_payload(robot, payload.spheres, shell(solid), [solid])


def largest_robot(cell_map: CellMap) -> Robot:
    """Return the robot with all that it may carry."""
    if cell_map.payload is None:
        return cell_map.robot
    return envelope_robot(cell_map.robot, cell_map.payload)


def loaded_map(cell_map: CellMap) -> CellMap:
    """Return the map of the robot with the whole envelope in its hand.

    Its arm's layer holds the cells of both; its edges are those of the map, also
    those that the payload layer closes.
    BadInput for a map without a payload layer.
    """
    payload = required(cell_map)
    arm = cell_map.arm_cells.unpacked()
    carried = payload.cells.unpacked()
    room = len(arm.block) + len(carried.block)
    ptr = np.zeros_like(arm.ptr)
    block, mask = np.empty(room, arm.block.dtype), np.empty(room, np.uint64)
    end = merge_lists(arm, carried, ItemCells(ptr, block, mask))
    lists = ptr, block[:end], mask[:end].copy()
    cells = packed_lists(*lists, cell_map.grid.n_blocks, share=False)
    robot = envelope_robot(cell_map.robot, payload)
    return replace(cell_map, robot=robot, arm_cells=cells, payload=None, hash="")


def required(cell_map: CellMap) -> PayloadLayer:
    """Return the payload layer, or say how to get one."""
    if cell_map.payload is None:
        raise BadInput(
            f"map {cell_map.recipe.name} has no payload layer, so nothing can be "
            "attached; add a [payload] table to its recipe, such as radius = 0.1 and "
            "position = [0.0, 0.0, 0.05] (a sphere in the tool frame, in metres), and "
            "build it again"
        )
    return cell_map.payload


def build_payload(
    robot: Robot,
    recipe: Recipe,
    roadmap: Roadmap,
    grid: WorkspaceGrid,
    scenery: Scenery,
    threads: int,
    workers: Workers,
    progress: Progress | None,
) -> PayloadLayer:
    """Sweep the envelope and find where it touches the arm or the scenery.

    BadRecipe where it touches one of them at every node.
    """
    spheres = envelope_spheres(recipe)
    loaded = with_payload(robot, spheres, shell(envelope_solid(recipe.payload)), [])
    link = len(loaded.link_names) - 1
    alone = only_link(loaded, link)
    rest = (grid, recipe.safety, workers, progress)
    cells = sweep_roadmap(alone, arm_of(alone), roadmap, *rest)
    test = static_test(StaticTestSpec(loaded, scenery, recipe.safety), threads)
    ends = np.asarray(roadmap.edges)
    still = np.zeros_like(roadmap.nodes)
    dq = difference(robot, roadmap.nodes[ends[:, 0]], roadmap.nodes[ends[:, 1]])
    free = np.concatenate(
        [
            test.motions_free(roadmap.nodes, still),
            test.motions_free(roadmap.nodes[ends[:, 0]], dq),
        ]
    )
    n = roadmap.n_nodes
    if not free[:n].any():
        why = test.why(roadmap.nodes[0], still[0])
        raise BadRecipe(
            f"the [payload] envelope is in contact at all {n} nodes (at node 0: {why});"
            " make it smaller or move it away from the tool"
        )
    closed = ~free
    closed[n:] |= closed[ends[:, 0]] | closed[ends[:, 1]]
    return PayloadLayer(recipe.payload, spheres, cells, closed)


def envelope_spheres(recipe: Recipe) -> np.ndarray:
    """Return spheres (n, 4) that contain the envelope, tool frame [m]."""
    solid = envelope_solid(recipe.payload)
    if solid.kind == SPHERE:
        return np.array([[*recipe.payload.position, recipe.payload.radius]])
    return kept_cover([solid], recipe.robot.cover_excess, closely=False)


def only_link(robot: Robot, link: int) -> Robot:
    """Return a robot that has the spheres of one link only."""
    on_link = robot.sphere_link == link
    return replace(
        robot,
        spheres=robot.spheres[on_link],
        sphere_body=robot.sphere_body[on_link],
        sphere_link=robot.sphere_link[on_link],
        sphere_reach=robot.sphere_reach[on_link],
    )


@dataclass(frozen=True, eq=False)
class CarriedObject:
    """Something to carry, in a frame of its own; made by `carried_object`.

    Attributes:
        spheres: (n, 4) spheres that contain it [m].
        shell: (k, 3) points whose hull contains it [m].
        exact: Whether it is its spheres, so that they must fit in the envelope;
            otherwise the shell must.
    """

    spheres: np.ndarray
    shell: np.ndarray
    exact: bool

    def __post_init__(self) -> None:
        freeze(self, spheres=float, shell=float)

    def moved(self, T: np.ndarray) -> "CarriedObject":
        """Return it in another frame, T (4, 4)."""
        spheres = self.spheres.copy()
        spheres[:, :3] = moved_points(spheres[:, :3], T)
        return CarriedObject(spheres, moved_points(self.shell, T), self.exact)


def carried_object(thing: object) -> CarriedObject:
    """Make ready what `ReactivePlanner.attach` takes; once per object.

    Spheres take no time. Of a box, cylinder, capsule or mesh (its convex hull counts)
    the cover is computed, which takes up to seconds once on a machine.

    Args:
        thing: (n, 4) spheres, centre and radius [m]; or a shape of `odm`.

    Raises:
        BadInput: Not spheres and no shape, or larger than 10 m.
    """
    if isinstance(thing, CarriedObject):
        return thing
    if isinstance(thing, shapes.Sphere | shapes.Capsule):
        return _of_spheres(_round_spheres(thing))
    if isinstance(thing, shapes.Box | shapes.Cylinder | shapes.Mesh):
        solid = _solid_of(thing)
        points = shell(solid)
        sides = np.ptp(points, axis=0)
        if sides.max() > _NO_HAND_HOLDS:  # before minutes of cover
            raise BadInput(
                f"the object is {_sides(sides)} m large, which no hand holds; give all "
                "its lengths in metres, not in millimetres"
            )
        cover = kept_cover([solid], _EXCESS, closely=False)
        return CarriedObject(cover, points, False)
    return _of_spheres(_checked(thing))


def require_fit(recipe: PayloadRecipe, thing: CarriedObject) -> None:
    """Refuse an object, in the tool frame, that the envelope does not contain."""
    T = pose_of(recipe.position, recipe.rpy)
    if thing.exact:
        points, radii = thing.spheres[:, :3], thing.spheres[:, 3]
    else:
        points, radii = thing.shell, np.zeros(len(thing.shell))
    local = (points - T[:3, 3]) @ T[:3, :3]
    if recipe.radius is not None:
        needed = float((np.linalg.norm(local, axis=1) + radii).max())
        if needed > recipe.radius + _ROUNDING:
            raise BadInput(
                f"the object reaches {needed:.4f} m from the centre of the map's "
                f"payload envelope, a sphere of {recipe.radius:g} m radius; hold it "
                "nearer to the centre, or enlarge [payload] radius in the recipe and "
                "build the map again"
            )
        return
    sides = 2.0 * (np.abs(local) + radii[:, None]).max(axis=0)
    if (sides > np.array(recipe.size) + _ROUNDING).any():
        raise BadInput(
            f"the object needs {_sides(sides)} m about the centre of the map's payload "
            f"envelope, a box of {_sides(recipe.size)} m; hold it nearer to the centre,"
            " or enlarge [payload] size in the recipe and build the map again"
        )


def _sides(size: object) -> str:
    return " x ".join(f"{s:.4g}" for s in np.asarray(size))


def _of_spheres(spheres: np.ndarray) -> CarriedObject:
    return CarriedObject(spheres, polytope_around(spheres), True)


def _checked(spheres: object) -> np.ndarray:
    try:
        array = np.array(as_floats("the spheres", spheres), ndmin=2)
    except BadInput as error:
        raise BadInput(
            f"an object of type {type(spheres).__name__} cannot be attached; give "
            "(n, 4) spheres, a shape of odm, or a carried_object"
        ) from error
    if array.ndim != 2 or array.shape[1] != 4 or len(array) == 0:
        raise BadInput(
            f"the object's spheres have shape {np.shape(spheres)}; give (n, 4): centre "
            "and radius of each"
        )
    if not np.isfinite(array).all() or not (array[:, 3] > 0).all():
        raise BadInput(
            "a sphere of the object is not finite or its radius is not above 0; give "
            "metres"
        )
    return array


def _round_spheres(shape: shapes.Sphere | shapes.Capsule) -> np.ndarray:
    if isinstance(shape, shapes.Sphere):
        return np.array([[*shape.T_base_shape[:3, 3], shape.radius]])
    a, b = shape.ends()
    n = 1 + int(np.ceil(2.0 * shape.length / shape.radius))
    step = shape.length / (2 * max(1, n - 1))
    radius = np.hypot(shape.radius, step)
    at = np.linspace(0.0, 1.0, n)[:, None]
    return np.hstack([a + at * (b - a), np.full((n, 1), radius)])


def _solid_of(shape: shapes.Box | shapes.Cylinder | shapes.Mesh) -> Solid:
    T = np.array(shape.T_base_shape)
    if isinstance(shape, shapes.Box):
        return Solid(BOX, 0, T, tuple(shape.size.tolist()))
    if isinstance(shape, shapes.Cylinder):
        return Solid(CYLINDER, 0, T, (shape.radius, shape.length, 0.0))
    try:
        corners = hull_corners(np.asarray(shape.vertices))
    except Exception as error:  # qhull's own error class
        raise BadInput(
            "the object's mesh is flat, so it has no volume; give it thickness"
        ) from error
    return Solid(HULL, 0, T, points=corners)
