"""`odm warmup`: compile every kernel before a frame has to wait for it.

Numba compiles a kernel for the types of its arguments, and keeps the result on disk.
To it a read-only array is another type than a writable one, so the arrays here are
the real ones: a map that was stored and is read again.
"""

import gc
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from odm import (
    Box,
    Capsule,
    CellMap,
    Cylinder,
    DepthCamera,
    Mesh,
    Obstacles,
    PlannerSettings,
    PointCloud,
    ReactivePlanner,
    Recipe,
    SeenSettings,
    SeenSpace,
    Sphere,
    build_map,
    load_map,
    sample_capsules,
    surface_of,
)
from odm.cameras import look_at
from odm.cell_map.recipe import PayloadRecipe, RobotRecipe
from odm.close_test.safety import Safety
from odm.processes import in_processes
from odm.search._state import NO_ITEM
from roadmap.builds.chunks import Progress
from roadmap.builds.unfinished import temporary_folder
from roadmap.graph.connecting import RoadmapSettings
from roadmap.kinematics.forward import tool_pose
from roadmap.transforms import pose_of
from sim.terminal.ahead import compile_ahead

if TYPE_CHECKING:
    from handover import Chain, ReachMap

URDF = """<robot name="sample">
<link name="base"><collision><geometry><cylinder radius="0.06" length="0.1"/></geometry>
</collision></link>
<link name="upper"><collision><origin xyz="0.1 0 0"/><geometry>
<box size="0.2 0.05 0.05"/></geometry></collision></link>
<link name="fore"><collision><origin xyz="0.1 0 0"/><geometry>
<box size="0.2 0.04 0.04"/></geometry></collision></link>
<link name="hand"><collision><origin xyz="0.05 0 0"/><geometry>
<sphere radius="0.03"/></geometry></collision></link>
<joint name="a" type="revolute"><parent link="base"/><child link="upper"/>
<origin xyz="0 0 0.2"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
<joint name="b" type="revolute"><parent link="upper"/><child link="fore"/>
<origin xyz="0.2 0 0"/><axis xyz="0 1 0"/>
<limit lower="-2.5" upper="2.5" velocity="1" effort="1"/></joint>
<joint name="c" type="revolute"><parent link="fore"/><child link="hand"/>
<origin xyz="0.2 0 0"/><axis xyz="0 1 0"/>
<limit lower="-2.5" upper="2.5" velocity="1" effort="1"/></joint>
</robot>
"""
COARSE, FINE = 0.04, 0.004  # [m] the fine one needs more blocks than 16 bits can name


def run_warmup(progress: Progress, fine: bool = False) -> tuple[float, int]:
    """Compile all by building, storing and using a tiny map, in two processes.

    Returns the seconds it took, and how many kernels were compiled anew. `fine` is for
    grids of more than 65535 blocks, too.
    """
    begun = time.perf_counter()
    sizes = (COARSE, FINE) if fine else (COARSE,)
    done, total = 0, len(sizes) * len(_MAIN)
    compiled = compile_ahead("warmup")
    for h in sizes:
        with temporary_folder() as folder, _beside(folder, h, _BESIDE) as beside:
            here = map(_Jobs(folder, h).run, _MAIN)
            for misses in chain(here, beside):
                if misses is None:  # the other process did that one
                    continue
                compiled += misses
                done += 1
                progress("kernels", done, total)
    return time.perf_counter() - begun, compiled


class _Jobs:
    """What is compiled, job by job; whichever process comes first takes a job.

    The map of cells of side `h` [m] is stored in `folder`, and read again.
    """

    def __init__(self, folder: Path, h: float) -> None:
        self.folder, self.h = folder, h
        self._map: CellMap | None = None

    def run(self, name: str) -> int | None:
        """Run one job; return how many kernels it compiled, None if it was taken."""
        try:
            (self.folder / f"{name}.taken").touch(exist_ok=False)
        except FileExistsError:
            return None
        before = cache_misses()
        if name == "build":
            build_map(tiny_recipe(self.folder, self.h)).save(self.folder / "map")
        elif name in _ALONE:
            _ALONE[name]()
        else:
            _WITH_MAP[name](self.map)
        return cache_misses() - before

    @property
    def map(self) -> CellMap:
        """The map, as soon as it is stored."""
        while self._map is None:
            if (self.folder / "map").exists():  # it is put there whole
                self._map = load_map(self.folder / "map")
            else:
                time.sleep(0.05)
        return self._map


