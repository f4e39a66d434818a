"""The page in a browser, by mouse: the hand is dragged, a recording scrubbed."""

import threading
import time

import numpy as np
import pytest
from PIL import Image
from recorded import new_loop

from sim.bench.browser import Browser, found_browser
from sim.record import read_record
from sim.view.dragged import DraggedPerson
from sim.view.gate import listening
from sim.view.moment import Moment
from sim.view.sources import NO_ROWS, Recorded

pytest.importorskip("viser")
pytestmark = pytest.mark.skipif(found_browser() is None, reason="browser")

SIZE = (900, 560)  # small: the processor draws
OPENED, ENDED = "robot to person", "It has ended"
WAIT_S = 60.0


@pytest.fixture(scope="module")
def browser():
    with Browser() as made:
        yield made


@pytest.fixture
def tab(browser):
    made = browser.tab(SIZE)
    yield made
    made.close()


class Opened:
    """A page that draws in a thread of its own; a context manager."""

    def __init__(self, show, host="127.0.0.1", token=""):
        from sim.view.page import Page

        self.page = Page(show, listening(host, 0), host, token)
        self.thread = threading.Thread(target=self.page.run, daemon=True)
        self.address = f"http://127.0.0.1:{self.page.gate.port}/"

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.page.stop()
        self.thread.join(10)


def show_of(source, **more):
    from sim.view.page import Show

    return Show(source, source.robot, **more)


def until(holds, doing=lambda: time.sleep(0.05)):
    """Do something until it holds; fail where it does not."""
    end = time.monotonic() + WAIT_S
    while not holds():
        assert time.monotonic() < end
        doing()


def colours(tab, path, place):
    """Return the colours (7, 7, 3) that are drawn around a place of the window."""
    x, y = np.rint(place).astype(int)
    with Image.open(tab.picture(path)) as image:
        return np.asarray(image.convert("RGB"))[y - 3 : y + 4, x - 3 : x + 4]


def is_blue(pixels):
    """Return which of (..., 3) pixels are an arrow's that points up."""
    red, green, blue = np.moveaxis(pixels.astype(int), -1, 0)
    return (blue > red + 100) & (blue > green + 50)


def reset_view(page):
    """Put the only window's camera where "Reset View" does; wait until it is back."""
    (client,) = page.server.get_clients().values()
    camera, first = client.camera, page.server.initial_camera
    camera.position, camera.look_at = first.position, first.look_at
    until(lambda: np.abs(camera.position - first.position).max() > 0.02)


def place_of(tab, kind):
    """Return left, top, width and height of the first element, once it stays there."""
    asked = (
        f"(() => {{const r = document.querySelector('{kind}')?.getBoundingClientRect();"
        " return r ? [r.x, r.y, r.width, r.height] : null})()"
    )
    seen = [None, tab.ask(asked)]

    def look():
        time.sleep(0.5)
        seen.append(tab.ask(asked))

    until(lambda: seen[-1] is not None and seen[-1] == seen[-2], look)
    return seen[-1]


def pixel(page, size, point):
    """Return where on the window a point (3,) of the world is seen."""
    (client,) = page.server.get_clients().values()
    camera = client.camera
    eye = np.asarray(camera.position)
    ahead = np.asarray(camera.look_at) - eye
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    seen = np.array([right, np.cross(right, ahead), ahead]) @ (point - eye)
    scale = 0.5 * size[1] / np.tan(camera.fov / 2) / seen[2]
    return 0.5 * size[0] + scale * seen[0], 0.5 * size[1] - scale * seen[1]


def test_dragging_the_slider_scrubs_a_recording(view_file, tab, tmp_path):
    source = Recorded(read_record(view_file))
    with Opened(show_of(source)) as opened:
        playback = opened.page.playback
        tab.open(opened.address, OPENED)
        assert playback.at == 0.0 and not playback.playing

        def drag():  # a page on a busy machine may not hear the first one
            x, y, wide, high = place_of(tab, ".mantine-Slider-thumb")
            left, _, width, _ = place_of(tab, ".mantine-Slider-track")
            at = y + high / 2
            tab.drag((x + wide / 2, at), (left + 0.75 * width, at))
            time.sleep(1.0)

        there = pytest.approx(0.75 * playback.end, rel=0.1)
        until(lambda: playback.at == there, drag)
        moment = source.at(playback.at)
        node = opened.page.stage._bodies[2]
        frames = opened.page.stage.robot
        from roadmap.kinematics.forward import body_frames

        there = body_frames(frames, moment.q)[2, :3, 3]
        until(lambda: np.allclose(node.position, there, atol=1e-6))
        tab.picture(tmp_path / "scrubbed.png")


