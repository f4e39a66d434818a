"""A robot that waits gets out of the way of who comes, in time and in no other case."""

import numpy as np
import pytest
from small import draw_valid

import odm
from sim.execution import RETREATING, Executor
from sim.lookout import LASTS
from sim.threat import Threat, ThreatSettings

PERIOD = 0.01
TOUCH = 0.021  # [m] nearer than this to a sample it may touch the hand
WAITS = np.array([0.0, 0.8, 0.4])


class Scene:
    """A robot that waits since its goal is taken, and a ball that comes at it."""

    def __init__(self, small_map, looks=True):
        self.planner = odm.ReactivePlanner(small_map)
        self.planner.set_goals([WAITS])
        self.executor = Executor(small_map.robot, self.planner, WAITS.copy(), PERIOD)
        if not looks:
            self.executor._lookout = None
        self.gaps, self.states, self.speeds = [], [], []

    def frame(self, p, velocity, known=True):
        points = odm.sample_capsules(np.array([[*p, *p, 0.05]]), 0.03)
        commit = self.executor.commit()
        answer = self.planner.step(points, q=commit.q)
        speeds = np.tile(np.array(velocity, float), (len(points), 1))
        threat = Threat(points, speeds if known else None, 0.0, ThreatSettings())
        self.executor.heed(answer, commit, threat)
        point = self.executor.set_point
        self.gaps.append(self.planner.separation(point.q))
        self.speeds.append(np.abs(point.dq).max())
        self.states.append(self.executor.state)
        self.executor.advance()

    def comes(self, speed=0.5, start=0.8, seconds=1.8, side=(1.0, 0.0, 0.0)):
        """Let the ball come at where the robot's hand was, and through it."""
        tool = tool_of(self.planner, WAITS)
        side = np.array(side)
        for k in range(round(seconds / PERIOD)):
            p = tool + side * (start - speed * k * PERIOD)
            self.frame(p, -speed * side)
        return self


def tool_of(planner, q):
    from roadmap.kinematics import sphere_centers

    return sphere_centers(planner.robot, q)[planner.robot.moving][-1]


def test_it_retreats_before_a_hand_that_comes_touches_it(small_map):
    scene = Scene(small_map).comes()
    assert RETREATING in scene.states
    assert min(scene.gaps) > TOUCH
    first = scene.states.index(RETREATING)
    assert scene.gaps[first] > scene.planner.keep  # in time, not an escape


def test_one_that_does_not_look_is_touched(small_map):
    scene = Scene(small_map, looks=False).comes()
    assert min(scene.gaps) < 0.0


@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (0.8, 0.0, 0.0)])
def test_who_rests_or_goes_makes_it_stay(small_map, velocity):
    scene = Scene(small_map)
    tool = tool_of(scene.planner, WAITS)
    for _ in range(60):
        scene.frame(tool + [0.3, 0.0, 0.0], velocity)
    assert RETREATING not in scene.states and max(scene.speeds) == 0.0


def test_nobody_near_and_nothing_known_make_it_stay(small_map):
    scene = Scene(small_map)
    tool = tool_of(scene.planner, WAITS)
    for _ in range(30):
        scene.frame(tool + [1.1, 0.0, 0.0], (-0.5, 0.0, 0.0))
        scene.frame(tool + [0.3, 0.0, 0.0], (-0.5, 0.0, 0.0), known=False)
    assert RETREATING not in scene.states


def test_a_trembling_hand_does_not_make_it_leave(small_map):
    scene = Scene(small_map)
    tool = tool_of(scene.planner, WAITS)
    for k in range(200):
        phase = 2 * np.pi * 5.0 * k * PERIOD
        x = 0.3 + 0.02 * np.sin(phase)
        v = 0.02 * 2 * np.pi * 5.0 * np.cos(phase)
        scene.frame(tool + [x, 0.0, 0.0], (v, 0.0, 0.0))
    assert RETREATING not in scene.states
    assert 0.5 / 5.0 <= LASTS + 1e-9


@pytest.mark.parametrize("seed", range(8))
def test_the_way_out_ends_farther_from_where_they_will_be(small_map, seed):
    rng = np.random.default_rng(seed)
    planner = odm.ReactivePlanner(small_map)
    q = draw_valid(planner, rng)
    planner.set_goals([q])
    side = rng.normal(size=3)
    side /= np.linalg.norm(side)
    tool = tool_of(planner, q)
    found = 0
    for near in (0.25, 0.35, 0.45):
        p = tool + near * side
        now = odm.sample_capsules(np.array([[*p, *p, 0.05]]), 0.03)
        threat = Threat(now, np.tile(-side, (len(now), 1)), 0.0, ThreatSettings())
        coming = threat.path(0.4)
        planner.step(now, q=q)
        if planner.separation(q) < planner.keep:
            continue
        way = planner.way_out(q, coming)
        if way is None:
            continue
        found += 1
        assert np.array_equal(way[0], q)
        assert gap_to(planner, way[1], coming) > gap_to(planner, q, coming) + 0.05
        assert planner.is_free(way[0], way[1])
    assert found or seed in ()


def gap_to(planner, q, points):
    from roadmap.kinematics import sphere_centers

    robot = planner.robot
    centers = sphere_centers(robot, q)[robot.moving]
    off = np.linalg.norm(points[:, None] - centers, axis=2)
    return (off - robot.spheres[robot.moving, 3]).min()


def test_where_velocities_lead_is_where_the_points_will_be():
    points = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    velocity = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
    ahead = Threat(points, velocity, 0.1, ThreatSettings()).path(0.3, 4)
    assert ahead.shape == (8, 3)
    for k, t in enumerate((0.1, 0.2, 0.3, 0.4)):
        assert np.allclose(ahead[2 * k : 2 * k + 2], points + t * velocity)
    assert Threat(points, None, 0.0, ThreatSettings()).path(0.3) is None
