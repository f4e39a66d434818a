"""What is taken was tested, from where the robot is: of stops, ways out and retreats.

The planner here says of every motion what a test wants, so that one rule is left alone.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from odm.execution.executor import BRAKED, MOVING, RETREATING, STANDING, Executor
from odm.execution.lookout import SeparationWatch
from odm.execution.robot_threat import intent_of
from odm.execution.settings import ExecutionSettings
from odm.execution.shell_test import ShellTest
from odm.execution.stop_test import BrakingTest
from odm.execution.threat import Threat, ThreatSettings
from odm.execution.tracking import TrackingMonitor
from odm.obstacles.obstacles import Obstacles
from roadmap.motion.blending import joint_motion_bounds
from roadmap.motion.motion import time_path

START, END = np.array([-1.2, 0.6, 0.0]), np.array([1.2, 0.6, 0.0])
ASIDE = np.array([1.2, -0.3, 0.4])
OUT = np.array([START, END])
PERIOD = 0.01
FAR = np.array([[0.0, 0.0, 3.0, 0.0, 0.0, 3.2, 0.05]])
PERSON = Threat(FAR, np.zeros((1, 2, 3)), np.zeros(1), 0.0, ThreatSettings())


class Scene:
    """An executor, and a planner to which everything is free, or nothing."""

    def __init__(self, cell_map, stands_still=True, settings=None):
        robot = cell_map.robot
        self.free, self.gap_at = True, lambda q: 1.0
        self.planner = SimpleNamespace(
            cell_map=cell_map,
            blocked_leg=lambda *_: None if self.free else 0,
            separation=lambda q: self.gap_at(q),
        )
        if stands_still:
            free = lambda q, dq: np.ones(len(q), bool)  # noqa: E731
            self.planner.static = SimpleNamespace(robot=robot, motions_free=free)
        self.executor = Executor(robot, self.planner, START, PERIOD, settings)
        self.executor._shells = SimpleNamespace(passes=lambda *_: self.free)
        self.back = OUT  # the retreat that every answer has
        self.ways = []  # out, which the lookout has yet to find
        self.executor._lookout = SimpleNamespace(
            evasion=lambda *_: self.ways.pop() if self.ways else None,
            look_at_once=lambda: None,
            is_due=False,
        )
        self.points = [self.executor.set_point]

    def frames(self, n, status="following", threat=PERSON, end=END, push=None):
        executor = self.executor
        for _ in range(n):
            if push is not None:
                executor.locate(executor.set_point.q + push)
            commit = executor.commit()
            path = np.array([commit.q, end])
            if status == "holding":
                path = path[:0]
            answer = SimpleNamespace(status=status, path=path, retreat=self.back)
            answer.reason = ""
            executor.update(answer, commit, threat)
            self.pass_by()

    def pass_by(self, n=1):
        """Let periods pass, whether or not a frame was answered."""
        for _ in range(n):
            self.executor.advance()
            self.points.append(self.executor.set_point)

    def retreat(self, n=20, threat=PERSON):
        self.frames(n, "holding", threat)
        assert self.executor.state == RETREATING and self.speed > 0.1
        return self

    def evade(self, n=20):
        """Get out of the way of who comes for some frames."""
        self.ways = [OUT]
        self.frames(n, "holding")
        assert self.executor.state == RETREATING and self.speed > 0.1
        return self

    @property
    def speed(self):
        return np.abs(self.executor.set_point.dq).max()

    def check_no_jump(self):
        q, dq = (np.array([p[k] for p in self.points]) for k in (0, 1))
        expected = 0.5 * (dq[1:] + dq[:-1]) * PERIOD
        assert np.abs(np.diff(q, axis=0) - expected).max() < 1e-3


@pytest.fixture
def scene(small_map):
    return Scene(small_map)


class Grows:
    """Somebody told by the times asked about, who needs so many metres more."""

    def between(self, begin, end):
        return (begin, end), end


@pytest.mark.parametrize("late", [0.0, 0.07])
def test_the_whole_way_to_a_stop_is_tested_at_the_times_of_each_place(small_map, late):
    motion = time_path(small_map.robot, OUT, blend=0, speed_scale=0.5)
    t = 0.3 * motion.duration
    begin = t + 0.1
    stop, asked = motion.stop(begin), []

    def blocked_leg(path, extra, times):
        asked.append((path[0, 0], path[-1, 0], *times, extra))
        return 0 if len(asked) == 1 else None

    test = BrakingTest(SimpleNamespace(blocked_leg=blocked_leg), latency_s=late)
    assert test.passes(motion, t, begin, stop, Grows(), closer=0.003, off=0.001)
    lasts = begin - t + stop.duration + late
    whole = motion.at(t).q[0], stop.q_end[0], 0.0, lasts, lasts - 0.002
    assert asked[0] == pytest.approx(whole)
    assert all(extra == pytest.approx(end - 0.002) for *_, end, extra in asked[1:])
    check_all_tested(motion, t, begin, stop, [row[:4] for row in asked[1:]], late)


def check_all_tested(motion, t, begin, stop, asked, late):
    """Check that pieces (q from, q to, time from, time to) hold the way to a stop."""
    asked, lasts = np.array(asked), begin - t + stop.duration
    for now in np.linspace(0.0, lasts, 100):
        on = motion.at(t + now) if t + now < begin else stop.at(t + now - begin)
        there = (asked[:, 0] <= on.q[0] + 1e-9) & (asked[:, 1] >= on.q[0] - 1e-9)
        until = asked[:, 3] >= now + late - 1e-9
        assert (there & (asked[:, 2] <= now + 1e-9) & until).any()


class OneShell:
    """Remembers what is swept, and at which times somebody was where they are shown."""

    def __init__(self, robot):
        self.robot, self.asked, self.times = robot, [], None
        self.show, self.apart = lambda hulls: None, lambda least: True

    complete = True  # every link has one

    def between(self, begin, end):
        self.times = begin, end
        return Obstacles(capsules=FAR), 0.0

    def sweep(self, q0, q1):
        self.asked.append((q0[0], q1[0], *self.times))
        return True


@pytest.mark.parametrize("late", [0.0, 0.07])
def test_by_the_shells_it_is_tested_at_the_same_times(small_map, late):
    robot = small_map.robot
    motion = time_path(robot, OUT, blend=0, speed_scale=0.5)
    t = 0.3 * motion.duration
    begin, there = t + 0.1, OneShell(robot)
    frame = SimpleNamespace(base_world=np.eye(4))
    there_is = SimpleNamespace(static=SimpleNamespace(robot=robot), frame=frame)
    test = ShellTest(there_is, late)
    test._shells = there
    assert test.passes(motion, t, begin, motion.stop(begin), there, 0.005)
    check_all_tested(motion, t, begin, motion.stop(begin), there.asked, late)


def test_late_frames_lead_on_without_a_jump(scene):
    for _ in range(2):
        scene.frames(40)
        assert scene.speed > 0.2
        scene.pass_by(4)
        assert scene.executor.state == BRAKED
    scene.check_no_jump()


def test_a_stop_from_before_nobody_was_about_is_not_taken(scene):
    scene.frames(20)
    scene.frames(20, threat=None)
    scene.pass_by(40)
    assert scene.speed == 0.0
    scene.check_no_jump()


def test_nor_is_one_from_before_nobody_was_about_while_it_retreats(scene):
    scene.retreat().retreat(20, threat=None)
    scene.pass_by(60)
    assert scene.speed == 0.0
    scene.check_no_jump()


def test_a_path_that_did_not_pass_is_neither_stopped_on_nor_taken_for_the_one_in_use(
    scene,
):
    scene.frames(40)
    held, scene.free = scene.executor.held, False
    scene.frames(1, end=ASIDE)
    assert scene.executor.motion is held
    scene.free = True
    scene.frames(400, end=ASIDE)
    assert scene.executor.set_point.q == pytest.approx(ASIDE, abs=1e-6)
    scene.check_no_jump()


def test_where_it_was_pushed_to_it_takes_no_stop_from_elsewhere(scene):
    executor, push = scene.executor, np.array([0.0, 0.05, 0.0])
    scene.frames(30)
    while not executor.at_rest:
        scene.frames(1, push=push)
    there = executor.set_point.q + push
    for _ in range(15):
        executor.locate(there)
        scene.frames(1, "holding")
    assert executor.set_point.q == pytest.approx(there)
    scene.free = False
    scene.frames(5)
    assert executor.set_point.q == pytest.approx(there, abs=1e-3)


def test_who_follows_late_is_nowhere_on_a_way_that_it_was_pushed_from(small_map):
    scene = Scene(small_map, settings=ExecutionSettings(latency_s=0.5))
    executor, there = scene.executor, START + np.array([0.0, 0.05, 0.0])
    scene.frames(20, end=START)
    for _ in range(15):
        executor.locate(there)
        scene.frames(1, "holding")
    assert executor.set_point.q == pytest.approx(there) and not executor.off
    executor.locate(START)
    assert executor.off


def test_all_tests_of_one_that_follows_late_are_told(small_map):
    late = ExecutionSettings(latency_s=0.07)
    executor = Executor(small_map.robot, Scene(small_map).planner, START, PERIOD, late)
    executor.part_from(SimpleNamespace())
    tests = executor._test, executor._shells, executor._held_out[1]
    assert [test.latency_s for test in tests] == [0.07] * 3


@pytest.mark.parametrize("late", [0.0, 0.015, 0.02, 0.5])
def test_where_it_may_be_is_as_late_as_was_told_and_no_later(small_map, late):
    robot, step = small_map.robot, np.array([0.1, -0.02, 0.0])
    monitor = TrackingMonitor(robot, 0.002, PERIOD, latency_s=late)
    for k in range(4):
        monitor.leave(START + k * step)
    for ago in (0.0, 0.004, 0.01, 0.013, 0.018, 0.03, 0.04, 0.06):  # [s]
        monitor.measure(START + 4 * step, START + (4 - ago / PERIOD) * step)
        beyond = ago - min(late, 0.04)
        far = ago / PERIOD * joint_motion_bounds(robot) @ np.abs(step)
        assert monitor.off == pytest.approx(far if beyond > 1e-9 else 0.0)
        assert ("ms ago" in monitor.note) == (beyond > 1e-9 and ago <= 0.04)


def test_pushes_of_joints_in_opposite_directions_do_not_make_up_for_each_other(scene):
    push = np.array([-0.05, 0.02, 0.0])
    scene.executor.locate(START + push)
    bounds = joint_motion_bounds(scene.executor.robot)
    assert scene.executor.off == pytest.approx(bounds @ np.abs(push))


def test_led_by_hand_it_is_not_held_still_whose_ever_array_tells_where_it_is(scene):
    q = START.copy()
    for _ in range(30):
        q[1] += 0.01
        scene.executor.locate(q)
        scene.frames(1, "holding", None)
    assert scene.executor.set_point.q == pytest.approx(START)


def test_an_intent_leads_without_a_gap_from_here_to_a_rest(scene):
    scene.frames(30)
    executor = scene.executor
    executor.update(
        SimpleNamespace(status="following", path=OUT), executor.commit(), PERSON
    )
    goes, stops = intent_of(executor)
    ends = [(s.motion.at(s.begin).q, s.motion.at(s.end).q) for s in (goes, stops)]
    assert ends[0][0] == pytest.approx(executor.set_point.q)
    assert ends[0][1] == pytest.approx(ends[1][0])
    assert not stops.motion.at(stops.end).dq.any()


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_pushed_beyond_a_limit_its_set_point_is_the_limit(scene, side):
    robot, q = scene.executor.robot, START.copy()
    q[1] = (robot.upper if side > 0.0 else robot.lower)[1] + 0.02 * side
    for _ in range(15):
        scene.executor.locate(q)
        scene.frames(1, "holding", None)
    assert scene.executor.set_point.q[1] == q[1] - 0.02 * side


def test_where_setting_off_passes_later_but_not_now_its_stop_is_the_one_from_here(
    scene,
):
    scene.frames(40)
    held, scene.free = scene.executor.held, False
    scene.frames(2)
    assert scene.executor.state == BRAKED and scene.executor.motion is held
    scene.executor._test.passes = lambda motion, t, *_: t > 0.0
    scene.frames(1)
    assert scene.executor.motion is scene.executor.held is held
    scene.check_no_jump()


def test_a_stop_that_begins_later_is_no_proof_for_the_one_that_is_held(scene):
    scene.frames(20)
    executor, held = scene.executor, scene.executor.held
    executor._test.passes = lambda motion, t, begin, *_: begin - t > 0.03
    assert not executor._stop_free(executor.motion, executor.t, PERSON, 0.05)
    assert executor.held is held


def test_the_place_of_the_next_path_is_of_this_moment(scene):
    scene.frames(30)
    executor = scene.executor
    executor.next_commit()
    scene.frames(3)
    s = executor.commit().s
    executor._next = None
    assert executor.commit().s == s


# --- retreats and ways out --------------------------------------------------------


def test_what_passes_by_the_shells_has_its_own_stop(scene):
    scene.frames(20)
    executor, scene.free = scene.executor, False
    executor._shells = SimpleNamespace(passes=lambda *_: True)
    assert executor._evasion_free(executor.motion, executor.t, PERSON)
    assert executor.held_t == -PERIOD
    begins = executor.motion.at(executor.t + PERIOD).q
    assert executor.held.at(0.0).q == pytest.approx(begins)


def test_a_way_out_that_is_free_no_more_is_left_by_its_tested_stop_at_once(scene):
    scene.evade()
    held, scene.free = scene.executor.held, False
    scene.frames(1, "holding")
    assert scene.executor.motion is held and scene.executor.state == STANDING
    scene.frames(40, "holding")
    assert scene.speed == 0.0
    scene.check_no_jump()


def test_no_way_out_is_taken_that_does_not_pass_or_begins_elsewhere(scene):
    executor = scene.executor
    executor._left = np.array([END, START]), (1.0,), None
    scene.frames(1, "holding")
    assert executor.state == STANDING and executor._left is None
    scene.free = False
    assert not executor._begin_evading(OUT, PERSON, (1.0,))


def test_a_way_out_reckons_with_who_lately_sped_up_hard(scene):
    ends = FAR[:, :6].reshape(1, 2, 3)
    past = tuple((0.01 * k, ends + 5.0 * (0.01 * k) ** 2) for k in range(3))
    hard = Threat(FAR, PERSON.velocity, PERSON.error, 0.0, ThreatSettings(), past=past)
    executor, told = scene.executor, []
    executor._test.passes = lambda m, t, b, s, threat, *_: told.append(threat) or True
    assert executor._begin_evading(OUT, hard, (1.0,))
    assert executor._evades_on(hard)
    assert len(told) > 1
    assert all(threat.most.min() > 20.0 for threat in told)


def test_who_is_left_behind_is_reckoned_with_as_hard_as_they_lately_sped_up(scene):
    ends = FAR[:, :6].reshape(1, 2, 3)
    past = tuple((0.01 * k, ends + 5.0 * (0.01 * k) ** 2) for k in range(3))
    hard = Threat(FAR, PERSON.velocity, PERSON.error, 0.0, ThreatSettings(), past=past)
    executor, told = scene.executor, []

    def passes(motion, t, begin, stop, threat, closer=0.0, off=0.0):
        told.append(threat)
        return closer > 0.0  # it is too near to somebody, and gets away from them

    executor._test.passes = passes
    executor._test.left_behind = lambda *_: np.ones(1, bool)
    assert executor._may_go(time_path(executor.robot, OUT), 0.0, hard)
    assert len(told) > 1 and told[-1].most.min() > 20.0


@pytest.mark.parametrize(
    ("off", "gap", "goes"), [(0.0, 0.03, True), (0.0, 0.01, False)]
    + [(0.03, 0.06, True), (0.03, 0.04, False)],
)  # fmt: skip
def test_it_retreats_no_farther_when_points_are_too_near_whoever_has_them(
    scene, off, gap, goes
):
    """Nobody is told of: only the separation tells, less by how far it is off."""
    scene.retreat(threat=None)
    scene.gap_at = lambda q: gap
    scene.executor._separation.last = gap
    push = np.array([off, 0.0, 0.0]) / joint_motion_bounds(scene.executor.robot)[0]
    scene.frames(1, "holding", None, push=push)
    assert (scene.executor.state == RETREATING) == goes
    assert scene.executor.off == pytest.approx(off)


def test_it_begins_no_retreat_where_points_are_too_near(scene):
    scene.gap_at = lambda q: 0.01
    scene.frames(20, "holding", None)
    assert scene.executor.state == STANDING and scene.speed == 0.0


def test_a_pushed_robot_retreats_no_farther_where_nobody_knows_what_stands_there(
    small_map,
):
    scene = Scene(small_map, stands_still=False).retreat()
    scene.frames(1, "holding", push=np.array([0.05, 0.0, 0.0]))
    assert scene.executor.state == BRAKED


def test_a_retreat_to_where_points_are_nearer_is_broken_off(scene):
    scene.retreat()
    scene.gap_at = lambda q: 0.5 if np.allclose(q, END) else 1.0
    scene.frames(1, "holding")
    assert scene.executor.state == STANDING
    scene.frames(40, "holding")
    scene.check_no_jump()


def test_a_retreat_that_begins_a_little_beside_it_is_not_taken(scene):
    scene.executor._separation.last = 1.0
    scene.executor._retreat(OUT + 1e-3, PERSON)
    assert scene.executor.motion.duration == 0.0
    scene.executor._retreat(OUT, PERSON)
    assert scene.executor.motion.duration > 0.0


def test_points_that_come_nearer_count_as_two_frames_nearer(scene):
    gaps = iter([0.1, 0.06, 0.06])
    watch = SeparationWatch(SimpleNamespace(separation=lambda q: next(gaps)))
    above = [watch.stays_above(0.022, START) for _ in range(3)]
    assert above == [False, False, True]  # in the first it is not known how fast


def test_no_retreat_is_begun_or_gone_on_with_that_does_not_pass(scene):
    scene.free = False
    scene.frames(12, "holding")
    assert not any(point.dq.any() for point in scene.points)
    for push in (None, np.array([0.05, 0.0, 0.0])):
        scene.executor = Executor(scene.executor.robot, scene.planner, START, PERIOD)
        scene.free = True
        held = scene.retreat().executor.held
        scene.free = False
        scene.frames(1, "holding", push=push)
        assert scene.executor.state in (STANDING, BRAKED)
        assert scene.executor.motion is held


def test_it_gets_no_nearer_than_it_says_while_it_gets_away(scene):
    """Within m by the cover, by 5 mm of the links where that does not pass."""
    executor, m, asked = scene.executor, scene.executor._clearance, []
    gap = executor.settings.yield_gap
    executor._test.passes = lambda m, t, b, s, threat, closer, *_: asked.append(closer)
    executor._shells = SimpleNamespace(passes=lambda *args: asked.append(args[-1]))
    assert not executor._evasion_free(executor.motion, 0.0, PERSON)
    assert not executor._retreat_free(executor.motion, 0.0, PERSON)
    executor._test.left_behind = lambda *_: np.ones(1, bool)
    assert not executor._may_go(executor.motion, 0.0, PERSON)
    assert asked == pytest.approx([m - gap, gap, m, 0.0, m - gap])


def test_a_higher_speed_is_taken_only_where_it_passes(scene):
    executor = scene.executor
    executor.limit_speed(0.4)
    scene.frames(30)
    slow = executor.motion.speed_scale
    assert slow < executor.settings.speed_scale
    executor.limit_speed(1.0)
    executor._test.passes = lambda motion, *_: motion.speed_scale <= slow
    for _ in range(10):
        scene.frames(1)
        assert executor.motion.speed_scale == slow
    executor._test.passes = lambda *_: True
    scene.frames(10)
    assert executor.motion.speed_scale > slow


def test_it_goes_on_getting_away_faster_only_where_that_passes(scene):
    executor = scene.executor
    executor._test.passes = lambda motion, *_: motion.speed_scale <= 0.2
    scene.free, scene.back = False, None  # nor by the shells
    scene.evade()
    assert executor.motion.speed_scale == pytest.approx(0.15)
    executor._test.passes = lambda *_: True
    scene.frames(3, "holding")
    assert executor.motion.speed_scale > 0.2
    scene.check_no_jump()


def test_a_limit_of_the_speed_is_kept_by_what_passes(scene):
    executor = scene.executor
    scene.frames(30)
    full = executor.motion.speed_scale
    executor._test.passes = lambda motion, *_: motion.speed_scale >= full
    executor.limit_speed(0.4)
    for _ in range(5):
        scene.frames(1)
        assert executor.state == MOVING and executor.motion.speed_scale == full
