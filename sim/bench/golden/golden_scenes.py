"""What the golden work is done on: small maps, people who move, and words for results.

A part of `golden_work.py`, which runs in any checkout: nothing of `sim` is imported.
"""

import hashlib
from collections.abc import Iterator, Set

import numpy as np

import odm

_FLOOR = '[[scenery]]\ntype = "plane"\nname = "floor"\n'
_BOX = (
    '[[scenery]]\ntype = "box"\nname = "post"\nsize = [0.1, 0.1, 0.5]\n'
    "position = [-0.45, 0.3, 0.25]\n"
)
_MESH = (
    '[[scenery]]\ntype = "mesh"\nname = "wedge"\nfile = "wedge.stl"\n'
    "position = [0.3, -0.6, 0.0]\n"
)
_SAFETY = "[safety]\nh = {h}\nrho = 0.03\nmu = {mu}\n"


def _recipe(robot: str, roadmap: str, h: float = 0.05, mu: float = 0.01) -> str:
    sizes = _SAFETY.format(h=h, mu=mu)
    return f"[robot]\n{robot}\n[roadmap]\n{roadmap}\n{sizes}{_FLOOR}"


RECIPES = {
    "arm": _recipe(
        'source = "plain_arm"\ntip = "tool"\ncover_excess = 0.03',
        "nodes = 700\nneighbors = 10\nseed = 1",
    )
    + _BOX
    + _MESH,
    "carry": _recipe(
        'source = "plain_arm"\ntip = "tool"\ncover_excess = 0.03',
        'nodes = 400\nneighbors = 8\nseed = 2\nsampling = "halton"',
    )
    + "[payload]\nradius = 0.12\nposition = [0.0, 0.0, 0.05]\n",
    "rail": _recipe(
        'source = "rail_arm"\ncover_excess = 0.03',
        "nodes = 500\nneighbors = 8\nseed = 3\nweights = [2.0, 1.0, 1.0, 1.0, 0.7]\n"
        "region = [[-0.7, -1.0, 0.15], [0.9, 1.0, 1.2]]",
    ),
    "kawasaki": _recipe(
        'source = "kawasaki_fs003n"\ncover_excess = 0.03\nsrdf = "pairs.srdf"',
        'nodes = 250\nneighbors = 8\nseed = 3\nsampling = "uniform"',
        h=0.06,
    ),
    "gross": _recipe(
        'source = "kawasaki_fs003n"\ncover_excess = 0.04\n'
        "locked = { joint4 = 0.0, joint5 = 0.0, joint6 = 0.0 }",
        'nodes = 300\nneighbors = 10\nseed = 1\nsampling = "grid"\n'
        "region = [[-0.2, -0.6, 0.0], [0.7, 0.6, 0.9]]",
    ),
    "large": _recipe(
        'source = "plain_arm"\ntip = "tool"\ncover_excess = 0.02',
        "nodes = 4000\nneighbors = 12\nseed = 1",
        h=0.04,
        mu=0.006,
    ),
    "fingers": _recipe(
        'source = "panda"\ncover_excess = 0.03\ntravel = ["panda_finger_joint1"]',
        "nodes = 250\nneighbors = 8\nseed = 1",
        mu=0.006,
    )
    + "[payload]\nsize = [0.16, 0.12, 0.2]\nposition = [0.0, 0.0, 0.05]\n"
    "rpy = [0.0, 0.0, 0.4]\n",
}
LARGE = "large"  # to time frames; the others are small
SRDF = """<robot name="kawasaki">
<disable_collisions link1="link1" link2="link3" reason="golden"/>
</robot>
"""
_WEDGE = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.25, 0], [0, 0, 0.4]], np.float32)
_SPACING = 0.03  # of samples on capsules [m]
SPEED = 1.2  # of every joint, between frames [rad/s or m/s]
PERIOD = 0.01  # of frames [s]


