"""The robot as frozen arrays: a tree of bodies, limits, solids, sphere cover."""

import hashlib
import json
from dataclasses import dataclass, field, fields

import numpy as np

from roadmap.arrays import brief, freeze, frozen
from roadmap.kinematics.inverse import solve

HULL, BOX, CYLINDER, SPHERE = 0, 1, 2, 3  # solid_kind

_TYPES = {  # of arrays that are no floats
    "continuous": np.bool_,
    **dict.fromkeys(("solid_ptr", "shell_ptr"), np.int64),
    **dict.fromkeys(
        ("tree_i", "link_body", "sphere_body", "sphere_link", "solid_kind",
         "solid_link", "shell_link", "self_pairs"),
        np.int32,
    ),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot arm as the planner sees it; loading one from a map needs no URDF.

    A *body* is a joint's child link with all links fixed to it; body 0 is the base,
    which never moves. Parents come before children. A body's frame is its joint's
    frame after the motion. A *link* is a URDF link that carries geometry.

    Attributes:
        name: Name of the robot.
        joint_names: (dof,) names of the moving joints, the order of `q`.
        lower, upper: (dof,) limits [rad or m]; a continuous joint has (-pi, pi).
        continuous: (dof,) True where a joint turns without limit.
        max_velocity, max_acceleration, max_jerk: (dof,) [rad/s.. or m/s..].
        tree_i: (n_bodies, 3) parent body, joint index or -1, kind of the joint.
        tree_f: (n_bodies, 17) rotation (9, row-major) and translation (3) from the
            parent body to the joint frame, axis (3, unit), mimic factor and offset:
            the joint's value is `factor * q[joint] + offset`.
        tip_body, T_body_tip, tip_name: the tool frame, (4, 4) in its body.
        link_names, link_body: links with geometry and the body that carries each.
        spheres: (n, 4) cover: centre in the body frame and radius [m].
        sphere_body, sphere_link: (n,) owner of each sphere.
        sphere_reach: (n, n_bodies) bound over all configurations on the distance of
            the sphere's centre from the axis of each ancestor body's joint [m]; 1
            for a prismatic one; 0 where the joint does not move the sphere.
        solid_kind, solid_link, solid_pose, solid_size, solid_ptr, solid_points: the
            exact solids: convex hulls (vertices `solid_points[ptr[i]:ptr[i+1]]` in
            the solid's frame), boxes (full sizes), cylinders (radius, length along
            z), spheres (radius); `solid_pose` (n, 4, 4) is T_body_solid.
        shell_ptr, shell_points, shell_link: convex polytopes with few vertices (body
            frame) that contain the solids: what self-collision is tested with.
        shell_reach: (n_shells, n_bodies) as sphere_reach, for all points of a shell.
        self_pairs: (n, 2) pairs of *link* indices that are tested.
        dropped_pairs: (link, link, reason) of the pairs that are not.
        notes: what a user should know: links without geometry, defaults taken...
        source: where the description came from (text).
    """

    name: str
    joint_names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    continuous: np.ndarray
    max_velocity: np.ndarray
    max_acceleration: np.ndarray
    max_jerk: np.ndarray
    tree_i: np.ndarray
    tree_f: np.ndarray
    tip_name: str
    tip_body: int
    T_body_tip: np.ndarray
    link_names: tuple[str, ...]
    link_body: np.ndarray
    spheres: np.ndarray
    sphere_body: np.ndarray
    sphere_link: np.ndarray
    sphere_reach: np.ndarray
    solid_kind: np.ndarray
    solid_link: np.ndarray
    solid_pose: np.ndarray
    solid_size: np.ndarray
    solid_ptr: np.ndarray
    solid_points: np.ndarray
    shell_ptr: np.ndarray
    shell_points: np.ndarray
    shell_link: np.ndarray
    shell_reach: np.ndarray
    self_pairs: np.ndarray
    dropped_pairs: tuple[tuple[str, str, str], ...] = ()
    notes: tuple[str, ...] = ()
    source: str = ""
    moving: np.ndarray = field(init=False, repr=False)

    __repr__ = brief

    def __post_init__(self) -> None:
        freeze(self, **{n: _TYPES.get(n, np.float64) for n in ARRAYS})
        moving = frozen(self.sphere_body > 0, np.bool_)
        object.__setattr__(self, "moving", moving)

    @property
    def dof(self) -> int:
        """Number of moving joints."""
        return len(self.joint_names)

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the arrays by name, for the store."""
        return {name: getattr(self, name) for name in ARRAYS}

    def meta(self) -> dict:
        """Return everything that is not an array, as plain JSON data."""
        skip = {*ARRAYS, "moving"}
        names = [f.name for f in fields(self) if f.name not in skip]
        return json.loads(json.dumps({n: getattr(self, n) for n in names}))

    @classmethod
    def from_store(cls, meta: dict, arrays: dict[str, np.ndarray]) -> "Robot":
        """Make a robot again from `meta()` and `arrays()`."""
        plain = dict(meta)
        for name in ("joint_names", "link_names", "notes"):
            plain[name] = tuple(plain[name])
        plain["dropped_pairs"] = tuple(tuple(p) for p in plain["dropped_pairs"])
        plain |= {name: arrays[name] for name in ARRAYS}
        return cls(**plain)

    def fingerprint(self) -> str:
        """Return a SHA-256 over geometry, kinematics and limits (not the notes)."""
        digest = hashlib.sha256()
        digest.update(json.dumps([self.joint_names, self.tip_name]).encode())
        for name, array in self.arrays().items():
            digest.update(name.encode() + str(array.shape).encode())
            digest.update(array.tobytes())
        return digest.hexdigest()

    def ik(
        self, T_base_tool: np.ndarray, q_seed: np.ndarray | None = None, **options
    ) -> list:
        """Return configurations that reach a tool pose; see `kinematics.inverse`."""
        return solve(self, T_base_tool, q_seed, **options)


ARRAYS = [f.name for f in fields(Robot) if f.type is np.ndarray and f.init]  # stored
