"""A robot that waits gets out of the way of who comes, in time and in no other case."""

import numpy as np
import pytest
from small import draw_valid

import odm
from odm.execution.executor import RETREATING, Executor
from odm.execution.threat import Threat, ThreatSettings, Watcher
from roadmap.kinematics.forward import sphere_centers

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
        self.watcher = Watcher()
        self.gaps, self.states, self.speeds = [], [], []

    def frame(self, p, known=True):
        capsule = np.array([[*p, *p, 0.05]])
        points = odm.sample_capsules(capsule, 0.03)
        commit = self.executor.commit()
        answer = self.planner.step(points, q=commit.q)
        now = PERIOD * len(self.gaps)
        threat = self.watcher.look(capsule, points, np.zeros((1, 3)), now)
        if not known:
            threat = Threat(points, None, 0.0, ThreatSettings())
        self.executor.update(answer, commit, threat)
        point = self.executor.set_point
        self.gaps.append(self.planner.separation(point.q))
        self.speeds.append(np.abs(point.dq).max())
        self.states.append(self.executor.state)
        self.executor.advance()

    def comes(self, side=(1.0, 0.0, 0.0), speed=0.3, start=0.8):
        """Let the ball come from one side to where the robot's hand was."""
        tool, side = tool_of(self.planner, WAITS), np.array(side)
        for k in range(round(start / speed / PERIOD)):
            self.frame(tool + side * (start - speed * k * PERIOD))
        return self

    def touched(self):
        """Return the frames in which the cover holds a sample."""
        return np.flatnonzero(np.array(self.gaps) < 0.0)


def tool_of(planner, q):
    return sphere_centers(planner.robot, q)[planner.robot.moving][-1]


def test_it_retreats_before_a_hand_that_comes_touches_it(small_map):
    scene = Scene(small_map).comes()
    assert RETREATING in scene.states
    assert min(scene.gaps) > TOUCH
    first = scene.states.index(RETREATING)
    assert scene.gaps[first] > scene.planner.keep  # in time, not an escape


def test_one_that_does_not_look_is_touched(small_map):
    assert len(Scene(small_map, looks=False).comes().touched())


@pytest.mark.parametrize("speed", [0.3, 0.5])
@pytest.mark.parametrize("side", [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)])
def test_it_is_touched_less_and_never_while_it_moves(small_map, side, speed):
    looks = Scene(small_map).comes(side, speed)
    stays = Scene(small_map, looks=False).comes(side, speed)
    assert len(looks.touched()) < len(stays.touched())
    assert (np.array(looks.speeds)[looks.touched()] <= 0.01).all()


@pytest.mark.parametrize("speed", [0.0, 0.8])
def test_who_rests_or_goes_makes_it_stay(small_map, speed):
    scene = Scene(small_map)
    tool = tool_of(scene.planner, WAITS)
    for k in range(60):
        scene.frame(tool + [0.25 + speed * k * PERIOD, 0.0, 0.0])
    assert RETREATING not in scene.states and max(scene.speeds) == 0.0


def test_who_is_far_or_whose_speed_is_not_known_makes_it_stay(small_map):
    for start, known in ((1.1, True), (0.4, False)):
        scene = Scene(small_map)
        tool = tool_of(scene.planner, WAITS)
        for k in range(30):
            scene.frame(tool + [start - 0.5 * k * PERIOD, 0.0, 0.0], known)
        assert RETREATING not in scene.states


def test_a_trembling_hand_does_not_make_it_leave(small_map):
    scene = Scene(small_map)
    tool = tool_of(scene.planner, WAITS)
    for k in range(200):
        x = 0.25 + 0.02 * np.cos(2 * np.pi * 5.0 * k * PERIOD)
        scene.frame(tool + [x, 0.0, 0.0])
    assert RETREATING not in scene.states


def test_the_way_out_keeps_more_distance_than_staying(small_map):
    planner = odm.ReactivePlanner(small_map)
    found = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        q = draw_valid(planner, rng)
        planner.set_goals([q])
        side = rng.normal(size=3)
        side /= np.linalg.norm(side)
        p = tool_of(planner, q) + 0.35 * side
        now = odm.sample_capsules(np.array([[*p, *p, 0.05]]), 0.03)
        coming = [(t, now - t * side) for t in (0.1, 0.2, 0.3, 0.4)]
        planner.step(now, q=q)
        way = planner.evasion(q, coming, 0.5)
        if way is None:
            continue
        found += 1
        assert np.array_equal(way[0], q)
        if planner.separation(q) > planner.keep:
            assert planner.is_free(way[0], way[1])
        stays = min(gap_to(planner, q, points) for _, points in coming)
        needed = np.abs(way[1] - q) / (0.5 * small_map.robot.max_velocity)
        goes = []
        for t, points in coming:
            share = min(1.0, (t - 0.06) / needed.max())
            goes.append(gap_to(planner, q + share * (way[1] - way[0]), points))
        assert min(goes) > stays + 0.029
    assert found > 3


@pytest.mark.parametrize("speed_scale", [0.0, 1.5])
def test_a_way_out_at_no_such_speed_is_refused(small_map, speed_scale):
    planner = odm.ReactivePlanner(small_map)
    with pytest.raises(odm.planner.planner.BadInput, match="share in"):
        planner.evasion(WAITS, [], speed_scale)


def gap_to(planner, q, points):
    robot = planner.robot
    centers = sphere_centers(robot, q)[robot.moving]
    off = np.linalg.norm(points[:, None] - centers, axis=2)
    return (off - robot.spheres[robot.moving, 3]).min()


def test_where_velocities_lead_is_where_the_points_will_be():
    points = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    velocity = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
    ahead = Threat(points, velocity, 0.1, ThreatSettings()).likely(0.0, 0.1, 0.2, 0.3)
    assert ahead.shape == (8, 3)
    for k, t in enumerate((0.1, 0.2, 0.3, 0.4)):
        assert np.allclose(ahead[2 * k : 2 * k + 2], points + t * velocity)
    assert Threat(points, None, 0.0, ThreatSettings()).likely(0.3) is None
