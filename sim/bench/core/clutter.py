"""`odm bench clutter`: shelves, boxes, cages and tables, as boxes of the frame.

Each scene is asked once, by a planner that knows nothing of it: one `step`, and where
that holds, `improve` and `step` in turn until there is a path, within a counted number
of calls. OMPL's RRT-Connect gets two seconds for each with exact checks that keep the
same clearance m. Every path of ours is looked at again by python-fcl, densely.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from odm import Obstacles, ReactivePlanner, load_map
from odm.answer import HOLDING, ROADMAP, SEARCH, STRAIGHT, Answer
from odm.cell_map.cell_map import CellMap
from odm.close_test.static import StaticTest
from odm.exact.distances import ExactRobot, obstacles_of
from odm.exact.fcl_robot import FclRobot
from roadmap.kinematics.forward import motion_per_joint
from sim.bench.clock import Clock, time_row
from sim.bench.core.clutter_scenes import CLEAR, KINDS, Scene, make_scenes
from sim.bench.rivals.ompl import OmplMissing, OmplPlanner, length
from sim.tables.header import header
from sim.tables.table import value_row

LIMIT_S = 2.0  # that OMPL gets
MOTIONS, MOST_CALLS = 8, 60  # of `improve`: budget, and calls for a scene
IMPROVED = 10  # further calls of `improve` on a path that was found
STEP = 0.004  # [m] no point of the robot moves farther between two checks
SOLVED, P50_MS, P95_MS = 97.0, 5.0, 60.0  # [%], asked


class Tried(NamedTuple):
    """What came of one scene."""

    kind: str
    path: np.ndarray | None  # first answer
    better: np.ndarray | None  # after IMPROVED calls of `improve`
    stage: str | None
    calls: int  # of `improve`, before there was a path
    wall_us: float  # of all calls up to then
    cpu_us: float
    free_ends: bool  # the planner calls both ends free
    other: np.ndarray | None  # OMPL's path


def run(
    map_dir: str | Path,
    *,
    seed: int = 1,
    short: bool = False,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Solve 400 scenes, or 10 where it is to be short.

    Args:
        map_dir: Folder of a built map.
        seed: Of the scenes.
        short: Few scenes: to see that it runs, not to measure.
        tell: Called with what is measured.

    Returns:
        Plain data for JSON: "header", "setup" and "rows".

    Raises:
        NoScene: The robot has no configurations in such scenes.
    """
    cell_map, tell = load_map(map_dir, verify=False), tell or (lambda text: None)
    tell("scenes")
    scenes = make_scenes(cell_map, 10 if short else 400, seed)
    bench = _Bench(cell_map, seed)
    bench.solve(scenes[0])  # compiled, and warm
    bench.set_goals = Clock()
    tried = []
    for k, scene in enumerate(scenes):
        if k % 10 == 0:
            tell(f"scene {k} of {len(scenes)}")
        tried.append(bench.solve(scene))
    setup = {
        "scenes": len(scenes),
        "seed": seed,
        "ends": f"{100 * CLEAR:g} cm from all boxes by exact geometry, or more",
        "calls": f"step; improve({MOTIONS}) and step in turn, {MOST_CALLS} times",
    }
    rows = _rows(tried, bench)
    return {"bench": "clutter", "header": header(cell_map), "setup": setup} | {
        "rows": rows
    }


class KeepsClear:
    """Exact checks: contact with nothing, and the clearance m kept from the boxes."""

    def __init__(self, cell_map: CellMap) -> None:
        """Make the exact solids."""
        self.exact, self.m = ExactRobot(cell_map.robot), cell_map.safety.m
        self.static = StaticTest(
            cell_map.robot, cell_map.scenery, cell_map.safety, cell_map.grid, threads=1
        )
        self.still = np.zeros(cell_map.robot.dof)

    def set_obstacles(self, boxes: tuple) -> None:
        """Take boxes as the obstacles."""
        self.obstacles = obstacles_of(list(boxes))

    def free(self, q: np.ndarray) -> bool:
        """Return whether the robot may stand at q."""
        if self.exact.collides(q, self.obstacles, self.m):
            return False
        return self.static.motion_free(q, self.still)


class ClearOmpl(OmplPlanner):
    """OMPL's RRT-Connect that keeps the clearance m as we do."""

    def __init__(self, cell_map: CellMap, seed: int) -> None:
        """Set space and checks up."""
        super().__init__(cell_map, seed)
        self.checker = KeepsClear(cell_map)

    def _valid(self, state) -> bool:  # noqa: ANN001 (an OMPL state)
        q = np.array([state[j] for j in range(self.robot.dof)])
        return self.checker.free(q)


