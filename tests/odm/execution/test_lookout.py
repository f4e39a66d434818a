"""A robot that waits gets out of the way of who comes, in time and in no other case."""

import numpy as np
import pytest
from small import draw_valid

import odm
from odm.exact.distances import ExactRobot
from odm.execution.executor import RETREATING, Executor
from odm.execution.settings import ExecutionSettings
from odm.execution.threat import (
    CloudThreat,
    Threat,
    ThreatSettings,
    Watcher,
    rods_of,
)
from roadmap.errors import BadInput
from roadmap.kinematics.forward import sphere_centers
from roadmap.transforms import pose_of

PERIOD = 0.01
TOUCH = 0.0  # [m] nearer than this it may touch the hand
WAITS = np.array([0.0, 0.8, 0.4])


class Scene:
    """A robot that waits since its goal is taken, and a ball that comes at it."""

    def __init__(self, small_map, looks=True, scale=1.0):
        self.planner = odm.ReactivePlanner(small_map)
        self.planner.set_goals([WAITS])
        settings = ExecutionSettings(yields=looks, yield_scale=scale)
        robot = small_map.robot
        self.executor = Executor(robot, self.planner, WAITS.copy(), PERIOD, settings)
        self.watcher = Watcher()
        self.gaps, self.states, self.speeds = [], [], []

    def frame(self, p, known=True, also=None):
        """Play a frame beside the ball, and beside what no threat tells of."""
        capsule = np.array([[*p, *p, 0.05]])
        commit = self.executor.commit()
        obstacles = odm.Obstacles(capsules=capsule, **(also or {}))
        answer = self.planner.step(obstacles, q=commit.q)
        threat = self.watcher.look(capsule, PERIOD * len(self.gaps))
        if not known:
            lost = np.array([np.inf])
            threat = Threat(capsule, threat.velocity, lost, 0.0, ThreatSettings())
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
        """Return the frames in which the cover touches the ball."""
        return np.flatnonzero(np.array(self.gaps) < 0.0)


def tool_of(planner, q):
    return sphere_centers(planner.robot, q)[planner.robot.moving][-1]


def test_it_retreats_before_a_hand_that_comes_touches_it(small_map):
    scene = Scene(small_map).comes()
    assert RETREATING in scene.states
    assert min(scene.gaps) > TOUCH
    first = scene.states.index(RETREATING)
    assert scene.gaps[first] > scene.planner.keep  # in time, not an escape


def test_what_is_put_in_the_way_of_an_evasion_ends_it(small_map):
    scene = Scene(small_map, scale=0.3)
    planner, executor, ball = scene.planner, scene.executor, odm.Sphere(0.02)
    tool, exact, gaps = tool_of(planner, WAITS), ExactRobot(small_map.robot), []
    for k in range(400):
        scene.frame(tool + np.array([0.8 - 0.3 * k * PERIOD, 0.0, 0.0]))
        q = executor.set_point.q
        if scene.states[-1] == RETREATING and not len(planner.scene):
            there = pose_of(tool_of(planner, executor.motion.q_end), np.zeros(3))
            standing = ball.moved(there)
            planner.scene.add("ball", ball, there)
        if len(planner.scene):
            gaps.append(exact.distance(q, [standing]).distance)
    assert gaps[0] > 0.1 and min(gaps) > small_map.safety.m


@pytest.mark.parametrize("kind", ["boxes", "spheres", "points"])
def test_what_the_frame_shows_in_the_way_of_an_evasion_ends_it(small_map, kind):
    scene, standing, also, gaps = Scene(small_map), None, {}, []
    executor, exact = scene.executor, ExactRobot(small_map.robot)
    tool = tool_of(scene.planner, WAITS)
    for k in range(266):
        scene.frame(tool + np.array([0.8 - 0.3 * k * PERIOD, 0.0, 0.0]), also=also)
        if scene.states[-1] == RETREATING and standing is None:
            there = pose_of(tool_of(scene.planner, executor.motion.q_end), np.zeros(3))
            standing = odm.Box(np.full(3, 0.04), there)
            if kind == "spheres":
                standing = odm.Sphere(0.02, there)
            also = {
                "boxes": {"boxes": [[*there[:3].ravel(), 0.04, 0.04, 0.04]]},
                "spheres": {"spheres": [[*there[:3, 3], 0.02]]},
                "points": {"points": odm.surface_of(standing, 0.02).points},
            }[kind]
            also = {name: np.array(rows) for name, rows in also.items()}
        if standing is not None:
            gaps.append(exact.distance(executor.set_point.q, [standing]).distance)
    assert gaps[0] > 0.1 and min(gaps) > 0.0045  # `yield_gap`, less the tracking


