"""ReachMap: the 6-D cells a robot or an arm reaches, with quality and witness."""

from dataclasses import dataclass, field
from functools import cached_property
from numbers import Integral
from pathlib import Path

import numpy as np

from handover.chain import Chain, chain_of
from handover.reach import _reach_build as kernels
from handover.reach import _reach_lookup as lookup
from handover.reach.extremes import work_of
from handover.reach.reach_grid import ReachGrid
from handover.reach.rotations import rotation_grid
from roadmap.arrays import as_floats, brief, frozen
from roadmap.builds.store import made_of, read_folder, write_folder
from roadmap.errors import BadInput, BadMap
from roadmap.kinematics._chain import from_lattice
from roadmap.ranges import check_kind, check_path, check_yes, is_real, told
from roadmap.robot.robot import Robot
from roadmap.transforms import check_pose, flat_pose

_KIND = "reach map"
_PACKED = {
    "row_of": np.int32,
    "bits": np.uint64,
    "first": np.int64,
    "first_root": np.int64,
    "quality": np.uint8,
    "way": np.uint8,  # in files; the predecessor of each cell
    "roots": np.uint16,
}


@dataclass(frozen=True, eq=False)
class ReachMap:
    """Which tool poses are reached, how well, and by what configuration.

    Made by `build_reach_map`, read by `load_reach_map`; poses are in the frame that
    the chain starts in (a robot's base, a person's shoulder).

    Attributes:
        chain: The joints; of a loaded map without the robot's geometry.
        grid: The cells.
        packed: The marked cells, see `Packed`.
        reference: The dexterity that is quality 1.
        built: Facts of the build: settings, counts, seconds.
        hash: SHA-256 of the stored map; empty while it was not stored.
    """

    chain: Chain
    grid: ReachGrid
    packed: lookup.Packed
    reference: float
    built: dict = field(default_factory=dict)
    hash: str = ""

    __repr__ = brief

    def __post_init__(self) -> None:
        arrays = [frozen(a, t) for a, t in zip(self.packed, _PACKED.values())]
        object.__setattr__(self, "packed", lookup.Packed(*arrays))

    @property
    def n_marked(self) -> int:
        """Number of cells that are reached."""
        return len(self.packed.quality)

    @cached_property
    def _grid_arrays(self) -> kernels.Grid:
        return self.grid.arrays

    def quality(self, T_base_tool: np.ndarray) -> np.ndarray:
        """Return the quality of tool poses, in [0, 1]; 0 where they are not reached.

        Args:
            T_base_tool: (4, 4) or (n, 4, 4) [m]; of a person's arm in units of its
                length, see `Human.reach_pose`, so that a map fits any height.

        Returns:
            A float, or (n,) float64: the byte of the cell over 255.

        Raises:
            BadInput: Not poses, not finite, not rigid.
        """
        poses = _flat(T_base_tool)
        out = np.empty(len(poses), np.uint8)
        lookup.qualities_of_poses(self.packed, self._grid_arrays, poses, out)
        quality = out / 255.0
        return quality if np.ndim(T_base_tool) == 3 else float(quality[0])

    def witness(self, T_base_tool: np.ndarray) -> np.ndarray | None:
        """Return the configuration that proves a pose's cell reached, None without.

        Its tool is in the same cell, not at the same pose: `robot.ik(T, q_seed=...)`
        goes the rest where the pose itself can be reached.

        Raises:
            BadInput: As in `quality`.
            BadMap: The map contradicts itself.
        """
        pose = flat_pose(check_pose(T_base_tool, "T_base_tool"))
        return self.witness_of(int(kernels.cell_of(self._grid_arrays, pose)))

    def witness_of(self, cell: int) -> np.ndarray | None:
        """Return the witness of a cell as the robot's q, None if it is not reached.

        Raises:
            BadInput: The cell is no whole number.
            BadMap: The map contradicts itself.
        """
        if not isinstance(cell, Integral) or not is_real(cell):
            raise BadInput(f"a cell is {told(cell)}; give the whole number of one")
        grid = self._grid_arrays
        if lookup.entry_of(self.packed, grid.size[3], cell) < 0:
            return None
        predecessors = np.empty(kernels.MAX_DEPTH + 1, np.int64)
        n, root = lookup.predecessors_to_root(self.packed, grid, cell, predecessors)
        work, chain = work_of(self.chain), self.chain.arrays
        whole = root >= 0 and kernels.replay(
            chain, grid, predecessors[:n], np.array(self.packed.roots[root]), cell, work
        )
        if not whole:
            raise BadMap(
                f"the witness of cell {cell} of the reach map of {self.chain.name} "
                "cannot be made again; build the map again on this machine"
            )
        from_lattice(chain, work.code, work.q)
        return self.chain.full(work.q)

    def qualities(self, cells: np.ndarray) -> np.ndarray:
        """Return the (n,) uint8 qualities of cells (n,), 0 where not reached.

        Raises:
            BadInput: No list of whole numbers, or a cell that is not in the grid (-1
                is: not reached).
        """
        whole = as_floats("cells", cells)
        if whole.ndim != 1 or (whole != np.round(whole)).any():
            raise BadInput(f"cells are {told(cells)}; give (n,) whole numbers")
        cells = np.ascontiguousarray(cells, np.int64)
        if len(cells) and not (-1 <= cells.min() and cells.max() < self.grid.n_cells):
            raise BadInput(
                f"cells go from {cells.min()} to {cells.max()}; the map has "
                f"{self.grid.n_cells}"
            )
        out = np.empty(len(cells), np.uint8)
        n = self.grid.rotations.n_cells
        lookup.qualities_of_cells(self.packed, n, cells, out)
        return out

    def dense(self) -> np.ndarray:
        """Return quality bytes (n_positions, n_rotations), 0 where not reached."""
        out = np.zeros(self.grid.n_cells, np.uint8)
        out[self.marked_cells()] = self.packed.quality
        return out.reshape(self.grid.n_positions, -1)

    def marked_cells(self) -> np.ndarray:
        """Return the (n_marked,) int64 cells that are reached, ascending."""
        n = self.grid.rotations.n_cells
        positions = np.flatnonzero(self.packed.row_of >= 0)
        bits = np.unpackbits(
            np.ascontiguousarray(self.packed.bits).view(np.uint8),
            axis=1,
            bitorder="little",
        )
        rows, rotation = np.nonzero(bits[:, :n])
        return positions[rows] * n + rotation

    def save(self, path: str | Path) -> Path:
        """Write the map to a folder, atomically."""
        chain = self.chain
        manifest = {
            "kind": _KIND,
            "name": chain.name,
            "unit": chain.unit,
            "frame": chain.frame,
            "joint_names": list(chain.joint_names),
            "robot_rows": list(chain.rows),
            "robot_rest": list(chain.rest),
            "collision_hash": chain.collision_hash,
            "chain_hash": chain.fingerprint(),
            "grid": {
                "cell": self.grid.cell,
                "shape": list(self.grid.shape),
                "rotations": self.grid.rotations.n_cells,
            },
            "reference": self.reference,
            "built": self.built,
        }
        arrays = dict(zip(_PACKED, self.packed, strict=True))
        arrays |= {f"chain.{name}": a for name, a in chain.arrays._asdict().items()}
        return write_folder(path, manifest, arrays | {"origin": self.grid.origin})


