"""What tunes the execution: its speeds, its looks at people, and its tests.

What a caller sets is in `ExecutionSettings`, `ThreatSettings` and `SpeedSettings`. The
other classes here hold what was chosen once: their defaults are what the benches
measured.
"""

import math
from dataclasses import dataclass

from roadmap.ranges import check_row, check_settings

Ranges = dict[str, tuple[float, float, str]]


@dataclass(frozen=True)
class ExecutionSettings:
    """Settings of the execution: speeds, blends, commit point and retreats.

    Attributes:
        speed_scale: Share of the joints' speed limits the robot uses.
        retreat_scale: The same while it retreats.
        yields: Whether a robot gets out of the way of who comes at it, as far as its
            stop passes the braking test; else it stands and is come to.
        yield_scale: Share of the joints' speed limits that it then uses: less makes it
            be touched more often, `odm bench motions`.
        blend: Corners are rounded within this [m], but never within more than the
            map's blending share of m.
        commit_delay_s: A new path begins where the robot would stand if it began to
            stop this much later [s]. More: corners have more length to be rounded on,
            and the robot answers later.
        min_retreat_separation: No backing off where the separation, extrapolated by
            two frames, is below this [m].
        yield_gap: Who comes is evaded only as far as the links themselves keep this
            from them until a stop is over [m]. Less: it goes on where a person is
            within the cover, and is touched while it moves by who speeds up by more
            than is assumed.
        encoder_error: Bound on the position error of any robot point that the encoders
            cause [m]; it is taken off the tracking share of m. It cannot be measured
            here, so the caller has to know it.
        hold_delay_s: A robot that moves begins to hold so much later than the planner
            says so [s], while its path up to the end of a stop is free of all that the
            frame has, and of where the person may come. More: it goes on past a goal
            that is taken for a moment, and nearer to one that stays taken. Less: beside
            a hand that trembles it stops and starts anew at each tremble.
        levels: Levels of speed, of which the braking test lets it use the fastest.
        lower: Each is this share of the one above. More, or levels nearer to each
            other: it loses less speed to somebody far away, and needs more frames to
            slow down for somebody near.
    """

    speed_scale: float = 0.5
    retreat_scale: float = 0.25
    yields: bool = True
    yield_scale: float = 1.0
    blend: float = 0.004
    commit_delay_s: float = 0.05
    min_retreat_separation: float = 0.022
    yield_gap: float = 0.005
    encoder_error: float = 0.0
    hold_delay_s: float = 0.2
    levels: int = 5
    lower: float = 0.6

    def __post_init__(self) -> None:
        ranges: Ranges = {
            "speed_scale": (1e-6, 1.0, ""),
            "retreat_scale": (1e-6, 1.0, ""),
            "yield_scale": (1e-6, 1.0, ""),
            "blend": (0.0, 1.0, "m"),
            "commit_delay_s": (0.0, 10.0, "s"),
            "min_retreat_separation": (0.0, math.inf, "m"),
            "yield_gap": (0.0, 0.1, "m"),
            "encoder_error": (0.0, 0.1, "m"),
            "hold_delay_s": (0.0, 10.0, "s"),
            "levels": (1, 100, ""),
            "lower": (0.01, 0.99, ""),
        }
        check_settings(self, ranges, ("levels",))

    @property
    def slowest_scale(self) -> float:
        """Share of the joints' speed limits of the slowest level that it uses."""
        return self.speed_scale * self.lower ** (self.levels - 1)


@dataclass(frozen=True)
class PaceSettings:
    """How the executor goes from speed to speed, and retreats (`executor.Executor`).

    Attributes:
        look_ahead_s: A higher speed must pass the test of a stop that begins so much
            later [s]. More: the robot is quicker again later, and slows down less.
        hindered_s: After it slowed down for somebody no jerk is limited for so long
            [s]: a gentle start beside them would creep.
        keep_every: Frames between two looks at the jerk of a motion, which cost a
            timing each.
        again: A limit of the jerk that differs by this factor is another one.
        harder: Factor on the limit of jerk where a motion cannot keep that limit.
        retreat_every: Frames between two searches for a retreat, which take a while.
        retreats: Shares of a retreat's speed that are tried, one after the other.
        evasions: Shares of its present speed at which an evasion goes on.
        slowest: No evasion is slower than this share of the joints' speed limits.
        tracking: Tracking share of m for planners without a map [m].
        quick_s: Who stops within this from the slowest speed [s] need not expect that
            somebody speeds up harder meanwhile than so far (`ThreatSettings.jerk`): in
            0.05 s that would be 2 mm, a fifth of m.
    """

    look_ahead_s: float = 0.02
    hindered_s: float = 0.12
    keep_every: int = 3
    again: float = 1.5
    harder: float = 4.0
    retreat_every: int = 5
    retreats: tuple[float, ...] = (1.0, 0.4, 0.15)
    evasions: tuple[float, ...] = (0.8, 0.5, 0.2)
    slowest: float = 0.01
    tracking: float = 0.002
    quick_s: float = 0.05

    def __post_init__(self) -> None:
        counts = ("keep_every", "retreat_every")
        ranges: Ranges = dict.fromkeys(counts, (1, 10_000, ""))
        times = ("look_ahead_s", "hindered_s", "quick_s")
        ranges |= dict.fromkeys(times, (0.0, 10.0, "s"))
        ranges |= dict.fromkeys(("again", "harder"), (1.0, 100.0, ""))
        ranges |= {"slowest": (1e-6, 1.0, ""), "tracking": (0.0, 0.1, "m")}
        check_settings(self, ranges, counts)
        for name in ("retreats", "evasions"):
            check_row(self, name, 1e-6, 1.0)


