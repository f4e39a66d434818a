"""`odm bench view`: what the page costs the loop beside it, how soon it is there."""

import gc
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np

from handover import load_reach_map
from odm import load_map
from roadmap.errors import BadInput
from sim.bench.browser import Browser, Tab, found_browser
from sim.run.folders import REACH_MAPS
from sim.story.cases import StoryCase, StorySetup, setup_of
from sim.story.play import RATE, StoryPlay, rehearse
from sim.story.watched import StoryPage
from sim.tables.header import header
from sim.tables.table import value_row
from sim.view.gate import LOCAL
from sim.view.page import RATE_HZ

ROUNDS = 3  # of each; a frame counts with the least time of its rounds
CLIENTS = 2
USABLE_S, SHARE, HIDDEN_HZ, SHOWN_HZ = 3.0, 1.3, 30.0, 10.0  # asked
_OPENED = "robot to person"  # the panel says so once a moment is drawn
_EMPTY = "nothing but a frame"
_LOOK_S, _SETTLED_S = 4.0, 3.0
# what a browser says first: viser counts it as a client from then on
_LOOKS = {
    "type": "ViewerCameraMessage",
    "wxyz": (0.5, -0.5, 0.5, -0.5),
    "position": (-2.0, 0.0, 0.5),
    "fov": 0.8,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 900,
    "image_width": 1440,
    "look_at": (0.0, 0.0, 0.5),
    "up_direction": (0.0, 0.0, 1.0),
}


