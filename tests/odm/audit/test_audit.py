"""The audit finds nothing on a sound map, and finds what was taken away."""

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from odm.audit import audit as audits
from odm.audit.audit import Auditor, audit
from odm.audit.audit_library import FAMILIES, _mesh, draw_specimens
from odm.audit.audit_targets import audit_solids
from odm.audit.sabotage import most_needed_sphere, part_of, spoiled
from odm.cell_map.build import build_map
from odm.cell_map.recipe import Recipe, RobotRecipe
from odm.exact.distances import ExactRobot
from odm.obstacles.shapes import Mesh
from odm.obstacles.surfaces import surface_of
from roadmap.errors import BadInput
from roadmap.graph.connecting import RoadmapSettings
from roadmap.kinematics.forward import difference
from roadmap.transforms import moved_points

ARM = """
<robot name="stick">
  <link name="base"/>
  <joint name="a" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>
    <limit lower="-2.5" upper="2.5" velocity="2" effort="1"/></joint>
  <link name="upper"><collision><origin xyz="0.15 0 0" rpy="0 1.5708 0"/>
    <geometry><cylinder radius="0.05" length="0.3"/></geometry></collision></link>
  <joint name="b" type="revolute"><parent link="upper"/><child link="fore"/>
    <origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="2" effort="1"/></joint>
  <link name="fore"><collision><origin xyz="0.15 0 0"/>
    <geometry><box size="0.3 0.06 0.08"/></geometry></collision></link>
  <joint name="c" type="prismatic"><parent link="fore"/><child link="tip"/>
    <origin xyz="0.3 0 0"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.1" velocity="1" effort="1"/></joint>
  <link name="tip"><collision><geometry><sphere radius="0.03"/></geometry></collision>
  </link>
</robot>
"""


@pytest.fixture(scope="module")
def cell_map(tmp_path_factory):
    urdf = tmp_path_factory.mktemp("arm") / "stick.urdf"
    urdf.write_text(ARM)
    recipe = Recipe(
        "stick",
        RobotRecipe(str(urdf), tip="tip", cover_excess=0.03),
        RoadmapSettings(nodes=60, neighbors=6),
    )
    return build_map(recipe, threads=1)


def auditor_of(cell_map, seed):
    rng = np.random.default_rng(seed)
    return Auditor(cell_map, seed, False, draw_specimens(27, 0.03, rng))


@pytest.fixture(scope="module")
def report(cell_map):
    return audit(cell_map, pairs=4000, seed=1, threads=1)


def test_a_sound_map_passes(report):
    assert report.passed, str(report)
    assert report.violations == 0 and report.unresolved == 0
    assert report.smallest >= report.m
    assert report.free_share >= 0.2
    assert report.boundary >= 0.4 * report.pairs
    assert report.pairs == 4000
    assert all(row[1] > 0 for row in report.families.values())
    assert json.loads(json.dumps(report.as_dict(), allow_nan=False))["passed"]


def test_a_sound_close_test_passes(cell_map):
    report = audit(cell_map, pairs=3000, close=True, threads=1)
    assert report.passed, str(report)


def test_more_is_resolved_where_the_clearance_is_large(cell_map, monkeypatch):
    monkeypatch.setattr(audits, "CAP", 0.5 * cell_map.safety.m)
    report = audit(cell_map, pairs=300, threads=1)
    assert report.passed and report.free_share > 0.2, str(report)


def test_a_mesh_is_sampled_however_fine_the_map_is():
    mesh = _mesh(0.0008, np.random.default_rng(16))  # was refused as too large
    assert len(mesh.points) > 500


def test_a_corner_at_the_very_centre_of_a_sphere_is_aimed_at(cell_map):
    robot = cell_map.robot
    corner = [0.3, 0.03, 0.04, 1.0]  # of the forearm's box
    body = robot.link_body[robot.link_names.index("fore")]
    spheres = np.where((robot.sphere_body == body)[:, None], corner, robot.spheres)
    solids = audit_solids(replace(robot, spheres=spheres), np.random.default_rng(0))
    assert np.isfinite(solids.targets).all()
    there = np.isclose(solids.targets[:, :3], [0.15, 0.03, 0.04]).all(axis=1)
    assert (solids.targets[there, 3:] @ corner[:3] > 0.0).all() and there.sum() > 20


@pytest.mark.parametrize("term", ["rho", "mu", "sphere"])
def test_a_map_without_one_term_fails(cell_map, term):
    report = audit(cell_map, pairs=8000, sabotage=term, threads=1)
    assert not report.passed
    assert report.violations > 0
    assert report.worst[0].distance < report.m
    assert "FAILED" in str(report)


def test_an_unknown_sabotage_is_refused(cell_map):
    with pytest.raises(BadInput, match="choose one of rho, mu, sphere"):
        audit(cell_map, pairs=10, sabotage="nonsense")


def test_the_seed_decides_not_the_threads(cell_map):
    one = audit(cell_map, pairs=4500, seed=5, threads=1).as_dict()
    two = audit(cell_map, pairs=4500, seed=5, threads=2).as_dict()
    other = audit(cell_map, pairs=4500, seed=6, threads=2).as_dict()
    for plain in (one, two, other):
        del plain["seconds"]
    assert one == two
    assert one["worst"] != other["worst"]