@contextmanager
def _beside(
    folder: Path, h: float, names: tuple[str, ...]
) -> Iterator[Iterator[int | None]]:
    """Yield what jobs compiled, one after the other, in a process of their own.

    None: that job was taken already. On a single core nothing is yielded.
    """
    if (os.cpu_count() or 1) < 2:
        yield iter(())
        return
    given = (folder, h, gc.get_threshold())
    with in_processes(1, _run_job, list(names), _prepare_child, given) as misses:
        yield misses


_shared: dict[str, _Jobs] = {}  # of the process beside


def _prepare_child(folder: Path, h: float, collect: tuple[int, int, int]) -> None:
    gc.set_threshold(*collect)
    _shared["jobs"] = _Jobs(folder, h)


def _run_job(name: str) -> int | None:
    return _shared["jobs"].run(name)


def tiny_recipe(folder: Path, h: float = COARSE) -> Recipe:
    """Return the recipe of a map that is built in a moment; writes its URDF."""
    urdf = folder / "sample.urdf"
    urdf.write_text(URDF, encoding="utf-8")
    return Recipe(
        name="sample",
        robot=RobotRecipe(source=str(urdf), tip="hand"),
        roadmap=RoadmapSettings(nodes=60, neighbors=6),
        safety=Safety(h=h),
        scenery=(
            {"type": "plane", "name": "floor"},
            {"type": "box", "size": [0.2, 0.2, 0.1], "position": [0.6, 0.4, 0.05]},
        ),
        payload=PayloadRecipe(radius=0.06, position=(0.12, 0.0, 0.0)),
    )


def _load(cell_map: CellMap) -> None:
    robot = cell_map.robot
    robot.ik(tool_pose(robot, np.array([0.1, 0.4, 0.5])))


def exercise(cell_map: CellMap) -> None:
    """Take every way through a frame once, with a planner of its own.

    Later planners of this process then find all kernels loaded.
    """
    settings = PlannerSettings(point_capacity=64)
    for always_replan in (True, False):
        planner = ReactivePlanner(cell_map, always_replan, settings)
        start, goal = _two_nodes(planner)
        planner.set_goals([np.array(cell_map.roadmap.nodes[0])])
        planner.set_goals([goal], costs=[0.5])
        planner.set_goals([goal, start])
        for points in _scenes(cell_map, start, goal):
            for q in (start, 0.9 * start + 0.1 * goal, goal):
                planner.step(points, q=q, dq=np.zeros_like(q))
                answer = planner.step(points, q=q, stamp=0.0, now=0.01)
                _ = answer.reason, answer.blockers, answer.retreat
            planner.attacher.attach_free(1)
            planner.improve(8)
            planner.attacher.attach_more(64)
            planner.decision.sees_better_goal()
            if not always_replan:
                planner.smoother.was_hit(0)
            planner.separation(start)
            planner.is_free(start, goal)
            planner.blocked_leg(np.stack([start, goal]), 0.1, points)
            planner.evasion(start, [(0.1, points)], 0.5)
            if planner.memory.path.count[0] >= 2:
                planner.attacher.forget_start()
                planner.step(points, q=start)
            planner.attacher.attach_start(start, without_cells=True)
            planner.connector.search(planner.frame.q.copy(), False)
            planner.invalid_nodes()
            planner.invalid_edges()
        shapes = _shapes(points)
        for given in (shapes, Obstacles.of([]), shapes, shapes):
            answer = planner.step(given, q=start)
            _ = answer.reason, answer.retreat
            planner.separation(start)
            planner.blocked_leg(np.stack([start, goal]), 0.1, given)
            planner.evasion(start, [(0.1, given)], 0.5)
        planner.set_base(np.eye(4))  # after which shapes are sampled again
        planner.step(shapes, q=start)
        planner.expect(shapes)
        _improve_a_detour(planner, start, goal)
        planner.step(points, q=start, covering_radius=cell_map.safety.rho)
        for bad in (np.nan, 1e3):  # and one that lies outside, then and there
            planner.step(np.full((1, 3), bad), q=start)
        planner.step(np.array(cell_map.grid.upper)[None] - 0.1, q=start, stamp=0.0)
        planner.step(np.array(cell_map.grid.upper)[None] + 0.1, q=start, stamp=0.0)
        planner.see(points, q=start)
        planner.reset()
    _watch(planner, start)


