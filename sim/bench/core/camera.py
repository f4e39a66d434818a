"""`odm bench camera`: depth images in, cells and points out, robot in the picture."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from odm import (
    Capsule,
    CellMap,
    DepthCamera,
    PlannerSettings,
    ReactivePlanner,
    SeenSettings,
    SeenSpace,
    load_map,
)
from odm.cameras import look_at
from odm.exact.distances import ExactRobot, obstacles_of
from roadmap.errors import BadInput
from roadmap.kinematics.forward import sphere_centers
from sim.bench.clock import Clock
from sim.bench.core.camera_scene import HandBeside, far_box, person_at
from sim.bench.depth_render import DepthScene
from sim.tables.header import header
from sim.tables.table import TRUTH, value_row

SIZE, FOCAL = (640, 480), 476.0
ASKED_US = 3000.0
VALID = (50_000, 80_000)  # readings of an image that the figure is asked for
CLEAR = 0.15  # [m] from the person, where the robot stands and is to go
CUT = 1.35  # times the distance of the base: readings beyond it are none, or clear


def run(
    map_dir: str | Path,
    *,
    seed: int = 0,
    short: bool = False,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Measure `SeenSpace.update` on rendered images of a robot and a person.

    Args:
        map_dir: Folder of a built map.
        seed: Of the person's motion.
        short: Few frames: to see that it runs, not to measure.
        tell: Called with what is measured.

    Returns:
        Plain data for JSON: "header", "setup" and "rows".
    """
    tell = tell or (lambda text: None)
    cell_map = load_map(map_dir, verify=False)
    frames = 20 if short else 400
    reach = float(cell_map.grid.upper[0] - cell_map.grid.origin[0]) / 2.0
    cameras = [_camera(reach, side) for side in (0.45, -1.2)]
    q, goal = free_places(cell_map, reach, seed)
    tell("images of a robot and a person")
    images = _images(cell_map, cameras, q, reach, seed, 6 if short else 24)
    settings = SeenSettings(d_self=0.005)
    rows = []
    for name, used, kept, asked in (
        ("depth image -> cells", 1, "cut", {"p50": ASKED_US}),
        ("... every pixel has a reading", 1, "whole", {}),
        ("... cut, 65535 where nothing is", 1, "clear", {}),
        ("... two cameras, cut", 2, "cut", {}),
    ):
        tell(name)
        seen_by = [_cleared(c) for c in cameras] if kept == "clear" else cameras
        rows += _measure(
            name, cell_map, seen_by[:used], [i[:used] for i in images[kept]], (q, goal),
            settings, frames, asked,
        )  # fmt: skip
    tell("a hand beside the robot")
    rows += _hand_rows(cell_map, settings, reach)
    setup = {
        "frames": frames,
        "images": f"{SIZE[0]} x {SIZE[1]}, focal length {FOCAL:g} px, rendered",
        "self filter": f"{1e3 * settings.d_self:g} mm",
        "memory": f"{settings.memory_s:g} s at {settings.speed:g} m/s",
        "shadow": "on",
        "seed": seed,
    }
    return {"bench": "camera", "header": header(cell_map), "setup": setup, "rows": rows}


def _camera(reach: float, side: float) -> DepthCamera:
    """Return a camera before the robot, above its shoulder."""
    eye = [1.1 * reach, side * reach, 0.75 * reach]
    return _camera_at(eye, [0.15 * reach, 0.0, 0.3 * reach])


def _camera_at(eye: list[float], target: list[float]) -> DepthCamera:
    middle = (SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2
    pose = look_at(eye, target)
    return DepthCamera(*SIZE, FOCAL, FOCAL, *middle, pose, scale=0.00025)


def _far(camera: DepthCamera) -> float:
    """Return up to which depth an image that is cut off has readings [m]."""
    return CUT * float(np.linalg.norm(camera.T_base_camera[:3, 3]))


def _cleared(camera: DepthCamera) -> DepthCamera:
    """Return the same camera, which tells where nothing is before its readings end."""
    return replace(camera, clear_m=_far(camera))


def _images(
    cell_map: CellMap,
    cameras: list[DepthCamera],
    q: np.ndarray,
    reach: float,
    seed: int,
    n: int,
) -> dict[str, list[list[np.ndarray]]]:
    """Render n images of each camera: of a whole room, and cut off at short range.

    Twice: 0 is farther off, or 65535, which says so to a camera that is `_cleared`.
    """
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0, 2 * np.pi, 3)
    found: dict[str, list] = {"cut": [], "whole": [], "clear": []}
    bare = []
    for camera in cameras:
        room = DepthScene(camera).add_robot(cell_map.robot, q)
        bare.append((room.depth_m.copy(), room.add_boxes(*far_box(reach)).depth_m))
    for k in range(n):
        person = person_at(reach, 2 * np.pi * k / n + phase)
        pair: dict[str, list] = {kept: [] for kept in found}
        for camera, (robot, room) in zip(cameras, bare, strict=True):
            depth = DepthScene(camera).add_capsules(person).depth_m
            near = np.minimum(depth, robot)
            near = np.where(near < _far(camera), near, np.inf)
            pair["cut"].append(camera.from_metres(near))
            pair["clear"].append(_cleared(camera).from_metres(near))
            pair["whole"].append(camera.from_metres(np.minimum(depth, room)))
        for kept, images in pair.items():
            found[kept].append(images)
    return found


