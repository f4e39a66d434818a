"""The loop in real time, between keys and screen."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from sim.keyboard.bindings import ARM_KEYS, END, HELP, PAUSE, plain
from sim.keyboard.key_motion import KeyboardArm
from sim.keyboard.picture import key_lines, painted, picture
from sim.keyboard.shown import View, plain_line
from sim.keyboard.signals import Signals
from sim.keyboard.stats import Stats
from sim.keyboard.terminal import Keys, PlainScreen, Screen, taken
from sim.loop.loop import Frame

REDRAW = 0.1  # from picture to picture [s]
RELINE = 1.0  # from line to line where there is no picture [s]
NAP = 0.05  # longest sleep, so that a signal is noticed soon at low rates too [s]


class Pacer:
    """Lets each turn of a loop begin one period after the one before.

    A turn that takes longer than the period makes the next one late. The lost time
    is not made up for: the schedule slips, and the delay is counted.

    Args:
        period: From turn to turn [s].
        clock: Returns the time [s].
        sleep: Waits for some seconds.

    Attributes:
        late: Turns that began late.
        slipped_s: By how much the simulation is behind the clock [s].
    """

    def __init__(
        self,
        period: float,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.period, self.late, self.slipped_s = period, 0, 0.0
        self._clock, self._sleep = clock, sleep
        self.restart()

    def restart(self) -> None:
        """Begin a turn now, after a pause that is no delay."""
        self._next = self._clock() + self.period

    def wait(self, stop: Callable[[], bool] = lambda: False) -> None:
        """Sleep until the next turn is due, or until `stop()`."""
        now = self._clock()
        if now > self._next:
            self.late += 1
            self.slipped_s += now - self._next
            self._next = now
        while now < self._next and not stop():
            self._sleep(min(self._next - now, NAP))
            now = self._clock()
        self._next += self.period


@dataclass(frozen=True)
class Setting:
    """Settings of a session."""

    rate_hz: float  # frames per second of simulation and wall clock
    # simulated time after which it ends [s]; None: when the user ends it
    seconds: float | None = None
    title: str = ""  # name of the robot, for the screen
    edges: int = 0  # edges of the roadmap
    # returns how many of them the last frame blocks; None: not known
    blocked: Callable[[], int] | None = None


class Session:
    """Runs a loop at the pace of the wall clock while keys move the person's arm.

    Args:
        loop: Its `frame` answers one frame and moves on, as that of
            `sim.loop.loop.Loop`; it asks `arm` where the person is.
        arm: Moved by the keys.
        setting: Rate, end, and what the screen needs.
        on_frame: Called with every frame, to keep or record it.

    Attributes:
        stats, pacer: Figures so far.
        ended: "seconds", "q" or the name of a signal; None while it runs.
    """

    def __init__(
        self,
        loop: object,
        arm: KeyboardArm,
        setting: Setting,
        on_frame: Callable[[Frame], None] = lambda frame: None,
    ) -> None:
        self.loop, self.arm, self.setting, self.on_frame = loop, arm, setting, on_frame
        self.stats = Stats(setting.rate_hz)
        self.pacer = Pacer(1.0 / setting.rate_hz)
        self.ended: str | None = None
        self.paused = self.help = False
        self._drawn = -1e9

    def run(self, keys: Keys, screen: Screen) -> str:
        """Run to the end and return why it ended; the terminal is given back always."""
        with Signals() as signals:
            while self._some(keys, screen, signals):
                signals.suspend()  # only now is the terminal the shell's again
            return self.ended

    def _some(self, keys: Keys, screen: Screen, signals: Signals) -> bool:
        """Run until the end, then return False, or until Ctrl-Z."""
        with taken(keys, screen):
            if isinstance(screen, PlainScreen):
                screen.draw([(f"{key:<5}{does}", False) for key, does in key_lines()])
            self.pacer.restart()
            while not signals.suspended:
                self._obey(keys, signals)
                if self.ended:
                    return False
                self._turn(screen, signals)
            return True

    def _obey(self, keys: Keys, signals: Signals) -> None:
        """Take keys and signals, and see whether the time is over."""
        for key in map(plain, keys.read()):
            if key in ARM_KEYS:
                self.arm.press(key)
            elif key == END:
                self.ended = "q"
            elif key in (PAUSE, HELP):
                self._switch("paused" if key == PAUSE else "help")
        limit = self.setting.seconds
        if limit is not None and self.stats.frames >= limit * self.setting.rate_hz:
            self.ended = "seconds"
        # no more keys can come: the same as being hung up on
        self.ended = signals.ended or ("SIGHUP" if keys.closed else self.ended)

    def _turn(self, screen: Screen, signals: Signals) -> None:
        if self.paused:
            time.sleep(NAP)
            self.pacer.restart()
            self._draw(screen)
            return
        frame = self.loop.frame()
        self.stats.take(frame)
        self.on_frame(frame)
        self._draw(screen)
        self.pacer.wait(lambda: bool(signals.ended or signals.suspended))

    def _switch(self, name: str) -> None:
        setattr(self, name, not getattr(self, name))
        self._drawn = -1e9

    def _draw(self, screen: Screen) -> None:
        now, plainly = time.perf_counter(), isinstance(screen, PlainScreen)
        if now - self._drawn < (RELINE if plainly else REDRAW):
            return
        self._drawn = now
        width, height = screen.size
        view = self._view()
        if plainly:
            screen.draw([(plain_line(view), False)])
        else:
            screen.draw(painted(picture(view, width, height), width))

    def _view(self) -> View:
        setting, share = self.setting, None
        if setting.blocked is not None and setting.edges and self.stats.last:
            share = setting.blocked() / setting.edges
        self.stats.explain()
        return View(
            title=setting.title,
            rate_hz=setting.rate_hz,
            stats=self.stats,
            arm=self.arm.state,
            limits=self.arm.limits,
            blocked=share,
            edges=setting.edges,
            late=self.pacer.late,
            slipped_s=self.pacer.slipped_s,
            paused=self.paused,
            help=self.help,
        )