def _flat(poses: np.ndarray) -> np.ndarray:
    """Return poses (4, 4) or (n, 4, 4) as rows (n, 12), checked."""
    poses = as_floats("poses", poses)
    if poses.shape[-2:] != (4, 4) or poses.ndim not in (2, 3):
        raise BadInput(f"poses have the shape {poses.shape}; give (n, 4, 4)")
    stack = poses.reshape(-1, 4, 4)
    if not np.isfinite(stack).all():
        raise BadInput("poses hold NaN or infinity; give finite numbers")
    R = stack[:, :3, :3]
    off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(initial=0.0)
    last = np.abs(stack[:, 3] - [0, 0, 0, 1]).max(initial=0.0)
    if off > 1e-6 or last > 1e-9 or (np.linalg.det(R) < 0).any():
        raise BadInput(
            f"poses are not rigid motions (error {max(off, last):.2g}, limit 1e-6); "
            "normalise them"
        )
    return flat_pose(stack)


def load_reach_map(
    path: str | Path, verify: bool = True, robot: Robot | Chain | None = None
) -> ReachMap:
    """Load a reach map; no URDF is needed.

    Args:
        path: Folder of the map.
        verify: Read every array into memory of its own and compare these very bytes
            with their SHA-256 (some 20 ms). False maps the files instead: a missing
            or truncated array is still refused, but nobody may write into them while
            the map is in use.
        robot: Where given, the map must be of exactly this robot or chain.

    Raises:
        BadMap: Not a reach map, truncated, altered, of another version or robot.
    """
    path = check_path("the folder of a reach map", path)
    verify = check_yes("verify", verify)
    if robot is not None:
        check_kind("robot", robot, (Robot, Chain), "give a Robot, a Chain or None")
    if not (path / "manifest.json").is_file():
        raise BadMap(
            f"{path} holds no reach map; build one with `odm workspace build ROBOT "
            "--out DIR`"
        )
    manifest, arrays = read_folder(path, verify)
    if manifest.get("kind") != _KIND:
        raise BadMap(
            f"{path} holds a {manifest.get('kind')!r}, not a reach map; build one with "
            "`odm workspace build ROBOT --out DIR`"
        )
    with made_of(path):
        if robot is not None:
            _check_robot(path, manifest, robot)
        return _made(manifest, arrays)


def _made(manifest: dict, arrays: dict[str, np.ndarray]) -> ReachMap:
    """Make a reach map of what a folder holds."""
    parts = {k[6:]: a for k, a in arrays.items() if k.startswith("chain.")}
    chain = Chain(
        name=manifest["name"],
        joint_names=tuple(manifest["joint_names"]),
        **parts,
        unit=manifest["unit"],
        frame=manifest["frame"],
        rows=tuple(manifest["robot_rows"]),
        rest=tuple(manifest["robot_rest"]),
        collision_hash=manifest["collision_hash"],
    )
    grid = ReachGrid(
        arrays["origin"],
        manifest["grid"]["cell"],
        tuple(manifest["grid"]["shape"]),
        rotation_grid(manifest["grid"]["rotations"]),
    )
    packed = lookup.Packed(*(arrays[name] for name in _PACKED))
    facts = {k: manifest[k] for k in ("reference", "built", "hash")}
    return ReachMap(chain, grid, packed, **facts)


def _check_robot(path: Path, manifest: dict, robot: Robot | Chain) -> None:
    if isinstance(robot, Robot):
        robot = chain_of(robot, self_collisions=bool(manifest["collision_hash"]))
    found, asked = manifest["chain_hash"], robot.fingerprint()
    if found != asked:
        raise BadMap(
            f"reach map {path} was built for another robot ({manifest['name']}, hash "
            f"{found[:12]}, not {asked[:12]} of {robot.name}); build one for this robot"
        )