def test_what_else_is_in_the_frame_is_what_no_capsule_that_is_known_holds(small_map):
    planner = odm.ReactivePlanner(small_map)
    q, end = WAITS, WAITS + [0.6, 0.0, 0.0]
    way, here, free = np.stack([q, end]), tool_of(planner, q), np.zeros((0, 7))
    there, T = tool_of(planner, end), pose_of([0.3, -0.2, 0.5], [0.4, 0.0, 2.0])
    planner.set_base(T)
    at, away = (T[:3, :3] @ p + T[:3, 3] for p in (there, 2.0 * there - here))
    ball = np.array([[*at, *away, 0.03]])  # in its way
    within = np.append(ball[0, :6], 0.04)[None]
    half = np.array([[*at, *at, 0.03]])  # holds one end of it
    points = odm.sample_capsules(ball, 0.02)
    far = np.ones((2, 3)) * [[-3.0], [3.0]]
    around = np.c_[far, far, [0.01, 0.01]]  # on either side, and not there
    for seen in (odm.Obstacles(capsules=ball), odm.Obstacles(points=points)):
        planner.step(seen, q=q)
        assert not planner.clear_of_others(way, 0.0, free)
        assert not planner.clear_of_others(way, 0.0, half)
        assert not planner.clear_of_others(way, 0.0, half * np.nan)
        assert not planner.clear_of_others(way, 0.0, around)
        assert planner.clear_of_others(way, 0.0, within)
        assert planner.clear_of_others(np.stack([q, 2 * q - end]), 0.0, free)
    planner.step(odm.Obstacles(capsules=ball, spheres=[[*at, 0.02]]), q=q)
    assert not planner.clear_of_others(way, 0.0, half[:0])
    assert planner.clear_of_others(way, 0.0, within)
    box = [*pose_of(at)[:3].ravel(), 0.04, 0.04, 0.04]
    planner.step(odm.Obstacles(capsules=ball, boxes=[box]), q=q)
    assert not planner.clear_of_others(way, 0.0, within)  # no capsule
    assert planner.step(odm.Obstacles(capsules=ball * np.nan), q=q).reason
    assert not planner.clear_of_others(way, 0.0, within)  # it could not be used
    with pytest.raises(BadInput, match="capsules that are known"):
        planner.clear_of_others(way, 0.0, at)


def test_who_is_told_of_is_known_where_they_were_seen_and_are_by_now():
    rods, rates = np.array([[0.5, 0, 0.5, 0.5, 0, 0.8, 0.05]]), np.zeros((1, 2, 3))
    rates[..., 0] = 1.0
    seen = Threat(rods, rates, np.zeros(1), 0.1, ThreatSettings())
    known = rods_of(seen)
    assert np.array_equal(known[0], rods[0]) and known[1, 0] == pytest.approx(0.6)
    assert known[1, 6] >= 0.05
    lost = Threat(rods, rates, np.zeros(1), None, ThreatSettings())
    assert np.array_equal(rods_of(lost), rods)
    assert not len(rods_of(None))
    assert not len(rods_of(CloudThreat(rods[:, :3], 0.0, ThreatSettings())))


def test_one_that_does_not_look_is_touched(small_map):
    assert len(Scene(small_map, looks=False).comes().touched())


def test_one_that_yields_uses_the_speed_it_is_given_and_no_more(small_map):
    fastest = {}
    for scale in (0.2, 1.0):
        scene = Scene(small_map, scale=scale).comes((0.0, 1.0, 0.0), speed=0.9)
        assert RETREATING in scene.states
        fastest[scale] = max(scene.speeds)
        assert fastest[scale] <= scale * small_map.robot.max_velocity.max() + 1e-9
    assert fastest[1.0] > 1.2 * fastest[0.2]


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
        coming = [(t, p - t * side) for t in (0.1, 0.2, 0.3, 0.4)]
        shapes = [(t, odm.Obstacles(spheres=np.array([[*c, 0.05]]))) for t, c in coming]
        planner.step(odm.Obstacles(spheres=np.array([[*p, 0.05]])), q=q)
        way = planner.evasion(q, shapes, 0.5)
        if way is None:
            continue
        found += 1
        assert np.array_equal(way[0], q)
        if planner.separation(q) > planner.keep:
            assert planner.is_free(way[0], way[1])
        stays = min(gap_to(planner, q, p) for _, p in coming)
        needed = np.abs(way[1] - q) / (0.5 * small_map.robot.max_velocity)
        goes = []
        for t, p in coming:
            share = min(1.0, (t - 0.06) / needed.max())
            goes.append(gap_to(planner, q + share * (way[1] - way[0]), p))
        assert min(goes) > stays + 0.029
    assert found > 3


