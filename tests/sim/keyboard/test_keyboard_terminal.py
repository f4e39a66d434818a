"""The keyboard at a real terminal: bytes, sizes, signals, and what is left behind."""

import contextlib
import json
import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from keyboard_pty import User
from warm_process import WarmPopen

from odm.cell_map.build import build_map
from odm.cell_map.cell_map import load_map
from odm.cell_map.recipe import Recipe, RobotRecipe
from odm.planner.planner import ReactivePlanner
from roadmap.graph.connecting import RoadmapSettings
from sim.keyboard.control import KeyEvent
from sim.keyboard.key_motion import KeyboardArm
from sim.keyboard.story import KeyboardStory
from sim.keyboard.terminal import NoTerminal, Screen, open_terminal
from sim.loop.loop import LoopSettings, run_loop
from sim.run.places import DEMO, find_places

# a loop that answers at once, so that only keys, screen and clock are tested
FAKE = """
import json, os, sys
from types import SimpleNamespace
from sim.keyboard.key_motion import KeyboardArm
from sim.keyboard.session import Session, Setting
from sim.keyboard.signals import ENDINGS
from sim.keyboard.terminal import open_terminal
from sim.loop.loop import Frame

class Fake:
    def __init__(self, arm, crash):
        self.arm, self.crash, self.index = arm, crash, 0
    def frame(self):
        if self.index == self.crash:
            raise RuntimeError("the loop broke")
        capsules = self.arm.capsules(self.index / 100)
        answer = SimpleNamespace(status="holding", reason="the hand is in the way")
        self.index += 1
        return Frame(self.index, None, capsules, answer, 0, 0.2, 0, 0, 1e-5, 0, 0)

options = json.loads(sys.argv[1])
keys, screen = open_terminal()
arm = KeyboardArm()
setting = Setting(100.0, options.get("seconds"), "fake", 50, lambda: 17)
session = Session(Fake(arm, options.get("crash")), arm, setting)
ended = session.run(keys, screen)
if ended == "SIGHUP":
    sys.exit(ENDINGS[ended])
moved = arm.state.target - arm.limits.home
print(json.dumps({"ended": ended, "keys": [e.key for e in arm.events],
                  "moved": moved.round(6).tolist(), "frames": session.stats.frames}))
print("after the screen")
sys.exit(ENDINGS.get(ended, 0))
"""

# what a shell does: it starts a job in the foreground, and wakes it after Ctrl-Z
SHELL = """
import os, signal, sys, termios
child = os.fork()
if child == 0:
    os.setpgid(0, 0)
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)
    os.tcsetpgrp(0, os.getpgrp())
    signal.signal(signal.SIGTTOU, signal.SIG_DFL)
    os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
signal.signal(signal.SIGTTOU, signal.SIG_IGN)
_, status = os.waitpid(child, os.WUNTRACED)
os.tcsetpgrp(0, os.getpgrp())
echo = bool(termios.tcgetattr(0)[3] & termios.ECHO)
print("stopped", os.WIFSTOPPED(status), "echo", echo, flush=True)
sys.stdin.readline()
os.tcsetpgrp(0, child)
os.kill(child, signal.SIGCONT)
_, status = os.waitpid(child, 0)
sys.exit(os.waitstatus_to_exitcode(status))
"""

REAL = """
import json, sys
from pathlib import Path
from sim.keyboard import KeyboardPerson
from sim.run.request import RunRequest
from sim.run.runner import run as start
run = KeyboardPerson()
start(RunRequest(Path(sys.argv[1]), "keyboard", rate=50.0), run)
data = {"events": [[e.t, e.key] for e in run.events], "frames": run.frames,
        "print": run.result.fingerprint()}
open(sys.argv[2], "w").write(json.dumps(data))
sys.exit(run.exit_code)
"""


def fake(term="xterm", size=(80, 24), **options):
    words = ("-c", FAKE, json.dumps(options))
    return User(*words, columns=size[0], lines=size[1], term=term, warm={})


def told(user):
    return json.loads(user.read(r'(\{"ended".*\})').group(1))


