"""The roadmap: reproducible, connected, and handed out as a graph."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra

from roadmap import load_robot
from roadmap.errors import BadInput, BuildRefused, NothingFree
from roadmap.graph.connecting import RoadmapSettings, build_roadmap
from roadmap.graph.sampling import SAMPLERS, draw


def everything_free(q, dq):
    return np.ones(len(q), bool)


def nothing_free(q, dq):
    return np.zeros(len(q), bool)


def asking(motions_free):
    """Return the test of many chunks by one of a chunk."""
    return lambda stage, parts: (motions_free(*part) for part in parts)


def test_halton_draws_what_maps_were_built_of():
    """Another version of scipy may scramble otherwise: maps would have other bytes."""
    robot = SimpleNamespace(dof=3, lower=np.zeros(3), upper=np.ones(3))
    drawn = draw(robot, "halton", 1, 0, None)
    rows = [next(drawn)[0].tolist() for _ in range(2)]
    assert rows == [
        [0.8266998079256848, 0.5345619081195782, 0.09241988789982591],
        [0.8262115266756848, 0.9140772259065009, 0.5352998878998261],
    ]


def test_every_edge_stands_in_the_lists_of_both_its_nodes(small_map):
    roadmap = small_map.roadmap
    for edge, (a, b) in enumerate(roadmap.edges):
        for here, there in ((a, b), (b, a)):
            own = slice(roadmap.adj_ptr[here], roadmap.adj_ptr[here + 1])
            k = np.flatnonzero(roadmap.adj_edge[own] == edge)
            assert len(k) == 1
            assert roadmap.adj_node[own][k[0]] == there


def test_landmarks_never_exceed_the_true_distance(small_map):
    roadmap = small_map.roadmap
    true = dijkstra(roadmap.to_sparse())
    for column in roadmap.landmarks.T:
        bound = np.abs(column[:, None] - column[None, :])
        assert (bound <= true + 1e-9).all()


@pytest.mark.parametrize("sampling", SAMPLERS)
def test_every_sampler_stays_within_limits_and_repeats_itself(small_map, sampling):
    robot = small_map.robot
    first = next(draw(robot, sampling, 4, 500, None))
    again = next(draw(robot, sampling, 4, 500, None))
    assert np.array_equal(first, again)
    assert ((first >= robot.lower) & (first <= robot.upper)).all()


def test_a_region_draws_the_tool_into_it(small_map):
    from roadmap import tool_pose

    robot = small_map.robot
    region = np.array([[0.0, -1.0, 0.0], [1.0, 1.0, 2.0]])
    q = next(draw(robot, "uniform", 1, 500, region))
    inside = np.mean([tool_pose(robot, row)[0, 3] >= 0 for row in q])
    assert inside > 0.8


def test_an_unknown_sampler_lists_the_known_ones(small_map):
    with pytest.raises(BadInput, match="halton"):
        next(draw(small_map.robot, "sobol", 1, 10, None))


def test_components_are_reported_and_only_the_largest_is_kept(small_map):
    def halves(q, dq):  # nothing crosses q[0] = 0.3
        return np.sign(q[:, 0] - 0.3) == np.sign(q[:, 0] + dq[:, 0] - 0.3)

    settings = RoadmapSettings(nodes=120, neighbors=5, seed=2)
    roadmap, report = build_roadmap(small_map.robot, settings, asking(halves))
    assert len(report.components) >= 2
    assert sum(report.components) == 120
    assert roadmap.n_nodes == report.components[0]
    side = np.sign(roadmap.nodes[:, 0] - 0.3)
    assert (side == side[0]).all()


def test_a_place_with_no_valid_configuration_is_refused(small_map):
    settings = RoadmapSettings(nodes=50, neighbors=4)
    with pytest.raises(BuildRefused, match="only 0 of"):
        build_roadmap(small_map.robot, settings, asking(nothing_free))


def test_links_that_touch_in_many_poses_are_named_then(tmp_path):
    """An arm whose last link folds back onto the base."""
    box = '<collision><origin xyz="{} 0 0"/><geometry><box size="{} 0.1 0.1"/>'
    box += "</geometry></collision>"
    links = {
        "base": box.format(0.2, 0.4),
        "upper": box.format(0, 0.1),
        "fore": box.format(0.1, 0.4),
    }
    joints = (("a", "base", "upper", 0.5), ("b", "upper", "fore", 0.0))
    urdf = '<robot name="folded">'
    urdf += "".join(f'<link name="{k}">{v}</link>' for k, v in links.items())
    for name, parent, child, x in joints:
        urdf += f'''<joint name="{name}" type="revolute"><parent link="{parent}"/>
            <child link="{child}"/><origin xyz="{x} 0 0"/><axis xyz="0 0 1"/>
            <limit lower="-3" upper="3" velocity="1" effort="1"/></joint>'''
    path = tmp_path / "folded.urdf"
    path.write_text(urdf + "</robot>", encoding="utf-8")
    settings = RoadmapSettings(nodes=50, neighbors=4)
    with pytest.raises(BuildRefused, match=r"base and fore touch in \d+%.*--lock"):
        build_roadmap(load_robot(path), settings, asking(nothing_free))


def test_weights_of_the_wrong_number_are_refused(small_map):
    settings = RoadmapSettings(nodes=50, neighbors=4, weights=(1.0, 2.0))
    with pytest.raises(BuildRefused, match="2 joint weights"):
        build_roadmap(small_map.robot, settings, asking(everything_free))


def test_a_roadmap_that_would_have_no_edges_is_refused(small_map):
    def still(q, dq):  # every node, and no motion
        return (dq == 0.0).all(axis=1)

    settings = RoadmapSettings(nodes=50, neighbors=4)
    with pytest.raises(NothingFree, match="none of .* no edges; give more nodes"):
        build_roadmap(small_map.robot, settings, asking(still))
    near = RoadmapSettings(nodes=2, neighbors=1, max_step=1e-3)
    with pytest.raises(BuildRefused, match="no two of 2 nodes lie within max_step"):
        build_roadmap(small_map.robot, near, asking(everything_free))