def test_ctrl_c_keeps_what_was_done(cell_map):
    def stop(stage, done, total):
        if stage == "pairs":
            raise KeyboardInterrupt

    report = audit(cell_map, pairs=10_000, threads=1, progress=stop)
    assert 0 < report.pairs < 10_000
    assert not report.complete and not report.passed


def test_every_case_can_be_run_again_without_the_compiled_loop(cell_map):
    """Cells by set arithmetic, distance by `ExactRobot`: same verdict, same number."""
    auditor, exact = auditor_of(cell_map, 3), ExactRobot(cell_map.robot)
    pairs, found = auditor.run_chunk(0, 300)
    assert 60 < found.free.sum() < 300
    for k in range(0, len(found.free), 3):
        case = auditor.case(pairs, found, k)
        points = points_of(auditor, case)
        if case.motion >= 0:
            a, b = cell_map.roadmap.edges[case.motion]
            items = (a, b, cell_map.roadmap.n_nodes + case.motion)
            q_a, q_b = cell_map.roadmap.nodes[a], cell_map.roadmap.nodes[b]
            q = q_a + case.t * difference(cell_map.robot, q_a, q_b)
            assert np.allclose(case.q, q)
        else:
            items = (-1 - case.motion,)
        if found.boundary[k] or not np.isnan(pairs.start[k]):
            assert found.free[k] == (not shares_cell(cell_map, points, items))
        if found.free[k]:
            shapes = auditor.specimens[case.specimen].shapes
            there = [shape.moved(case.T_base_obstacle) for shape in shapes]
            near = exact.distance(case.q, there, cap=audits.CAP)
            assert near.distance == pytest.approx(case.distance, abs=1e-7)


def points_of(auditor, case):
    """Return the samples of a case's obstacle where it stood, (n, 3)."""
    return moved_points(auditor.specimens[case.specimen].points, case.T_base_obstacle)


def shares_cell(cell_map, points, items):
    """Say whether a point lies in a swept cell of one of the items."""
    lists, (_, ny, nz) = cell_map.arm_cells.by_item, cell_map.grid.blocks.tolist()
    cells = cell_map.grid.locate(points).tolist()
    for item in items:
        rows = range(lists.ptr[item], lists.ptr[item + 1])
        masks = {int(lists.block[k]): int(lists.mask[k]) for k in rows}
        for x, y, z in cells:
            block = (x // 4 * ny + y // 4) * nz + z // 4
            bit = 16 * (x % 4) + 4 * (y % 4) + z % 4
            if x >= 0 and masks.get(block, 0) >> bit & 1:
                return True
    return False


def test_boundary_pairs_lie_at_the_boundary(cell_map):
    """A little further in, the map calls the motion blocked."""
    auditor = auditor_of(cell_map, 4)
    pairs, found = auditor.run_chunk(0, 200)
    at = np.flatnonzero(found.boundary & (pairs.motion < 0))
    assert len(at)
    for k in at[:20]:
        case = auditor.case(pairs, found, int(k))
        points = points_of(auditor, case)
        assert not shares_cell(cell_map, points, (-1 - case.motion,))
        edges = cell_map.grid.origin + cell_map.grid.h * np.arange(400)[:, None]
        gap = np.abs(points[:, :, None] - edges.T[None]).min(axis=2)
        assert gap.min() < 1e-4  # some sample is about to enter another cell


def many_points(shape, spacing):
    if not isinstance(shape, Mesh):
        return surface_of(shape, spacing).points
    mesh = trimesh.Trimesh(shape.vertices, shape.faces)
    return np.concatenate([trimesh.sample.sample_surface(mesh, 4000)[0], mesh.vertices])


@pytest.mark.parametrize("rho", [0.03, 0.012])
def test_every_sampling_of_the_audit_is_legal(rho):
    specimens = draw_specimens(2 * len(FAMILIES), rho, np.random.default_rng(0))
    worst = 0.0
    for one in specimens:
        for shape in one.shapes:
            dense = many_points(shape, rho / 8)
            far = cKDTree(one.points).query(dense)[0].max()
            assert far <= rho, one.family
            worst = max(worst, far)
        tree = cKDTree(one.points)
        assert (tree.query(one.aims[:, :3])[0] <= rho).all()
    assert worst > 0.95 * rho  # and as sparse as legal allows


def test_aims_are_points_of_their_obstacles():
    for one in draw_specimens(2 * len(FAMILIES), 0.03, np.random.default_rng(1)):
        clouds = [many_points(shape, 0.004) for shape in one.shapes]
        near = cKDTree(np.concatenate(clouds)).query(one.aims[:, :3])[0]
        assert (near <= 0.0041).all(), one.family


def test_a_small_copy_keeps_a_connected_part(cell_map):
    part = part_of(cell_map.roadmap, 20)
    assert part.n_nodes == 20
    assert part.n_edges >= 19
    assert part.edges.max() < 20


def test_the_sphere_taken_away_is_needed(cell_map):
    sphere, depth = most_needed_sphere(cell_map.robot)
    assert cell_map.robot.sphere_body[sphere] > 0
    assert depth > 0.005
    lame = spoiled(cell_map, "sphere", 20)
    assert lame.arm_cells.n_entries > 0 and lame.safety == cell_map.safety
