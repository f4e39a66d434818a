"""The viewer of a loop: three lines, and nothing that the loop could wait for."""

import os
import pickle
import select
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from importlib import util
from typing import TYPE_CHECKING

import numpy as np

from odm.cell_map.cell_map import CellMap
from odm.obstacles.shapes import Shape
from roadmap.errors import BadInput, PlanningError
from sim.draw.surroundings import all_triangles
from sim.view.gate import LOCAL, PORT, address_of, listening, token_for
from sim.view.mailbox import HAND, READY, Mailbox
from sim.view.moment import NOBODY, ON_THE_WAY, Event, Happenings, Moment, state_of

if TYPE_CHECKING:
    from collections.abc import Mapping

KEPT_ROWS, KEPT_EVENTS = 256, 32  # that a letter tells of
EVERY_S = 1.0 / 60.0  # a letter is written no more often [s]
ASK_AGAIN_S = 1.0  # a hold is asked for its reason so often [s]
OPEN_S = 180.0  # the page has to be there by then [s]
_HAND_ROOM = 64


class ViewerMissing(PlanningError):
    """viser is not installed; everything but the page works without it."""

    def __init__(self) -> None:
        super().__init__(
            "the page needs viser, which is not installed; "
            "run: pip install 'odm-planner[view]'"
        )


def check_viewer() -> None:
    """Refuse where the page cannot be shown, before any work."""
    if util.find_spec("viser") is None:
        raise ViewerMissing


