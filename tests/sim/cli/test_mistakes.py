"""A hundred plausible mistakes: one sentence each, with value and remedy, at once.

What is typed wrong is told in the words that were typed, before any work: exit code 2,
nothing on stdout, nothing written.
"""

import json
import os
import subprocess
import sys
from importlib.metadata import version

import numpy as np
import pytest
from rows import each

from odm import build_map
from sim.loop.warmup import tiny_recipe
from sim.terminal import checks

RUN, BUILD = ("run", "--map", "map"), ("build", "--robot", "arm.urdf", "--tip", "hand")
MEET = ("workspace", "meet", "--robot", "panda")
GRASPS = ("grasps", "build", "--object", "cup", "--hand", "panda")
MOCAP = ("demo", "handover", "--map", "map", "--human", "mocap")
CAMERA, HUMAN = ("camera", "d.png", "--map", "map"), ("workspace", "build", "human")
FRAMES = ("replay", "--map", "map", "--frames")

FLAGS = [  # units, numbers, words and choices, told without loading anything
    (RUN + ("--seconds", "-5"), "--seconds is -5", "above 0"),
    (RUN + ("--seconds", "0"), "--seconds is 0", "above 0"),
    (RUN + ("--seconds", "nan"), "--seconds is nan", "above 0"),
    (RUN + ("--seconds", "inf"), "--seconds is inf", "86400"),
    (RUN + ("--seconds", "30s"), "--seconds is '30s'", "such as 0.5"),
    (RUN + ("--rate", "0"), "--rate is 0", "a frame every 10 ms"),
    (RUN + ("--rate", "0.01"), "--rate is 0.01", "from 1 to 10000 Hz"),
    (RUN + ("--rate", "100Hz"), "--rate is '100Hz'", "number"),
    (RUN + ("--rate", "1000000"), "--rate is 1000000", "10000"),
    (RUN + ("--seed", "-1"), "--seed is '-1'", "0"),
    (RUN + ("--seed", "1.5"), "--seed is '1.5'", "whole number"),
    (RUN + ("--execution", "fast"), "--execution is 'fast'", "kinematic or timed"),
    (RUN + ("--execution", "Timed"), "--execution is 'Timed'", "did you mean timed"),
    (RUN + ("--targets", "met"), "--targets is 'met'", "did you mean meet"),
    (RUN + ("--motion", "sweeep"), "sweeep", "sweep"),
    (RUN + ("--motion", "mocap"), "--motion mocap", "--file"),
    (RUN + ("--file", "clip.bvh"), "--file", "--motion mocap"),
    (RUN + ("--carry", "10"), "--carry is 10", "0.06"),
    (RUN + ("--carry", "-0.1"), "--carry is -0.1", "above 0"),
    (RUN + ("--no-yield",), "--no-yield", "timed"),
    (RUN + ("--scene", "cell.stl"), "cell.stl is no scene", ".scene"),
    (RUN + ("--scene", "none.scene"), "none.scene", "path"),
    (RUN + ("--base-height", "75"), "--base-height is 75", "5 m"),
    (RUN + ("--stand", "1", "2"), "--stand", "X Y YAW"),
    (RUN + ("--stand", "1", "0", "nan"), "--stand YAW is nan", "-360 to 360 degrees"),
    (RUN + ("--stand", "150", "0", "0"), "--stand X is 150", "-100 to 100 m"),
    (RUN + ("--seed", "1" * 25), "--seed is '1111", "9223372036854775807 or less"),
    (RUN + ("--seed", "1", "--seed", "-1"), "--seed is '-1'", "0 or more"),
    (RUN + ("--between", "60", "130"), "--between is 60", "m"),
    (RUN + ("--between", "0.6", "1.3"), "--between", "--targets meet"),
    (RUN + ("--object", "wrench"), "--object", "--targets meet"),
    (RUN + ("--targets", "meet", "--object", "cup"), "'cup'", "wrench or mallet"),
    (RUN + ("--targets", "meet", "--side", "both"), "--side is 'both'", "left"),
    (RUN + ("--motion", "keyboard", "--plot", "a.png"), "--plot", "leave it out"),
    (RUN + ("--wrench",), "--wrench", "--help"),
    (("run",), "--map", "--help"),
    (("run", "--map"), "--map", "give a value"),
    (("rum", "--map", "map"), "rum", "did you mean"),
    (("demo", "--seconds", "0"), "--seconds is 0", "above 0"),
    (("demo", "--threads", "-1"), "--threads is '-1'", "0"),
    (("demo", "--object", "cup.stl"), "--object", "odm demo handover"),
    (("demo", "handover", "--mass", "0.3"), "--mass", "--object"),
    (("demo", "handover", "--scale", "0.001"), "--scale", "--object"),
    (("demo", "handover", "--object", "cup.stl", "--mass", "0"), "--mass is 0", "0.3"),
    (("demo", "handover", "--object", "c.stl", "--scale", "-1"), "--scale", "0.001"),
    (("demo", "maintenance", "--object", "cup.stl"), "--object", "odm demo handover"),
    (("run-two", "--map", "map", "--seconds", "-1"), "--seconds is -1", "above 0"),
    (("run-two", "--map", "map", "--other", "wild"), "'wild'", "planned or scripted"),
    (("run-two", "--map", "map", "--base", "1", "0"), "--base", "X Y YAW"),
    (("run-two", "--map", "map", "--base", "inf", "0", "0"), "--base X is inf", "m"),
    (("run-two", "--map", "map", "--base", "0", "0", "800"), "YAW is 800", "degrees"),
    (("warmup", "bogus"), "PART is 'bogus'", "choose run or demo"),
    (("warmup", "Demo"), "PART is 'Demo'", "did you mean demo?"),
    (("build",), "recipe", "--robot"),
    (("build", "demo", "--robot", "arm.urdf"), "either", "--robot"),
    (("build", "no_such_recipe"), "no_such_recipe", "panda"),
    (BUILD + ("--nodes", "-1"), "--nodes is -1", "from 2"),
    (BUILD + ("--nodes", "9" * 400), "--nodes is inf", "from 2 to 5000000 nodes"),
    (BUILD + ("--workers", "9999"), "--workers is '9999'", "4096 or less"),
    (BUILD + ("--nodes", "1e4"), "--nodes is '1e4'", "whole number"),
    (BUILD + ("--neighbors", "0"), "--neighbors is 0", "from 1"),
    (BUILD + ("--h", "4"), "--h is 4", "0.04"),
    (BUILD + ("--h", "-0.04"), "--h is -0.04", "0.002"),
    (BUILD + ("--rho", "30"), "--rho is 30", "0.03"),
    (BUILD + ("--lock", "a"), "--lock is 'a'", "JOINT=VALUE"),
    (BUILD + ("--lock", "a=90deg"), "'a=90deg'", "rad"),
    (BUILD + ("--lock", "=1"), "'=1'", "JOINT=VALUE"),
    (("audit", "map", "--pairs", "0"), "--pairs is '0'", "1"),
    (("audit", "map", "--sabotage", "luck"), "'luck'", "certificate"),
    (("human", "info", "--height", "175"), "--height is 175", "1.75"),
    (("human", "info", "--posture", "standng"), "'standng'", "standing"),
    (("human", "info", "--mass", "0"), "--mass is 0", "above 0"),
    (("human", "info", "--thickness", "thin"), "'thin'", "mean"),
    (("workspace", "human", "--side", "middle"), "'middle'", "left"),
    (MEET + ("--height", "175"), "--height is 175", "1.75"),
    (MEET + ("--distance", "90"), "--distance is 90", "0.9"),
    (MEET + ("--cell", "15"), "--cell is 15", "0.15"),
    (MEET + ("--object", "hammer"), "'hammer'", "wrench"),
    (("workspace", "build", "panda", "--cell", "5"), "--cell is 5", "0.05"),
    (("workspace", "build", "panda", "--stop-after", "0"), "--stop-after", "above 0"),
    (("camera", "d.png", "--map", "map", "--fx", "0"), "--fx is 0", "above 0"),
    (("camera", "d.png", "--map", "map", "--d-self", "3"), "--d-self is 3", "0.01 m"),
    (("camera", "d.png", "--map", "map", "--flying", "5"), "--flying is 5", "1 m"),
    (("camera", "d.png", "--map", "map", "--eye", "0", "0", "900"), "--eye Z", "m"),
    (("camera", "d.png", "--map", "map", "--policy", "dark"), "'dark'", "occupied"),
    (("camera", "d.png", "--map", "map", "--eye", "1", "2"), "--eye", "X Y Z"),
    (FRAMES + ("f.npz", "--spacing", "30"), "--spacing is 30", "0.03"),
    (("replay",), "file", "run.npz"),
    (("bench", "speed"), "'speed'", "latency"),
    (("bench", "workspace"), "reach map", "odm workspace build"),
    (("bench", "latency", "--seed", "-1"), "--seed is -1", "from 0"),
    (("bench", "motions", "--seeds", "0"), "--seeds is 0", "from 1"),
    (("grasps", "build", "--object", "cup"), "--hand", "--help"),
    (GRASPS + ("--samples", "0"), "--samples is 0", "from 1 to 5000"),
    (GRASPS + ("--friction", "5"), "--friction is 5", "from 0.01 to 2"),
    (GRASPS + ("--rolls", "100"), "--rolls is 100", "from 1 to 72"),
    (GRASPS + ("--seed", "3000000000"), "--seed is 3000000000", "2147483647"),
    (("view", "--at", "-1"), "--at is -1", "s"),
    (("view", "--port", "99999", "--map", "map"), "--port 99999", "65535"),
    (RUN + ("--out", ""), "--out is ''", "leave it out"),
    (RUN + ("--out=",), "--out is ''", "leave it out"),
    (("info", ""), "''", "shell"),
    (RUN + ("--stand", "0", "0", "90"), "--stand", "--motion mocap"),
    (RUN + ("--mapping", "m.toml"), "--mapping", "--motion mocap"),
    (("demo", "--port", "9999"), "--port", "--view"),
    (BUILD + ("--threads", "-2"), "--threads is '-2'", "0 or more"),
    (("workspace", "human", "--spacing", "2"), "--spacing is 2", "to 0.2 m"),
    (BUILD + ("--name", "a/b"), "--name is 'a/b'", "--out"),
    (BUILD + ("--lock", "a=1", "--lock", "a=2"), "--lock names 'a' twice", "leave"),
    (BUILD + ("--scheduler", "localhost"), "'localhost'", "tcp://host:8786"),
    (BUILD + ("--scheduler", "http://h:1"), "'http://h:1'", "tcp://host:8786"),
    (("handover", "plan", "butler", "--time-limit", "0"), "--time-limit is 0", "60"),
    (BUILD + ("--name", ".."), "--name is '..'", "--out"),
    (BUILD + ("--neighbors", "501"), "--neighbors is 501", "from 1 to 500"),
    (BUILD + ("--seed", str(2**63)), f"--seed is {2**63}: ", f"0 to {2**63 - 1}"),
    # flags that would have no effect there
    (RUN + ("--base-height", "1"), "--base-height", "--motion mocap"),
    (RUN + ("--targets", "meet", "--carry", "0.1"), "--carry", "--targets places"),
    (("audit", "map", "--sequences", "5", "--pairs", "9"), "--pairs", "--sequences"),
    (("audit", "map", "--sabotage", "certificate", "--close"), "--close", "by pairs"),
    (("audit", "map", "--sabotage", "certificate", "--payload"), "--payload", "pairs"),
    (("view", "--map", "map", "--at", "3"), "--at goes with a recording", "leave it"),
    (CAMERA + ("--pose", *"000000", "--eye", "1", "1", "1"), "--eye", "--pose"),
    (CAMERA + ("--pose", *"000000", "--at", "1", "1", "1"), "--at", "--pose"),
    (HUMAN + ("--no-self-collision",), "--no-self-collision goes with a robot", "out"),
    (HUMAN + ("--lock", "a=1"), "--lock goes with a robot", "leave it out"),
    (("demo", "handover", "--cycles", "3"), "--cycles", "odm demo maintenance"),
    (("demo", "--robot", "panda"), "--robot", "odm demo maintenance"),
]  # fmt: skip

