"""Where the time of a run beside a person goes, and how many trips were possible.

Of a robot that makes half the trips it makes alone, was the place taken, was there no
way, or did it drive a long one? Who stands is asked by exact geometry, past the person
as they stand at that moment: is the place free, is the robot, does a way lead on?
"""

from collections.abc import Sequence

import numpy as np

from odm import ReactivePlanner
from odm.execution.executor import BRAKED, RETREATING, SLOWED
from sim.bench.driven_oracle import trips_driven
from sim.bench.trip_oracle import TripOracle
from sim.loop.loop import Frame, exact_audit
from sim.loop.run_result import RunResult
from sim.people.human_motion import HumanMotion

_EVERY = 10  # frames, of those in which it stands, between two that are asked
_PACES = {"slowed": (SLOWED, BRAKED), "evading": (RETREATING,)}
_STANDING = ("taken", "pinned", "no way", "waits")  # names that fit a terminal
_ORACLES = ("possible", "by sight", "stops", "yields", "drives")
_COLUMNS = (*_ORACLES, "trips", "detour", *_PACES, *_STANDING)


class PaceWatch:
    """Remembers what the executor did in each frame; a listener of a loop."""

    def __init__(self) -> None:
        """No frame was heard."""
        self.paces: list[str] = []

    def hear(self, frame: Frame) -> None:
        """Take a frame."""
        self.paces.append(frame.pace)


def lost_time(
    planner: ReactivePlanner,
    places: np.ndarray,
    human: HumanMotion,
    result: RunResult,
    paces: Sequence[str],
    speed_scale: float,
    trip_s: float,
) -> dict[str, float]:
    """Return the shares of the time by name, and the trips that were "possible".

    Those "by sight" are of one who sees the person as they are, and not what comes;
    who "stops" has to be able to besides, and who "yields" gets out of the way, too.
    Who "drives" does that with the dynamics of our robot.

    "trips" is what those made take a robot with nobody about; "detour" the rest of the
    time at full speed: longer ways, more corners, ways begun in vain. It stands since
    its place is "taken", within m of the person; else since it is "pinned", within m
    itself; else there is "no way", or one and it "waits".

    Args:
        planner: Its robot, roadmap and clearance count.
        places: (n, dof) the work places [rad or m].
        human: The person.
        result: The run.
        paces: (F,) what the executor did in each of its frames.
        speed_scale: Share of the joints' speed limits it used.
        trip_s: What a trip takes with nobody about [s].
    """
    oracle = TripOracle(planner, places, speed_scale)
    pace = np.array(paces)
    stands = ~np.r_[result.moving[1:], False]
    stands &= pace != RETREATING
    shares = {
        name: float(np.mean(np.isin(pace, states) & ~stands))
        for name, states in _PACES.items()
    }
    shares |= _standing(oracle, planner, places, result, np.flatnonzero(stands))
    shares["trips"] = result.trips * trip_s / result.duration_s
    shares["detour"] = 1.0 - sum(shares.values())
    run = (human.capsules, result.duration_s, trip_s)
    trips = (
        oracle.trips(*run),
        oracle.trips_by_sight(*run),
        oracle.trips_with_stops(*run),
        oracle.trips_with_stops(*run, yields=True),
        trips_driven(oracle, human, result.duration_s),
    )
    whole = result.duration_s / trip_s
    return shares | {k: n / whole for k, n in zip(_ORACLES, trips, strict=True)}


def _standing(
    oracle: TripOracle,
    planner: ReactivePlanner,
    places: np.ndarray,
    result: RunResult,
    frames: np.ndarray,
) -> dict[str, float]:
    """Return the shares of the time in which it stands, by why."""
    audit, m = exact_audit(planner.robot), planner.cell_map.safety.m
    counts = dict.fromkeys(_STANDING, 0)
    asked = frames[::_EVERY].tolist()
    for k in asked:
        person, place = result.capsules[k], int(result.place[k])
        if audit(places[place], person) < m:
            why = "taken"
        elif result.separation[k] < m:
            why = "pinned"
        elif oracle.leads_on(result.q[k], place, person):
            why = "waits"
        else:
            why = "no way"
        counts[why] += 1
    share = len(frames) / max(result.frames, 1) / max(len(asked), 1)
    return {name: count * share for name, count in counts.items()}


def lost_time_table(runs: Sequence[dict]) -> dict:
    """Return a table with a row for each motion: means over its runs [%].

    Args:
        runs: Each with its "motion", and "lost" of `lost_time`.
    """
    rows = []
    for name in dict.fromkeys(run["motion"] for run in runs):
        own = [run["lost"] for run in runs if run["motion"] == name]
        means = [100.0 * np.mean([one[key] for one in own]) for key in _COLUMNS]
        rows.append([name, *(f"{mean:.0f}" for mean in means)])
    title = "Trips possible and made, of those alone, and where the other time goes [%]"
    return {"title": title, "head": ["beside", *_COLUMNS], "rows": rows}
