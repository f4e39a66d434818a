"""The page: viser, the gate before it, and the loop that draws what there is."""

import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
import rich
import viser

from odm.cell_map.cell_map import CellMap
from roadmap.errors import PlanningError
from roadmap.robot.robot import Robot
from sim.view import theme
from sim.view.blocked import RoadmapPicture
from sim.view.gate import LOCAL, Gate
from sim.view.moment import Moment
from sim.view.panel import Panel
from sim.view.playback import Playback
from sim.view.robot_shapes import Part, solid_parts
from sim.view.sources import Source
from sim.view.stage import Stage

RATE_HZ = 30.0  # pictures a second
_IDLE_S = 0.05  # from look to look while nobody watches
_LAST_S = 0.3  # so long the last words may take to the clients [s]
_WHOLE = 8  # so many capsules are a whole person
_SAME_PLACE = 1e-3  # a camera this near to a place is at it [m]
_FAR = 3.0  # a hand is not dragged farther from the base [m]


@dataclass(frozen=True, eq=False)
class Show:
    """What a page shows."""

    source: Source  # moments
    robot: Robot  # the robot
    label: str = "odm"  # title of the panel
    sentences: list[str] = field(default_factory=list)  # what is not shown, and why
    # returns the robot's meshes, and a sentence about what is missing; until then, and
    # without it, its collision solids are drawn
    load_parts: Callable[[], tuple[list[Part], str]] | None = None
    # returns the map; both are asked beside the drawing, for they may take a second;
    # None: there is no map
    load_map: Callable[[], CellMap] | None = None
    # is told in each turn where the person's hand is dragged to, (3,) [m] or None;
    # None: it cannot be dragged
    hand: Callable[[np.ndarray | None], None] | None = None
    layers: tuple[str, ...] = ()  # layers that are shown once the map is there
    # (n, 3, 3) triangles of what stands around [m]
    still: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    # returns of the robot's meshes how low robot and people come in the whole run [m],
    # where it is known: that low the floor is; None: it sinks as they come lower
    lowest: Callable[[list[Part]], float] | None = None


class _Server(viser.ViserServer):
    """viser without its way out to the internet, which any client could ask for."""

    def request_share_url(self, verbose: bool = True) -> None:
        """Share nothing."""