FILES = [  # paths, formats and permissions of what is to be written
    (RUN + ("--animation", "x.mp4"), "x.mp4", "name it x.gif"),
    (RUN + ("--plot", "x.pdf"), "x.pdf", "name it x.png"),
    (RUN + ("--record", "run.bag"), "run.bag", "name it run.npz"),
    (RUN + ("--json", "map"), "--json map", "name a file in it"),
    (RUN + ("--json", "/proc/nowhere/a.json"), "/proc/nowhere", "another folder"),
    (RUN + ("--out", "arm.urdf"), "--out arm.urdf", "name a folder"),
    (RUN + ("--out", "run.png"), "--out run.png: a folder is made", "name it run"),
    (RUN + ("--plot", "arm.urdf/x.png"), "arm.urdf", "choose another one"),
    (RUN + ("--plot", "locked/x.png"), "locked/x.png", "permissions"),
    (RUN + ("--out", "locked/out"), "locked/out", "permissions"),
    (RUN + ("--record", "locked/r.npz"), "locked/r.npz", "permissions"),
    (("info", "map", "--plot", "map.svg"), "map.svg", "map.png"),
    (("info", "map", "--json", "locked/a"), "locked/a", "permissions"),
    (("demo", "--out", "locked/out"), "locked/out", "permissions"),
    (("run-two", "--map", "map", "--animation", "a.avi"), "a.avi", "a.gif"),
    (BUILD + ("--out", "locked/map"), "locked/map", "permissions"),
    (BUILD + ("--out", "arm.urdf"), "--out arm.urdf", "name a folder"),
    (BUILD + ("--out", "map.npz"), "--out map.npz: a folder is made", "name it map"),
    (BUILD + ("--out", "others"), "others", "another --out"),
    (("human", "info", "--plot", "p.jpg"), "p.jpg", "p.png"),
    (("replay", "f.npz", "--recipe-out", "r.json"), "r.json", "r.toml"),
    (("handover", "plan", "butler", "--out", "x.toml"), "x.toml", "x.json"),
    (("handover", "plan", "butler", "--plot", "x.pdf"), "x.pdf", "x.png"),
    (("handover", "plan", "butler", "--animation", "x.mp4"), "x.mp4", "x.gif"),
    (RUN + ("--scene", "others"), "others is no scene: it is a folder", ".scene"),
]  # fmt: skip

