"""A pushed robot: seeded and bounded pushes, an executor that stops and goes on."""

import math
import re

import numpy as np
import pytest
from forms import some

import odm
from odm.execution.executor import BRAKED, RETREATING, STANDING, Executor
from odm.execution.kinematic import KinematicMover
from odm.execution.settings import ExecutionSettings
from odm.execution.threat import Threat, ThreatSettings
from roadmap.kinematics.forward import difference, sphere_centers, tool_pose
from roadmap.motion.blending import joint_motion_bounds
from sim.bench.pushed import (
    KINDS,
    PushedLoop,
    PushedRobot,
    Pushes,
    PushSettings,
    mechanical_stop,
    run_pushed,
)
from sim.loop.loop import LoopSettings, run_loop
from sim.people.human_motion import make_motion, motion_names
from sim.people.scenes import SCENES, before_work_places

OFTEN = PushSettings(pause=0.3)
PERIOD = 0.01
PLACES = np.array([[1.2, 0.9, 0.0], [-1.2, -0.9, 0.5]])


def anywhere(q):
    return True


def pushed_at_rest(robot, q, seed, seconds, may_be=anywhere, settings=OFTEN, gap=None):
    """Return the body of a robot that stands at q, and where it was (n, dof)."""
    body = PushedRobot(robot, q, Pushes(robot, PERIOD, seed, settings), may_be)
    track = [body.q]
    for _ in range(round(seconds / PERIOD)):
        body.follow(q, q, gap)
        track.append(body.q)
    return body, np.array(track)


def strayed(robot, q, track):
    """Return how far any point was from where it is at q, for each row [m]."""
    there = sphere_centers(robot, q)
    moved = [sphere_centers(robot, p) - there for p in track]
    return [np.linalg.norm(m, axis=1).max() for m in moved]


def test_the_same_seed_pushes_the_same_way_and_another_one_does_not(crane):
    q = np.array([0.3, 0.2])
    _, one = pushed_at_rest(crane, q, 1, 20.0)
    _, again = pushed_at_rest(crane, q, 1, 20.0)
    _, other = pushed_at_rest(crane, q, 2, 20.0)
    assert np.array_equal(one, again) and not np.array_equal(one, other)


@pytest.mark.parametrize("seed", range(3))
def test_no_point_is_pushed_farther_than_said_and_all_kinds_come(crane, seed):
    q = np.array([0.3, 0.2])
    body, track = pushed_at_rest(crane, q, seed, 60.0)
    most = max(strayed(crane, q, track))
    assert 0.02 < most <= OFTEN.push + OFTEN.encoder + 1e-9
    assert math.isclose(body.farthest, most)
    assert all(body.count[kind] > 1 for kind in KINDS)


def test_a_robot_between_pushes_is_off_by_the_encoders_error_which_they_hide(crane):
    q = np.array([0.3, 0.2])
    calm = PushSettings(pause=1e5)
    body, track = pushed_at_rest(crane, q, 0, 1.0, settings=calm)
    assert 0.0 < max(strayed(crane, q, track)) <= calm.encoder
    assert np.allclose(body.measured, q, atol=1e-12)


def test_a_set_point_that_is_set_anew_moves_no_robot_at_once(crane):
    q = np.array([0.3, 0.2])
    pushes = Pushes(crane, PERIOD, 0, OFTEN)
    body = PushedRobot(crane, q, pushes, anywhere)
    while np.abs(body.measured - q).max() < 0.01:
        body.follow(q, q)
    before, anew = body.q, body.measured
    body.follow(anew, anew)
    assert body.seats == 1
    assert np.abs(body.q - before).max() < 0.3 * np.abs(anew - q).max()


@pytest.mark.parametrize("q", [[1.496, 0.0, 0.0], [1.2, 0.9, 0.0]])
def test_mechanical_stops_end_a_push_at_limits_and_scenery(small_map, q):
    robot, q = small_map.robot, np.array(q)  # near a limit; near the floor
    stop = mechanical_stop(odm.ReactivePlanner(small_map), robot)
    strong = PushSettings(pause=0.2, push=0.6, bump=0.6, encoder=0.0)
    _, free = pushed_at_rest(robot, q, 0, 20.0, settings=strong)
    _, track = pushed_at_rest(robot, q, 0, 20.0, stop, strong)
    assert not all(map(stop, free)) and all(map(stop, track))
    assert max(strayed(robot, q, track)) > 0.1


