"""A small robot, its recipe and things to draw at random: shared by many tests."""

from dataclasses import replace
from pathlib import Path

import numpy as np

import odm
from odm.cell_map.recipe import Recipe, RobotRecipe
from odm.close_test.safety import Safety
from roadmap.graph.connecting import RoadmapSettings

DATA = Path(__file__).parent / "data"
FLOOR = {"type": "plane", "name": "floor"}
# where the small arm goes from and to, and who stands in its way
HOME, AWAY = np.array([1.2, 0.6, 0.0]), np.array([-1.2, -0.6, 0.0])
NOBODY = np.zeros((0, 3))
POST = np.array([[0.0, 0.0, 0.9, 0.0, 0.0, 1.4, 0.05]])  # over the base


def small_recipe(**safety: float) -> Recipe:
    """Return the recipe of a quick map of the three-joint arm."""
    return Recipe(
        "arm3",
        RobotRecipe(source=str(DATA / "arm3.urdf"), tip="tool"),
        RoadmapSettings(nodes=150, neighbors=6, seed=3),
        replace(Safety(h=0.05), **safety),
        (FLOOR,),
    )


PLATES = """<robot name="plates"><link name="base"/>
<link name="arm"><collision><origin xyz="0.2 0 0"/>
<geometry><box size="0.4 0.1 0.02"/></geometry></collision></link>
<link name="plate"><collision><origin xyz="0.1 0 0"/>
<geometry><box size="0.2 0.3 0.02"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
<axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
<joint name="tilt" type="revolute"><parent link="arm"/><child link="plate"/>
<origin xyz="0.45 0 0"/><axis xyz="1 0 0"/>
<limit lower="-2" upper="2" velocity="1" effort="1"/></joint></robot>"""


def planner_of(
    folder: Path, urdf: str, tip: str, nodes: int = 150
) -> odm.ReactivePlanner:
    """Return a planner of the robot of a URDF's text, whose file is put in a folder."""
    path = folder / "robot.urdf"
    path.write_text(urdf)
    robot = RobotRecipe(source=str(path), tip=tip, cover_excess=0.05)
    recipe = Recipe("robot", robot, RoadmapSettings(nodes=nodes), Safety(h=0.08))
    return odm.ReactivePlanner(odm.build_map(recipe, threads=1))


def plates(folder: Path) -> odm.ReactivePlanner:
    """Return a planner of two plates within a coarse cover."""
    return planner_of(folder, PLATES, "plate")


def draw_valid(planner: odm.ReactivePlanner, rng: np.random.Generator) -> np.ndarray:
    """Draw a configuration that nothing standing still blocks."""
    robot = planner.robot
    while True:
        q = rng.uniform(robot.lower, robot.upper)
        if planner.static.motion_free(q, np.zeros_like(q)):
            return q


def draw_arm(rng: np.random.Generator) -> np.ndarray:
    """Draw two capsules (2, 7) somewhere around the small arm [m]."""
    shoulder = rng.uniform([-0.8, -0.4, 0.1], [0.8, 0.4, 1.0])
    elbow = shoulder + 0.3 * _direction(rng)
    hand = elbow + 0.35 * _direction(rng)
    return np.array([[*shoulder, *elbow, 0.05], [*elbow, *hand, 0.04]])


def on_its_way(cell_map: odm.CellMap, seed: int) -> tuple:
    """Return a planner with a path of two legs or more, the obstacles, the answer."""
    rng = np.random.default_rng(seed)
    for _ in range(200):
        planner = odm.ReactivePlanner(cell_map)
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        planner.set_goals([AWAY if rng.random() < 0.5 else draw_valid(planner, rng)])
        answer = planner.step(points, q=HOME)
        if len(answer.path) > 3:
            return planner, points, answer
    raise AssertionError("every path was straight")


def ball_at(p: np.ndarray, radius: float = 0.03) -> np.ndarray:
    """Return (n, 3) samples of a ball at p [m]."""
    return odm.sample_capsules(np.array([[*p, *p, radius]]), 0.03)


def wrapped(cell_map: odm.CellMap, q: np.ndarray) -> np.ndarray:
    """Return q with its continuous joints turned back into one turn."""
    turns = np.round(q / (2 * np.pi))
    return np.where(cell_map.robot.continuous, q - 2 * np.pi * turns, q)


def _direction(rng: np.random.Generator) -> np.ndarray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)