READ = [  # files that are not there, or are something else
    (("info", "no/map"), "no/map", "odm build"),
    (("info", "arm.urdf"), "arm.urdf", "odm build"),
    (("run", "--map", "no/map"), "no/map", "odm build"),
    (("audit", "others"), "others", "odm build"),
    (("build", "no.toml"), "no.toml", "check the path"),
    (("build", "broken.toml"), "broken.toml", "TOML"),
    (("build", "--robot", "no.urdf", "--tip", "hand"), "no.urdf", "path"),
    (("build", "--robot", "clip.csv", "--tip", "hand"), "clip.csv", "repair"),
    (("build", "--robot", "arm.urdf", "--tip", "tool0"), "tool0", "hand"),
    (BUILD + ("--lock", "elbow=1"), "elbow", "'a', 'b', 'c'"),
    (BUILD + ("--lock", "a=200"), "200", "3"),
    (BUILD + ("--srdf", "no.srdf"), "no.srdf", ""),
    (BUILD + ("--srdf", "arm.urdf"), "arm.urdf is a URDF", "the SRDF beside it"),
    (BUILD + ("--srdf", "others"), "others is a folder", "name the SRDF in it"),
    (BUILD + ("--scenery", "others"), "others is a folder", "name a file in it"),
    (BUILD + ("--out", "map", "--srdf", "no.srdf"), "no.srdf", "leave it out"),
    (BUILD + ("--out", "map", "--tip", "tool0"), "no link 'tool0'", "hand"),
    (BUILD + ("--out", "map"), "the map of another recipe", "--force"),
    (FRAMES + ("good.npz", "--reach", "r"), "--reach goes with a recorded", "leave"),
    (("replay", "other.json", "--map", "map"), "--map goes with a recording", "leave"),
    (RUN + ("--motion", "mocap", "--file", "no.bvh"), "no.bvh", ""),
    (RUN + ("--motion", "mocap", "--file", "clip.csv"), "clip.csv", "HIERARCHY"),
    (RUN + ("--carry", "0.1"), "payload", "recipe"),
    (FRAMES + ("no.npz",), "no.npz", ""),
    (FRAMES + ("clip.csv",), "clip.csv", "npz"),
    (FRAMES + ("short_q.npz",), "q_start", "3"),
    (FRAMES + ("no_goal.npz",), "q_goal", ""),
    (FRAMES + ("flat.npz",), "capsules", "7"),
    (FRAMES + ("good.npz", "--holds"), "--holds", "leave it out"),
    (("replay", "good.npz"), "good.npz", "--map"),
    (("replay", "no.npz"), "no.npz", "odm run --record"),
    (("replay", "clip.csv"), "clip.csv is no .npz", "numpy.savez"),
    (("replay", "others"), "others is a folder", "odm run --record"),
    (("replay", "other.json"), "other.json", "odm handover plan"),
    (MOCAP + ("--file", "no.bvh"), "no.bvh", "path of a recording"),
    (MOCAP + ("--file", "clip.csv", "--mapping", "no.toml"), "no.toml", "mapping"),
    (MOCAP + ("--file", "clip.csv"), "clip.csv", "HIERARCHY"),
    (("view", "map"), "map is a folder", "--map map"),
    (("build", "empty.toml"), "empty.toml is empty", "[robot]"),
    (("build", "latin.toml"), "latin.toml", "UTF-8"),
    (("camera", "clip.csv", "--map", "map"), "clip.csv", "16-bit PNG"),
    (("camera", "no.png", "--map", "map"), "no.png", ""),
    (("camera", "rgb.png", "--map", "map"), "rgb.png", "16 bits"),
    (("camera", "depth.png", "--map", "map", "--q", "0,1"), "shape (2,)", "a, b, c"),
    (("camera", "depth.png", "--map", "map", "--q", "home"), "--q 'home'", "write"),
    (("demo", "handover", "--map", "map", "--object", "no.stl"), "no.stl", "mesh"),
    (("workspace", "info", "map"), "map", "reach map"),
    (("grasps", "info", "map"), "map", "grasps"),
    (("run-two", "--map", "map", "--other-map", "no/map"), "no/map", "odm build"),
]  # fmt: skip