def test_no_push_presses_the_robot_nearer_to_a_person_than_they_let_it(crane):
    q = np.array([0.3, 0.2])
    gap = lambda p: 0.05 - 0.5 * abs(p - q).max()  # noqa: E731 (all ways lead nearer)
    strong = PushSettings(pause=0.2, push=0.3, bump=0.3)
    _, free = pushed_at_rest(crane, q, 0, 20.0, settings=strong)
    _, held = pushed_at_rest(crane, q, 0, 20.0, settings=strong, gap=gap)
    assert min(map(gap, free)) < 0.0 < strong.keep_off <= min(map(gap, held)) + 1e-9


# --- the executor -----------------------------------------------------------------


class Pushable:
    """An executor on its way through the small map, and who pushes it."""

    def __init__(self, small_map, settings=None):
        self.planner = odm.ReactivePlanner(small_map)
        self.planner.set_goals([PLACES[1]])
        self.executor = Executor(
            small_map.robot, self.planner, PLACES[0], PERIOD, settings
        )
        self.sway = joint_motion_bounds(small_map.robot)
        self.reasons = set()

    def frame(self, q=None, threat=None):
        executor = self.executor
        executor.locate(executor.set_point.q if q is None else q)
        commit = executor.commit()
        rows = np.zeros((0, 7)) if threat is None else threat.capsules
        self.answer = self.planner.step(odm.Obstacles(capsules=rows), q=commit.q)
        executor.update(self.answer, commit, threat)
        self.reasons.add(executor.reason)
        executor.advance()

    def run(self, n, beside=None):
        for _ in range(n):
            point = self.executor.set_point.q
            self.frame(point if beside is None else point + beside)

    def beside(self, far):
        """Return a push of the first joint by which a point moves `far` at most [m]."""
        return np.array([far / self.sway[0], 0.0, 0.0])


@pytest.fixture
def pushable(small_map):
    return Pushable(small_map)


def test_within_the_tracking_share_it_goes_on_and_beyond_it_stops(pushable):
    executor, share = pushable.executor, pushable.planner.cell_map.safety.tracking
    pushable.run(60, pushable.beside(0.9 * share))
    assert executor.motion.speed(executor.t) > 0.3 and executor.reason == ""
    pushable.run(1, pushable.beside(0.034))
    assert executor.state == BRAKED and executor.off == pytest.approx(0.034)
    assert executor.reason == "pushed 34 mm off its path; stopped"


@pytest.mark.parametrize("told_s", [0.0, 0.02, 0.025])
def test_who_follows_late_is_not_pushed_if_that_is_told(small_map, told_s):
    """The robot is where its set-point was 25 ms ago, between those of two frames."""
    pushable = Pushable(small_map, ExecutionSettings(latency_s=told_s))
    points = [pushable.executor.set_point.q] * 4
    for _ in range(80):
        pushable.frame(0.5 * (points[-4] + points[-3]))
        points.append(pushable.executor.set_point.q)
    if told_s == 0.025:
        went = np.abs(points[-1] - points[0]).max()
        assert went > 0.5 and pushable.reasons == {""}
        return
    told = f"may be {1e3 * told_s:g} ms late"
    late = rf"\d+ mm behind, where its set-point was 25 ms ago; stopped .* {told}"
    assert any(re.match(late, reason) for reason in pushable.reasons)


def test_late_as_told_a_push_aside_stops_it_as_ever(small_map):
    pushable = Pushable(small_map, ExecutionSettings(latency_s=0.05))
    pushable.run(40)
    executor = pushable.executor
    x, y, _ = executor.set_point.dq
    aside = 0.06 / np.hypot(x, y) * np.array([-y, x, 0.0])
    pushable.run(1, aside)
    assert executor.state == BRAKED
    assert executor.off == pytest.approx(np.abs(aside) @ pushable.sway)
    assert "off its path; stopped" in executor.reason


def test_how_far_a_push_moves_what_is_carried_counts_too(pushable):
    executor, share = pushable.executor, pushable.planner.cell_map.safety.tracking
    q = executor.set_point.q + pushable.beside(0.9 * share)
    executor.locate(q)
    assert executor.off == 0.0
    pushable.planner.attach(np.array([[0.0, 0.0, 0.3, 0.02]]))
    executor.locate(q)
    assert executor.off > share
    pushable.planner.detach()
    executor.locate(q)
    assert executor.off == 0.0


def test_what_the_encoders_may_be_wrong_by_comes_off_the_share(small_map):
    share = small_map.safety.tracking
    told = Pushable(small_map, ExecutionSettings(encoder_error=0.5 * share))
    told.run(30, told.beside(0.4 * share))
    assert told.executor.off == 0.0
    told.run(1, told.beside(0.6 * share))
    assert told.executor.off > 0.0


