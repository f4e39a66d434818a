"""`odm bench scene` runs, and its rows say what is asked."""

import pytest

from sim.bench.command import markdown_of
from sim.bench.core import scene


@pytest.fixture(scope="module")
def result(small_map, tmp_path_factory):
    folder = small_map.save(tmp_path_factory.mktemp("map") / "arm3")
    return scene.run(folder, short=True)


def test_a_short_run_measures_each_part(result):
    rows = {row["name"]: row for row in result["rows"]}
    assert rows["scene.add, box"]["asked"] == {"p99": 5000.0}
    assert rows["scene.add, mesh of 320 triangles"]["n"] == 4
    assert rows["set_goals of one pose"]["asked"] == {"p50": 5000.0, "p99": 20000.0}
    assert rows["... poses with a valid solution"]["value"] > 60
    assert rows["attach a ball, no payload layer"]["n"] == 1
    assert "scene.add, box" in markdown_of(result)


def test_the_mesh_is_closed_and_not_convex():
    import trimesh

    mesh = scene.dented_ball(4)
    whole = trimesh.Trimesh(mesh.vertices, mesh.faces)
    assert len(mesh.faces) == 5120 and whole.is_watertight and not whole.is_convex