RECIPES = [  # keys and values of a recipe; told in its own words
    ("[robt]\nsource='arm.urdf'", "'robt'", "did you mean 'robot'"),
    ("[robot]\nurdf='arm.urdf'", "'urdf'", "did you mean 'source'"),
    ("[robot]\nsource=3", "robot.source is 3", "text"),
    ("[robot]\nlocked={a='90'}", "robot.locked.a is '90'", "number"),
    ("[robot]\ncover_excess=15.0", "cover_excess is 15", "0.2"),
    ("[safety]\nh=4.0", "h is 4.0", "1.0"),
    ("[safety]\nrho=0.0", "rho is 0.0", "0.0005"),
    ("[safety]\nclearance=0.01", "'clearance'", "Known keys"),
    ("[roadmap]\nnodes=1", "nodes is 1", "from 2"),
    ("[roadmap]\nneighbours=5", "'neighbours'", "did you mean 'neighbors'"),
    ("[roadmap]\nregion=[[0,0,0],[1,1]]", "region", "corner"),
    ("[payload]\nradius=100.0", "payload.radius is 100", "2.0"),
    ("[payload]\nposition=[0,0,0]", "[payload]", "radius"),
    ("[[scenery]]\ntype='box'\nsiez=[1,1,1]", "'siez'", "size"),
    ("[[scenery]]\ntype='cube'\nsize=[1,1,1]", "cube", "box"),
    ("[[scenery]]\ntype='mesh'\nfile='no.stl'", "no.stl", ""),
    ("[[scenery]]\ntype='box'\nsize=[1,-1,1]", "-1", ""),
    ("[[scenery]]\ntype='box'\nsize=[1,1,1]\nrpy=[90,0,0]", "90.0", "radians"),
    ("scenery='table'", "scenery is 'table'", "[[scenery]]"),
]  # fmt: skip


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Return a folder with a map, files that are sound, and some that are not."""
    from PIL import Image

    folder = tmp_path_factory.mktemp("room")
    build_map(tiny_recipe(folder), threads=1).save(folder / "map")
    (folder / "sample.urdf").rename(folder / "arm.urdf")
    (folder / "others").mkdir()
    (folder / "others" / "notes.txt").write_text("mine")
    (folder / "broken.toml").write_text("[robot\n")
    (folder / "clip.csv").write_text("walked to the door\n")
    (folder / "empty.toml").write_text("# nothing yet\n")
    (folder / "latin.toml").write_bytes(b"[robot]\nsource='stra\xdfe.urdf'\n")
    (folder / "other.json").write_text("[1, 2]")
    Image.fromarray(np.zeros((4, 4, 3), np.uint8)).save(folder / "rgb.png")
    Image.fromarray(np.full((16, 16), 900, np.uint16)).save(folder / "depth.png")
    good = {"capsules": np.zeros((2, 1, 7)), "rate_hz": 100.0}
    good |= {"q_start": np.zeros(3), "q_goal": np.zeros(3)}
    np.savez(folder / "good.npz", **good)
    np.savez(folder / "short_q.npz", **good | {"q_start": np.zeros(2)})
    np.savez(folder / "flat.npz", **good | {"capsules": np.zeros((2, 7))})
    del good["q_goal"]
    np.savez(folder / "no_goal.npz", **good)
    for index, (text, *_) in enumerate(RECIPES):
        (folder / f"recipe{index}.toml").write_text(text)
    (folder / "locked").mkdir(0o555)
    return folder


@pytest.fixture
def refused(odm, room, monkeypatch):
    """Return a function that types words, and holds what is true of every mistake."""

    def run(words, value, remedy):
        monkeypatch.chdir(room)
        before = sorted(room.rglob("*"))
        code, out, err = odm(*words)
        lines = [s for s in err.strip().splitlines() if s.startswith("odm: ")]
        assert code == 2 and out == "" and len(lines) == 1, (code, out, err)
        for extra in ("needs matplotlib", "needs PIL", "benches are not installed"):
            if extra in lines[0] and extra not in value:
                pytest.skip(
                    f"a bare wheel, without what this mistake needs: {lines[0]}"
                )
        assert "Traceback" not in err and value in lines[0] and remedy in lines[0], err
        assert ". " not in lines[0].replace("... ", ""), f"not one sentence: {lines[0]}"
        assert not [n for n in ("duration_s", "rate_hz is", "map_dir") if n in lines[0]]
        assert sorted(room.rglob("*")) == before, "something was written"

    return run


@each(("words", "value", "remedy"), FLAGS + FILES + READ)
def test_a_mistake_is_one_sentence_with_value_and_remedy(refused, words, value, remedy):
    refused(words, value, remedy)


@each(("index", "recipe"), list(enumerate(RECIPES)))
def test_a_mistake_in_a_recipe_names_its_key(refused, index, recipe):
    words = ("build", f"recipe{index}.toml", "--out", "made")
    refused(words, *recipe[1:])


@pytest.mark.parametrize(
    ("words", "module", "extra"),
    [
        (RUN + ("--plot", "a.png"), "matplotlib", "[sim]"),
        (RUN + ("--animation", "a.gif"), "PIL", "[sim]"),
        (RUN + ("--out", "out"), "matplotlib", "[sim]"),
        (("human", "info", "--plot", "a.png"), "matplotlib", "[sim]"),
    ],
)
def test_a_missing_extra_is_told_before_any_work(
    refused, monkeypatch, words, module, extra
):
    there = checks.is_there
    monkeypatch.setattr(checks, "is_there", lambda m: m != module and there(m))
    refused(words, f"needs {module}", extra)


@pytest.mark.parametrize("more", [(), ("handover",), ("--out", "there")])
def test_what_a_demo_always_draws_cannot_be_left_out(refused, monkeypatch, more):
    """The remedy was to leave out `--out`, which nobody had given."""
    there = checks.is_there
    monkeypatch.setattr(checks, "is_there", lambda m: m != "matplotlib" and there(m))
    refused(("demo", *more), "needs matplotlib", "[sim]'; `odm run` and docs/examples")


def test_without_a_word_the_help_is_shown_once(odm):
    code, out, err = odm()
    assert code == 2 and (out + err).count("Usage:") == 1


def test_the_version_is_told(odm):
    assert odm("--version")[:2] == (0, f"odm-planner {version('odm-planner')}\n")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")
def test_a_standard_output_without_room_is_told_in_one_sentence():
    with open("/dev/full", "w") as full:
        words = [sys.executable, "-m", "sim", "--help"]
        told = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True)
    assert told.returncode == 2 and told.stderr.count("\n") == 1
    assert "standard output could not be written: No space left" in told.stderr


def test_these_are_more_than_a_hundred():
    assert len(FLAGS + FILES + READ + RECIPES) >= 155


@pytest.mark.parametrize("words", [("--json", "figures"), ("--json=figures",)])
def test_figures_go_to_a_file_of_any_name(odm, tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    code, out, _ = odm("human", "info", *words)
    assert code == 0 and "Segments" in out
    assert json.loads((tmp_path / "figures").read_text())["height_m"] == 1.75
