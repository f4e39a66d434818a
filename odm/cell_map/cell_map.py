"""CellMap: a robot, its roadmap and the cells every node and edge sweeps."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from odm.cell_map.lists import CellLists, lists_of
from odm.cell_map.recipe import PayloadRecipe, Recipe, recipe_of_map
from odm.close_test._arm import Arm
from odm.close_test.arm import arm_of
from odm.close_test.safety import Safety
from odm.obstacles.grid import WorkspaceGrid
from odm.obstacles.scenery import Scenery
from roadmap.arrays import brief, freeze
from roadmap.builds.store import made_of, read_folder, write_folder
from roadmap.errors import BadInput, BadMap
from roadmap.graph.roadmap import Roadmap
from roadmap.ranges import check_kind
from roadmap.robot.robot import Robot

ROUNDING = 1e-6  # [m] added to every swept radius


@dataclass(frozen=True, eq=False)
class PayloadLayer:
    """What nodes and edges sweep with the largest payload in hand, beside the arm.

    Attributes:
        recipe: The envelope.
        spheres: (n, 4) spheres that contain it, tool frame [m].
        cells: What it sweeps; an edge's list leaves out what the envelope sweeps at
            the edge's nodes.
        closed: (n_items,) True where the envelope touches the arm or the recipe's
            scenery.
    """

    recipe: PayloadRecipe
    spheres: np.ndarray
    cells: CellLists
    closed: np.ndarray

    def __post_init__(self) -> None:
        freeze(self, spheres=self.spheres.dtype, closed=self.closed.dtype)

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the arrays by name, for the store."""
        arrays = {"spheres": self.spheres, "closed": self.closed}
        return arrays | self.cells.arrays()


@dataclass(frozen=True, eq=False)
class CellMap:
    """Everything the planner needs, frozen; made by `build_map`, read by `load_map`.

    A map that was loaded is pickled as the path of its folder. To unpickle it loads the
    map from there, and is refused where the folder holds another map by now. A copy of
    a map is the map.

    Attributes:
        robot: The robot.
        roadmap: Its roadmap.
        grid: The workspace grid.
        recipe: What it was built from.
        arm_cells: Swept cells of the layer `arm`, the gripper included.
        scenery: What stands still around the robot in this recipe.
        payload: Layer of what may be carried, or None.
        built: Facts of the build: seconds, counts, components, versions.
        hash: SHA-256 of the stored map; empty while it was not stored.
    """

    robot: Robot
    roadmap: Roadmap
    grid: WorkspaceGrid
    recipe: Recipe
    arm_cells: CellLists
    scenery: Scenery
    payload: PayloadLayer | None = None
    built: dict = field(default_factory=dict)
    hash: str = ""
    # where exactly this map lies: (folder, verified when loaded)
    _lies: tuple[str, bool] | None = field(default=None, init=False, repr=False)

    __repr__ = brief

    def __copy__(self) -> "CellMap":
        """Return the map itself: nothing in it can change."""
        return self

    def __deepcopy__(self, memo: dict) -> "CellMap":
        """Return the map itself: nothing in it can change."""
        return self

    def __reduce__(self) -> tuple:
        """Pickle by folder and hash; refused where the map was not loaded as it is."""
        if self._lies is None:
            raise BadInput(
                "a map pickles by its folder, and this one was not loaded from any; "
                "save it, and pickle what odm.load_map returns for that folder"
            )
        return _load_again, (*self._lies, self.hash)

    def lying_in(self, path: str | Path, verify: bool) -> "CellMap":
        """Return this map, which pickles as what lies in a folder from now on."""
        object.__setattr__(self, "_lies", (str(Path(path).resolve()), verify))
        return self

    @property
    def safety(self) -> Safety:
        """The terms of the safety argument."""
        return self.recipe.safety

    @cached_property
    def arm(self) -> Arm:
        """The moving spheres sorted by body, for the compiled loops."""
        return arm_of(self.robot)

    @property
    def motion_tolerance(self) -> float:
        """Largest inflation of a piece of motion, mu / 2 [m]."""
        return 0.5 * self.safety.mu

    def swept_radii(self) -> np.ndarray:
        """Radii of `arm`'s spheres grown by rho + m [m]: the close test's."""
        return self.arm.spheres[:, 3] + self.safety.rho + self.safety.m

    def save(self, path: str | Path) -> Path:
        """Write the map to a folder, atomically."""
        manifest = {
            "kind": "cell map",
            "recipe": self.recipe.for_map(),
            "robot": self.robot.meta(),
            "robot_hash": self.robot.fingerprint(),
            "safety": self.safety.as_dict(),
            "layers": ["arm"] if self.payload is None else ["arm", "payload"],
            "grid": {"h": self.grid.h},
            "scenery": self.scenery.meta(),
            "built": self.built,
        }
        arrays = {f"robot.{k}": a for k, a in self.robot.arrays().items()}
        arrays |= {f"roadmap.{k}": a for k, a in self.roadmap.arrays().items()}
        arrays |= {f"arm.{k}": a for k, a in self.arm_cells.arrays().items()}
        if self.payload is not None:
            arrays |= {f"payload.{k}": a for k, a in self.payload.arrays().items()}
        arrays |= {f"scenery.{k}": a for k, a in self.scenery.arrays().items()}
        arrays |= {"grid.origin": self.grid.origin, "grid.blocks": self.grid.blocks}
        return write_folder(path, manifest, arrays)


