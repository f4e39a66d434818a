"""A recording needs nothing but its file; what it lacks is said in one sentence."""

from dataclasses import replace

import numpy as np
import pytest

from roadmap.errors import BadInput
from sim.cli import main, view
from sim.record import read_record, write_record

pytest.importorskip("viser")


def test_without_its_map_a_recording_says_what_is_missing(
    view_file, view_map, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    show = view.recorded_show(view.ViewRequest(file=view_file))
    assert show.load_map is None and show.robot.name == "crane"
    told = [s for s in show.sentences if "roadmap are not shown" in s]
    assert len(told) == 1 and "--map" in told[0] and view_map.hash[:12] in told[0]


def test_a_beginning_after_its_end_is_refused(view_file):
    typer_testing = pytest.importorskip("typer.testing")
    asked = ["view", str(view_file), "--at", "99", "--port", "0"]
    done = typer_testing.CliRunner().invoke(main.app, asked)
    assert done.exit_code == 2
    assert f"--at is 99 s, but {view_file} ends at 2.49 s; give" in done.stderr


def test_with_its_map_it_has_cells_and_edges(view_file, view_map, tmp_path):
    folder = view_map.save(tmp_path / "map")
    show = view.recorded_show(view.ViewRequest(file=view_file, map_dir=folder))
    assert show.load_map().hash == view_map.hash
    assert not [s for s in show.sentences if "not shown" in s]


def test_another_map_is_refused(view_file, view_map, tmp_path):
    record = read_record(view_file)
    head = record.head | {"map": record.head["map"] | {"hash": "0" * 64}}
    path = write_record(replace(record, head=head), tmp_path / "run.npz")
    folder = view_map.save(tmp_path / "map")
    with pytest.raises(BadInput, match="was recorded on map crane 000000000000, but"):
        view.recorded_show(view.ViewRequest(file=path, map_dir=folder))


def test_what_stood_around_is_shown_without_the_map(view_file, tmp_path):
    assert view.recorded_show(view.ViewRequest(file=view_file)).still.shape == (0, 3, 3)
    record = read_record(view_file)
    pose = np.eye(4)
    pose[:3, 3] = 0.5, 0.2, 0.1
    part = {"kind": "Box", "size": [0.2, 0.2, 0.2], "T_base_shape": np.eye(4).tolist()}
    row = {"name": "crate", "pose": pose.tolist(), "parts": [part]}
    path = write_record(
        replace(record, head=record.head | {"scene": [row]}), tmp_path / "a.npz"
    )
    still = view.recorded_show(view.ViewRequest(file=path)).still.reshape(-1, 3)
    assert np.allclose(still.min(axis=0), [0.4, 0.1, 0.0])
    assert np.allclose(still.max(axis=0), [0.6, 0.3, 0.2])