class Page:
    """Serves what is shown until it is told to stop.

    Args:
        show: What.
        listener: A socket that listens, see `sim.view.gate.listening`.
        host: The address it was opened for.
        token: What a client has to know; "": nothing.

    Attributes:
        gate: What stands between that socket and the server.
        drawn: Moments drawn so far.
    """

    def __init__(self, show: Show, listener: object, host: str, token: str) -> None:
        rich.get_console().quiet = True  # viser's own words on stdout
        self.shown, self.drawn = show, 0
        self.server = _Server(host=LOCAL, port=0, label=show.label, verbose=False)
        self.server.gui.configure_theme(show_logo=False, show_share_button=False)
        source = show.source
        self.playback = Playback(*source.span(), source.live)
        with self.server.atomic():
            parts = solid_parts(show.robot)
            self.stage = Stage(self.server.scene, show.robot, parts)
            self.stage.stand(show.still)
            if show.lowest is not None:
                self.stage.sink(show.lowest(parts))
            self.panel = Panel(
                self.server.gui,
                source,
                self.playback,
                self.stage,
                show.hand is not None,
            )
        self.panel.sentences = list(show.sentences)
        self._gizmo = self.server.scene.add_transform_controls(
            "/hand", scale=0.22, disable_rotations=True, depth_test=False, visible=False
        )
        self._came: deque[Callable[[], None]] = deque()  # what was loaded
        self._stop = threading.Event()
        self._seen: set[int] = set()  # clients whose camera was set
        self._placed = False  # whether a camera was placed by a moment with a person
        self.gate = Gate(listener, self.server.get_port(), host, token)
        threading.Thread(target=self._load, daemon=True, name="load").start()

    def _load(self) -> None:
        """Load beside the drawing what takes a while."""
        show = self.shown
        if show.load_map is not None:
            try:
                cell_map = show.load_map()
                picture = RoadmapPicture(cell_map)
                self._came.append(lambda: self.stage.set_map(cell_map, picture))
                self._came.append(lambda: self.panel.map_came(show.layers))
            except PlanningError as error:
                self.panel.sentences.append(f"cells and edges are not shown: {error}")
        if show.load_parts is not None:
            parts, missing = show.load_parts()
            if missing:
                self.panel.sentences.append(missing)
            else:
                self._came.append(lambda: self.stage.set_parts(parts))

    def stop(self) -> None:
        """End `run`, from any thread."""
        self._stop.set()

    def run(self, alive: Callable[[], bool] = lambda: True) -> None:
        """Draw until `stop`, or until `alive()` is false."""
        before = time.perf_counter()
        try:
            while not self._stop.is_set() and alive():
                now = time.perf_counter()
                self.turn(now, now - before)
                before = now
                took = time.perf_counter() - now
                self._stop.wait(max(1.0 / RATE_HZ - took, 0.001))
        finally:
            self._tell_end()
            self.gate.close()
            with suppress(RuntimeError):
                self.server.stop()

    def _tell_end(self) -> None:
        """Say so on the pages that are open, which cannot be told later."""
        if not self.server.get_clients():
            return
        with suppress(RuntimeError):
            self.panel.tell_end()
            self.server.flush()
        time.sleep(_LAST_S)

    def turn(self, clock: float, passed: float) -> None:
        """Draw one picture, `passed` seconds after the last one."""
        source, playback = self.shown.source, self.playback
        source.poll()
        self.panel.obey()
        playback.span(*source.span())
        playback.advance(passed)
        clients = self.server.get_clients()
        while self._came:
            with self.server.atomic():
                self._came.popleft()()
        if not clients:
            self.panel.let_go()
        moment = source.at(playback.at)
        waits = moment is None
        if waits:
            robot = self.shown.robot
            moment = Moment(0.0, np.clip(0.0, robot.lower, robot.upper))
        self._drag(moment)
        if not clients and self._placed:
            self._seen.clear()
            time.sleep(_IDLE_S)
            return
        with self.server.atomic():
            self.stage.draw(moment, clock)
            self.panel.draw(moment, clock)
        self.drawn += 1
        self._place_cameras(moment, clients, waits)

    def _drag(self, moment: Moment) -> None:
        """Show the arrows at the hand while it is taken, and tell where they are."""
        if self.shown.hand is None:
            return
        taken = self.panel.takes_hand and len(moment.capsules) > 0
        if taken and not self._gizmo.visible:
            self._gizmo.position = moment.capsules[-1, 3:6]
        if taken != self._gizmo.visible:
            self._gizmo.visible = taken
        place = np.asarray(self._gizmo.position, float)
        sound = taken and np.isfinite(place).all()
        self.shown.hand(np.clip(place, -_FAR, _FAR) if sound else None)

    def _place_cameras(self, moment: Moment, clients: dict, waits: bool) -> None:
        """Let new clients see robot and person, whatever the shape of their window."""
        whole = not waits
        if whole and not self._placed:
            self._placed = True
            self._seen.clear()
            eye, target = theme.eye_on(*self.stage.bounds(moment), side=_side(moment))
            camera = self.server.initial_camera
            camera.position, camera.look_at = eye, target
            camera.fov = theme.FOV
        for number, client in clients.items():
            if not whole or number in self._seen and not self._reset(client.camera):
                continue
            self._seen.add(number)
            size = client.camera.image_width, client.camera.image_height
            bounds = self.stage.bounds(moment)
            eye, target = theme.eye_on(*bounds, size, _side(moment))
            with suppress(AssertionError, RuntimeError):  # it has left meanwhile
                client.camera.fov = theme.FOV
                client.camera.position = eye
                client.camera.look_at = target

    def _reset(self, camera: viser.CameraHandle) -> bool:
        """Return whether a camera went to where one stands for no window of its own.

        By "Reset View", or as its page drew for the first time, on a busy machine
        after it was placed for its window.
        """
        first = self.server.initial_camera
        size = camera.image_width, camera.image_height
        return size != theme.WINDOW and all(
            np.allclose(there, at, rtol=0.0, atol=_SAME_PLACE)
            for there, at in (
                (camera.position, first.position),
                (camera.look_at, first.look_at),
            )
        )


def _side(moment: Moment) -> float:
    """Return from which side a camera sees the hand of a whole person that takes."""
    return -1.0 if len(moment.capsules) >= _WHOLE else 1.0
