"""Hold, back off, escape: each really occurs in its scene, and is seen in the film."""

from dataclasses import replace

import numpy as np
import pytest
from forms import size
from recorded import PLACES, crane_recipe

import odm
from odm.execution.executor import RETREATING
from sim.loop.loop import Loop, LoopSettings, run_frames
from sim.loop.run_result import RETREATS
from sim.people.human_motion import make_motion
from sim.people.scenes import (
    BACKOFF_GAP,
    BLOCK_GAP,
    ESCAPE_GAP,
    SCENES,
    before_work_places,
    gap_from,
    make_scene,
    robot_balls,
)

EXECUTIONS = ("kinematic", "timed")
LONG_S = {"hold": 9.0, "backoff": 7.0, "escape": 8.0}  # till what it is to show is over
BACKING, ESCAPING = RETREATS.index("backing off"), RETREATS.index("escaping")


@pytest.fixture(scope="module")
def crane_map(crane_urdf):
    recipe = crane_recipe(crane_urdf, nodes=400)
    robot = replace(recipe.robot, cover_excess=0.02)
    return odm.build_map(replace(recipe, robot=robot), threads=1)


@pytest.fixture(scope="module")
def crane(crane_map):
    return crane_map.robot


@pytest.fixture(scope="module")
def played(crane_map):
    """Return a function: (frames, result, staged scene) of a scene beside the crane."""
    known = {}

    def play(name, execution):
        if (name, execution) not in known:
            planner = odm.ReactivePlanner(crane_map)
            scene = before_work_places(make_scene(name), planner.robot, PLACES)
            how = {"execution": execution, "keep_paths": 8}
            settings = LoopSettings(duration_s=size(LONG_S[name], 12.0), **how)
            frames = []
            loop = Loop(planner, planner.robot, PLACES, scene, settings)
            result = run_frames(loop, frames.append)
            known[name, execution] = frames, result, scene
        return known[name, execution]

    return play


@pytest.mark.parametrize("execution", EXECUTIONS)
def test_the_robot_holds_while_a_hand_is_at_the_goal_and_goes_on_after(
    played, crane, execution
):
    frames, result, scene = played("hold", execution)
    (hold,) = (h for h in result.holds if h.end_s - h.start_s > 1.0)
    near = execution == "timed"  # it holds as the hand comes, before it is there
    said = ["goal 0 is blocked"] + near * ["around goal 0 is cut off"]
    assert any(words in hold.reason for words in said)
    resting = scene.capsules(0.5 * (hold.start_s + hold.end_s))
    assert gap_from(robot_balls(crane, PLACES[1]), resting) <= BLOCK_GAP
    assert result.trips >= 1 and result.contacts == 0
    held = result.status[round(100 * hold.start_s) + 40 : round(100 * hold.end_s) - 1]
    assert (held == 2).all() and not result.retreat.any()


@pytest.mark.parametrize("execution", EXECUTIONS)
def test_the_waiting_robot_backs_off_from_a_slow_hand(played, crane, execution):
    frames, result, scene = played("backoff", execution)
    assert result.retreat[:40].max() == 0  # it waits at first
    assert "goal 0 is blocked" in result.holds[0].reason
    assert (result.retreat == BACKING).any() and (result.retreat != ESCAPING).all()
    assert any(frame.pace == RETREATING for frame in frames)
    away = np.flatnonzero(result.retreat == BACKING)
    before, after = result.q[away[0]], result.q[away[-1] + 1]
    capsules = scene.capsules(away[-1] / 100)
    gaps = [gap_from(robot_balls(crane, q), capsules) for q in (before, after)]
    assert gaps[1] > gaps[0] + 0.005 and result.contacts == 0


@pytest.mark.parametrize("execution", EXECUTIONS)
def test_the_robot_escapes_from_a_hand_within_its_clearance(played, crane, execution):
    frames, result, scene = played("escape", execution)
    assert "the start is in contact" in result.holds[0].reason
    away = np.flatnonzero(result.retreat == ESCAPING)
    assert 0 < away[0] < 50 and result.contacts == 0
    arms = scene.capsules(0)
    gaps = [gap_from(robot_balls(crane, q), arms) for q in result.q]
    assert gaps[0] <= ESCAPE_GAP and gaps[away[-1] + 1] > gaps[0] + 0.01


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_is_smooth_keeps_its_speed_and_repeats(name, crane):
    scene = make_scene(name).before(crane, PLACES)
    times = np.arange(0.0, 17.0, 0.005)
    rods = np.array([scene.capsules(t) for t in times])
    ends = np.concatenate([rods[:, :, :3], rods[:, :, 3:6]], axis=1)
    velocity = np.diff(ends, axis=0) / 0.005
    speed = np.linalg.norm(velocity, axis=2)
    assert 0.3 * scene.max_speed < speed.max() <= scene.max_speed
    jumps = np.linalg.norm(np.diff(velocity, axis=0), axis=2)
    assert jumps.max() < 0.2 * scene.max_speed
    for arm in scene.motions:
        np.testing.assert_allclose(arm.capsules(1 + arm.period), arm.capsules(1))


def test_a_hand_comes_as_near_as_the_scene_asks(crane):
    cover = robot_balls(crane, PLACES[0])
    scene = make_scene("backoff").before(crane, PLACES)
    gaps = [gap_from(cover, scene.capsules(t)) for t in np.arange(0.0, 8.0, 0.02)]
    assert BACKOFF_GAP - 0.003 < min(gaps) <= BACKOFF_GAP and gaps[0] > 0.15


def test_scenes_are_known_by_name_and_staged_before_the_work_places(crane):
    motion = make_motion("hold", 3)
    moved = before_work_places(motion, crane, PLACES)
    assert moved.name == "hold" and moved.capsules(0.0).shape == (2, 7)
    assert np.abs(moved.capsules(0.0) - motion.capsules(0.0)).max() > 0.05


def test_the_film_of_a_scene_shows_its_state_from_the_start(
    played, crane, tmp_path, monkeypatch
):
    from sim.draw import animation
    from sim.draw.cover_world import CoverWorld

    shown = []
    draw = animation._Painter._draw_caption

    def note(self, result, frame):
        shown.append((frame, animation._shown_status(result, frame)))
        draw(self, result, frame)

    monkeypatch.setattr(animation._Painter, "_draw_caption", note)
    film = animation.FilmSettings(width=160, height=120, frames=25, begin_s=0.0)
    _, result, _ = played("escape", "kinematic")
    world = CoverWorld(crane)
    path = tmp_path / "escape.gif"
    animation.write_animation(result, crane, PLACES, world, path, film)
    assert shown[0][0] == 0 and "escaping" in [state for _, state in shown]
    assert path.stat().st_size > 1000


def test_a_retreat_without_limits_of_acceleration_does_not_tremble(played, crane):
    """Backing off goes one way: no frame leads back to where it began."""
    _, result, _ = played("backoff", "kinematic")
    away = np.flatnonzero(result.retreat == BACKING)
    first = away[: 1 + int(np.argmax(np.diff(np.r_[away, away[-1] + 2]) > 1))]
    q = result.q[first[0] : first[-1] + 2]
    off = np.linalg.norm(q - q[0], axis=1)
    assert len(off) > 5 and (np.diff(off)[1:-1] > 0).all()