def run(
    map_dir: str | Path,
    *,
    reach: str | Path | None = None,
    pads: Sequence[str] = (),
    seconds: float = 5.0,
    seed: int = 0,
    short: bool = False,
    card: bool = False,
    plot: str | Path | None = None,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Play a hand-over with and without the page, in turn, and look at it.

    Args:
        map_dir: Folder of a map of a robot with fingers.
        reach: Folder of its reach map; None: maps/built/reach/NAME.
        pads: Links that may touch an object; see `sim.story.cases.pads_of`.
        seconds: Simulated time of each run [s].
        seed: Of the person.
        short: One second, one round: to see that it runs, not to measure.
        card: The browser draws with the graphics card; else the processor does.
        plot: PNG of what a browser shows; nothing without one.
        tell: Called with what is done.

    Raises:
        BadInput: A robot without fingers, or no seconds.
    """
    tell = tell or (lambda text: None)
    if not 0 < seconds < np.inf:
        raise BadInput(f"{seconds} s of each run are none; give seconds above 0")
    rounds = 1 if short else ROUNDS
    seconds = min(seconds, 1.0) if short else seconds
    cell_map = load_map(map_dir, verify=False)
    folder = REACH_MAPS / cell_map.robot.name if reach is None else Path(reach)
    setup = setup_of(cell_map, load_reach_map(folder), pads=pads)
    case = StoryCase.drawn("give", seed)
    tell("compiling")
    rehearse(setup)
    rows = _compared(setup, case, seconds, rounds, tell)
    tell("a browser looks")
    with _page(setup, case) as page:
        rows += _looked_at(page, plot, short, card)
    found = {"runs of each": rounds, "seconds of each run": seconds, "clients": CLIENTS}
    return {"bench": "view", "header": header(cell_map), "setup": found, "rows": rows}


def _compared(
    setup: StorySetup,
    case: StoryCase,
    seconds: float,
    rounds: int,
    tell: Callable[[str], None],
) -> list[dict]:
    """Return what a frame takes with and without clients, in turn."""
    bare, seen, shown = [], [], []
    sent: list[dict] = []
    for k in range(rounds):  # in turn: what else the machine does meets both
        tell(f"round {k + 1} of {rounds}")
        bare.append(_alone(setup, case, seconds))
        with _page(setup, case) as page:
            with _Clients(page.viewer.address) as clients:
                took, more = _watched(page, seconds)
            seen.append(took)
            shown.append(more)
            sent = sent or _messages(clients, len(took))
    without, beside = _least(bare), _least(seen)
    p99 = [1e3 * float(np.percentile(c, 99)) for c in (without, beside)]
    show_us = 1e6 * np.concatenate(shown)
    note = f"thread time, least of {rounds} rounds of each frame, {len(without)} frames"
    return [
        value_row("frame, nobody watches: p99", p99[0], "ms", note),
        value_row(f"frame, {CLIENTS} clients watch: p99", p99[1], "ms"),
        value_row("the same, of the one before", p99[1] / p99[0], "", most=SHARE),
        value_row("to show a frame: p50", float(np.percentile(show_us, 50)), "us"),
        value_row("to show a frame: p99", float(np.percentile(show_us, 99)), "us"),
        *sent,
    ]


def _page(setup: StorySetup, case: StoryCase) -> StoryPage:
    return StoryPage(StoryPlay(setup, case), port=0, paced=False)


def _alone(setup: StorySetup, case: StoryCase, seconds: float) -> np.ndarray:
    """Return (F,) thread time of frames at the clock's pace [s]."""
    run, took = StoryPlay(setup, case), []
    gc.collect()
    for _ in _ticks(seconds):
        took.append(run.step().cpu_s)
    return np.array(took)


def _ticks(seconds: float) -> Iterator[int]:
    """Yield the frames of so many seconds, each when it is due."""
    begun = time.perf_counter()
    for k in range(round(seconds * RATE)):
        time.sleep(max(0.0, begun + k / RATE - time.perf_counter()))
        yield k


def _watched(page: StoryPage, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (F,) thread time of frames at that pace, and of showing them [s]."""
    took, shown = [], []
    gc.collect()
    for _ in _ticks(seconds):
        moment = page.run.step()
        begun = time.thread_time()
        page.hear(moment)
        shown.append(time.thread_time() - begun)
        took.append(moment.cpu_s)
    return np.array(took), np.array(shown)


def _least(rounds: list[np.ndarray]) -> np.ndarray:
    """Return (F,) the least time of each frame: all rounds compute the same."""
    return np.min(rounds, axis=0)


class _Clients:
    """Who watches without drawing: their messages and bytes are counted."""

    def __init__(self, address: str) -> None:
        self._address = address.replace("http", "ws", 1)
        self._over = threading.Event()
        self.messages = self.bytes = 0
        self.scene = 0  # bytes of the first second

    def __enter__(self) -> "_Clients":
        self._begun = time.perf_counter()
        self._threads = [threading.Thread(target=self._hear) for _ in range(CLIENTS)]
        for thread in self._threads:
            thread.start()
        time.sleep(2.0)  # the scene has been sent
        self.scene, self.messages, self.bytes = self.bytes, 0, 0
        self._begun = time.perf_counter()
        return self

    def __exit__(self, *_: object) -> None:
        self.seconds = time.perf_counter() - self._begun
        self._over.set()
        for thread in self._threads:
            thread.join()

    def _hear(self) -> None:
        import msgspec
        import viser
        from websockets.sync.client import connect

        told = [f"viser-v{viser.__version__}"]
        options = {"subprotocols": told, "max_size": None, "compression": None}
        with connect(self._address, **options) as line:
            line.send(msgspec.msgpack.encode(_LOOKS))
            while not self._over.is_set():
                try:
                    letter = line.recv(timeout=0.2)
                except TimeoutError:
                    continue
                self.messages += 1
                self.bytes += len(letter)


def _messages(clients: _Clients, frames: int) -> list[dict]:
    per = CLIENTS * clients.seconds
    note = f"{frames} frames in {clients.seconds:.1f} s"
    return [
        value_row("scene, sent to a client", clients.scene / CLIENTS / 1e6, "MB"),
        value_row("messages to a client", clients.messages / per, "1/s", note),
        value_row("bytes to a client", clients.bytes / per / 1e3, "kB/s"),
    ]


def _looked_at(
    page: StoryPage, plot: str | Path | None, short: bool, card: bool = False
) -> list[dict]:
    """Return how soon a browser shows the page, and how many pictures it draws."""
    if found_browser() is None:
        return [value_row("page usable after", np.nan, "s", "no browser was found")]
    for _ in range(50):
        page.hear(page.run.step())
    look_s = 1.0 if short else _LOOK_S
    with Browser(card) as browser:
        with redirect_stdout(sys.stderr):  # viser tells there that it begins and ends
            empty, empty_hz = _empty_page(browser, look_s)
        tab = browser.tab()
        tab.open(page.viewer.address, _OPENED)  # the browser's own beginning
        tab.close()
        tab = browser.tab()
        after = tab.open(page.viewer.address, _OPENED)
        by = f"drawn by {tab.drawn_by() or 'nothing that WebGL names'}"
        rows = [value_row("page usable after", after, "s", by, most=USABLE_S), *empty]
        edges = len(page.run.setup.cell_map.roadmap.edges)
        for word, asked in (("hidden", HIDDEN_HZ), ("shown", SHOWN_HZ)):
            if word == "shown":
                tab.press("Layers")
                time.sleep(1.0)
                tab.toggle("Roadmap, all edges")
                time.sleep(1.0)
            what = f"{edges} edges {word}"
            told, hz = _pictures(
                tab, browser, look_s, what, asked, lambda: page.hear(page.run.step())
            )
            rows += told
            share = hz / empty_hz if empty_hz else np.nan
            rows.append(value_row("  the same, of an empty page's", share, ""))
        if plot is not None:
            tab.picture(Path(plot))
    return rows


def _empty_page(browser: Browser, look_s: float) -> tuple[list[dict], float]:
    """Return what a page of viser's with one moving frame in it costs, and its rate.

    More pictures than of this no page of viser's draws in this browser.
    """
    import viser

    server = viser.ViserServer(host=LOCAL, port=0, verbose=False)
    server.gui.add_markdown(_EMPTY)
    server.scene.configure_environment_map(None)
    server.scene.configure_default_lights(True, cast_shadow=False)
    frame = server.scene.add_frame("/frame", axes_length=0.1, axes_radius=0.005)
    tab = browser.tab()
    tab.open(f"http://{LOCAL}:{server.get_port()}/", _EMPTY)
    time.sleep(_SETTLED_S)

    def turn() -> None:
        frame.position = (0.0, 0.0, 0.1 * np.sin(5 * time.perf_counter()))
        time.sleep(1.0 / RATE_HZ)

    found = _pictures(tab, browser, look_s, "an empty page of viser's", None, turn)
    tab.close()
    server.stop()
    return found


def _pictures(
    tab: Tab,
    browser: Browser,
    look_s: float,
    what: str,
    asked: float | None,
    turn: Callable[[], None],
) -> tuple[list[dict], float]:
    """Return what a browser draws while `turn` changes what there is, and its rate."""
    before, drawn, busy = tab.pictures(), tab.drawn(), browser.cpu_s()
    begun = time.perf_counter()
    while time.perf_counter() - begun < look_s:
        turn()
    passed = time.perf_counter() - begun
    turns, cost = tab.pictures() - before, browser.cpu_s() - busy
    calls, faces = (b - a for a, b in zip(drawn, tab.drawn(), strict=True))
    n = max(turns, 1)
    note = f"{calls / n:.0f} draw calls, {faces / n:.0f} triangles each"
    hz = turns / passed
    return [
        value_row(f"pictures a second, {what}", hz, "1/s", note, least=asked),
        value_row(f"  CPU of the browser a picture, {what}", cost / n, "s"),
    ], hz
