"""The page itself, with clients that shake hands, leave and flood."""

import asyncio
import io
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from handover.human.human import Human
from sim.record import read_record
from sim.view import theme
from sim.view.blocked import thickness_of
from sim.view.gate import listening
from sim.view.robot_shapes import (
    Part,
    drawn_parts,
    link_frames,
    robot_parts,
    solid_parts,
)
from sim.view.sources import Recorded

viser = pytest.importorskip("viser")
websockets = pytest.importorskip("websockets")


@pytest.fixture(scope="module")
def page(view_file, view_map, ending):
    from sim.view.page import Page, Show

    source = Recorded(read_record(view_file))
    taken = []
    show = Show(
        source,
        source.robot,
        load_parts=lambda: (solid_parts(source.robot), ""),
        load_map=lambda: view_map,
        hand=taken.append,
        layers=("cells", "blocked"),
    )
    made = Page(show, listening("127.0.0.1", 0), "127.0.0.1", "")
    made.taken = taken
    runs = threading.Thread(target=made.run, daemon=True)
    runs.start()
    yield made
    made.stop()
    ending.append(runs)


def connect(page):
    return websockets.connect(
        f"ws://127.0.0.1:{page.gate.port}",
        subprotocols=[f"viser-v{viser.__version__}"],
        max_size=None,
        compression=None,
    )


async def heard(page, seconds):
    """Return how many bytes and messages a client is told."""
    sizes = []
    async with connect(page) as line:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            try:
                sizes.append(len(await asyncio.wait_for(line.recv(), 0.2)))
            except TimeoutError:
                pass
    return sum(sizes), len(sizes)


def test_a_client_that_shakes_hands_is_sent_the_scene(page):
    size, count = asyncio.run(heard(page, 0.6))
    assert count > 0 and size > 10_000


def test_a_client_of_another_version_is_sent_away(page):
    async def ask():
        address = f"ws://127.0.0.1:{page.gate.port}"
        async with websockets.connect(address, subprotocols=["viser-v0"]) as line:
            await line.recv()

    with pytest.raises(websockets.exceptions.ConnectionClosed):
        asyncio.run(ask())


def test_clients_that_leave_or_say_nonsense_do_not_stop_the_page(page):
    async def trouble():
        for _ in range(5):
            async with connect(page) as line:
                for _ in range(50):
                    await line.send(b"\x00\xff" * 100)
                line.transport.abort()

    asyncio.run(trouble())
    size, _ = asyncio.run(heard(page, 0.4))
    assert size > 10_000


def test_the_hand_is_nobodys_while_nobody_is_there(page):
    time.sleep(0.2)
    assert page.taken and page.taken[-1] is None


def test_commands_of_a_flood_are_dropped_but_the_last(page):
    panel = page.panel
    for i in range(10_000):
        panel._do(lambda t=i: page.playback.seek(t / 1e4))
    for _ in range(100):
        if page.playback.at == pytest.approx(0.9999):
            break
        time.sleep(0.05)
    assert page.playback.at == pytest.approx(0.9999)


def test_the_floor_is_below_who_stands_lower_than_the_base(page):
    stage, moment = page.stage, page.shown.source.at(1.0)
    floor = stage.scene.get_handle_by_name("/floor")
    before = floor.position[2]
    person = Human().capsules() + [1, 0, -0.5, 1, 0, -0.5, 0]
    stage.draw(replace(moment, capsules=person), 0.0)
    lowest = np.minimum(person[:, 2], person[:, 5]) - person[:, 6]
    assert floor.position[2] == pytest.approx(lowest.min(), abs=0.003) and before > -0.1
    head = stage.scene.get_handle_by_name("/person/part_8")
    assert tuple(head.color) == theme.SKIN
    stage.draw(moment, 0.0)  # it does not rise again
    assert floor.position[2] < -0.3


def test_a_turn_draws_cells_and_blocked_edges_once_the_map_is_there(page):
    for _ in range(100):
        if page.stage.cell_map is not None:
            break
        time.sleep(0.05)
    moment = page.shown.source.at(1.0)
    page.stage.draw(moment, 1e9)
    assert page.stage.scene.get_handle_by_name("/cells") is not None
    assert page.stage.scene.get_handle_by_name("/edges") is None  # hidden: not sent
    page.stage.show("edges", True)
    assert page.stage.n_blocked > 0
    assert thickness_of(3000) == 0.1 and thickness_of(10**6) == 0.05 < thickness_of(0)
    edges = page.stage.scene.get_handle_by_name("/edges")
    drawn = trimesh.load(io.BytesIO(edges.glb_data), file_type="glb", process=False)
    (lines,) = drawn.geometry.values()
    n_edges = page.stage.cell_map.roadmap.n_edges
    assert len(lines.vertices) == 2 * n_edges
    segments = page.stage.roadmap.segments.astype(np.float32)
    np.testing.assert_array_equal(lines.vertices, segments.reshape(-1, 3))


def test_only_layers_that_can_have_something_are_offered(page):
    boxes = page.panel._boxes
    assert {name for name, box in boxes.items() if not box.visible} == {
        *("points", "before"),  # no recording has them
        "still",  # nothing stands around here
    }


def test_the_robots_visual_meshes_stand_where_its_links_do(crane_urdf, crane):
    from roadmap.kinematics.forward import body_frames
    from roadmap.robot.description import read_description

    frames = link_frames(read_description(crane_urdf), crane, np.array([0.4, -0.7]), {})
    bodies = body_frames(crane, np.array([0.4, -0.7]))
    for name, body in zip(crane.link_names, crane.link_body, strict=True):
        np.testing.assert_allclose(frames[name], bodies[body], atol=1e-12)


def test_a_mesh_has_as_few_faces_as_were_asked_and_its_shape():
    ball = trimesh.creation.icosphere(5, 0.1)
    some = [Part(1, ball), Part(2, trimesh.creation.box([0.1] * 3), (1, 2, 3))]
    assert drawn_parts(some, 30_000) is some  # few already: as they are
    round_, box = drawn_parts(some, 3_000)
    assert 300 < len(round_.mesh.faces) + len(box.mesh.faces) <= 3_000
    assert (round_.body, box.body, box.colour) == (1, 2, (1, 2, 3))
    far = np.linalg.norm(round_.mesh.vertices, axis=1)
    assert 0.09 < far.min() and far.max() <= 0.1 + 1e-9
    assert round_.mesh.volume == pytest.approx(ball.volume, rel=0.1)
    np.testing.assert_allclose(box.mesh.bounds, some[1].mesh.bounds)


def test_a_robot_without_visual_geometry_is_drawn_by_its_solids(crane_urdf, crane):
    parts, told = robot_parts(crane, str(crane_urdf))
    assert len(parts) == len(crane.solid_kind)
    assert told.startswith("the robot is drawn by its collision solids")
    parts, told = robot_parts(crane, "/nowhere/robot.urdf")
    assert len(parts) == len(crane.solid_kind) and "/nowhere/robot.urdf" in told
