"""`odm workspace`: maps on disk, told in words or JSON, drawn, refused in a line."""

import json

import numpy as np
import pytest
from command_line import one_sentence, started
from small import DATA

from handover import ReachMap, load_reach_map
from sim.draw import style
from sim.draw.map_picture import by_position, fullest_layer, write_reach_plot

ARM = str(DATA / "arm3.urdf")
QUICK = ("--cell", "0.1", "--rotations", "72", "--samples", "5000", "--tip", "tool")


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Build a map in a process of its own; returns folder, output and JSON."""
    folder = tmp_path_factory.mktemp("reach")
    words = [
        "-m",
        "sim.cli.main",
        "workspace",
        "build",
        ARM,
        *QUICK,
        "--json=facts.json",
    ]
    with started([*words, "--plot", "cut.png"], folder, warm={}) as process:
        out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    return folder, out, json.loads((folder / "facts.json").read_text())


def test_a_build_stores_a_map_under_its_name_and_says_what_it_is(built):
    folder, out, facts = built
    place = folder / "maps" / "built" / "reach" / "arm3"
    reach = load_reach_map(place, verify=True)
    assert facts["cells"]["marked"] == reach.n_marked > 100
    assert facts["hash"] == reach.hash and facts["recall"]["recall"] is None
    assert f"{reach.n_marked:,} of" in out and "fewer than 6 joints" in out
    assert (folder / "cut.png").stat().st_size > 10_000
    rows = {row["name"]: row for row in facts["figures"]}
    assert rows["precision in the cell"]["value"] == 100
    size = sum(f.stat().st_size for f in place.iterdir())
    assert rows["size of the files"]["value"] == pytest.approx(1e-6 * size, abs=0.006)
    assert 0 < rows["load"]["value"] < 1000
    assert rows["built in, wall clock"]["value"] == facts["built"]["seconds"]
    assert "recall" not in rows and "centres reached" not in rows
    # limits are asked of one grid only, and this is another
    assert not any(row["asked"] for row in facts["figures"])
    assert all(name in out for name in rows)


def test_what_is_asked_is_told_for_the_grid_it_is_asked_of(monkeypatch, tmp_path):
    from handover import ReachSettings, build_reach_map, chain_of
    from roadmap import load_robot
    from sim.tables import reach_figures

    monkeypatch.setattr(reach_figures, "CELL_M", 0.15)
    monkeypatch.setattr(reach_figures, "ROTATIONS", 72)
    chain = chain_of(load_robot("kawasaki_fs003n", cover_excess=0.2))
    settings = ReachSettings(cell=0.15, rotations=72, samples=20_000)
    reach = build_reach_map(chain, settings, threads=2)
    place = reach.save(tmp_path / "reach")
    stages = set()
    rows, recall = reach_figures.measured(
        reach, place, chain, 200, lambda stage, done, n: stages.add(stage)
    )
    found = {row["name"]: row for row in rows}
    assert found["recall"]["value"] == pytest.approx(100 * recall.recall, abs=0.01)
    assert found["recall"]["asked"] == {"least": 97.0}
    assert found["precision in the cell"]["asked"] == {"least": 99.0}
    assert found["built in, wall clock"]["asked"] == {"most": 30.0}
    assert 0 < found["centres reached"]["value"] <= 100
    share = reach.built["cpu_seconds"] / 2
    assert found["processor time by thread"]["value"] == pytest.approx(share, abs=0.01)
    assert {"random poses", "witnesses", "centres of cells"} <= stages


def test_the_same_seed_builds_the_same_map(built, odm, tmp_path):
    options = ("--out", str(tmp_path / "again"), "--threads", "1", "--recall", "0")
    code, out, _ = odm("workspace", "build", ARM, *QUICK, *options, "--json=-")
    assert code == 0
    assert json.loads(out)["hash"] == built[2]["hash"]
    facts = json.loads(out)
    assert "recall" not in facts
    assert "centres reached" not in [row["name"] for row in facts["figures"]]


def test_info_tells_the_same_and_sees_an_altered_byte(built, odm, tmp_path):
    import shutil

    place = tmp_path / "copy"
    shutil.copytree(built[0] / "maps/built/reach/arm3", place)
    code, out, _ = odm("workspace", "info", str(place), "--json=-")
    facts = json.loads(out)
    assert code == 0 and facts["cells"] == built[2]["cells"]
    data = bytearray((place / "quality.npy").read_bytes())
    data[-1] ^= 1
    (place / "quality.npy").write_bytes(bytes(data))
    code, out, err = odm("workspace", "info", str(place))
    assert code == 2 and one_sentence(err) and "altered" in err


@pytest.mark.parametrize(
    "words",
    [
        ("info", "no/such/map"),
        ("build", "no_such_robot"),
        ("build", ARM, "--tip", "nose"),
        ("build", ARM, "--tip", "tool", "--cell", "-1"),
        ("build", ARM, "--tip", "tool", "--cell", "0.001", "--out", "x"),
        ("build", ARM, "--tip", "tool", "--rotations", "100"),
        ("build", ARM, "--tip", "tool", "--samples", "3"),
        ("build", ARM, "--tip", "tool", "--lock", "a=1", "--out", "x"),
    ],
)
def test_a_mistake_is_told_in_one_sentence(odm, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = odm("workspace", *words)
    assert code == 2 and out == "" and one_sentence(err), err
    assert not list(tmp_path.iterdir())


def test_what_is_no_reach_map_is_left_alone(odm, tmp_path):
    (tmp_path / "letter.txt").write_text("dear")
    code, _, err = odm("workspace", "build", ARM, *QUICK, "--out", str(tmp_path))
    assert code == 2 and "left alone" in err
    assert [p.name for p in tmp_path.iterdir()] == ["letter.txt"]


def test_the_picture_shows_what_the_map_holds(built, tmp_path, monkeypatch):
    reach = load_reach_map(built[0] / "maps/built/reach/arm3")
    best, share = by_position(reach)
    dense = reach.dense().reshape(*reach.grid.shape, -1)
    np.testing.assert_allclose(best, dense.max(axis=-1) / 255)
    np.testing.assert_allclose(share, (dense > 0).mean(axis=-1))
    assert fullest_layer(share, 2) == (dense > 0).sum(axis=(0, 1, 3)).argmax()
    assert isinstance(reach, ReachMap)
    drawn, save = [], style.save
    monkeypatch.setattr(
        style, "save", lambda f, *p, **k: drawn.append(f) or save(f, *p)
    )
    assert write_reach_plot(reach, tmp_path / "a.png").is_file()
    titles = [axis.get_title(loc="left") for axis in drawn[0].axes[:4]]
    assert all(title.endswith(f" {reach.chain.unit}") for title in titles)
    labels = {axis.get_ylabel() for axis in drawn[0].axes[4:]}
    assert "share of all rotations" in labels