def wedge_stl() -> bytes:
    """Return the mesh that the scenery of a recipe names, a tetrahedron."""
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    rows = np.zeros(4, [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    rows["v"] = _WEDGE[np.array(faces)]
    return b"\0" * 80 + np.uint32(4).tobytes() + rows.tobytes()


# --- words ----------------------------------------------------------------------------


def digest(array: np.ndarray) -> str:
    """Return kind, shape, the values where they are few, and a hash of all bytes."""
    array = np.ascontiguousarray(array)
    code = hashlib.sha256(array.tobytes()).hexdigest()[:12]
    few = " ".join(f"{v:.5g}" for v in array.ravel()) if 0 < array.size <= 8 else ""
    return f"{array.dtype.str[1:]}{list(array.shape)} {few} #{code}".replace("  ", " ")


def told(value: object) -> str:
    """Return a value in words that are equal only where its bytes are."""
    if isinstance(value, np.ndarray):
        return digest(value)
    if isinstance(value, np.generic):
        return repr(value.item())
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k}: {told(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple | set | frozenset):
        value = sorted(value) if isinstance(value, set | frozenset) else value
        if len(value) > 8 and all(isinstance(v, int | float) for v in value):
            return digest(np.array(value))
        return "[" + ", ".join(map(told, value)) + "]"
    if value is None or isinstance(value, str | int | float):
        return value if isinstance(value, str) else repr(value)
    return type(value).__name__


def fields(value: object, *names: str) -> str:
    """Return some attributes of an object in words."""
    return ", ".join(f"{name} {told(getattr(value, name))}" for name in names)


def flat(data: object, leave: Set[str] = frozenset(), at: str = "") -> Iterator[str]:
    """Yield plain data as lines 'a.b[0] = value', some keys left out."""
    if isinstance(data, dict):
        for key, value in data.items():
            if key not in leave:
                yield from flat(value, leave, f"{at}.{key}" if at else str(key))
    elif isinstance(data, list) and any(isinstance(v, dict | list) for v in data):
        for k, value in enumerate(data):
            yield from flat(value, leave, f"{at}[{k}]")
    else:
        yield f"{at} = {told(data)}"


# --- who stands and moves about the robot ---------------------------------------------


def clip(rng: np.random.Generator, frames: int, reach: float = 0.9) -> list[np.ndarray]:
    """Return (k, 7) capsules of every frame: an arm that moves, rods that come and go.

    Sometimes nobody is there, so that points are cleared.
    """
    turn = rng.uniform(-1.0, 1.0)
    out = np.array([np.cos(turn), np.sin(turn), 0.0])
    shoulder = reach * out + [0.0, 0.0, rng.uniform(0.4, 0.7)]
    middle = rng.uniform(0.4, 0.7) * reach * out + [0.0, 0.0, rng.uniform(0.3, 0.6)]
    size, rate = rng.uniform(0.05, 0.3, 3), rng.uniform(0.3, 1.2, 3)
    phase = rng.uniform(0.0, 2 * np.pi, 3)
    rods = [_rod(rng, reach) for _ in range(4)]
    spans = [sorted(rng.integers(0, frames, 2).tolist()) for _ in rods]
    gone = int(rng.integers(frames // 4, frames)) if frames > 8 else frames
    found = []
    for k in range(frames):
        hand = middle + size * np.sin(2 * np.pi * rate * PERIOD * k + phase)
        elbow = 0.5 * (shoulder + hand) + [0.0, 0.0, -0.12]
        rows = (
            []
            if gone <= k < gone + 12
            else [[*shoulder, *elbow, 0.05], [*elbow, *hand, 0.04]]
        )
        rows += [rod for rod, (a, b) in zip(rods, spans, strict=True) if a <= k < b]
        found.append(np.array(rows).reshape(-1, 7))
    return found


def _rod(rng: np.random.Generator, reach: float) -> list[float]:
    turn, far = rng.uniform(-np.pi, np.pi), rng.uniform(0.5, 1.1) * reach
    foot = [far * np.cos(turn), far * np.sin(turn), rng.uniform(0.1, 0.5)]
    return [*foot, *(foot + rng.uniform(-0.2, 0.2, 3)), 0.03]


def points_of(capsules: np.ndarray) -> np.ndarray:
    """Return the samples of capsules (k, 7), (n, 3) [m]."""
    if not len(capsules):
        return np.zeros((0, 3))
    return odm.sample_capsules(capsules, _SPACING)


def advance(path: np.ndarray, speed: float = SPEED) -> np.ndarray:
    """Return where a path (k, dof) leads to until the next frame."""
    left = PERIOD
    for a, b in zip(path[:-1], path[1:], strict=True):
        needed = float(np.abs(b - a).max()) / speed
        if needed > left:
            return a + (b - a) * (left / needed)
        left -= needed
    return path[-1].copy()


def draw_free(planner: odm.ReactivePlanner, rng: np.random.Generator) -> np.ndarray:
    """Draw a configuration that the planner calls free now, at most near a node."""
    nodes = planner.cell_map.roadmap.nodes
    for _ in range(200):
        q = nodes[rng.integers(len(nodes))] + rng.normal(0.0, 0.1, nodes.shape[1])
        if planner.is_free(q, q):
            return q
    return nodes[0].copy()


def pose(x: float, y: float, z: float, yaw: float = 0.0, tilt: float = 0.0):  # noqa: ANN201
    """Return a pose (4, 4): tilted about x, then turned about z [m, rad]."""
    a, b, c, d = np.cos(yaw), np.sin(yaw), np.cos(tilt), np.sin(tilt)
    T = np.eye(4)
    T[:3, :3] = np.array([[a, -b, 0], [b, a, 0], [0, 0, 1]]) @ [
        [1, 0, 0],
        [0, c, -d],
        [0, d, c],
    ]
    T[:3, 3] = x, y, z
    return T


def look_at(eye: list[float], target: list[float]) -> np.ndarray:
    """Return the pose (4, 4) of a camera that looks at a place, its axes as odm's."""
    z = np.array(target) - eye
    x = np.cross(z, [0.0, 0.0, 1.0])
    z, x = z / np.linalg.norm(z), x / np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.column_stack([x, np.cross(z, x), z]), eye
    return T


def depth_image(
    T_base_camera: np.ndarray, lens: tuple, balls: np.ndarray, wall_m: float
) -> np.ndarray:
    """Return what a pin-hole camera sees of balls (k, 4) before a wall, uint16 [mm].

    Args:
        T_base_camera: Pose of the camera (4, 4).
        lens: Width, height, fx, fy, cx, cy in pixels.
        balls: Centre and radius of each, base frame [m].
        wall_m: Depth of the wall, square to the camera [m].
    """
    width, height, fx, fy, cx, cy = lens
    v, u = np.mgrid[:height, :width]
    rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones_like(u, float)], axis=-1)
    depth = np.full((height, width), wall_m)
    R, p = T_base_camera[:3, :3], T_base_camera[:3, 3]
    for ball in balls:
        center = R.T @ (ball[:3] - p)
        a, b = (rays**2).sum(axis=-1), rays @ center
        root = b * b - a * (center @ center - ball[3] ** 2)
        near = np.where(root > 0.0, (b - np.sqrt(np.abs(root))) / a, np.inf)
        depth = np.minimum(depth, np.where(near > 0.05, near, np.inf))
    image = np.round(1000.0 * depth).astype(np.uint16)
    image[::17, ::13] = 0  # no reading
    return image


def improve(planner: odm.ReactivePlanner, budget: int) -> int:
    """Improve between frames; checkouts of before call it polishing."""
    return (getattr(planner, "improve", None) or planner.polish)(budget)