def test_encoders_that_fail_once_and_then_say_nothing_do_not_stop_it_for_good(pushable):
    executor = pushable.executor
    pushable.run(30)
    cases = [(0.0, True, 0.0), (0.034, False, 0.034), (0.034, True, 0.034)]
    for off, nan, still in cases:
        q = executor.set_point.q
        executor.locate(q + pushable.beside(off))
        if nan:
            executor.locate(np.full_like(q, np.nan))
            assert executor.off == math.inf
        executor.locate_nowhere()
        assert executor.off == pytest.approx(still)
    executor.locate(executor.set_point.q)
    executor.locate_nowhere()
    assert executor.off == 0.0


def test_at_rest_and_held_still_it_takes_where_it_is_for_its_set_point(pushable):
    executor = pushable.executor
    pushable.run(60)
    points, q = [], executor.set_point.q + pushable.beside(0.03)
    for _ in range(200):
        points.append(executor.set_point)
        pushable.frame(q)
        if "goes on" in executor.reason:
            break
    stop = points[: 1 + np.flatnonzero([np.any(p.dq) for p in points])[-1]]
    jerk = np.abs(np.diff([p.ddq for p in stop], axis=0)) / PERIOD
    assert (jerk <= 1.001 * executor.robot.max_jerk).all()  # a stop, no jump
    assert executor.set_point.q == pytest.approx(q, abs=1e-4)  # and moves again
    assert pushable.answer.path[0] == pytest.approx(q)  # it is planned from there
    pushable.run(600)
    assert np.abs(executor.set_point.q - PLACES[1]).max() < 1e-6


def test_while_its_place_changes_it_stands_and_sets_nothing_anew(pushable):
    executor = pushable.executor
    pushable.run(60)
    for k in range(150):
        pushable.frame(executor.set_point.q + pushable.beside(0.02 + 0.002 * (k % 9)))
    assert executor.at_rest and executor.state == STANDING
    assert not any("goes on" in reason for reason in pushable.reasons)


def test_released_before_it_is_set_anew_it_goes_on_to_its_goal(pushable):
    executor = pushable.executor
    pushable.run(60)
    pushable.run(20, pushable.beside(0.02))
    assert executor.state == BRAKED
    pushable.run(600)
    assert executor.reason == "" and not any("goes on" in r for r in pushable.reasons)
    assert np.abs(executor.set_point.q - PLACES[1]).max() < 1e-6


@pytest.mark.parametrize("nowhere", [math.nan, math.inf])
def test_a_robot_that_is_nowhere_stops_and_stays(pushable, nowhere):
    executor = pushable.executor
    pushable.run(60)
    for _ in range(150):
        pushable.frame(np.full(3, nowhere))
    assert executor.at_rest and "nobody knows" in executor.reason


def gets_away(small_map, far, off, standing=None):
    """Whether a robot that is `off` goes on out of the way of who comes from above.

    They are `far` over the place where it can stop, and come down at 1 m/s.
    """
    pushable = Pushable(small_map)
    executor = pushable.executor
    pushable.run(60)
    tip = tool_pose(small_map.robot, executor.motion.stop(executor.t).q_end)[:3, 3]
    middle = tip + [0.0, 0.0, far]
    capsule = np.r_[middle - [0.05, 0.0, 0.0], middle + [0.05, 0.0, 0.0], 0.03]
    down = np.tile([0.0, 0.0, -1.0], (1, 2, 1))
    if standing is not None:
        pushable.planner.set_static(standing)
    person = odm.Obstacles(capsules=capsule[None])
    pushable.planner.step(person, q=executor.set_point.q)
    executor.state = RETREATING  # as if it had begun to before the push
    executor._separation.measure(executor.set_point.q)
    threat = Threat(capsule[None], down, np.zeros(1), 0.0, ThreatSettings())
    pushable.frame(executor.set_point.q + pushable.beside(off), threat)
    return executor.state == RETREATING


def test_the_balls_of_the_braking_test_grow_by_how_far_it_is_off(small_map):
    def nearest(off):
        places = np.arange(0.1, 0.7, 0.01)
        return next(far for far in places if gets_away(small_map, far, off))

    hardly = nearest(0.003)
    assert hardly > 0.25  # far above where it would not be wise to move at all
    assert nearest(0.043) == pytest.approx(hardly + 0.04, abs=0.015)


def test_it_does_not_get_away_into_what_stands_beside_its_way(small_map):
    robot, pushable = small_map.robot, Pushable(small_map)
    pushable.run(60)
    q = pushable.executor.set_point.q
    beside = tool_pose(robot, q + pushable.beside(0.15))[:3, 3]
    post = beside[None]
    assert gets_away(small_map, 0.6, 0.01, post)
    assert gets_away(small_map, 0.6, 0.15)
    assert not gets_away(small_map, 0.6, 0.15, post)