class _Bench:
    """Solves scenes with both planners, and looks at the paths again."""

    def __init__(self, cell_map: CellMap, seed: int) -> None:
        self.planner = ReactivePlanner(cell_map)
        self.robot, self.m = cell_map.robot, cell_map.safety.m
        arm = cell_map.arm
        self.motion = motion_per_joint(
            arm.tree_i, arm.tree_f, arm.reach + arm.spheres[:, 3:], self.robot.dof
        )
        self.fcl, self.exact = FclRobot(self.robot), ExactRobot(self.robot)
        self.set_goals, self.checks, self.touches = Clock(), 0, 0
        self.nearest = np.inf
        try:
            self.ompl = ClearOmpl(cell_map, seed)
        except OmplMissing:
            self.ompl = None

    def solve(self, scene: Scene) -> Tried:
        obstacles = Obstacles.of(scene.boxes)
        planner, clock, calls = self.planner, Clock(), 0
        planner.reset()
        self.set_goals(planner.set_goals, [scene.q_goal])

        def ask() -> Answer:
            return clock(planner.step, obstacles, q=scene.q_start)

        answer = ask()
        while answer.status == HOLDING and calls < MOST_CALLS:
            calls += 1
            if clock(planner.improve, MOTIONS):
                answer = ask()
        times = 1e-3 * sum(clock.wall), 1e-3 * sum(clock.cpu)
        ends = all(planner.stands_clear(q) for q in (scene.q_start, scene.q_goal))
        path = better = other = None
        if answer.status != HOLDING:
            path = answer.path
            self.look_again(path, scene)
            for _ in range(IMPROVED):
                planner.improve(MOTIONS)
                better = ask().path
            self.look_again(better, scene)
        if self.ompl is not None:
            other = self.ompl.solve(scene, scene.boxes, LIMIT_S)
        return Tried(scene.kind, path, better, answer.stage, calls, *times, ends, other)

    def look_again(self, path: np.ndarray, scene: Scene) -> None:
        """Count where python-fcl finds contact along a path (k, dof)."""
        self.fcl.set_obstacles(list(scene.boxes))
        obstacles = obstacles_of(list(scene.boxes))
        for a, b in zip(path[:-1], path[1:], strict=True):
            pieces = max(1, int(np.ceil(np.abs(b - a) @ self.motion / STEP)))
            for k in range(pieces + 1):
                q = a + (b - a) * (k / pieces)
                self.checks += 1
                self.touches += self.fcl.collides(q)
                if k % 8 == 0:
                    near = self.exact.distance(q, obstacles, cap=0.1).distance
                    self.nearest = min(self.nearest, near)


def _rows(tried: list[Tried], bench: _Bench) -> list[dict]:
    mine = np.array([t.path is not None for t in tried])
    free = np.array([t.free_ends for t in tried])
    theirs = np.array([t.other is not None for t in tried])
    rows = []
    if bench.ompl is None:
        rows.append(
            value_row("scenes solved (OMPL is not installed)", _share(mine), "%")
        )
    else:
        rows += _against(mine, theirs, free)
    rows.append(
        value_row(
            "... of those whose ends the cover calls free", _share(mine[free]), "%"
        )
    )
    for kind in KINDS:
        of_kind = np.array([t.kind == kind for t in tried])
        rows.append(value_row(f"solved: {kind}", _share(mine[of_kind]), "%"))
    rows += _times(tried, mine, bench)
    for stage in (STRAIGHT, ROADMAP, SEARCH):
        count = sum(t.stage == stage for t in tried)
        rows.append(value_row(f"answered by: {stage}", count, "scenes"))
    calls = np.array([t.calls for t in tried])[mine]
    rows += [
        value_row("solved in the first step", _share(calls == 0), "% of those solved"),
        value_row("calls of improve before a path, p99", _percentile(calls, 99), ""),
    ]
    both = [t for t in tried if t.path is not None and t.other is not None]
    name = "path length, median ratio to OMPL simplified"
    note = f"joint space, rad; improved: {IMPROVED} more calls of improve"
    for what, which in (("first answer", "path"), ("improved", "better")):
        ratios = [length(getattr(t, which)) / length(t.other) for t in both]
        rows.append(value_row(f"{name}, {what}", _percentile(ratios, 50), "", note))
    note = f"python-fcl, no point moves by more than {1e3 * STEP:g} mm between two"
    return rows + [
        value_row("configurations of our paths checked", bench.checks, "", note),
        value_row("... in contact", bench.touches, "", most=0),
        value_row("... exact distance from the boxes, least", 100 * bench.nearest,
                  "cm", "every eighth of them", least=100 * bench.m),
    ]  # fmt: skip


def _against(mine: np.ndarray, theirs: np.ndarray, free: np.ndarray) -> list[dict]:
    return [
        value_row("scenes OMPL solves", _share(theirs), "%",
                  f"RRT-Connect, {LIMIT_S:g} s, exact checks that keep m"),
        value_row("... of those solved by us", _share(mine[theirs]), "%", least=SOLVED),
        value_row("... and whose ends the cover calls free",
                  _share(mine[theirs & free]), "%"),
        value_row("solved by us, not by OMPL", int((mine & ~theirs).sum()), "scenes"),
        value_row("scenes solved by us", _share(mine), "%"),
    ]  # fmt: skip


def _times(tried: list[Tried], mine: np.ndarray, bench: _Bench) -> list[dict]:
    wall = np.array([t.wall_us for t in tried])[mine]
    cpu = np.array([t.cpu_us for t in tried])[mine]
    note = "step, and improve and step until there is a path; scenes solved"
    return [
        time_row(
            "obstacles to path", note, wall, cpu, p50=1e3 * P50_MS, p95=1e3 * P95_MS
        ),
        value_row("... p95", 1e-3 * _percentile(wall, 95), "ms"),
        value_row("... p95, CPU", 1e-3 * _percentile(cpu, 95), "ms"),
        bench.set_goals.row("set_goals before it", "a goal never seen"),
    ]


def _share(found: np.ndarray) -> float:
    return 100.0 * float(np.mean(found)) if len(found) else float("nan")


def _percentile(values: np.ndarray | list, share: float) -> float:
    return float(np.percentile(values, share)) if len(values) else float("nan")