class Live:
    """What a loop does, as a page is shown it."""

    live, knows_latency, events, lacks = True, False, (), frozenset()

    def __init__(self, loop):
        self.loop, self.robot = loop, loop.robot
        self.step()

    def step(self):
        frame = self.loop.frame()
        self.frame = frame
        self.moment = Moment(
            frame.index / 100.0, frame.q, frame.capsules, separation=frame.separation
        )
        return frame

    def poll(self):
        return True

    def span(self):
        return 0.0, self.moment.time_s

    def rows(self):
        return NO_ROWS

    def at(self, time_s):
        return self.moment


def test_the_arrows_drag_the_hand_and_the_robot_answers(view_map, tab, tmp_path):
    taken = [None]
    loop, alone = new_loop(view_map), new_loop(view_map)
    loop.motion = DraggedPerson(loop.motion, lambda: taken[-1])
    source = Live(loop)
    trips = [alone.frame().q]
    with Opened(show_of(source, hand=taken.append)) as opened:
        tab.open(opened.address, OPENED)
        before = source.frame.capsules[-1, 3:6].copy()
        up = np.array([0.0, 0.0, 1.0])

        def reached(height):  # by the arrow that points up [px]
            return pixel(opened.page, SIZE, before + height * up)

        def at_the_arrow():
            return colours(tab, tmp_path / "arrows.png", reached(0.15))

        reset_view(opened.page)  # as a page does that draws late for the first time
        assert tab.toggle("Drag the hand")
        until(lambda: taken[-1] is not None)
        np.testing.assert_allclose(taken[-1], before, atol=1e-6)
        until(lambda: is_blue(at_the_arrow()).any())  # the arrows are drawn
        time.sleep(1.0)  # and heard
        grip, stop = reached(0.15), reached(0.40)  # to 25 cm above
        tab.drag(grip, stop, steps=20)
        until(lambda: np.linalg.norm(taken[-1] - before) > 0.15)
        tab.picture(tmp_path / "dragged.png")
        pulled = taken[-1] - before
        assert pulled[2] == pytest.approx(0.25, abs=0.08)
        np.testing.assert_allclose(pulled[:2], 0.0, atol=0.01)
        for _ in range(150):
            source.step()
            trips.append(alone.frame().q)
        hand = source.frame.capsules[-1, 3:6]
        assert np.linalg.norm(hand - taken[-1]) < 0.05
        # the same robot beside the person that nobody drags is elsewhere by now
        assert np.abs(trips[-1] - source.frame.q).max() > 0.01
        assert source.frame.separation > 0


def test_a_page_says_that_it_has_ended(view_file, tab):
    with Opened(show_of(Recorded(read_record(view_file)))) as opened:
        tab.open(opened.address, OPENED)
        assert ENDED not in tab.ask("document.body.innerText")
        opened.page.stop()
        until(lambda: ENDED in tab.ask("document.body.innerText"))
        assert OPENED in tab.ask("document.body.innerText")  # and the moment stays


def test_opened_wider_the_page_is_shown_to_who_knows_its_token(view_file, tab):
    source = Recorded(read_record(view_file))
    with Opened(show_of(source), "0.0.0.0", "secret") as opened:
        for address in (opened.address, opened.address + "?token=guess"):
            tab.open(address, "wants a token", canvas=False)
            assert not tab.ask("!!document.querySelector('canvas')")
            assert OPENED not in tab.ask("document.body.innerText")
        tab.open(opened.address + "?token=secret", OPENED)
        assert "secret" not in tab.ask("location.href")  # the cookie knows it now
        tab.open(opened.address, OPENED)