class Viewer(AbstractContextManager):
    """Shows a loop in the browser, from a process of its own.

    `show` lays the newest frame into a mailbox of one slot and returns; what the page
    does not fetch in time is never drawn. Clients that leave, flood or are slow are the
    page's business. The page is open once the constructor returns.

    Args:
        cell_map: The planner's map. Cells and edges are drawn of a map that was loaded.
        host: Address it listens at; anything but this machine's own asks clients for
            a token.
        port: Its port; 0: any that is free.
        token: What a client has to know; None: a new one where one is needed.
        rate_hz: Frames per second, of frames that have a number and no time.
        label: Title of the panel.
        drag: Whether clients may drag the person's hand, see `hand`.
        standing: What stands around besides the map's scenery: shapes of `odm` in the
            world, such as `[shape for _, shape in planner.scene.shapes()]`.

    Attributes:
        address: What to open in a browser.

    Raises:
        ViewerMissing: viser is not installed.
        BadInput: The port is taken, or the address is none of this machine's.
    """

    def __init__(
        self,
        cell_map: CellMap,
        *,
        host: str = LOCAL,
        port: int = PORT,
        token: str | None = None,
        rate_hz: float = 100.0,
        label: str = "",
        drag: bool = False,
        standing: Sequence[Shape] = (),
    ) -> None:
        check_viewer()
        token = token_for(host, token)
        self.rate_hz, self.robot = rate_hz, cell_map.robot
        self._begun: float | None = None
        self._written = self._asked = -np.inf
        self._rows = np.zeros((KEPT_ROWS, 5))
        self._used = 0
        self._happenings = Happenings()
        self._path: np.ndarray | None = None
        self._before: np.ndarray | None = None
        self._reason = self._held = ""
        self._closed = False
        self._down, self._up = Mailbox(), Mailbox(room=_HAND_ROOM)
        self._place: np.ndarray | None = None
        told = {
            "robot": (self.robot.meta(), self.robot.arrays()),
            "source": cell_map.recipe.robot.source,
            "locked": dict(cell_map.recipe.robot.locked),
            "label": label or self.robot.name,
            "host": host,
            "token": token,
            "drag": drag,
            "still": all_triangles(
                [*(shape for _, shape in cell_map.scenery.shapes()), *standing]
            ),
            "boxes": [(box.descriptor, box.room) for box in (self._down, self._up)],
            **_packed(cell_map),
        }
        self.address = self._start(told, host, port, token)

    def _start(self, told: "Mapping", host: str, port: int, token: str) -> str:
        """Start the process and wait until the page is open; return its address."""
        listener = listening(host, port)
        told = {**told, "listener": listener.fileno()}
        kept = [listener.fileno(), self._down.descriptor, self._up.descriptor]
        paths = os.pathsep.join(p or os.getcwd() for p in sys.path)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "sim.view.child"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=kept,
            env={**os.environ, "PYTHONPATH": paths},
            process_group=0,  # Ctrl-C is the loop's; in one session nice counts
        )
        pickle.dump(told, self._process.stdin)
        self._process.stdin.flush()
        number = listener.getsockname()[1]
        listener.close()
        ready, _, _ = select.select([self._process.stdout], [], [], OPEN_S)
        said = self._process.stdout.readline() if ready else b"it took too long"
        if said != READY:
            self.close()
            why = said.decode(errors="replace").strip() or "its process ended"
            raise BadInput(f"the page did not open: {why}")
        return address_of(host, number, token)

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the page's process; frames that are shown later go nowhere."""
        if self._closed:
            return
        self._closed = True
        try:  # it ends once its stdin is closed
            self._process.communicate(timeout=3.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()
        self._down.close()
        self._up.close()

    @property
    def open(self) -> bool:
        """Whether the page is still there."""
        return not self._closed and self._process.poll() is None

    def show(
        self,
        frame: object = None,
        *,
        q: np.ndarray | None = None,
        answer: object = None,
        capsules: np.ndarray | None = None,
        points: np.ndarray | None = None,
        targets: np.ndarray | None = None,
        separation: float = np.inf,
        time_s: float | None = None,
        told: Sequence[str] = (),
        doing: str = "",
    ) -> None:
        """Show a frame, about 0.1 ms; nothing that it could wait for.

        Args:
            frame: A `sim.loop.loop.Frame`, or whatever has some of its attributes;
                what is given by name counts instead.
            q: (dof,) where the robot is [rad or m].
            answer: The planner's.
            capsules: (k, 7) the person [m].
            points: (n, 3) what a sensor saw [m].
            targets: (n, 5) places of the tool [m], qualities in [0, 1], and 1 for the
                one pursued.
            separation: Distance of robot and person [m].
            time_s: When [s]; None: by the frame's number, else by the clock.
            told: What happened in this frame, for the time line.
            doing: What it does, in words; "": why it does not move, if it does not.
        """
        now = time.perf_counter()
        q = getattr(frame, "q", None) if q is None else q
        if q is None or self._closed:
            return
        answer = getattr(frame, "answer", None) if answer is None else answer
        separation = min(separation, getattr(frame, "separation", np.inf))
        time_s = self._time(frame, now) if time_s is None else time_s
        state = self._take(frame, answer, separation, time_s)
        self._happenings.events += [Event(time_s, ON_THE_WAY, text) for text in told]
        if now - self._written < EVERY_S:
            return
        self._written = now
        capsules = getattr(frame, "capsules", None) if capsules is None else capsules
        moment = Moment(
            time_s=time_s,
            q=np.array(q, float),
            capsules=np.asarray(NOBODY if capsules is None else capsules, float),
            state=state,
            reason=doing or self._reason,
            separation=float(separation),
            path=self._path,
            before=self._before,
            targets=targets,
            points=points,
            payload=getattr(frame, "payload", None),
            things=getattr(frame, "things", 0),
            rows=self._latest(),
            events=tuple(self._happenings.events[-KEPT_EVENTS:]),
        )
        self._send(moment)

    def _send(self, moment: Moment) -> None:
        """Lay a moment into the mailbox; if it has too many points, some of them."""
        if self._down.put(pickle.dumps(moment, protocol=5)) or moment.points is None:
            return
        step = len(moment.points) // 50_000 + 1
        fewer = replace(moment, points=moment.points[::step].astype(np.float32))
        self._down.put(pickle.dumps(fewer, protocol=5))

    def hand(self) -> np.ndarray | None:
        """Return where a client drags the person's hand to, (3,) [m], or None."""
        letter = None if self._closed else self._up.take()
        if letter is not None:
            taken, *place = HAND.unpack(letter)
            self._place = np.array(place) if taken else None
        if self._place is not None and not self.open:
            self._place = None  # a page that ended holds no hand
        return self._place

    def _time(self, frame: object, now: float) -> float:
        index = getattr(frame, "index", None)
        if index is not None:
            return index / self.rate_hz
        if self._begun is None:
            self._begun = now
        return now - self._begun

    def _take(
        self, frame: object, answer: object, separation: float, time_s: float
    ) -> int:
        """Note what every frame tells, drawn or not; return its state."""
        status = getattr(answer, "status", "")
        state = state_of(status, getattr(frame, "pace", ""), separation)
        place = getattr(frame, "place", 0)
        path = getattr(answer, "path", None)
        fresh = status == "replanned" and self._path is not None
        if path is not None and len(path):
            if fresh:
                self._before = self._path
            self._path = np.asarray(path, float)
        else:
            self._path = None
        self._reason = self._why(frame, answer, status, time_s)
        self._happenings.take(time_s, state, place, self._reason, fresh)
        del self._happenings.events[: -4 * KEPT_EVENTS]
        took = getattr(frame, "wall_s", None)
        if took is None:
            took = getattr(answer, "latency_s", {}).get("total", 0.0)
        self._rows[self._used % KEPT_ROWS] = time_s, separation, took, state, place
        self._used += 1
        return state

    def _why(self, frame: object, answer: object, status: str, time_s: float) -> str:
        """Return why it does not move; the planner is asked once in a while."""
        if status != "holding":
            self._asked = -np.inf
            return getattr(frame, "brake", "")
        if not 0.0 <= time_s - self._asked < ASK_AGAIN_S:
            self._asked = time_s
            self._held = getattr(answer, "reason", "") or ""
        return self._held

    def _latest(self) -> np.ndarray:
        """Return (n, 5) the last rows in order."""
        used, at = self._used, self._used % KEPT_ROWS
        if used <= KEPT_ROWS:
            return self._rows[:used]
        return np.roll(self._rows, -at, axis=0)


def _packed(cell_map: CellMap) -> dict:
    """Return the map as bytes, or a sentence about why not."""
    try:
        return {"map": pickle.dumps(cell_map), "sentences": []}
    except BadInput:
        told = "cells and edges are drawn of a map that was loaded from a folder"
        return {"map": None, "sentences": [told]}
