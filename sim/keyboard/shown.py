"""What a picture shows, and its pieces as short texts."""

import math
from dataclasses import dataclass

from sim.keyboard.bindings import SLIDERS
from sim.keyboard.control import NUDGES, ArmLimits, ArmState
from sim.keyboard.stats import Stats


@dataclass(frozen=True, eq=False)
class View:
    """All that a picture shows."""

    title: str  # name of the robot
    rate_hz: float  # frames per second
    stats: Stats  # figures so far
    # the person's arm and its bounds
    arm: ArmState
    limits: ArmLimits
    # share of the roadmap's edges that are blocked, None if unknown
    blocked: float | None = None
    edges: int = 0  # how many edges there are
    # frames that began late, and the delay they left [s]
    late: int = 0
    slipped_s: float = 0.0
    # whether the loop stands, and whether the keys are explained
    paused: bool = False
    help: bool = False

    @property
    def status(self) -> str:
        """The planner's status; a new path is shown long enough to be seen."""
        if self.stats.last is None:
            return "starting"
        status = self.stats.last.answer.status
        return "replanned" if status == "following" and self.stats.replanned else status

    @property
    def state(self) -> str:
        """What the loop does, for the head of the screen."""
        if self.paused:
            return "paused"
        held = self.stats.held
        return self.status if held is None else f"holding for {held:.1f} s"

    @property
    def reason(self) -> str:
        """Why it holds, or why it did."""
        last = self.stats.last_hold
        if self.stats.held is not None:
            return str(self.stats.hold_reason)
        if last is None:
            return "no hold so far"
        return f"held {last[1]:.1f} s, {last[0]:.0f} s ago: {self.stats.hold_reason}"

    @property
    def clock(self) -> str:
        """Time of the simulation as minutes and seconds."""
        minutes, seconds = divmod(self.stats.frames / self.rate_hz, 60)
        return f"{int(minutes)}:{int(seconds):02d}"

    @property
    def separation(self) -> str:
        """Separation now and the smallest so far."""
        last = self.stats.last
        now = math.inf if last is None else last.separation
        return f"{_cm(now)}, smallest {_cm(self.stats.smallest)}"

    @property
    def speed(self) -> str:
        """Speed of the robot's fastest point."""
        last = self.stats.last
        return f"{0.0 if last is None else last.point_speed:.2f} m/s"

    @property
    def latency(self) -> str:
        """Latency of the planner's step so far."""
        p50, p99 = (self.stats.latency.percentile(share) for share in (0.5, 0.99))
        return f"p50 {_time(p50)}, p99 {_time(p99)}"

    @property
    def blocked_percent(self) -> str:
        """Share of the edges that are blocked."""
        return "-" if self.blocked is None else f"{100 * self.blocked:.0f} %"

    @property
    def nudge(self) -> str:
        """What one key moves: shoulder, angle."""
        metres, radians = NUDGES[self.arm.size]
        return f"{100 * metres:.0f} cm {math.degrees(radians):.0f}°"

    def value(self, axis: int) -> str:
        """Return what a slider stands at."""
        slider, x = SLIDERS[axis], SLIDERS[axis].sign * self.arm.x[axis]
        if slider.unit == "m":
            return f"{x:.2f} m"
        return f"{round(math.degrees(x))}°"

    def shares(self, axis: int) -> tuple[float, float]:
        """Return where value and target of a slider stand between its bounds."""
        lower, upper = self.limits.lower[axis], self.limits.upper[axis]
        shares = [
            (v[axis] - lower) / (upper - lower) for v in (self.arm.x, self.arm.target)
        ]
        if SLIDERS[axis].sign < 0:
            shares = [1 - share for share in shares]
        return shares[0], shares[1]


def plain_line(view: View) -> str:
    """Return the state in one line, for a terminal that only writes below."""
    parts = [
        f"{view.clock} {view.state}",
        f"separation {view.separation}",
        f"latency {view.latency}",
        f"blocked {view.blocked_percent}",
        f"trips {view.stats.trips}",
        f"late frames {view.late}",
    ]
    reason = [] if view.stats.held is None else [view.reason]
    return "; ".join(parts + reason)


def _cm(metres: float) -> str:
    return f"{100 * metres:.1f} cm" if math.isfinite(metres) else "-"


def _time(seconds: float | None) -> str:
    if seconds is None:
        return "-"
    return f"{1e6 * seconds:.0f} µs" if seconds < 1e-3 else f"{1e3 * seconds:.1f} ms"
