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
        yields: Whether the robot moves out of the way of a person who comes, if the
            braking test of its stop passes; else it stands still.
        yield_scale: Share of the joints' speed limits used for that. Less: it is
            touched more often, see `odm bench motions`.
        blend: Corners are rounded within this [m], at most within the map's blending
            share of m.
        commit_delay_s: A new path begins where the robot would stand if it began to
            stop this much later [s]. More: corners are rounded wider, and the robot
            answers later.
        min_retreat_separation: It does not back off where the separation, extrapolated
            by two frames, is below this [m].
        yield_gap: While it moves out of the way, its links keep this from the person
            until it stands [m]. Less: it also moves where a person is inside the cover,
            and may be touched by somebody who accelerates harder than assumed.
        encoder_error: Bound on the position error that the encoders cause at any robot
            point [m], taken off the tracking share of m. The caller must know it.
        hold_delay_s: A moving robot goes on for so long after the planner holds [s],
            while its path up to the end of a stop is free. More: it passes a goal that
            is blocked for a moment, and comes nearer to one that stays blocked. Less:
            beside a trembling hand it stops and starts again and again.
        levels: Levels of speed; the fastest that passes the braking test is used.
        lower: Each level is this share of the one above. More levels, nearer to each
            other: less speed is lost to a person far away, and slowing down for one
            nearby takes more frames.
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
        check_settings(self, ranges)

    @property
    def slowest_scale(self) -> float:
        """Share of the joints' speed limits of the slowest level that it uses."""
        return self.speed_scale * self.lower ** (self.levels - 1)


@dataclass(frozen=True)
class PaceSettings:
    """How the executor goes from speed to speed, and retreats (`executor.Executor`).

    Attributes:
        look_ahead_s: A higher speed must pass the test of a stop that begins this much
            later [s]. More: it speeds up later, and slows down less.
        hindered_s: After slowing down for a person, jerk is not limited for so long
            [s]: a gentle start beside them would creep.
        keep_every: Frames between two checks of a motion's jerk limit; each takes a
            timing.
        again: A jerk limit that differs by this factor counts as changed.
        harder: Factor on the jerk limit where a motion cannot keep it.
        retreat_every: Frames between two searches for a retreat, which take a while.
        retreats: Shares of a retreat's speed, tried in turn.
        evasions: Shares of its present speed at which an evasion may go on.
        slowest: No evasion is slower than this share of the joints' speed limits.
        tracking: Tracking share of m for planners without a map [m].
        quick_s: A robot that stops from its slowest speed within this [s] does not
            expect anybody to accelerate harder meanwhile than so far
            (`ThreatSettings.jerk`): in 0.05 s that would be 2 mm, a fifth of m.
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
        every = ("keep_every", "retreat_every")
        ranges: Ranges = dict.fromkeys(every, (1, 10_000, ""))
        times = ("look_ahead_s", "hindered_s", "quick_s")
        ranges |= dict.fromkeys(times, (0.0, 10.0, "s"))
        ranges |= dict.fromkeys(("again", "harder"), (1.0, 100.0, ""))
        ranges |= {"slowest": (1e-6, 1.0, ""), "tracking": (0.0, 0.1, "m")}
        check_settings(self, ranges)
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

    Every choice proves as much: finer pieces free more motions, and cost more.

    Attributes:
        slice_s: Length of a piece that is tested by the cover [s].
        shell_slice_s: Length of a piece that is tested by the shells [s].
        at_once: How many of those are tested together first.
        places: Places on a motion at which it is checked that it leads away from a
            person.
        near: A person within m and this is near [m]; more than the close test's own
            share.
    """

    slice_s: float = 0.04
    shell_slice_s: float = 0.02
    at_once: int = 4
    places: int = 4
    near: float = 0.01

    def __post_init__(self) -> None:
        ranges: Ranges = {"at_once": (1, 1000, ""), "places": (2, 1000, "")}
        ranges |= dict.fromkeys(("slice_s", "shell_slice_s"), (1e-3, 10.0, "s"))
        check_settings(self, ranges | {"near": (0.0, 1.0, "m")})


@dataclass(frozen=True)
class TrackingSettings:
    """When a pushed robot counts as held still (`tracking.TrackingMonitor`).

    Attributes:
        still: No point of it moves by more than this [m],
        held_s: ... for so long [s]: then its set-point becomes where it is. More: a
            robot led by hand goes on by itself later.
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
        check_settings(self, {"step_s": (1e-3, 10.0, "s"), "most": (1, 10_000, "")})


@dataclass(frozen=True)
class FollowSettings:
    """How a person is followed from frame to frame (`threat.Watcher`).

    Attributes:
        drift_s: Time over which a part's drift is averaged, and for which the fastest
            part is remembered [s]; a hand that trembles at 5 Hz or faster gets nowhere
            in it.
        spurt_s: With noise, an acceleration is measured over this time [s].
        confirmed: Frames that must agree on a velocity before it counts.
        most_growth: A part that may be farther than this from where it is expected may
            be anywhere [m].
    """

    drift_s: float = 0.2
    spurt_s: float = 0.06
    confirmed: int = 3
    most_growth: float = 4.0

    def __post_init__(self) -> None:
        ranges: Ranges = dict.fromkeys(("drift_s", "spurt_s"), (1e-3, 10.0, "s"))
        ranges |= {"confirmed": (2, 1000, ""), "most_growth": (0.0, 100.0, "m")}
        check_settings(self, ranges)


@dataclass(frozen=True)
class AheadSettings:
    """How far ahead a limit of speed or jerk looks (`speed_limit.SpeedLimit`).

    Attributes:
        direction_s: Length of the motion's next piece, whose direction counts [s].
        jerk_s: Times from now at which points near a hand keep the limit of jerk [s]: a
            motion becomes gentle early enough for a gentle stop before the hand.
    """

    direction_s: float = 0.05
    jerk_s: tuple[float, ...] = (0.0, 0.2, 0.4)

    def __post_init__(self) -> None:
        check_settings(self, {"direction_s": (1e-3, 10.0, "s")})
        check_row(self, "jerk_s", 0.0, 10.0, "s")