def _improve_a_detour(
    planner: ReactivePlanner, start: np.ndarray, goal: np.ndarray
) -> None:
    """Shorten and smooth a path with corners, which no scene may have led to."""
    node = np.array(planner.cell_map.roadmap.nodes[0])
    planner.step(np.zeros((0, 3)), q=start)
    vertices = [planner.attacher.new_vertex() for _ in range(4)]
    corners = np.array([start, 0.5 * (start + node), node, goal])
    planner.path.lead(0, np.array(vertices), corners, [NO_ITEM] * 3)
    planner.path.followed = True
    for ahead in (None, start):
        planner.improve(16, ahead)
    planner.smoother.time(corners)
    path = planner.path
    planner.candidates.is_known(int(path.vertex[0]), int(path.vertex[1]))
    planner.candidates.add(int(path.vertex[0]), int(path.vertex[1]), NO_ITEM)


def _shapes(points: np.ndarray) -> Obstacles:
    """Return a shape of each kind, and points."""
    T = pose_of((0.3, 0.0, 0.3), (0.1, 0.2, 0.3))
    corners = np.vstack([np.zeros(3), 0.1 * np.eye(3)])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    solids = [
        Sphere(0.05, T),
        Capsule(0.04, 0.2, T),
        Cylinder(0.04, 0.2, T),
        Box(np.array([0.1, 0.2, 0.1]), T),
        Mesh(corners, faces, T),
    ]
    return Obstacles.of(solids, points)