def test_letters_and_torn_arrows_move_the_arm_and_unknown_keys_do_not():
    with fake() as user:
        user.see("q end")
        user.type(b"\x1b[A\x1b")
        user.look(0.3)
        user.type(b"[D")
        user.see(r"shoulder x +0\.80 m")
        user.see(r"shoulder y +0\.10 m")
        user.type(b"xX\x1b[24~\xc3\xa4\t\x13wW")
        user.see("flexion +-19°")
        user.type(b"+u")
        user.see(r"shoulder z +0\.60 m")
        user.type(b"q")
        assert user.end() == 0 and user.restored
        data = told(user)
    assert data["keys"] == ["up", "left", "w", "w", "+", "u"]
    nudge = np.radians(16).round(6)
    assert data["moved"] == [-0.05, -0.05, 0.1, nudge, 0.0, 0.0, 0.0]
    assert "after the screen" in user.screen.text  # and not on the one that is gone
    assert "holding" not in user.screen.text


def test_the_screen_refreshes_in_place_and_survives_every_size():
    with fake() as user:
        user.see("17|34 %")
        user.see(r"● holding for [1-9]")
        assert user.screen.modes["1049"] and not user.screen.modes["25"]
        user.resize(40, 12)
        user.see(r"(?m)^x 0\.85 y 0\.15 z 0\.50 m")
        assert user.screen.text.splitlines()[0].startswith("● holding")
        user.resize(15, 3)
        user.see(r"(?m)\A● holding.*\n.*\n\+-")
        user.resize(80, 24)
        user.see("shoulder x")
        user.see("late +0|behind the clock")
        assert user.screen.scrolled == 0
        user.type(b"?")
        user.see("larger, smaller nudge")
        user.type(b"?")
        user.see("shoulder x")
        user.type(b"q")
        assert user.end() == 0 and user.restored


def test_a_pause_stops_the_simulation_and_goes_on_with_it():
    with fake() as user:
        user.see("late  ")
        user.type(b"p")
        user.see("● paused")
        user.look(0.3)
        count = user.see(r"of ([\d,]+) frames").group(1)
        user.look(0.3)
        user.type(b"w")
        user.look(0.3)
        assert user.see(r"of ([\d,]+) frames").group(1) == count
        user.type(b" ")
        user.see("● holding")
        user.see("flexion +-2[78]°")
        user.type(b"q")
        assert user.end() == 0


@pytest.mark.parametrize(
    ("wish", "name", "code"), [("key", "SIGINT", 130), (signal.SIGTERM, "SIGTERM", 143)]
)
def test_signals_end_the_run_and_give_the_terminal_back(wish, name, code):
    with fake() as user:
        user.see("q end")
        if wish == "key":
            user.type(b"\x03")
        else:
            os.kill(user.process.pid, wish)
        assert user.end() == code and user.restored
        assert told(user)["ended"] == name
        assert user.screen.text.count("after the screen") == 1


def test_a_line_that_is_cut_ends_the_run():
    with fake() as user:
        user.see("q end")
        user.hang_up()
        assert user.process.wait(timeout=30) == 129


def test_an_error_gives_the_terminal_back_before_it_is_told():
    with fake(crash=20) as user:
        assert user.end() == 1 and user.restored
        assert "RuntimeError: the loop broke" in user.screen.text


def test_the_time_given_is_simulated_time():
    with fake(seconds=0.3) as user:
        assert user.end() == 0 and user.restored
        assert told(user) | {"keys": 0, "moved": 0} == {
            "ended": "seconds", "keys": 0, "moved": 0, "frames": 30,
        }  # fmt: skip


def test_ctrl_z_gives_the_terminal_back_and_takes_it_again():
    with User("-c", SHELL, "-c", FAKE, "{}") as user:
        user.see("q end")
        user.type(b"\x1a")
        user.see("stopped True echo True")
        assert user.restored
        user.type(b"\n")
        user.see("shoulder x")
        user.type(b"\x1b[A")
        user.see(r"shoulder x +0\.80 m")
        user.type(b"q")
        assert user.end() == 0 and user.restored


def test_a_dumb_terminal_gets_lines_and_no_escapes():
    with fake(term="dumb") as user:
        user.read("bend, stretch the elbow")
        user.read("holding.*smallest 20.0 cm.*34 %.*the hand is in the way")
        user.type(b"\x03")
        assert user.end() == 130 and user.restored
        assert "\x1b" not in user.sent