def _measure(
    name: str,
    cell_map: CellMap,
    cameras: list[DepthCamera],
    images: list[list[np.ndarray]],
    ends: tuple[np.ndarray, np.ndarray],
    settings: SeenSettings,
    frames: int,
    asked: dict[str, float],
) -> list[dict]:
    q, goal = ends
    space = SeenSpace(cell_map, cameras, settings)
    planner = ReactivePlanner(cell_map, settings=PlannerSettings(history_s=0.0))
    planner.set_goals([goal])
    clock, plan, answered = Clock(), Clock(), []
    valid, points, kept = [], [], []
    order = list(range(len(images))) + list(range(len(images) - 2, 0, -1))
    for k in range(-len(order), frames):
        shown = images[order[k % len(order)]]
        if k < 0:  # first once round: memory fills, kernels load
            seen = space.update(shown, q, 0.033 * (k + len(order)))
            planner.step(seen.points, q=q, covering_radius=seen.covering_radius)
            continue
        seen = clock(space.update, shown, q, 0.033 * (k + len(order)))
        radius = seen.covering_radius
        answer = plan(planner.step, seen.points, q=q, covering_radius=radius)
        answered.append(len(answer.path) > 0)
        valid.append(seen.readings["valid"])
        points.append(len(seen.points))
        kept.append(space.counts()["remembered"])
    rows = [clock.row(name, "self filter, memory, shadow", **asked)]
    name = "" if asked else f"{name.removeprefix('... ')}: "
    least, most = (float(f(valid)) for f in (min, max))
    if asked:
        rows.append(value_row("... fewest readings", least, "", least=VALID[0]))
        rows.append(value_row("... most readings", most, "", most=VALID[1]))
        rows.append(value_row("... remembered cells, mean", round(np.mean(kept)), ""))
    else:
        rows.append(value_row(f"... {name}readings, mean", round(np.mean(valid)), ""))
    rows.append(value_row(f"... {name}points, mean", round(np.mean(points)), ""))
    rows.append(
        plan.row(f"... {name}points -> answer", "planner.step with history_s=0")
    )
    share = 100.0 * float(np.mean(answered))
    rows.append(value_row(f"... {name}frames with a path", share, "%"))
    return rows


def free_places(
    cell_map: CellMap, reach: float, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return where the robot stands and where it is to go, (dof,) each.

    Both farther than CLEAR from the person at all times, by exact geometry, so that its
    frames are no holds of a robot in contact: the middle of its limits, or nodes.
    """
    robot, exact = cell_map.robot, ExactRobot(cell_map.robot)
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, 3)
    people = [person_at(reach, 2 * np.pi * k / 12 + phase) for k in range(12)]
    rods = np.unique(np.concatenate(people), axis=0)
    about = obstacles_of([Capsule.between(r[:3], r[3:6], r[6]) for r in rods])
    static, found = ReactivePlanner(cell_map).static, []
    for q in (0.5 * (robot.lower + robot.upper), *np.array(cell_map.roadmap.nodes)):
        if not static.motion_free(q, np.zeros_like(q)):
            continue
        if exact.distance(q, about, cap=2 * CLEAR).distance > CLEAR:
            found.append(q)
        if len(found) == 2:
            return found[0], found[1]
    raise BadInput(
        f"{robot.name} has no two nodes {100 * CLEAR:g} cm from a person beside it; "
        "measure with a larger map, or another robot"
    )


def _hand_rows(cell_map: CellMap, settings: SeenSettings, reach: float) -> list[dict]:
    """See a hand 2 cm from the fifth link: is it there, does it block the motion?"""
    robot, place = cell_map.robot, HandBeside(cell_map, 0.02)
    middle = 0.5 * (place.capsule[:3] + place.capsule[3:6])
    eye = middle + 0.8 * place.side + [0.25, 0.0, 0.35]
    camera = _camera_at(eye, middle)
    scene = DepthScene(camera).add_robot(robot, place.q).add_boxes(*far_box(reach))
    empty = scene.image()
    image = scene.add_capsules(place.capsule).image()
    alone = DepthScene(camera).add_capsules(place.capsule).image()
    hand = camera.points(np.where(alone == image, alone, 0).astype(np.uint16))
    centers = sphere_centers(robot, place.q)
    gap = np.linalg.norm(hand[:, None] - centers, axis=2) - robot.spheres[:, 3]
    stay = 100.0 * float((gap.min(axis=1) > settings.d_self).mean())
    free = []
    for pixels in (image, empty):
        seen = SeenSpace(cell_map, camera, settings).update(pixels, place.q, 0.0)
        planner = ReactivePlanner(cell_map)
        planner.step(seen.points, q=place.q, covering_radius=seen.covering_radius)
        free.append(bool(planner.is_free(place.q, place.into)))
    name = f"hand 2 cm from {place.link}"
    return [
        value_row(f"{name}: its visible points that stay", stay, "%", least=50.0),
        value_row("... blocks the motion into it", float(not free[0]), TRUTH, least=1),
        value_row("... which is free without it", float(free[1]), TRUTH, least=1),
    ]
