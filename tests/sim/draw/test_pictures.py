"""Pictures are written, show what they should, and stay small."""

from dataclasses import replace

import numpy as np
import pytest

from odm import Box
from sim.draw import animation, scene_picture, style
from sim.draw.animation import floor_of, write_animation
from sim.draw.cover_world import CoverWorld
from sim.draw.film import FilmSettings, best_stretch
from sim.draw.style import new_figure
from sim.draw.surroundings import triangles_of
from sim.draw.viewpoint import Camera
from sim.loop.loop import LoopSettings, run_loop
from sim.run.latency_plot import write_latency_plot

pytest.importorskip("matplotlib")
Image = pytest.importorskip("PIL.Image")
SMALL = Camera(width=240, height=180)


@pytest.fixture(scope="module")
def run(crane, places):
    from sim.people.arm import HumanArm
    from sim.people.arm_path import Person
    from sim.people.human_motion import make_motion

    class Straight:
        def set_goals(self, goals, costs=None):
            self.goal = goals[0]

        def separation(self, q):
            return 0.0

        def step(self, points, q, dq=None, stamp=None, now=None, **told):
            from types import SimpleNamespace

            hold = len(points) and 1.0 < now < 2.0
            path = np.zeros((0, 2)) if hold else np.array([q, self.goal])
            status = "holding" if hold else "following"
            return SimpleNamespace(
                status=status, path=path, reason="wait", latency_s={"total": 1e-5}
            )

    motion = make_motion("sweep", 0, Person(HumanArm.sized(), (1.1, 0.0, 0.5)))
    settings = LoopSettings(duration_s=4.0, keep_paths=4)
    return run_loop(Straight(), crane, places, motion, settings)


def test_the_film_is_a_short_small_gif_in_real_time(run, crane, places, tmp_path):
    settings = FilmSettings(width=240, height=180, frames=12, fps=12.5)
    world = CoverWorld(crane)
    told = []
    path = write_animation(
        run, crane, places, world, tmp_path / "a.gif", settings,
        tell=lambda *said: told.append(said),
    )  # fmt: skip
    packing = ("packing the film", 0, 1)  # "249 of 250" stood there for 16 s
    assert told == [*(("writing the film", k, 12) for k in range(12)), packing]
    with Image.open(path) as film:
        assert film.n_frames == 12 and film.size == (240, 180)
        assert film.info["duration"] == 80
    assert path.stat().st_size < 300_000


def test_a_frame_shows_the_planned_way_the_goal_and_the_state(run, crane, places):
    painter = animation._Painter(crane, places, CoverWorld(crane), SMALL)
    image = np.asarray(painter.paint(run, 40))
    teal = (np.abs(image.astype(int) - [0, 133, 124]).max(axis=2) < 12).sum()
    held = np.asarray(painter.paint(run, 150))
    red = (np.abs(held.astype(int) - [196, 62, 62]).max(axis=2) < 12).sum()
    assert teal > 200 and red > 200


def test_the_film_starts_where_most_happens(run):
    score = animation._liveliness(run)
    assert 0 <= best_stretch(score, 100) <= run.frames - 100
    assert best_stretch(score, run.frames + 5) == 0


def test_a_robot_with_legs_stands_on_a_floor_and_any_other_on_its_table(crane):
    assert floor_of(crane) == 0.0
    spheres, body = np.array(crane.spheres), np.array(crane.sphere_body)
    spheres[0], body[0] = [0.2, 0.0, -0.9, 0.1], 0
    assert floor_of(replace(crane, spheres=spheres, sphere_body=body)) == -1.0


def test_the_latency_plot_is_written(run, tmp_path):
    path = write_latency_plot(run, tmp_path / "latency.png")
    with Image.open(path) as image:
        assert image.size[0] > 800
        assert len(image.convert("RGB").getcolors(1 << 24)) > 50


def test_no_words_of_the_latency_plot_lie_on_others(run, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(style, "save", lambda figure, *_, **__: drawn.append(figure))
    same = replace(run, wall_s=np.full(run.frames, 2e-5))
    write_latency_plot(same, tmp_path / "latency.png")
    (figure,) = drawn
    figure.draw_without_rendering()
    texts = [text for axis in figure.axes for text in axis.texts if text.get_text()]
    boxes = [text.get_window_extent().padded(-0.5) for text in texts]
    assert len(boxes) == 6
    for k, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:k])


def test_a_run_of_one_frame_is_a_dot_in_its_plot(crane, places, straight, tmp_path):
    one = run_loop(straight, crane, places, None, LoopSettings(duration_s=0.01))
    assert one.frames == 1
    path = write_latency_plot(one, tmp_path / "one.png")
    with Image.open(path) as image:  # the curve's own colour, at the left of its axis
        left = np.asarray(image.convert("RGB"))[:, : image.size[0] // 4].astype(int)
    teal = np.abs(left - style.rgb(style.TEAL)).max(axis=-1) < 40
    assert teal.sum() > 10


def test_a_run_without_a_person_can_be_plotted(straight, crane, places, tmp_path):
    alone = run_loop(straight, crane, places, None, LoopSettings(duration_s=0.5))
    assert write_latency_plot(alone, tmp_path / "alone.png").stat().st_size > 1000


def test_quiet_words_can_be_read_on_what_is_below_them():
    def light(colour):
        part = np.array(style.rgb(colour)) / 255
        linear = np.where(
            part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4
        )
        return linear @ [0.2126, 0.7152, 0.0722] + 0.05

    for below in ("#ffffff", style.PALE):  # 4.5: WCAG 2.1, level AA
        assert light(below) / light(style.FAINT) > 4.5


@pytest.mark.parametrize("size", [(1.0, 1.0, 1.0), (3.0, 2.0, 1.0), (1.0, 1.0, 4.0)])
def test_the_floor_of_a_scene_is_inside_its_picture(size):
    parts = [(triangles_of(Box(size)), "#000000")]
    for k, view in enumerate(scene_picture._VIEWS, 1):
        figure = new_figure(15.0, 6.0)
        axis = figure.add_subplot(1, 3, k, projection="3d")
        scene_picture._draw(axis, parts, view)
        figure.draw_without_rendering()
        (line,) = axis.get_lines()
        floor = line.get_transform().transform(np.array(line.get_data()).T)
        assert all(axis.bbox.contains(*corner) for corner in floor)