def _two_nodes(planner: ReactivePlanner) -> tuple[np.ndarray, np.ndarray]:
    """Return two configurations that are free here, not quite roadmap nodes."""
    nodes = planner.cell_map.roadmap.nodes
    middle = np.array(nodes.mean(axis=0))
    some = nodes[:: max(1, len(nodes) // 40)]
    near = [0.999 * node + 0.001 * middle for node in some]
    free = [q for q in near if planner.is_free(q, q)]
    return (free[0], free[-1]) if free else (np.array(nodes[0]), np.array(nodes[-1]))


def _scenes(cell_map: CellMap, start: np.ndarray, goal: np.ndarray) -> list[np.ndarray]:
    """Return points of nobody, of an arm in the way, at the start and all around."""
    robot, rho = cell_map.robot, cell_map.safety.rho
    hand, there = (tool_pose(robot, q)[:3, 3] for q in (start, goal))
    between = 0.5 * (hand + there)
    rod = np.array([0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 0.03])

    def arm_at(*places: np.ndarray) -> np.ndarray:
        rows = [np.r_[p, p, 0.0] + rod for p in places]
        return sample_capsules(np.array(rows), rho)

    many = [arm_at(between + 0.03 * k) for k in range(4)]
    return [
        np.zeros((0, 3)),
        arm_at(between + 10.0),
        arm_at(between),
        arm_at(hand),
        arm_at(there),
        np.concatenate(many),
    ]


def _ask(cell_map: CellMap) -> None:
    """Set scenery of the place by each way, ask for a pose, sample all obstacles."""
    planner = ReactivePlanner(cell_map)
    box = Box(np.array([0.1, 0.1, 0.1]))
    planner.set_static(box)
    planner.set_static(surface_of(box, cell_map.safety.rho))
    start, goal = _two_nodes(planner)
    planner.set_goals([goal])
    planner.step(np.zeros((0, 3)), q=start)
    planner.scene.add("box", box)
    planner.scene.move("box", look_at([0.4, 0.0, 0.3], [1.0, 0.0, 0.3]))
    planner.scene.test_waiting()
    planner.improve(4)
    planner.set_goals(poses=[tool_pose(planner.robot, goal)])
    planner.approach(tool_pose(planner.robot, goal), distance=0.01)
    planner.scene.remove("box")
    planner.step(PointCloud(np.zeros((1, 3)) + 9.0, covering_radius=0.02), q=start)


def _carry(cell_map: CellMap) -> None:
    """Plan with something in the hand, the base elsewhere, more distance kept."""
    planner = ReactivePlanner(cell_map, settings=PlannerSettings(point_capacity=64))
    start, goal = _two_nodes(planner)
    planner.set_goals([goal])
    box = Box(np.full(3, 0.04), pose_of((0.12, 0.0, 0.0), (0.0, 0.0, 0.0)))
    planner.attach(box)  # its cover is chosen and proved, too
    planner.set_base(look_at([0.5, 0.0, 0.0], [1.0, 0.0, 0.0]))
    for extra in (0.0, 0.02):
        planner.set_extra_clearance(extra)
        for points in _scenes(cell_map, start, goal):
            answer = planner.step(points, q=start, classes=np.ones(len(points), int))
            _ = answer.reason, answer.blockers
            planner.blocked_leg(np.stack([start, goal]), 0.01, points, phase="give")
        planner.set_static(points)
    planner.detach()


def _see(cell_map: CellMap) -> None:
    """Let a camera look at the robot, with every option; finer cells change no type."""
    if cell_map.grid.h < COARSE:
        return
    pose = look_at([1.5, 0.0, 0.8], [0.0, 0.0, 0.2])
    camera = DepthCamera(640, 480, 500.0, 500.0, 320.0, 240.0, pose)
    q = np.array(cell_map.roadmap.nodes[0])
    for policy in ("free", "occupied"):
        settings = SeenSettings(d_self=0.01, flying_m=0.02, policy=policy)
        space = SeenSpace(cell_map, camera, settings)
        for k, depth_mm in enumerate((1200, 800, 1500)):
            image = np.full((480, 640), depth_mm, np.uint16)
            image[:, : 200 * k] = 0
            space.update(image, q, 0.1 * k)


def _audit(cell_map: CellMap) -> None:
    from odm.audit.audit import audit
    from odm.audit.clearance import clearance_overhead

    clearance_overhead(cell_map, 20, n_edges=2)
    audit(cell_map, pairs=60, threads=1)
    audit(cell_map, pairs=60, close=True, threads=1)


def _measure(cell_map: CellMap) -> None:
    from sim.loop.loop import exact_audit

    q = np.array(cell_map.roadmap.nodes[0])
    exact_audit(cell_map.robot)(q, np.array([[1.0, 0, 0, 1.0, 0, 0.3, 0.05]]))


def _watch(planner: ReactivePlanner, q: np.ndarray) -> None:
    from odm.close_test.shells import Hulls, Shells
    from odm.execution.shell_test import ShellTest
    from odm.execution.speed_limit import SpeedLimit
    from odm.execution.threat import Watcher
    from roadmap.geometry.gaps import ball_gaps, least_gap
    from roadmap.motion.motion import time_path

    watcher, arm = Watcher(), np.array([[0.5, 0.0, 0.5, 0.5, 0.0, 0.8, 0.05]])
    for now in (0.0, 0.01, 0.02):
        threat = watcher.look(arm, now)
    threat.as_lately().likely(0.1)
    ball_gaps(np.array([[0.0, 0.0, 0.0, 0.1]]), arm)
    least_gap(arm, arm)
    leg = np.array([q, q + 1e-3])
    motion = time_path(planner.robot, leg)
    limit = SpeedLimit(planner.robot)
    limit.share(motion, 0.0, 1.0, threat, arm)
    limit.jerk_share(motion, 0.0, arm)
    planner.blocked_leg(leg, 0.0, threat.between(0.0, 0.1)[0])
    ShellTest(planner).passes(motion, 0.0, 0.0, motion.stop(0.0), threat, 0.0)
    # a robot without shells has not come so far
    shells = Shells(planner.robot)
    shells.show(Hulls.of_rods(arm))
    shells.apart(0.0)


def _person() -> None:
    from handover import ArmState, Human, QualitySettings, posture_quality
    from handover.meet.places import qualities_at
    from sim.people.grips import grip_points

    human = Human()
    T, arm = human.T_world_hand("left"), human.arm("left")
    joints = human.arm_ik("left", T).q[0]
    arm.solvable(np.eye(4)[None])
    arm.jacobian(joints)
    grip_points(human, 8)
    posture_quality(ArmState.of(human, "left", QualitySettings()), joints)
    qualities_at(human, "left", T[None, :3, 3], rotations=72)


def _reach(cell_map: CellMap) -> None:
    from handover import chain_of

    _reach_of(chain_of(cell_map.robot))


def _reach_of_person() -> None:
    from handover import Human

    _reach_of(Human().arm("left").chain())


def _reach_of(chain: "Chain") -> None:
    """Build, store, load and ask a reach map."""
    from handover import ReachSettings, build_reach_map, load_reach_map
    from handover.reach.reach_recall import center_rate

    settings = ReachSettings(cell=0.2, rotations=72, samples=2000)
    with temporary_folder() as folder:
        build_reach_map(chain, settings, threads=1).save(folder / "reach")
        reach = load_reach_map(folder / "reach")
        cell = int(reach.marked_cells()[0])
        reach.quality(reach.grid.centers(np.array([cell])))
        reach.witness_of(cell)
        reach.qualities(np.array([cell]))
        reach.dense()
        center_rate(reach, chain, cells=1)
        if chain.robot is not None:
            _meet(reach)


def _meet(reach: "ReachMap") -> None:
    """Rank where to meet, once in every way."""
    from handover import Human, InteractionWorkspace, MeetSettings, wrench

    settings = MeetSettings(cell=0.2, rotations=72)
    human = Human().placed(0.8, 0, np.pi)
    meet = InteractionWorkspace(reach, human, wrench(), 1, settings)
    for target in meet.best(1):
        meet.remove(target)
    meet.rated([0])  # wherever the hand is: so coarse a map may know no target
    meet.build()
    coarser = replace(settings, cell=0.25)
    InteractionWorkspace(reach, human, wrench(), 1, coarser)


def _hand_over() -> None:
    """Plan a whole hand-over, with a handful of grasps."""
    from handover import build_grasps, load_scene, plan_handover
    from handover.grasps.grasp_build import GraspSettings

    scene, few = load_scene("kneeling", 0), GraspSettings(samples=5, rolls=2)
    giver = replace(scene.giver, arms=("left",))
    scene = replace(
        scene, giver=giver, receiver=replace(scene.receiver, arms=("left",))
    )
    hands = ("sdh_left", "hubo_left")
    grasps = {hand: build_grasps(scene.obj, hand, few) for hand in hands}
    plan_handover(scene, 600.0, grasps=grasps)


_ALONE = {
    "person": _person,
    "person's reach": _reach_of_person,
    "hand-over": _hand_over,
}
_WITH_MAP = {
    "load": _load,
    "exercise": exercise,
    "ask": _ask,
    "carry": _carry,
    "measure": _measure,
    "reach": _reach,
    "see": _see,
    "audit": _audit,
}
# Jobs in the order of each process: the frame's first, and beside it those that need
# no map first. Towards the end each takes what the other has not begun.
_MAIN = ("build", "load", "exercise", "ask", "carry", "measure", "audit", "see")
_MAIN += ("reach", *reversed(_ALONE))
_BESIDE = ("hand-over", "person's reach", "person", "reach", "see", "audit")
_BESIDE += ("measure",)  # the others share loops with what the first one does


def cache_misses() -> int:
    """Return how many kernels this process has compiled so far."""
    from numba.core.dispatcher import Dispatcher

    kernels = {}
    for name, module in list(sys.modules.items()):
        if name.split(".")[0] in ("roadmap", "odm", "handover", "sim"):
            found = [v for v in vars(module).values() if isinstance(v, Dispatcher)]
            kernels |= {id(kernel): kernel for kernel in found}
    return sum(sum(k.stats.cache_misses.values()) for k in kernels.values())
