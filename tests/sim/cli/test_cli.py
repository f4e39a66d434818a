"""The command line as a user meets it: exit codes, one sentence, whole files."""

import importlib
import inspect
import io
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer
from command_line import one_sentence
from rows import each

import sim.__main__ as entry
from odm import build_map, load_map
from sim.bench.command import bench_modules, fill_section, run_bench
from sim.cli import main as cli
from sim.cli import suggest
from sim.cli.build_command import built_facts
from sim.loop.warmup import tiny_recipe
from sim.tables.scale import Gain

COMMANDS = ("build", "info", "audit", "run", "demo", "replay", "bench", "warmup")
COMMANDS += ("human", "doctor")
GROUP = typer.main.get_command(cli.app)


@pytest.fixture(scope="module")
def map_dir(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli")
    return build_map(tiny_recipe(folder), threads=1).save(folder / "sample")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(odm, command):
    code, out, _ = odm(command, "--help")
    assert code == 0 and "Usage" in out


@pytest.mark.parametrize("command", ["run", "demo", "replay"])
def test_lines_of_help_are_broken_by_the_screen_alone(odm, monkeypatch, command):
    monkeypatch.setenv("COLUMNS", "80")
    told = odm(command, "--help")[1].partition("OPTIONS]")[2].partition("\u256d")[0]
    lines = [line.strip() for line in told.splitlines()]
    for line, after in zip(lines, lines[1:], strict=False):
        if line and after:  # the next word had no room
            assert len(line) + 1 + len(after.split()[0]) > 78, line


@pytest.mark.parametrize("errors", ["strict", "surrogateescape"])  # of LC_ALL=C
def test_output_that_is_closed_or_of_few_letters_ends_no_command(monkeypatch, errors):
    few = io.TextIOWrapper(io.BytesIO(), "ascii", errors, newline="\n")
    monkeypatch.setattr(sys, "stdout", few)
    monkeypatch.setattr(sys, "stderr", None)
    entry._mend_streams()
    print("20 \N{MICRO SIGN}s", flush=True)
    print("nobody hears", file=sys.stderr)
    sys.stderr.close()
    assert few.buffer.getvalue() == b"20 ?s\n"


def test_processors_with_avx2_are_told_tocompute_alike(monkeypatch, tmp_path):
    for name in entry.ALIKE:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Zen")  # what the user wants
    cpu = tmp_path / "cpuinfo"
    for flags, told in (("fpu avx sse2", False), ("fma fpu avx2 avx512f", True)):
        cpu.write_text(f"model name : any\nflags : {flags}\n")
        entry.compute_alike(str(cpu))
        assert ("NPY_DISABLE_CPU_FEATURES" in os.environ) == told
    assert os.environ["OPENBLAS_CORETYPE"] == "Zen"
    entry.compute_alike(str(tmp_path / "none"))  # no Linux


ALONE = """
import sys
from sim import __main__ as entry
if sys.argv[1] == "alike":
    entry.compute_alike()
import numpy as np
a = np.random.default_rng(0).uniform(-9.0, 9.0, (400, 3))
print(np.sin(a).tobytes().hex()[-4000:], (a @ a[:3].T).tobytes().hex()[-4000:])
"""


def test_numbers_end_alike_whatever_the_processor_could_do():
    """As one without AVX-512 computes, which is played by what numpy is told."""

    def computed(how, **told):
        clean = {k: v for k, v in os.environ.items() if k not in entry.ALIKE}
        command = [sys.executable, "-c", ALONE, how]
        run = subprocess.run(
            command, env={**clean, **told}, capture_output=True, check=True
        )
        return run.stdout

    flags = Path("/proc/cpuinfo").read_text() if os.path.exists("/proc/cpuinfo") else ""
    if "avx2" not in flags:
        pytest.skip("this processor has no AVX2")
    assert computed("alike") == computed("plain", **entry.ALIKE)


@pytest.mark.parametrize("part", ["run", "demo"])
def test_a_part_is_compiled_once(odm, part):
    assert odm("warmup", part)[0] == 0
    code, out, _ = odm("warmup", part)
    assert code == 0 and out.startswith("everything was compiled")


def test_a_wrong_option_is_a_usage_error(odm):
    assert odm("info", "--nonsense")[0] == 2
    assert odm("build")[0] == 2
    assert odm("build", "panda", "--robot", "my.urdf")[0] == 2
    assert odm("build", "--robot", "my.urdf", "--lock", "a=b")[0] == 2


@each(
    "words",
    [
        ("info", "no/such/map"),
        ("audit", "no/such/map"),
        ("run", "--map", "no/such/map"),
        ("run", "--map", "no/such/map", "--motion", "dance"),
        ("replay", "--map", "no/such/map", "--frames", "no.npz"),
        ("build", "no_such_recipe"),
        ("build", "--robot", "no_such.urdf", "--tip", "tool0"),
        ("build", "demo", "--h", "-1"),
        ("bench", "nothing"),
        ("warmup", "walk"),
        ("warmup", "run", "--fine"),
        ("human", "info", "--height", "2.3"),
        ("human", "info", "--posture", "flying"),
        ("human", "info", "--mass", "0"),
    ],
)
def test_a_mistake_is_told_in_one_sentence(odm, words):
    code, out, err = odm(*words)
    assert code == 2 and out == "" and one_sentence(err), err


def test_json_may_stand_alone_and_never_swallows_an_argument():
    for words, meant in (
        ("info --json maps/a", "info --json=- maps/a"),
        ("info maps/a --json", "info maps/a --json=-"),
        ("info --json a.json maps/a", "info --json=a.json maps/a"),
        ("bench latency --markdown --map m", "bench latency --markdown=- --map m"),
        ("run --map m --json figures", "run --map m --json=figures"),
        ("info maps/a --json figures", "info maps/a --json=figures"),
        ("info --plot p.png --json maps/a", "info --plot p.png --json=- maps/a"),
        ("build --json panda", "build --json=- panda"),
        ("build --robot a.urdf --json out", "build --robot a.urdf --json=out"),
        ("workspace meet --robot x --json out", "workspace meet --robot x --json=out"),
        ("--json human info", "--json=- human info"),
    ):
        assert cli.with_targets(words.split(), GROUP) == meant.split()


def test_build_makes_a_map_and_does_not_replace_another_one(odm, tmp_path):
    urdf = tiny_recipe(tmp_path).robot.source
    words = ("build", "--robot", urdf, "--tip", "hand", "--neighbors", 5, "--out")
    out = tmp_path / "built"
    code, text, _ = odm(*words, out, "--nodes", 40, "--json")
    made = json.loads(text)
    assert code == 0 and made["hash"] == load_map(out).hash
    assert made["nodes"] == load_map(out).roadmap.n_nodes
    code, text, err = odm(*words, tmp_path / "again", "--nodes", 40)
    assert " on disk, " in text and " in memory" in text
    told = "no scenery: the map knows of no floor and no table; give --scenery FILE, a"
    assert f"{told} recipe with [[scenery]], or planner" in " ".join(err.split())
    code, _, err = odm(*words, out, "--nodes", 50)
    assert code == 2 and "--force" in err and load_map(out).hash == made["hash"]
    assert odm(*words, out, "--nodes", 50, "--force")[0] == 0
    assert load_map(out).hash != made["hash"]
    (tmp_path / "mine").mkdir()
    code, _, err = odm(*words, tmp_path / "mine", "--nodes", 40, "--force")
    assert code == 2 and "not a map folder" in err


def test_a_build_tells_which_links_are_not_tested_since_they_always_touch(
    odm, tmp_path
):
    ball = '<collision><geometry><sphere radius="RADIUS"/></geometry></collision>'
    parts = ["<robot name='r'>"]
    for name in "abc":
        parts.append(f'<link name="{name}">{ball}</link>')
    for parent, child in ("ab", "bc"):
        parts.append(
            f'<joint name="to_{child}" type="revolute"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>'
            '<limit lower="-0.5" upper="0.5" velocity="1" effort="1"/></joint>'
        )
    words = ("--neighbors", 5, "--nodes", 40, "--out", tmp_path / "map", "--force")
    for radius, touches in (("0.1", False), ("0.4", True)):
        text = "".join([*parts, "</robot>"]).replace("RADIUS", radius)
        (tmp_path / "r.urdf").write_text(text)
        code, _, err = odm("build", "--robot", tmp_path / "r.urdf", *words)
        told = "hulls of meshes, touches in all poses: a and c; give those that can"
        assert code == 0 and (told in " ".join(err.split())) is touches


def test_a_recipe_is_built_from_another_folder(odm, tmp_path, monkeypatch):
    home = tmp_path / "home"
    home.mkdir()
    tiny_recipe(home)
    text = '[robot]\nsource = "sample.urdf"\ntip = "hand"\n[roadmap]\nneighbors = 4\n'
    (home / "tiny.toml").write_text(text)
    srdf = '<robot><disable_collisions link1="base" link2="hand"/></robot>'
    (tmp_path / "mine.srdf").write_text(srdf)
    monkeypatch.chdir(tmp_path)
    words = ("build", "home/tiny.toml", "--nodes", 30, "--out", "map")
    assert odm(*words)[0] == 0
    assert load_map("map").robot.source == "sample.urdf"
    # what is typed starts at the current folder
    assert odm(*words, "--srdf", "mine.srdf", "--force")[0] == 0
    pairs = [pair[:2] for pair in load_map("map").robot.dropped_pairs]
    assert ("base", "hand") in pairs


def test_the_tool_that_was_not_named_is_told_and_one_edge_is_one(odm, tmp_path):
    urdf = tiny_recipe(tmp_path).robot.source
    words = ("--nodes", 2, "--neighbors", 1, "--out", tmp_path / "map")
    code, out, err = odm("build", "--robot", urdf, *words)
    assert code == 0 and out.startswith("2 nodes and 1 edge in ")
    assert "the tool is hand" in err and "--tip" in err and "about 1 edge " in err
    _, _, err = odm("build", "--robot", urdf, "--tip", "hand", *words, "--force")
    assert "the tool" not in err


def test_a_joint_can_be_locked_on_the_command_line(odm, tmp_path):
    urdf = tiny_recipe(tmp_path).robot.source
    words = ("--robot", urdf, "--tip", "hand", "--lock", "b=0.5", "--nodes", 30)
    assert odm("build", *words, "--out", tmp_path / "locked")[0] == 0
    assert load_map(tmp_path / "locked").robot.joint_names == ("a", "c")


def test_suggest_agrees_with_a_real_build_and_builds_nothing(
    odm, tmp_path, monkeypatch
):
    monkeypatch.setattr(suggest, "NODES", (300,))  # two of each with what is asked
    monkeypatch.setattr(suggest, "CELLS", (0.05,))
    monkeypatch.setattr(suggest, "ASKED", (5, 10))
    urdf = tiny_recipe(tmp_path).robot.source
    words = ("build", "--robot", urdf, "--tip", "hand", "--nodes", 450)
    code, text, _ = odm(*words, "--out", tmp_path / "map", "--suggest", "--json")
    assert code == 0 and not (tmp_path / "map").exists()
    rows = json.loads(text)["rows"]
    sizes = [(0.04, 300), (0.04, 450), (0.05, 300), (0.05, 450)]
    assert [(row["h"], row["nodes"]) for row in rows] == sizes
    rows = [r for r in rows if (r["h"], r["nodes"]) == (0.04, 450)]
    assert odm(*words, "--out", tmp_path / "map")[0] == 0
    made = built_facts(load_map(tmp_path / "map"), tmp_path / "map", 0.0)
    for mine, real in (
        (rows[0]["edges"], made["edges"]),
        (rows[0]["bytes_per_edge"], made["bytes_per_edge"]["edge_major"]),
        (rows[0]["map_bytes"], made["folder_bytes"]),
    ):
        assert 0.7 * real < mine < 1.3 * real


def test_sizes_that_solve_alike_are_told_in_words(odm, tmp_path, monkeypatch):
    """All nine rows said 96 % and 98 %, which reads as figures of one's own robot."""
    monkeypatch.setattr(suggest, "NODES", (100, 200))
    monkeypatch.setattr(suggest, "CELLS", (0.05,))
    monkeypatch.setattr(suggest, "ASKED", (5, 10))
    urdf = tiny_recipe(tmp_path).robot.source
    words = ("build", "--robot", urdf, "--tip", "hand", "--suggest", "--nodes", 100)
    text = " ".join(odm(*words)[1].split())
    assert "On a Panda all of these sizes find a path in 96 % of" in text
    assert "crossing clutter" not in text

    def differing(nodes, h):
        return Gain(90.0 if nodes < 150 else 95.0, 98.0, 50.0)

    monkeypatch.setattr(suggest, "gain_of", differing)
    text = " ".join(odm(*words)[1].split())
    assert "crossing clutter" in text and "90 %" in text and "95 %" in text


@pytest.mark.parametrize(
    ("free", "told"),
    [
        ((True, False), "motions between 30"),
        ((False,), "configurations that were tried"),
    ],
)
def test_suggest_where_nothing_is_free_is_one_sentence(
    odm, tmp_path, monkeypatch, free, told
):
    class Nothing:
        def motions_free(self, q, dq):
            return np.full(len(q), free[bool(dq.any()) and len(free) > 1])

    monkeypatch.setattr(suggest, "static_test", lambda spec: Nothing())
    urdf = tiny_recipe(tmp_path).robot.source
    words = ("build", "--robot", urdf, "--tip", "hand", "--nodes", 30, "--suggest")
    code, _, said = odm(*words)
    assert code == 2 and told in said and "check the scenery" in said


def test_info_tells_what_the_map_holds(odm, map_dir):
    code, text, _ = odm("info", map_dir, "--overhead", "--json")
    found, cell_map = json.loads(text), load_map(map_dir)
    assert code == 0 and found["hash"] == cell_map.hash
    assert found["safety"] == cell_map.safety.as_dict()
    assert found["roadmap"]["edges"] == cell_map.roadmap.n_edges
    assert sum(found["bytes"][v] for v in ("edge_major", "block_major")) == sum(
        a.nbytes
        for view in (cell_map.arm_cells.arrays().values(), cell_map.arm_cells.by_block)
        for a in view
    )
    assert {row["link"] for row in found["cover"]} == set(cell_map.robot.link_names)
    code, text, _ = odm("info", map_dir, "--overhead")
    assert code == 0
    overhead = found["clearance_overhead"]
    close, cells = (overhead[f"edges, {by}"]["mean"] for by in ("close test", "cells"))
    assert 0 < close < cells < 0.12
    assert f"from {overhead['lines']} approaches" in " ".join(text.split())
    words = ("close test", "rho", "hand", "sticks out [mm]", "floor")
    for word in (*words, cell_map.hash[:12]):
        assert word in text


def test_an_audit_passes_a_sound_map_and_fails_a_spoiled_one(odm, map_dir):
    words = ("audit", map_dir, "--pairs", 2000, "--json")
    code, text, _ = odm(*words)
    assert json.loads(text)["violations"] == 0 and code == 0
    code, text, _ = odm(*words, "--sabotage", "rho")
    assert json.loads(text)["violations"] > 0 and code == 1
    code, _, err = odm("audit", map_dir, "--sabotage", "luck")
    assert code == 2 and one_sentence(err)


def test_a_damaged_map_is_one_sentence(odm, map_dir, tmp_path):
    broken = tmp_path / "broken"
    broken.mkdir()
    for file in map_dir.iterdir():
        (broken / file.name).write_bytes(file.read_bytes())
    data = bytearray((broken / "arm.code.npy").read_bytes())
    data[-5] ^= 1
    (broken / "arm.code.npy").write_bytes(data)
    code, _, err = odm("info", broken)
    assert code == 2 and one_sentence(err) and "arm.code" in err


def test_a_run_writes_its_figures(odm, map_dir, tmp_path):
    words = ("--motion", "reach", "--seconds", 1, "--json", tmp_path / "r.json")
    code, out, _ = odm("run", "--map", map_dir, *words)
    record = json.loads((tmp_path / "r.json").read_text())
    assert code == 0 and "p99" in out
    assert record["run"]["motion"] == "reach" and record["run"]["frames"] == 100


def test_benches_are_found_by_name(odm):
    assert "latency" in bench_modules()
    code, _, err = odm("bench", "workspace")
    assert code == 2 and "--map" in err


def test_a_table_goes_between_its_markers_only(tmp_path):
    page = tmp_path / "page.md"
    marks = [f"<!-- odm bench latency: {side} -->" for side in ("begin", "end")]
    page.write_text(f"before\n{marks[0]}\nold\n{marks[1]}\nafter\n")
    fill_section(page, "latency", "| new |")
    text = page.read_text()
    assert "| new |" in text and "old" not in text
    assert text.startswith("before\n") and text.endswith("\nafter\n")
    with pytest.raises(Exception, match="no section"):
        fill_section(page, "build", "| new |")
    with pytest.raises(Exception, match=r"gone\.md has no section .* add both lines"):
        fill_section(tmp_path / "gone.md", "latency", None)


@pytest.mark.parametrize(
    ("name", "recipe"),
    [("story", "story"), ("latency", "panda"), ("attach", "panda_carry")],
)
def test_a_bench_without_a_map_takes_the_one_it_is_meant_for(
    monkeypatch, tmp_path, name, recipe
):
    import sim.cli.build_command as build

    monkeypatch.chdir(tmp_path)
    folder = Path("maps") / recipe
    monkeypatch.setattr(build, "built_map", lambda made: folder.parent / made.name)
    module = importlib.import_module(bench_modules()[name])
    kept = inspect.signature(module.run)
    asked = []

    def run(**given):
        asked.append(given["map_dir"])
        return {"columns": [], "rows": []}

    run.__signature__ = kept
    monkeypatch.setattr(module, "run", run)
    assert run_bench(name, {}, json="-") == 0
    assert run_bench(name, {"map_dir": Path("mine")}, json="-") == 0
    there = Path("maps/built") / recipe  # the user's own, never replaced
    there.mkdir(parents=True)
    (there / "manifest.json").write_text("{}")
    assert run_bench(name, {}, json="-") == 0
    assert asked == [folder, Path("mine"), there]


def test_the_demo_at_work_has_a_seed_and_prints_its_figures_alone(
    odm, monkeypatch, tmp_path
):
    from sim.cli import run_command
    from sim.run import runner

    def played(request):
        print("tables")
        (tmp_path / "sweep.json").write_text(json.dumps({"seed": request.seed}))

    monkeypatch.setattr(run_command, "built_map", lambda *_: tmp_path)
    monkeypatch.setattr(runner, "run", played)
    code, out, err = odm("demo", "--seed", 3, "--out", tmp_path, "--json")
    assert code == 0 and json.loads(out) == {"seed": 3} and "tables" in err


def test_without_the_panda_the_story_gives_way_to_the_work(odm, monkeypatch):
    from sim.cli import run_command
    from sim.run import runner

    played = []
    monkeypatch.setattr(run_command, "is_there", lambda module: False)
    monkeypatch.setattr(run_command, "built_map", lambda recipe, threads: recipe.name)
    monkeypatch.setattr(runner, "run", lambda asked: played.append(asked.map_dir))
    code, out, _ = odm("demo", "handover")
    assert code == 0 and played == ["demo_plain"]
    assert "instead of a hand-over" in out


NO_GEOMETRY = """<robot name="bare"><link name="base"/><link name="arm"/>
<joint name="a" type="revolute"><parent link="base"/><child link="arm"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>
"""


def test_links_that_are_mostly_in_contact_are_told_at_the_build(odm, tmp_path):
    """A shape that is too large takes poses away, and only `odm info` said so."""
    recipe = tiny_recipe(tmp_path)
    urdf = Path(recipe.robot.source)
    words = ("--robot", urdf, "--tip", "hand", "--nodes", 40, "--out", tmp_path / "map")
    assert "in contact in" not in odm("build", *words)[2]
    ball = '<collision><geometry><sphere radius="0.35"/></geometry></collision>'
    hand = '<link name="hand">'
    urdf.write_text(urdf.read_text().replace(hand, hand + ball))
    code, _, err = odm("build", *words, "--force")
    told = "% of all poses; the robot never goes there: is their collision geometry"
    assert code == 0 and told in " ".join(err.split())


def test_base_links_that_are_only_drawn_are_told_at_the_build(odm, tmp_path):
    urdf = Path(tiny_recipe(tmp_path).robot.source)
    sign = '<visual><geometry><box size="1 1 1"/></geometry></visual>'
    more = f'<link name="sign">{sign}</link><joint name="s" type="fixed">'
    more += '<parent link="base"/><child link="sign"/></joint></robot>'
    urdf.write_text(urdf.read_text().replace("</robot>", more))
    words = ("--robot", urdf, "--tip", "hand", "--nodes", 40, "--out", tmp_path / "map")
    told = "left out: sign; the arm may meet them: give those within its reach"
    assert told in " ".join(odm("build", *words)[2].split())


def test_a_robot_without_any_geometry_is_refused(odm, tmp_path):
    (tmp_path / "bare.urdf").write_text(NO_GEOMETRY)
    words = ("--robot", str(tmp_path / "bare.urdf"), "--tip", "arm")
    code, _, err = odm("build", *words, "--out", str(tmp_path / "map"))
    assert code == 2 and "no link of bare that a joint moves has geometry" in err


@pytest.mark.parametrize("flag", ["--payload", "--close"])
def test_sequences_are_audited_without_what_concerns_pairs(odm, map_dir, flag):
    code, _, err = odm("audit", str(map_dir), "--sequences", "5", flag)
    assert code == 2 and f"{flag} goes with an audit by pairs" in err
