"""The viewer beside a loop: three lines, and nothing the loop waits for."""

import time
from dataclasses import dataclass

import numpy as np
import pytest

from roadmap.errors import BadInput
from sim.view.gate import listening
from sim.view.mailbox import Mailbox
from sim.view.sources import Letters
from sim.view.viewer import Viewer, ViewerMissing, check_viewer


@dataclass
class Answer:
    status: str
    path: np.ndarray
    reason: str = ""


@dataclass
class Frame:
    index: int
    q: np.ndarray
    capsules: np.ndarray
    answer: Answer
    pace: str = "moving"
    place: int = 0
    separation: float = 0.3
    wall_s: float = 1e-4


def frames(n):
    nobody = np.zeros((0, 7))
    for i in range(n):
        q = np.array([i / n, 0.0])
        status = "replanned" if i == n // 2 else "following"
        path = np.array([q, [1.0, 0.5 if i < n // 2 else 0.9]])
        yield Frame(i, q, nobody, Answer(status, path))


@pytest.fixture
def headless(view_map, monkeypatch):
    """Return a viewer whose process was never started, and what it would read."""
    monkeypatch.setattr(Viewer, "_start", lambda self, *_: "nowhere")
    viewer = Viewer(view_map, port=0)
    import os

    box = Mailbox(os.dup(viewer._down.descriptor))
    return viewer, Letters(box)


def test_every_frame_is_told_though_few_are_drawn(headless):
    viewer, letters = headless
    drawn = 0
    for frame in frames(200):
        viewer.show(frame)
        drawn += letters.poll()
    assert drawn < 200
    time.sleep(0.03)
    viewer.show(next(frames(200)), time_s=2.0)
    letters.poll()
    np.testing.assert_allclose(letters.rows()[:, 0], np.arange(201) / 100)
    last = letters.at(99.0)
    assert last.before[-1, 1] == 0.5 and [e.text for e in letters.events] == [
        "new path"
    ]


def test_a_loop_is_not_kept_waiting_though_nobody_reads(headless):
    viewer, _ = headless
    took = []
    for frame in frames(2000):
        begun = time.thread_time()
        viewer.show(frame)
        took.append(time.thread_time() - begun)
    assert np.median(took) < 2e-4 and np.percentile(took, 99) < 2e-3  # [s]


def test_own_loops_give_what_they_have(headless):
    viewer, letters = headless
    viewer.show()  # nothing is nothing
    assert not letters.poll()
    seen = np.random.default_rng(0).uniform(size=(2_000_000, 3))
    viewer.show(q=np.zeros(2), points=seen, time_s=1.0)  # too many: some of them
    assert letters.poll()
    assert 0 < len(letters.at(1.0).points) <= 50_000


def test_a_hold_is_asked_for_its_reason_once_in_a_while(headless):
    class Asked(Answer):
        times = 0

        @property
        def reason(self):
            Asked.times += 1
            return "a hand"

        @reason.setter
        def reason(self, value):
            pass

    viewer, letters = headless
    answer = Asked("holding", np.zeros((0, 2)))
    for i in range(250):
        viewer.show(q=np.zeros(2), answer=answer, time_s=i / 100)
    assert Asked.times == 3
    letters.poll()
    assert letters.events[0].text == "holding: a hand"


def test_the_real_process_opens_dies_and_is_not_missed(view_map):
    pytest.importorskip("viser")
    with Viewer(view_map, port=0) as viewer:
        assert viewer.address.startswith("http://127.0.0.1:") and viewer.open
        for frame in frames(20):
            viewer.show(frame)
        assert viewer.hand() is None
        viewer._process.kill()
        viewer._process.wait()
        for frame in frames(20):
            viewer.show(frame)
        assert viewer.hand() is None and not viewer.open
    viewer.close()  # twice is once


def test_a_port_that_is_taken_is_refused_before_a_process_starts(view_map):
    pytest.importorskip("viser")
    with listening("127.0.0.1", 0) as other:
        port = other.getsockname()[1]
        with pytest.raises(BadInput, match=f"port {port} .* is taken; give another"):
            Viewer(view_map, port=port)


def test_opened_wider_an_empty_token_is_refused(view_map, monkeypatch):
    monkeypatch.setattr("sim.view.viewer.check_viewer", lambda: None)
    with pytest.raises(BadInput, match="can be reached by others; give a --token"):
        Viewer(view_map, host="0.0.0.0", port=0, token="")


def test_without_the_extra_one_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ViewerMissing, match=r"pip install 'odm-planner\[view\]'"):
        check_viewer()