def test_without_a_terminal_one_sentence_names_the_other_motions():
    words = ("-m", "sim", "run", "--motion", "keyboard", "--map", "nowhere")
    with WarmPopen(
        words,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ,
    ) as process:
        _, err = process.communicate(timeout=60)
    assert process.returncode == 2
    lines = err.splitlines()
    (sentence,) = [line for line in lines if line.startswith("odm: ")]
    assert "needs a terminal" in sentence and "standard input is none" in sentence
    assert "sweep, reach, jitter, hover, intrusion" in sentence


def test_without_a_terminal_a_hand_over_names_the_other_people(monkeypatch):
    """It named the motions of `odm run`, which `odm demo handover` does not know."""
    with open(os.devnull) as nothing:
        monkeypatch.setattr(sys, "stdin", nothing)
        with pytest.raises(NoTerminal, match="--human keyboard needs") as told:
            KeyboardStory(5.0).open()
    assert str(told.value).endswith("choose another person: --human scripted or mocap")


def test_keys_without_a_place_to_draw_are_refused(monkeypatch):
    ours, theirs = os.openpty()
    with open(theirs) as keyboard, open(ours, "wb"):
        monkeypatch.setattr(sys, "stdin", keyboard)
        with pytest.raises(NoTerminal, match="neither standard output nor"):
            open_terminal()


@pytest.fixture
def pipe():
    ends = os.pipe()
    yield ends
    for end in ends:
        os.close(end)


def test_only_what_changed_is_sent(pipe):
    screen = Screen(pipe[1])
    screen.draw([("one", False), ("two", True)])
    assert os.read(pipe[0], 999) == b"\x1b[2J\x1b[1;1Hone\x1b[K\x1b[2;1Htwo"
    screen.draw([("one", False), ("too", False)])
    assert os.read(pipe[0], 999) == b"\x1b[2;1Htoo\x1b[K"


def test_a_terminal_without_unicode_gets_a_readable_screen(pipe):
    Screen(pipe[1], "ascii").draw([("─● ↑ 5 µs 8° █░ ü", False)])
    assert b"-* ^ 5 us 8' #. ?" in os.read(pipe[0], 999)


def test_a_line_that_takes_nothing_does_not_hold_the_loop(pipe):
    screen = Screen(pipe[1])
    os.set_blocking(pipe[1], False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(pipe[1], b"x" * 4096)
    os.set_blocking(pipe[1], True)
    screen.draw([("would wait for ever", False)])  # returns


@pytest.fixture(scope="module")
def map_dir(crane_urdf, tmp_path_factory):
    recipe = Recipe(
        name="crane",
        robot=RobotRecipe(source=str(crane_urdf), tip="jib"),
        roadmap=RoadmapSettings(nodes=150, neighbors=8),
    )
    return build_map(recipe, threads=1).save(tmp_path_factory.mktemp("map") / "crane")


def test_the_real_loop_ends_with_its_tables_and_its_keys_repeat_it(map_dir, tmp_path):
    out = tmp_path / "run.json"
    warm = dict(columns=100, lines=40, warm={"exercised": True})
    with User("-c", REAL, map_dir, out, **warm) as user:
        user.see("of [0-9,]+ edges")
        for keys in (b"\x1b[A" * 6, b"wwww", b"+\x1b[C\x1b[C", b"h"):
            user.type(keys)
            user.look(0.2)
        user.gone(r"shoulder x +0\.85")
        user.see("0:0[2-9]")
        user.type(b"\x03")
        assert user.end() == 130 and user.restored
        for words in ("contacts while moving", "p99", "ended by Ctrl-C"):
            assert words in user.screen.text or words in user.sent
    data = json.loads(out.read_text())
    planner = ReactivePlanner(load_map(map_dir))
    arm = KeyboardArm(events=[KeyEvent(t, key) for t, key in data["events"]])
    assert len(arm.events) == 14
    settings = LoopSettings(rate_hz=50.0, duration_s=data["frames"] / 50.0)
    assert settings.speed_scale == DEMO.speed_scale
    again = run_loop(planner, planner.robot, find_places(planner), arm, settings)
    assert again.frames == data["frames"]
    assert again.fingerprint() == data["print"]