def test_a_test_of_a_stop_asks_for_the_points_grown_by_the_deviation(small_map):
    pushable = Pushable(small_map)
    executor, asked = pushable.executor, []
    pushable.run(60)
    executor.state = RETREATING

    class Spy:
        def blocked_leg(self, way, extra, points):
            asked.append(extra)

    executor._test.planner = Spy()
    ball, rates = np.array([[3.0, 0, 0.5, 3.0, 0, 0.5, 0.05]]), np.zeros((1, 2, 3))
    threat = Threat(ball, rates, np.zeros(1), 0.0, ThreatSettings())
    for far in (0.0, 0.01, 0.03):
        q = executor.set_point.q + pushable.beside(far)
        executor.locate(q)
        executor._stop_free(executor.motion, executor.t, threat)
    assert np.allclose(np.diff(asked), [0.01, 0.02])


def test_a_kinematic_robot_is_asked_for_where_it_is_measured(crane, straight):
    mover = KinematicMover(crane, straight, np.zeros(2), PERIOD)
    mover.locate(np.array([0.1, 0.0]))
    assert np.array_equal(mover.commit().q, [0.1, 0.0])
    mover.locate(np.array([math.nan, 0.0]))
    assert np.array_equal(mover.commit().q, [0.1, 0.0])


# --- the loop ---------------------------------------------------------------------


def played(small_map, name, pushed, seconds=4.0, execution="timed", on_frame=None):
    planner = odm.ReactivePlanner(small_map)
    person = None
    if name is not None:
        person = make_motion(name, 0)
        person = before_work_places(person, planner.robot, PLACES)
    settings = LoopSettings(duration_s=seconds, execution=execution)
    given = planner, planner.robot, PLACES, person, settings
    if pushed is None:
        return run_loop(*given, on_frame)
    return run_pushed(PushedLoop(*given, pushed), on_frame)


@pytest.mark.parametrize(
    "name", some((n for n in motion_names() if n not in SCENES), 3, 6)
)
def test_pushed_beside_every_motion_it_touches_nobody_while_it_moves(small_map, name):
    frames = []
    pushed = PushSettings(pause=0.8)
    result = played(small_map, name, pushed, 6.0, on_frame=frames.append)
    assert result.contacts == 0
    assert sum(result.pushed[kind] for kind in KINDS) >= 2
    assert result.pushed["farthest_m"] > 0.002
    assert any("off its path; stopped" in frame.brake for frame in frames)
    led = [frame for frame in frames if frame.answer.status != "holding"]
    slowed = [frame for frame in led if frame.pace in ("slowed", "braked")]
    assert result.slowed_s == len(slowed) / result.rate_hz


def test_a_pushed_robot_makes_its_trips_and_the_same_seed_the_same_run(small_map):
    frames = []
    often = PushSettings(pause=1.5)
    result = played(small_map, None, often, 20.0, on_frame=frames.append)
    again = played(small_map, None, often, 20.0)
    assert result.to_json(timing=False) == again.to_json(timing=False)
    assert result.trips >= 2 and result.pushed["seats"] >= 1
    assert any("off its path; stopped" in frame.brake for frame in frames)
    assert result.summary()["pushed"] == result.pushed


def test_what_a_push_moves_is_the_robot_and_no_movement_of_its_own(small_map):
    result = played(small_map, None, PushSettings(pause=0.3), 10.0)
    still = ~result.moving
    assert result.point_speed[still].max() > 0.05  # pushed while it stands
    robot = small_map.robot
    steps = np.abs(difference(robot, result.q[:-1], result.q[1:])).max(axis=1)
    assert steps[still[1:]].max() > 1e-3


def test_a_kinematic_robot_that_is_pushed_comes_to_its_places(small_map):
    result = played(small_map, None, OFTEN, 20.0, "kinematic")
    assert result.trips >= 2 and result.pushed["farthest_m"] > 0.005


def test_without_pushes_nothing_is_said_of_them(small_map):
    assert "pushed" not in played(small_map, None, None, 0.5).summary()


@pytest.mark.parametrize("execution", ["kinematic", "timed"])
@pytest.mark.parametrize("name", ["sweep", "reach"])
def test_beside_a_person_told_as_shapes_it_touches_nobody_while_it_moves(
    small_map, name, execution
):
    planner = odm.ReactivePlanner(small_map)
    person = before_work_places(make_motion(name, 0), planner.robot, PLACES)
    settings = LoopSettings(duration_s=4.0, execution=execution)
    result = run_loop(planner, planner.robot, PLACES, person, settings)
    assert result.contacts == 0  # at rest it may be touched
    assert result.trips > 0 or execution == "timed"
    assert planner.frame.n_given == 0 and len(planner.points) > 0
