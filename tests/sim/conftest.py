"""A small robot, and planners that stand in for the real one."""

import sys
from dataclasses import dataclass, field

import numpy as np
import pytest
from built_once import built_once

import handover
from handover.targets.node_index import NodeIndex
from odm import load_map, sample_capsules
from roadmap import load_robot
from roadmap.kinematics.forward import sphere_centers
from sim.cli import main as cli
from sim.loop.warmup import exercise
from sim.people.arm import HumanArm
from sim.people.arm_path import Person
from sim.people.human_motion import make_motion

URDF = """<robot name="crane">
<link name="base"><collision><geometry><cylinder radius="0.08" length="0.1"/></geometry>
</collision></link>
<link name="boom"><collision><origin xyz="0.2 0 0"/><geometry>
<box size="0.4 0.08 0.08"/></geometry></collision></link>
<link name="jib"><collision><origin xyz="0.2 0 0"/><geometry>
<box size="0.4 0.06 0.06"/></geometry></collision></link>
<joint name="slew" type="revolute"><parent link="base"/><child link="boom"/>
<origin xyz="0 0 0.4"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="1.0" effort="1"/></joint>
<joint name="luff" type="revolute"><parent link="boom"/><child link="jib"/>
<origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" velocity="2.0" effort="1"/></joint>
</robot>
"""


@dataclass
class Answer:
    """The part of the planner's answer that the loop reads."""

    status: str
    path: np.ndarray
    reason: str = ""
    latency_s: dict = field(default_factory=lambda: {"total": 1e-5})
    retreat: np.ndarray | None = None


class Straight:
    """Drives straight to the goal, whatever stands there."""

    def set_goals(self, goals, costs=None):
        self.goal = np.asarray(goals[0])

    def separation(self, q):
        return self.gap

    def step(self, points, q, dq=None, stamp=None, now=None, **told):
        return Answer("following", np.array([q, self.goal]))


class Careful(Straight):
    """Drives straight, but holds while a capsule's sample is nearer than 15 cm."""

    def __init__(self, robot, retreat=None):
        self.robot, self.retreat, self.held = robot, retreat, False
        self.gap = np.inf

    def step(self, obstacles, q, dq=None, stamp=None, now=None, **told):
        points = sample_capsules(obstacles.capsules, 0.03)
        centers = sphere_centers(self.robot, q)[self.robot.moving]
        radii = self.robot.spheres[self.robot.moving, 3]
        gaps = np.linalg.norm(points[:, None] - centers, axis=2) - radii
        self.gap = gaps.min(initial=np.inf)
        before, self.held = self.held, self.gap < 0.15
        if self.held:
            reason = f"jib within {100 * self.gap:.1f} cm of the hand"
            nothing = np.zeros((0, self.robot.dof))
            return Answer("holding", nothing, reason, retreat=self.retreat)
        path = np.array([q, self.goal])
        return Answer("replanned" if before else "following", path)


class Statue:
    """A person who stands in the way and does not move."""

    name, max_speed = "statue", 0.0

    def capsules(self, t):
        return np.array([[0.6, -0.1, 0.45, 0.6, 0.1, 0.45, 0.05]])


class Once:
    """The exercise, for the first planner of this process: it loads all loops."""

    done = False

    def __call__(self, cell_map):
        if not self.done:
            exercise(cell_map)
        self.done = True


exercise_once = Once()


@pytest.fixture(scope="module", autouse=True)
def brief_rehearsals():
    """Rehearse for a moment: one process compiles once; commands do it in full."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sim.run.places.REHEARSAL_S", 0.2)
        for caller in ("run.places", "loop.replay", "story.play"):
            patch.setattr(f"sim.{caller}.exercise", exercise_once)
        yield


@pytest.fixture(scope="session")
def crane_urdf(tmp_path_factory):
    path = tmp_path_factory.mktemp("robot") / "crane.urdf"
    path.write_text(URDF)
    return path


@pytest.fixture(scope="session")
def crane(crane_urdf):
    return load_robot(crane_urdf, tip="jib")


@pytest.fixture(scope="session")
def places():
    return np.array([[0.9, 0.0], [-0.9, 0.3]])


@pytest.fixture
def straight():
    return Straight()


@pytest.fixture
def careful(crane):
    return Careful(crane)


@pytest.fixture
def statue():
    return Statue()


@pytest.fixture
def passing_by():
    """Return an arm that sweeps through the crane's work place."""
    return make_motion("sweep", 0, Person(HumanArm.sized(), (1.1, 0.0, 0.5)))


@pytest.fixture
def retreating(crane):
    """Return a planner that backs off to one side while it holds."""
    return Careful(crane, retreat=np.array([[0.9, 0.0], [2.0, 0.0]]))


@pytest.fixture(scope="session")
def meet_maps(tmp_path_factory):
    """Return the folders of a small map and a coarse reach map of the Kawasaki."""
    folder = built_once(tmp_path_factory, "meet", _build_meet_maps)
    return folder / "map", folder / "reach"


@pytest.fixture(scope="module")
def maps(meet_maps):
    """A cell map, its reach map, and where the tool is at each node."""
    cell_map = load_map(meet_maps[0])
    index = NodeIndex(cell_map.robot, cell_map.roadmap.nodes)
    return cell_map, handover.load_reach_map(meet_maps[1]), index


def _build_meet_maps(folder):
    from handover import ReachSettings, build_reach_map, chain_of
    from odm import Recipe, build_map
    from odm.cell_map.recipe import RobotRecipe
    from odm.close_test.safety import Safety
    from roadmap.graph.connecting import RoadmapSettings

    recipe = Recipe(
        "kawasaki",
        RobotRecipe(source="kawasaki_fs003n"),
        RoadmapSettings(nodes=250, neighbors=8, seed=3),
        Safety(h=0.06),
    )
    cell_map = build_map(recipe, threads=2)
    settings = ReachSettings(cell=0.1, rotations=72, samples=60_000, seed=3)
    reach = build_reach_map(chain_of(cell_map.robot), settings, threads=2)
    cell_map.save(folder / "map")
    reach.save(folder / "reach")


@pytest.fixture
def odm(capsys, monkeypatch):
    """Return a function that runs a command line: (exit code, stdout, stderr)."""

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["odm", *map(str, words)])
        code = 0
        try:
            cli.main()
        except SystemExit as stop:
            code = stop.code or 0
        shown = capsys.readouterr()
        return code, shown.out, shown.err

    return run
