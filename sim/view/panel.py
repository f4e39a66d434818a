"""The panel beside the scene: words, strips, time line, controls, layers, legend."""

from collections import deque
from collections.abc import Callable

import numpy as np
import viser

from sim.view import cards
from sim.view.moment import Moment
from sim.view.playback import SPEEDS, Playback
from sim.view.sources import Source
from sim.view.stage import LAYERS, Stage

WORDS_EVERY_S = 0.1  # the words are renewed so often [s]
STRIPS_EVERY_S = 0.25  # and the strips and the time line
MOST_COMMANDS = 256  # of clients, that wait; older ones are dropped
_MAP_LAYERS = ("cells", "edges", "blocked")


class Panel:
    """Shows a moment in words, and takes what clients press.

    Clients share one panel: who scrubs, scrubs for all. Callbacks come in threads of
    their own; they leave a command, and `obey` carries it out in the page's own.

    Args:
        gui: Where to.
        source: What is shown.
        playback: Where in it.
        stage: The scene.
        can_take: Whether the person's hand may be dragged.
    """

    def __init__(
        self,
        gui: "viser.GuiApi",
        source: Source,
        playback: Playback,
        stage: Stage,
        can_take: bool,
    ) -> None:
        self.gui, self.source, self.playback = gui, source, playback
        self.stage, self.takes_hand = stage, False
        self.sentences: list[str] = []
        self._commands: deque[Callable[[], None]] = deque(maxlen=MOST_COMMANDS)
        self._do = self._commands.append
        self._words_at = self._strips_at = -np.inf
        self._shown: dict[str, object] = {}
        runs = source.live or source.span()[1] > source.span()[0]
        self._over = gui.add_html(cards.ENDED, visible=False)
        self._status = gui.add_html("")
        self._runs, self._map = runs, gui.add_html("", visible=not runs)
        self._line = gui.add_html("", visible=runs)
        self._add_controls(runs)
        self._strips = gui.add_html("", visible=runs)
        if can_take:
            self._add_hand()
        self._add_layers()
        with gui.add_folder("Legend"):
            self._legend = gui.add_html("")
        self._note = gui.add_html("")

    def tell_end(self) -> None:
        """Say that nothing more will be shown; who still looks sees the last moment."""
        self._over.visible = True

    def obey(self) -> None:
        """Carry out what clients asked for."""
        while self._commands:
            self._commands.popleft()()
            self._words_at = self._strips_at = -np.inf

    def _add_controls(self, runs: bool) -> None:
        gui, playback = self.gui, self.playback
        self._slider = gui.add_slider(
            "Time [s]",
            0.0,
            1.0,
            0.01,
            0.0,
            visible=runs,
            hint="Drag to scrub; pause it to type a time",
        )

        @self._slider.on_update
        def _(event: viser.GuiEvent) -> None:
            if event.client is not None:  # not one that the page itself set
                time_s = float(event.target.value)
                self._do(lambda: playback.seek(time_s))

        names = ["Play", "Pause", "Live" if self.source.live else "End"]
        buttons = gui.add_button_group("Run", names, visible=runs)
        actions = dict(
            zip(names, (playback.play, playback.pause, playback.follow), strict=True)
        )
        buttons.on_click(lambda event: self._do(actions[event.target.value]))
        steps = gui.add_button_group("Event", ["Previous", "Next"], visible=runs)
        steps.on_click(lambda event: self._step(event.target.value))
        speed = gui.add_dropdown(
            "Speed",
            [f"{s:g}x" for s in SPEEDS],
            initial_value="1x",
            visible=runs and not self.source.live,
        )

        @speed.on_update
        def _(event: viser.GuiEvent) -> None:
            value = float(event.target.value.rstrip("x"))
            self._do(lambda: playback.set_speed(value))

    def _step(self, word: str) -> None:
        direction = 1 if word == "Next" else -1
        times = [event.time_s for event in self.source.events]
        self._do(lambda: self.playback.jump(times, direction))

    def _add_hand(self) -> None:
        box = self.gui.add_checkbox(
            "Drag the hand", False, hint="Pull the person's hand by the arrows"
        )

        @box.on_update
        def _(event: viser.GuiEvent) -> None:
            self.takes_hand = bool(event.target.value)

        self._hand = box

    def let_go(self) -> None:
        """Let go of the hand, whoever took it."""
        if self.takes_hand:
            self.takes_hand = self._hand.value = False

    def _add_layers(self) -> None:
        self._boxes = {}
        with self.gui.add_folder("Layers", expand_by_default=False):
            for layer, (name, _) in LAYERS.items():
                has = self._has(layer)
                box = self.gui.add_checkbox(name, self.stage.shown[layer], visible=has)
                box.on_update(self._toggle(layer))
                self._boxes[layer] = box

    def _has(self, layer: str) -> bool:
        """Return whether there is anything in a layer, now or later in the run."""
        if layer in _MAP_LAYERS:
            return self.stage.cell_map is not None
        if layer == "still":
            return self.stage.stands
        return layer not in self.source.lacks

    def _toggle(self, layer: str) -> Callable:
        def update(event: viser.GuiEvent) -> None:
            on = bool(event.target.value)
            self._do(lambda: self.stage.show(layer, on))

        return update

    def map_came(self, show: tuple[str, ...] = ()) -> None:
        """Offer the layers that need a map, and show some of them."""
        for layer in _MAP_LAYERS:
            self._boxes[layer].visible = True
        for layer in show:
            self._boxes[layer].value = True
            self.stage.show(layer, True)
        self._shown.pop("legend", None)

    def draw(self, moment: Moment, clock: float) -> None:
        """Renew what is due; `clock` [s] goes on also where the run stands still."""
        begin, end = self.playback.begin, self.playback.end
        if clock - self._words_at >= WORDS_EVERY_S:
            self._words_at = clock
            events = [e for e in self.source.events if e.time_s <= moment.time_s + 1e-9]
            card = cards.status_card(moment, events, end)
            self._tell("status", self._status, card)
            self._place_slider(begin, end)
        if clock - self._strips_at < STRIPS_EVERY_S:
            return
        self._strips_at = clock
        rows, now = self.source.rows(), moment.time_s
        line = cards.time_line(rows, self.source.events, (begin, end), now)
        self._tell("line", self._line, line)
        strips = cards.strips(rows, now, self.source.knows_latency)
        self._tell("strips", self._strips, strips)
        targets = moment.targets
        rated = targets is not None and bool(np.isfinite(targets[:, 3]).any())
        cell_map, blocked = self.stage.cell_map, self.stage.n_blocked
        told = cards.legend(cell_map is not None, rated, self._runs, self.source.lacks)
        self._tell("legend", self._legend, told)
        if cell_map is not None and not self._runs:
            roadmap = cell_map.roadmap
            told = cards.roadmap_line(roadmap.n_nodes, roadmap.n_edges, blocked)
            self._tell("map", self._map, told)
        self._tell("note", self._note, cards.note(self.sentences))

    def _place_slider(self, begin: float, end: float) -> None:
        slider, span = self._slider, (round(begin, 2), round(max(end, begin + 0.01), 2))
        if self._shown.get("span") != span:
            self._shown["span"] = span
            slider.min, slider.max = span
        slider.value = round(min(max(self.playback.at, span[0]), span[1]), 2)

    def _tell(self, name: str, html: object, content: str) -> None:
        if self._shown.get(name) != content:
            self._shown[name] = html.content = content