@dataclass(frozen=True)
class LookoutSettings:
    """How far ahead the lookout sees who comes, and how often (`lookout.Lookout`).

    Attributes:
        meets: Times at which it looks whether the person meets the robot [s]. At 1 m/s
            a hand does not get from one side of a link to the other between two.
        ahead: Times by which an evasion is asked to have led out of the way [s].
        between_looks: Least time between two looks [s].
        between_searches: Least time between two searches for an evasion [s], which
            take some milliseconds.
    """

    meets: tuple[float, ...] = tuple(0.06 * k for k in range(1, 9))
    ahead: tuple[float, ...] = (0.12, 0.24, 0.36, 0.48)
    between_looks: float = 0.02
    between_searches: float = 0.05

    def __post_init__(self) -> None:
        names = ("between_looks", "between_searches")
        check_settings(self, dict.fromkeys(names, (0.0, 10.0, "s")))
        for name in ("meets", "ahead"):
            check_row(self, name, 0.0, 10.0, "s")


@dataclass(frozen=True)
class StopTestSettings:
    """How finely the path to a stop is tested (`stop_test`, `shell_test`).

    Every choice proves as much: finer pieces free more, and cost more.

    Attributes:
        slice_s: By the cover, a motion is tested in pieces of this length [s].
        shell_slice_s: By the shells in pieces of this length [s],
        at_once: ... and so many of those at once before.
        places: Of a way, at which it is asked whether it leads away from who is near.
        near: Somebody farther away than m plus this is not near [m]; it must exceed
            the close test's own share.
    """

    slice_s: float = 0.04
    shell_slice_s: float = 0.02
    at_once: int = 4
    places: int = 4
    near: float = 0.01

    def __post_init__(self) -> None:
        counts = ("at_once", "places")
        ranges: Ranges = {"at_once": (1, 1000, ""), "places": (2, 1000, "")}
        ranges |= dict.fromkeys(("slice_s", "shell_slice_s"), (1e-3, 10.0, "s"))
        check_settings(self, ranges | {"near": (0.0, 1.0, "m")}, counts)


@dataclass(frozen=True)
class TrackingSettings:
    """When a pushed robot is held still (`tracking.TrackingMonitor`).

    Attributes:
        still: While no point of it moves by more than this [m]
        held_s: ... for so long [s]: then where it is becomes its set-point. More: a
            robot that is led by hand goes on by itself later.
    """

    still: float = 0.001
    held_s: float = 0.1

    def __post_init__(self) -> None:
        check_settings(self, {"still": (0.0, 0.1, "m"), "held_s": (0.0, 10.0, "s")})


@dataclass(frozen=True)
class IntentSettings:
    """How finely a robot's intent is told (`robot_threat.intent_threat`).

    Every choice holds the robot: finer balls are smaller, and more of them.

    Attributes:
        step_s: Time between two places on a stretch, if it is short [s].
        most: Places on one stretch.
    """

    step_s: float = 0.02
    most: int = 24

    def __post_init__(self) -> None:
        check_settings(
            self, {"step_s": (1e-3, 10.0, "s"), "most": (1, 10_000, "")}, ("most",)
        )


@dataclass(frozen=True)
class FollowSettings:
    """How a person is followed from frame to frame (`threat.Watcher`).

    Attributes:
        drift_s: Time over which the drift of a part is a mean [s], and for which it is
            remembered how fast anybody was: a hand that trembles at 5 Hz or faster
            gets nowhere in this time.
        spurt_s: With noise, an acceleration is measured over this time [s].
        confirmed: Frames that must agree on a velocity before it counts.
        most_growth: Who may be farther than this from where they are expected may be
            anywhere [m].
    """

    drift_s: float = 0.2
    spurt_s: float = 0.06
    confirmed: int = 3
    most_growth: float = 4.0

    def __post_init__(self) -> None:
        ranges: Ranges = dict.fromkeys(("drift_s", "spurt_s"), (1e-3, 10.0, "s"))
        ranges |= {"confirmed": (2, 1000, ""), "most_growth": (0.0, 100.0, "m")}
        check_settings(self, ranges, ("confirmed",))


@dataclass(frozen=True)
class AheadSettings:
    """How far ahead a limit of speed or jerk looks (`speed_limit.SpeedLimit`).

    Attributes:
        direction_s: The direction is that of the motion's next piece of this length
            [s].
        jerk_s: At these times from now no point near a hand is jerked [s]: a motion is
            gentle from where a gentle stop before the hand has still time.
    """

    direction_s: float = 0.05
    jerk_s: tuple[float, ...] = (0.0, 0.2, 0.4)

    def __post_init__(self) -> None:
        check_settings(self, {"direction_s": (1e-3, 10.0, "s")})
        check_row(self, "jerk_s", 0.0, 10.0, "s")
