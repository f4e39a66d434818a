"""The five lines of docs/cameras.md run as they stand."""

import re
from pathlib import Path

import numpy as np
from seen_scenes import camera_at, picture
from small import AWAY, HOME

import odm

DOC = Path(__file__).resolve().parents[3] / "docs" / "cameras.md"


def test_the_example_runs(small_map):
    text = DOC.read_text(encoding="utf-8")
    code = re.search(r"```python\n(.*?)```", text, re.S).group(1)
    lines = code.strip().splitlines()
    assert len(lines) == 5
    view = camera_at([1.3, 0, 0.6], size=(640, 480), focal=476.0, scale=0.001)
    known = {
        "odm": odm,
        "cell_map": small_map,
        "T_base_camera": np.array(view.T_base_camera),
        "image": picture(view, [], small_map.robot, HOME),
        "q_now": HOME,
        "stamp": 0.0,
        "now": 0.03,
    }
    exec("\n".join(lines[:3]), known)
    known["planner"].set_goals([AWAY])
    exec("\n".join(lines[3:]), known)
    assert known["answer"].status == "replanned"
    assert known["answer"].certified == known["seen"].certified
    known["now"] = 0.15  # the camera says nothing any more
    exec(lines[4], known)
    assert known["answer"].status == "holding"
    assert "150 ms old" in known["answer"].reason


def test_an_image_with_nothing_far_off_is_read_as_told():
    text = DOC.read_text(encoding="utf-8").split("## Where nothing is")[1]
    code = re.search(r"```python\n(.*?)```", text, re.S).group(1)
    depth = np.full((480, 640), 1.5)
    depth[:, 320:] = np.inf
    known = {"odm": odm, "depth": depth, "T_base_camera": np.eye(4)}
    exec(code, known)
    assert known["camera"].clear_m == 2.5
    assert set(known["image"][:, 320:].ravel()) == {65535}
    assert set(known["image"][:, :320].ravel()) == {1500}