@pytest.mark.parametrize("speed_scale", [0.0, 1.5])
def test_a_way_out_at_no_such_speed_is_refused(small_map, speed_scale):
    planner = odm.ReactivePlanner(small_map)
    with pytest.raises(odm.planner.planner.BadInput, match="no share"):
        planner.evasion(WAITS, [], speed_scale)


def gap_to(planner, q, p):
    robot = planner.robot
    centers = sphere_centers(robot, q)[robot.moving]
    off = np.linalg.norm(centers - p, axis=1) - robot.spheres[robot.moving, 3]
    return off.min() - 0.05


def test_points_that_come_are_evaded_as_the_shapes_they_stand_for(small_map):
    planner = odm.ReactivePlanner(small_map)
    p = tool_of(planner, WAITS) + [0.0, 0.3, 0.0]
    planner.step(odm.Obstacles(spheres=np.array([[*p, 0.05]])), q=WAITS)
    ball = odm.sample_capsules(np.array([[*p, *p, 0.05]]), 0.003)
    ways = []
    for kind in ("points", "shapes"):
        coming = []
        for t in (0.1, 0.2, 0.3, 0.4):
            off = np.array([0.0, t, 0.0])
            shape = odm.Obstacles(spheres=np.array([[*(p - off), 0.05]]))
            coming.append((t, ball - off if kind == "points" else shape))
        ways.append(planner.evasion(WAITS, coming, 0.5))
    assert ways[0] is not None and np.array_equal(*ways)
    nowhere = odm.Obstacles(spheres=1)
    assert planner.evasion(WAITS, [(0.1, nowhere)], 0.5) is None


def test_where_velocities_lead_is_where_the_parts_will_be():
    capsules = np.array([[1.0, 0, 0, 1.0, 0, 0.2, 0.05], [0, 1.0, 0, 0, 1.2, 0, 0.04]])
    velocity = np.zeros((2, 2, 3))
    velocity[0, :, 2], velocity[1, 1, 0] = 1.0, -1.0
    sure = np.zeros(2)
    threat = Threat(capsules, velocity, sure, 0.1, ThreatSettings())
    ahead = threat.likely(0.0, 0.1, 0.2, 0.3).capsules
    assert ahead.shape == (8, 7)
    for k, t in enumerate((0.1, 0.2, 0.3, 0.4)):
        moved = capsules + np.c_[t * velocity.reshape(-1, 6), np.zeros(2)]
        assert np.allclose(ahead[2 * k : 2 * k + 2], moved)
    nobody = Threat(capsules, velocity, sure + np.inf, 0.0, ThreatSettings())
    assert nobody.likely(0.3) is None


def speeds_when_pushed(small_map, speed, after, lost):
    """Return its speeds from a push on, `after` frames into an evasion.

    With `lost` the twelfth frame of the evasion is not answered in time.
    """
    scene, frames = Scene(small_map), 0
    tool, executor = tool_of(scene.planner, WAITS), scene.executor
    for k in range(250):
        frames += executor.state == RETREATING or frames > 0
        if frames >= after:
            executor.locate(executor.set_point.q + [0.05, -0.05, 0.0])
        if lost and frames == 12:
            frames += 1
            executor.advance()
            scene.gaps.append(scene.gaps[-1])
        else:
            scene.frame(tool + [0.8 - speed * k * PERIOD, 0.0, 0.0])
    return np.array(scene.speeds[-(frames - after + 1) :])


@pytest.mark.parametrize("speed", [0.3, 0.9])
@pytest.mark.parametrize("after", [15, 18])
def test_pushed_after_a_lost_frame_it_stops_as_soon_as_else(small_map, speed, after):
    stands = []
    for lost in (False, True):
        speeds = speeds_when_pushed(small_map, speed, after, lost)
        assert speeds[0] > 0.2  # it was on its way
        stands.append(int(np.argmax(speeds < 1e-3)))
    assert 0 < stands[1] <= stands[0] + 2


def test_an_evasion_that_goes_on_after_a_lost_frame_is_one(small_map):
    scene = Scene(small_map)
    tool = tool_of(scene.planner, WAITS)
    k = 0
    while scene.executor.state != RETREATING:
        scene.frame(tool + [0.8 - 0.3 * k * PERIOD, 0.0, 0.0])
        k += 1
    scene.executor.advance()  # no frame
    assert scene.executor.state == "braked"
    scene.frame(tool + [0.8 - 0.3 * (k + 1) * PERIOD, 0.0, 0.0])
    assert scene.executor.state == RETREATING
    assert scene.executor.reason == "somebody comes"