def load_map(
    path: str | Path, verify: bool = True, robot: Robot | None = None
) -> CellMap:
    """Load a map; no URDF is needed.

    Args:
        path: Folder of the map.
        verify: Read every array into memory of its own and compare these very bytes
            with their SHA-256: what happens to the files later changes nothing.
            False maps the files instead, in milliseconds and shared by all processes:
            while the map is in use nobody may write into them (to replace the whole
            folder, as `CellMap.save` does, is safe).
        robot: Where given, the map must be for exactly this robot.

    Raises:
        BadMap: Not a map, truncated, altered, of another version or robot.
    """
    if robot is not None:
        check_kind("robot", robot, Robot, "give what roadmap.load_robot returns")
    manifest, arrays = read_folder(path, verify)
    if manifest.get("kind") != "cell map":
        raise BadMap(
            f"{path} holds a {manifest.get('kind')!r}, not a cell map; give the folder "
            "that `odm build` wrote"
        )
    with made_of(path):
        loaded = _made(manifest, arrays)
    if robot is not None and robot.fingerprint() != manifest["robot_hash"]:
        raise BadMap(
            f"map {path} was built for another robot ({loaded.robot.name}, hash "
            f"{manifest['robot_hash'][:12]}, not {robot.fingerprint()[:12]}); build a "
            "map for this one"
        )
    return loaded.lying_in(path, verify)


def _made(manifest: dict, arrays: dict[str, np.ndarray]) -> CellMap:
    """Make a map of what a folder holds."""
    recipe = recipe_of_map(manifest["recipe"])
    payload, n_blocks = None, int(np.prod(arrays["grid.blocks"]))
    if recipe.payload is not None:
        layer = _part(arrays, "payload.")
        spheres, closed = layer.pop("spheres"), layer.pop("closed")
        cells = lists_of(layer, n_blocks)
        payload = PayloadLayer(recipe.payload, spheres, cells, closed)
    return CellMap(
        robot=Robot.from_store(manifest["robot"], _part(arrays, "robot.")),
        roadmap=Roadmap(**_part(arrays, "roadmap.")),
        grid=WorkspaceGrid(
            arrays["grid.origin"], manifest["grid"]["h"], arrays["grid.blocks"]
        ),
        recipe=recipe,
        arm_cells=lists_of(_part(arrays, "arm."), n_blocks),
        scenery=Scenery.from_store(manifest["scenery"], _part(arrays, "scenery.")),
        payload=payload,
        built=manifest["built"],
        hash=manifest["hash"],
    )


def _load_again(path: str, verify: bool, wanted: str) -> CellMap:
    """Load a map that was pickled, if it is still that map."""
    loaded = load_map(path, verify)
    if loaded.hash != wanted:
        raise BadMap(
            f"map {path} has the hash {loaded.hash[:12]}, but {wanted[:12]} was "
            "pickled; pickle the map again, or store that one there"
        )
    return loaded


def _part(arrays: dict[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    cut = len(prefix)
    return {k[cut:]: a for k, a in arrays.items() if k.startswith(prefix)}
