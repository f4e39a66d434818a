"""What tunes the execution: its speeds, its looks at people, and its tests.

What a caller sets is in `ExecutionSettings`, `ThreatSettings` and `SpeedSettings`. The
other classes here hold what was chosen once: their defaults are what the benches
measured.
"""

import math
from dataclasses import dataclass

from roadmap.ranges import CheckedSettings, setting


@dataclass(frozen=True)
class ExecutionSettings(CheckedSettings):
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
        latency_s: The robot is where its set-point was up to so long ago [s]: its
            control delay, and what it lags behind. 0: it follows at once. More: people
            count as so much nearer in time, and it is slower beside them.
        hold_delay_s: A moving robot goes on for so long after the planner holds [s],
            while its path up to the end of a stop is free. More: it passes a goal that
            is blocked for a moment, and comes nearer to one that stays blocked. Less:
            beside a trembling hand it stops and starts again and again.
        levels: Levels of speed; the fastest that passes the braking test is used.
        lower: Each level is this share of the one above. More levels, nearer to each
            other: less speed is lost to a person far away, and slowing down for one
            nearby takes more frames.
    """

    speed_scale: float = setting(0.5, 1e-6, 1.0)
    retreat_scale: float = setting(0.25, 1e-6, 1.0)
    yields: bool = True
    yield_scale: float = setting(1.0, 1e-6, 1.0)
    blend: float = setting(0.004, 0.0, 1.0, "m")
    commit_delay_s: float = setting(0.05, 0.0, 10.0, "s")
    min_retreat_separation: float = setting(0.022, 0.0, math.inf, "m")
    yield_gap: float = setting(0.005, 0.0, 0.1, "m")
    encoder_error: float = setting(0.0, 0.0, 0.1, "m")
    latency_s: float = setting(0.0, 0.0, 1.0, "s")
    hold_delay_s: float = setting(0.2, 0.0, 10.0, "s")
    levels: int = setting(5, 1, 100)
    lower: float = setting(0.6, 0.01, 0.99)

    @property
    def slowest_scale(self) -> float:
        """Share of the joints' speed limits of the slowest level that it uses."""
        return self.speed_scale * self.lower ** (self.levels - 1)


@dataclass(frozen=True)
class PaceSettings(CheckedSettings):
    """How the executor goes from speed to speed, and retreats (`executor.Executor`).

    Attributes:
        look_ahead_s: A higher speed must pass the test of a stop that begins this much
            later [s]. More: it speeds up later, and slows down less.
        set_off_s: A robot that was braked sets off where the braking test would pass
            this much later on its way, too, were the person as they are now [s],
        rests_s: ... or after so long [s]. 0: where it has to stop for somebody who
            stands still it starts and stops 20 times a second.
        creeps: Speeds below the slowest level, as shares of that one: where that is too
            fast it creeps on without a stop. 1: none.
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

    look_ahead_s: float = setting(0.02, 0.0, 10.0, "s")
    set_off_s: float = setting(0.05, 0.0, 10.0, "s")
    rests_s: float = setting(0.5, 0.0, 10.0, "s")
    creeps: tuple[float, ...] = setting((0.5,), 1e-6, 1.0)
    hindered_s: float = setting(0.12, 0.0, 10.0, "s")
    keep_every: int = setting(3, 1, 10_000)
    again: float = setting(1.5, 1.0, 100.0)
    harder: float = setting(4.0, 1.0, 100.0)
    retreat_every: int = setting(5, 1, 10_000)
    retreats: tuple[float, ...] = setting((1.0, 0.4, 0.15), 1e-6, 1.0)
    evasions: tuple[float, ...] = setting((0.8, 0.5, 0.2), 1e-6, 1.0)
    slowest: float = setting(0.01, 1e-6, 1.0)
    tracking: float = setting(0.002, 0.0, 0.1, "m")
    quick_s: float = setting(0.05, 0.0, 10.0, "s")


@dataclass(frozen=True)
class LookoutSettings(CheckedSettings):
    """How far ahead the lookout sees who comes, and how often (`lookout.Lookout`).

    Attributes:
        meets: Times at which it looks whether the person meets the robot [s]. At 1 m/s
            a hand does not get from one side of a link to the other between two.
        ahead: Times by which an evasion is asked to have led out of the way [s].
        between_looks: Least time between two looks [s].
        between_searches: Least time between two searches for an evasion [s], which
            take some milliseconds.
    """

    meets: tuple[float, ...] = setting(
        tuple(0.06 * k for k in range(1, 9)), 0.0, 10.0, "s"
    )
    ahead: tuple[float, ...] = setting((0.12, 0.24, 0.36, 0.48), 0.0, 10.0, "s")
    between_looks: float = setting(0.02, 0.0, 10.0, "s")
    between_searches: float = setting(0.05, 0.0, 10.0, "s")


@dataclass(frozen=True)
class StopTestSettings(CheckedSettings):
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

    slice_s: float = setting(0.04, 0.001, 10.0, "s")
    shell_slice_s: float = setting(0.02, 0.001, 10.0, "s")
    at_once: int = setting(4, 1, 1000)
    places: int = setting(4, 2, 1000)
    near: float = setting(0.01, 0.0, 1.0, "m")


@dataclass(frozen=True)
class TrackingSettings(CheckedSettings):
    """When a pushed robot counts as held still (`tracking.TrackingMonitor`).

    Attributes:
        still: No point of it moves by more than this [m],
        held_s: ... for so long [s]: then its set-point becomes where it is. More: a
            robot led by hand goes on by itself later.
        recalled_s: For so long set-points are kept, to tell a push from a robot that
            follows late [s].
    """

    still: float = setting(0.001, 0.0, 0.1, "m")
    held_s: float = setting(0.1, 0.0, 10.0, "s")
    recalled_s: float = setting(0.3, 0.0, 10.0, "s")


@dataclass(frozen=True)
class IntentSettings(CheckedSettings):
    """How finely a robot's intent is told (`robot_threat.intent_threat`).

    Every choice holds the robot: finer balls are smaller, and more of them.

    Attributes:
        step_s: Time between two places on a stretch, if it is short [s].
        most: Places on one stretch.
    """

    step_s: float = setting(0.02, 0.001, 10.0, "s")
    most: int = setting(24, 1, 10_000)


@dataclass(frozen=True)
class FollowSettings(CheckedSettings):
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

    drift_s: float = setting(0.2, 0.001, 10.0, "s")
    spurt_s: float = setting(0.06, 0.001, 10.0, "s")
    confirmed: int = setting(3, 2, 1000)
    most_growth: float = setting(4.0, 0.0, 100.0, "m")


@dataclass(frozen=True)
class AheadSettings(CheckedSettings):
    """How far ahead a limit of speed or jerk looks (`speed_limit.SpeedLimit`).

    Attributes:
        direction_s: Length of the motion's next piece, whose direction counts [s].
        jerk_s: Times from now at which points near a hand keep the limit of jerk [s]: a
            motion becomes gentle early enough for a gentle stop before the hand.
    """

    direction_s: float = setting(0.05, 0.001, 10.0, "s")
    jerk_s: tuple[float, ...] = setting((0.0, 0.2, 0.4), 0.0, 10.0, "s")
