"""Check a plan's JSON file without this project: python-fcl, dense in time.

Reads the file that `docs/plans.md` describes, the URDFs it names and their meshes,
and imports nothing of ours: `python sim/bench/handover/check.py plan.json`.

Tested at every moment: both agents against each other, against furniture and against
themselves, and the object against all. Left out: furniture against itself, the agents'
base links against furniture (they stand on it and never move), links of one agent that
are neighbours (no third link with geometry lies between them in the URDF; links welded
by fixed joints count as one), and the object against the links that the file lets touch
it while they hold it.

Moments lie so dense that nothing moves farther than `STEP` between two. python-fcl is
asked only where it can matter: boxes around solids bound a distance from below, and so
does a distance met at another moment, less what the one has moved in the other's frame
since. Between two moments of a pair the bound holds, too: nothing is nearer than half
of both distances less the way in between. Where that leaves less than `SHARE` of the
smallest distance of the kind, the time between is halved, until it does not, or until
the pair moves less than `FINE`. python-fcl's distances of round solids are up to 0.4 mm
too large, for which the bounds allow; its contacts are not, so whatever is nearer than
2 mm is asked for contact.
"""

import json
import sys
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import fcl
import numpy as np

STEP = 0.004  # [m] farthest that any point moves between two moments
FINE = 1e-4  # [m] a pair that moves less between two moments is not looked at between
SHARE = 0.5  # of the smallest distance: less must be excluded between moments, too
CAP = 0.05  # [m] distances beyond are not looked at
_NEAR = 0.002  # [m] nearer than this, contact is asked for, too
_ROUND = 5e-4  # [m] python-fcl's distances of round solids may be too large by this
_TINY = 1e-5  # [m] distances below are looked at, whatever was found before
_STILL = 1e-9  # [m] who moves less stands still
_CHUNK = 16  # moments with one box around a solid
_BESIDE = 1e-6  # [s] before a hold begins and after it ends
_SAME = 1e-3  # [m] the object may jump by this much where it changes hands
_AT_GOAL = (1e-3, np.radians(0.5))  # [m], [rad]
_KINDS = (
    ("giver", "receiver"), ("giver", "scenery"), ("receiver", "scenery"),
    ("giver", "giver"), ("receiver", "receiver"), ("object", "scenery"),
    ("object", "giver"), ("object", "receiver"),
)  # fmt: skip


@dataclass
class Solid:
    """A solid of a link: fcl's geometry, about the middle of a box around it."""

    link: str
    geometry: object
    T_link_solid: np.ndarray
    half: np.ndarray  # (3,) of the box [m]
    is_round: bool


@dataclass
class Urdf:
    """Links, joints and solids of a URDF."""

    root: str
    order: list  # (joint element data) parents first
    solids: list
    limits: dict
    group: dict  # link -> link that it is welded to
    neighbours: set = field(default_factory=set)


def check_plan(record: dict, step: float = STEP) -> dict:
    """Return what was found in a plan.

    Args:
        record: The plan as in its file.
        step: Farthest that any point moves between two moments [m].

    Returns:
        collisions: (time, one, other) of each that was met, the first of each pair;
        distances: the smallest of each kind, with time and pair, and `proved_m`, below
        which none of the kind is at any time, 0 where only moments of `FINE` tell;
        moments, and tests by python-fcl; duration_s; faults: sentences on limits, jumps
        and the goal; ok: neither.
    """
    return _Check(record, step).run()


class _Check:
    def __init__(self, record: dict, step: float) -> None:
        self.record, self.world = record, _World(record)
        self.faults: list[str] = []
        self.tests = _Tests(self.world)
        self.end = max((m["times"][-1] for m in record["motions"]), default=0.0)
        self.at = self.world.at(self._moments(step))
        self.way = self._ways()
        self.boxes = self._boxes()

    def run(self) -> dict:
        self._limits()
        self._slips()
        self._goal()
        traces, goals = [], {}
        for kind in _KINDS:
            found = self._search(kind)
            goals[kind] = max(SHARE * self.tests.best(kind), _TINY)
            traces.append((kind, found))
        open_ = {kind: self._between(kind, found, goals[kind])
                 for kind, found in traces}  # fmt: skip
        sampled = self._halve(open_, goals)
        names = {kind: "self of " + kind[0] if len(set(kind)) == 1 else " - ".join(kind)
                 for kind in _KINDS}  # fmt: skip
        collisions = self.tests.contacts
        return {
            "ok": not collisions and not self.faults,
            "collisions": [[t, *pair] for pair, t in collisions.items()],
            "distances": {
                names[k]: {
                    "distance_m": v[0], "time_s": v[1], "between": v[2],
                    "proved_m": 0.0 if k in sampled else min(goals[k], v[0]),
                }
                for k, v in self.tests.smallest.items()
            },
            "faults": self.faults,
            "moments": len(self.at.times),
            "tests": self.tests.count,
            "duration_s": self.end,
        }  # fmt: skip

    def _moments(self, step: float) -> np.ndarray:
        """Return times between which nothing moves farther than `step`."""
        times = {0.0, self.end}
        for motion in self.record["motions"]:
            times |= set(motion["times"])
        for hold in self.record["holds"]:
            last = self.end if hold["end"] is None else hold["end"]
            times |= {hold["begin"], last}
            times |= {hold["begin"] - _BESIDE, last + _BESIDE}
        knots = np.array(sorted(t for t in times if 0.0 <= t <= self.end))
        at = self.world.at(knots)
        far = _chords(at.R, at.p, self.world.radius[:, None]).max(axis=0, initial=0.0)
        each = np.maximum(np.ceil(1.2 * far / step), 1).astype(int)  # arcs are longer
        rows = [np.linspace(a, b, n + 1)[1:]
                for a, b, n in zip(knots, knots[1:], each, strict=False)]  # fmt: skip
        return np.concatenate([knots[:1], *rows])

    def _ways(self) -> np.ndarray:
        """Bound how far any point of a solid goes between two moments, (S, n - 1)."""
        world, at = self.world, self.at
        chords = _chords(at.R, at.p, world.radius[:, None])
        turned = np.stack([at.turned(s) for s in range(len(world.solids))])
        return chords + 0.25 * turned**2 * world.reach

    def _boxes(self) -> np.ndarray:
        """Return boxes (2, S, chunks, 3) that hold a solid during a chunk."""
        at, half = self.at, self.world.half
        extent = np.einsum("snij,sj->sni", np.abs(at.R), half)
        loose = np.zeros(extent.shape[:2])  # any place between is that near to an end
        loose[:, :-1] = 0.5 * self.way
        loose[:, 1:] = np.maximum(loose[:, 1:], 0.5 * self.way)
        extent += loose[..., None]
        first = np.arange(0, max(extent.shape[1] - 1, 1), _CHUNK)
        low, high = at.p - extent, at.p + extent
        boxes = np.stack([np.minimum.reduceat(low, first, axis=1),
                          np.maximum.reduceat(high, first, axis=1)])  # fmt: skip
        ends = np.minimum(first + _CHUNK, extent.shape[1] - 1)
        boxes[0] = np.minimum(boxes[0], low[:, ends])
        boxes[1] = np.maximum(boxes[1], high[:, ends])
        return boxes

    def _search(self, kind: tuple) -> list:
        """Find the smallest distance of a kind at all moments, and its contacts.

        Returns the traces of all pairs that were looked at, see `_Trace`.
        """
        one, other = self.world.pairs(kind)
        if not len(one):
            return []
        gaps = np.empty((len(one), self.boxes.shape[2]))
        for k in range(0, len(one), 256):
            a, b = one[k : k + 256], other[k : k + 256]
            apart = np.maximum(
                self.boxes[0][b] - self.boxes[1][a], self.boxes[0][a] - self.boxes[1][b]
            )
            gaps[k : k + 256] = np.linalg.norm(np.maximum(apart, 0.0), axis=-1)
        nearest, traces = gaps.min(axis=1), []
        for k in np.argsort(nearest, kind="stable"):
            wanted = max(self.tests.best(kind), _TINY)
            if nearest[k] >= wanted:
                break
            trace = self._trace(one[k], other[k], gaps[k] < wanted)
            if trace is not None:
                self._descend(kind, trace)
                traces.append(trace)
        return traces

    def _trace(self, a: int, b: int, chunks: np.ndarray) -> "_Trace | None":
        """Follow a pair through the chunks that are asked for."""
        n = len(self.at.times)
        use = np.zeros(n + _CHUNK, bool)
        for k in np.flatnonzero(chunks):
            use[k * _CHUNK : (k + 1) * _CHUNK + 1] = True
        rows = np.flatnonzero(use[:n])
        rows = rows[self.at.may_not_touch(a, b, rows)]
        if not len(rows):
            return None
        if self.world.radius[a] < self.world.radius[b]:
            a, b = b, a
        R, p = self.at.relative(a, b, rows)
        low = self.world.gap(a, b, R, p)
        way = _chords(R, p, self.world.radius[b])
        turned = self.at.turned(a, b)[np.minimum(rows[:-1], n - 2)] if n > 1 else way
        joined = np.diff(rows) == 1
        long = way + 0.25 * turned**2 * self.world.reach_of(a, b)
        return _Trace(
            a, b, rows, R, p, low, np.r_[0.0, np.cumsum(way)],
            np.where(joined, long, -np.inf), np.full(len(rows), np.inf),
        )  # fmt: skip

    def _descend(self, kind: tuple, trace: "_Trace") -> None:
        """Test a pair where it may be nearest, until nothing can be nearer."""
        while True:
            left = np.where(np.isinf(trace.exact), trace.low, np.inf)
            k = int(left.argmin())
            if left[k] >= max(self.tests.best(kind), _TINY):
                return
            self._test(kind, trace, k)

    def _test(self, kind: tuple, trace: "_Trace", k: int) -> None:
        """Test a pair at one moment; what it says of all other moments is noted."""
        moved = np.abs(trace.way - trace.way[k])
        same = moved <= _STILL
        t = self.at.times[trace.rows[int(same.argmax())]]
        d = self.tests.distance(kind, trace.a, trace.b, trace.R[k], trace.p[k], t)
        trace.exact[same] = d
        sure = d - self.world.error(trace.a, trace.b)
        np.maximum(trace.low, sure - moved, out=trace.low)

    def _between(self, kind: tuple, traces: list, goal: float) -> list:
        """Return (a, b, t, t, d, d) of what moments alone do not show to be apart."""
        found = []
        for trace in traces:
            for _ in range(2):
                rest = np.flatnonzero(
                    0.5 * (trace.low[:-1] + trace.low[1:] - trace.long) < goal
                )
                for k in np.union1d(rest, rest + 1):
                    if np.isinf(trace.exact[k]) and trace.low[k] < CAP:
                        self._test(kind, trace, int(k))
            times = self.at.times[trace.rows]
            for k in rest:
                met = min(trace.exact[k], trace.exact[k + 1]) <= 0.0
                if trace.long[k] > FINE and not met:
                    found.append((trace.a, trace.b, times[k], times[k + 1],
                                  trace.low[k], trace.low[k + 1]))  # fmt: skip
        return found

    def _halve(self, open_: dict, goals: dict) -> set:
        """Halve times between moments; return the kinds with any that is not proved."""
        sampled = set()
        rows = [(kind, *row) for kind, some in open_.items() for row in some]
        while rows:
            begin, end = (np.array([row[k] for row in rows]) for k in (3, 4))
            times, at = np.unique(
                np.concatenate([begin, 0.5 * (begin + end), end]), return_inverse=True
            )
            at, now, later = at.reshape(3, -1), self.world.at(times), []
            for k, (kind, a, b, t0, t1, low0, low1) in enumerate(rows):
                R, p = now.relative(a, b, at[:, k])
                middle = times[at[1, k]]
                d = self.tests.distance(kind, a, b, R[1], p[1], middle)
                low = d - self.world.error(a, b)
                turned = [np.abs(now.q[at[j + 1, k]] - now.q[at[j, k]])
                          @ now.moves(a, b, at[1, k]) for j in (0, 1)]  # fmt: skip
                curved = 0.25 * np.array(turned) ** 2 * self.world.reach_of(a, b)
                way = _chords(R, p, self.world.radius[b]) + curved
                for j, (ta, tb, la, lb) in enumerate(
                    ((t0, middle, low0, low), (middle, t1, low, low1))
                ):
                    if 0.5 * (la + lb - way[j]) >= goals[kind] or d <= 0.0:
                        continue
                    if way[j] <= FINE:
                        sampled.add(kind)
                        continue
                    later.append((kind, a, b, ta, tb, la, lb))
            rows = later
        return sampled

    def _slips(self) -> None:
        slip, t = self.world.slip(self.at)
        if slip > _SAME:
            self.faults.append(f"the object slips {slip * 1e3:.2f} mm at {t:.3f} s")

    def _limits(self) -> None:
        for motion in self.record["motions"]:
            urdf = self.world.urdf[motion["who"]]
            times, rows = np.array(motion["times"]), np.array(motion["positions"])
            for name, row in zip(motion["joints"], rows.T, strict=True):
                low, high, speed = urdf.limits[name]
                if row.min() < low - 1e-3 or row.max() > high + 1e-3:
                    self.faults.append(f"{motion['name']}: {name} leaves its limits")
                fast = np.abs(np.diff(row) / np.diff(times)).max(initial=0.0)
                if fast > 1.001 * speed + 1e-6:
                    self.faults.append(
                        f"{motion['name']}: {name} at {fast:.3f} exceeds {speed:.3f}"
                    )

    def _goal(self) -> None:
        ends = self.world.at(np.array([0.0, self.end]))
        wanted = [np.array(self.record["object"][k])
                  for k in ("T_world_start", "T_world_goal")]  # fmt: skip
        for k, (name, W) in enumerate(zip(("start", "goal"), wanted, strict=True)):
            R, p = (x[k] for x in ends.object)
            off = np.linalg.norm(p - W[:3, 3])
            cosine = 0.5 * (np.trace(R.T @ W[:3, :3]) - 1.0)
            turned = np.arccos(np.clip(cosine, -1.0, 1.0))
            if off > _AT_GOAL[0] or turned > _AT_GOAL[1]:
                self.faults.append(
                    f"the object is {off * 1e3:.2f} mm and "
                    f"{np.degrees(turned):.2f} deg from its {name}"
                )


@dataclass
class _Trace:
    """A pair at some of the moments, b in the frame of a; all lengths in metres.

    Attributes:
        a, b: The solids.
        rows: (m,) which moments.
        R, p: (m, 3, 3) and (m, 3), b's pose.
        low: (m,) not larger than the distance.
        way: (m,) no point of b has gone farther up to a moment than to another, by
            more than the difference; between the moments themselves, by chords.
        long: (m - 1,) the same of all times between two, arcs included; -inf between
            two that do not follow each other.
        exact: (m,) what python-fcl said, inf where it was not asked.
    """

    a: int
    b: int
    rows: np.ndarray
    R: np.ndarray
    p: np.ndarray
    low: np.ndarray
    way: np.ndarray
    long: np.ndarray
    exact: np.ndarray


class _Tests:
    """python-fcl's distances, and what was smallest of each kind."""

    def __init__(self, world: "_World") -> None:
        self.world, self.count = world, 0
        self.still = [fcl.CollisionObject(s.geometry) for s in world.solids]
        self.moved = [fcl.CollisionObject(s.geometry) for s in world.solids]
        self.smallest: dict = {}
        self._met: dict = {}

    @property
    def contacts(self) -> dict:
        """Pairs that met -> the first moment, in order of time."""
        return dict(sorted(self._met.items(), key=lambda item: item[1]))

    def best(self, kind: tuple) -> float:
        return self.smallest.get(kind, (CAP,))[0]

    def distance(
        self, kind: tuple, a: int, b: int, R: np.ndarray, p: np.ndarray, t: float
    ) -> float:
        """Return the distance of solid b at a pose in a's frame [m]; 0 is contact."""
        self.count += 1
        one, other = self.still[a], self.moved[b]
        other.setTransform(fcl.Transform(R, p))
        result = fcl.DistanceResult()
        d = max(fcl.distance(one, other, _DISTANCE, result), 0.0)
        if d < _NEAR:
            met = fcl.CollisionResult()
            if fcl.collide(one, other, fcl.CollisionRequest(), met):
                d = 0.0
        if d < self.best(kind):
            self.smallest[kind] = (d, round(float(t), 4), self._names(kind, a, b))
        if d <= 0.0:
            names = self._names(kind, a, b)
            self._met[names] = min(self._met.get(names, np.inf), round(float(t), 4))
        return d

    def _names(self, kind: tuple, a: int, b: int) -> tuple:
        whose, solids = self.world.whose, self.world.solids
        if whose[a] != kind[0] or (whose[b] == kind[0] and b < a):
            a, b = b, a
        return tuple(f"{whose[s]}/{solids[s].link}" for s in (a, b))


_DISTANCE = fcl.DistanceRequest()


class _World:
    """Everything in a plan: where all solids are at any times, at once."""

    def __init__(self, record: dict) -> None:
        self.record, self.urdf = record, {}
        self.solids, self.whose, self.driven = [], [], []
        for who in ("giver", "receiver"):
            self.urdf[who] = read_urdf(record[who]["urdf"])
            self._add(who, self.urdf[who].solids)
            for child, joint in self.urdf[who].order:
                if joint["kind"] != "fixed":
                    self.driven.append((who, child, joint))
        parts = record["object"]["parts"]
        self._add("object", [_shape(p, f"object {k}") for k, p in enumerate(parts)])
        self._add("scenery", [_shape(s, s["name"]) for s in record["scenery"]])
        self.half = np.array([s.half for s in self.solids])
        self.radius = np.linalg.norm(self.half, axis=1)
        self.holds = record["holds"]
        self.hold_T = np.array([h["T_link_object"] for h in self.holds], float)
        self._chains()

    def _add(self, who: str, solids: list) -> None:
        self.solids += solids
        self.whose += [who] * len(solids)

    def _chains(self) -> None:
        """Find the joints that move each solid, and how far they reach.

        `reach` (S, 1): no point of a solid is farther from a joint that the plan moves
        [m]. `weight` (joints,): slides count as turns of 0.1 m or more.
        """
        column = {(who, child): k for k, (who, child, _) in enumerate(self.driven)}
        moved = {
            (m["who"], name) for m in self.record["motions"] for name in m["joints"]
        }
        slides = np.array([j["kind"] == "prismatic" for _, _, j in self.driven], bool)
        self.weight = np.where(slides, 10.0, 1.0)
        self.chain, far, goes = {}, {}, {}
        for who, urdf in self.urdf.items():
            key = (who, urdf.root)
            self.chain[key] = np.zeros(len(self.driven), bool)
            far[key], goes[key] = 0.0, False
            for child, joint in urdf.order:
                key, up = (who, child), (who, joint["parent"])
                self.chain[key] = self.chain[up].copy()
                far[key] = far[up]
                if goes[up]:
                    far[key] += np.linalg.norm(joint["T"][:3, 3])
                goes[key] = goes[up]
                if joint["kind"] != "fixed":
                    self.chain[key][column[key]] = True
                    name = (joint["mimic"] or (joint["name"],))[0]
                    goes[key] |= (who, name) in moved
                    if joint["kind"] == "prismatic":
                        far[key] += self._travel(who, name, joint)
        none = np.zeros(len(self.driven), bool)
        self.of_hold = [self.chain.get((h["who"], h["link"]), none) for h in self.holds]
        carried = max((far.get((h["who"], h["link"]), 0.0)
                       + np.linalg.norm(T[:3, 3])
                       for h, T in zip(self.holds, self.hold_T, strict=True)
                       if h["who"] != "world"), default=0.0)  # fmt: skip
        reach = np.array([np.linalg.norm(s.T_link_solid[:3, 3]) for s in self.solids])
        for k, (solid, who) in enumerate(zip(self.solids, self.whose, strict=True)):
            mine = carried if who == "object" else far.get((who, solid.link), 0.0)
            reach[k] += 0.1 + self.radius[k] + mine
        self.reach = reach[:, None]
        self.of_solid = [
            self.chain.get((who, solid.link), none)
            for solid, who in zip(self.solids, self.whose, strict=True)
        ]

    def _travel(self, who: str, name: str, joint: dict) -> float:
        values = [abs(self.record[who]["joints"].get(name, 0.0))]
        for motion in self.record["motions"]:
            if motion["who"] == who and name in motion["joints"]:
                rows = np.array(motion["positions"])
                values.append(np.abs(rows[:, motion["joints"].index(name)]).max())
        _, factor, offset = joint["mimic"] or ("", 1.0, 0.0)
        return abs(factor) * max(values) + abs(offset)

    def reach_of(self, a: int, b: int) -> float:
        """Bound the lever of any joint on a pair that is nearer than `CAP` [m]."""
        return float(self.reach[a, 0] + self.reach[b, 0] + CAP)

    def error(self, a: int, b: int) -> float:
        """Return by how much a distance of python-fcl may be too large [m]."""
        any_round = self.solids[a].is_round or self.solids[b].is_round
        return _ROUND if any_round else 1e-6

    def pairs(self, kind: tuple) -> tuple[np.ndarray, np.ndarray]:
        """Return the pairs of a kind that are tested at all."""
        one, other = ([k for k, who in enumerate(self.whose) if who == w] for w in kind)
        found = [
            (a, b)
            for a in one
            for b in other
            if (kind[0] != kind[1] or a < b)
            and not self._left_out(kind, self.solids[a].link, self.solids[b].link)
        ]
        rows = np.array(found, int).reshape(-1, 2)
        return rows[:, 0], rows[:, 1]

    def _left_out(self, kind: tuple, a: str, b: str) -> bool:
        one, other = kind
        if one == other:
            return (a, b) in self.urdf[one].neighbours
        if other != "scenery" or one == "object":
            return False
        return self.urdf[one].group[a] == self.urdf[one].root

    def gap(self, a: int, b: int, R: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return distances of the boxes around two solids, never too large [m]."""
        there = np.einsum("nji,nj->ni", R, p)
        turned = np.abs(R)
        near = np.abs(p) - self.half[a] - turned @ self.half[b]
        far = (
            np.abs(there) - self.half[b] - np.einsum("nji,j->ni", turned, self.half[a])
        )
        return np.maximum(*(np.linalg.norm(np.maximum(x, 0.0), axis=1)
                            for x in (near, far)))  # fmt: skip

    def at(self, times: np.ndarray) -> "_Placed":
        """Place everything at times (n,)."""
        return _Placed(self, times)

    def values(self, times: np.ndarray) -> np.ndarray:
        """Return the value of every joint that is not fixed, (n, joints)."""
        told: dict = {}
        for who in self.urdf:
            for name, value in self.record[who]["joints"].items():
                told[who, name] = np.full(len(times), float(value))
        for motion in self.record["motions"]:
            late = times >= motion["times"][0]
            for name, row in zip(
                motion["joints"], np.array(motion["positions"]).T, strict=True
            ):
                told[motion["who"], name][late] = np.interp(
                    times[late], motion["times"], row
                )
        found = np.empty((len(times), len(self.driven)))
        for k, (who, _, joint) in enumerate(self.driven):
            name, factor, offset = joint["mimic"] or (joint["name"], 1.0, 0.0)
            found[:, k] = factor * told[who, name] + offset
        return found

    def slip(self, at: "_Placed") -> tuple[float, float]:
        """Return how far the object jumps where two hold it [m], and when [s]."""
        worst, when = 0.0, 0.0
        R, p = at.object
        corners = _box(-np.ones(3), np.ones(3))
        for k in range(len(self.holds)):
            rows = np.flatnonzero(at.held[k] & (at.hold != k))
            Q, o = at.carried(k, rows)
            for s, who in enumerate(self.whose):
                if who != "object" or not len(rows):
                    continue
                T = self.solids[s].T_link_solid
                points = (corners * self.half[s]) @ T[:3, :3].T + T[:3, 3]
                jump = np.einsum("nij,cj->nci", Q - R[rows], points)
                jump = np.linalg.norm(jump + (o - p[rows])[:, None], axis=2).max(axis=1)
                if jump.max() > worst:
                    worst, when = (
                        float(jump.max()),
                        float(at.times[rows[jump.argmax()]]),
                    )
        return worst, when


class _Placed:
    """Where everything is at some times.

    Attributes:
        times: (n,) [s].
        q: (n, joints) values.
        R, p: (S, n, 3, 3) and (S, n, 3), poses of all solids in the world.
        held: (holds, n) bool: which holds hold; `hold` (n,) is the first of them.
        object: (R, p) of the object.
    """

    def __init__(self, world: _World, times: np.ndarray) -> None:
        self.world, self.times = world, times
        self.q = world.values(times)
        self.links = self._links()
        self.held = np.array(
            [(h["begin"] - 1e-9 <= times)
             & (times <= (np.inf if h["end"] is None else h["end"] + 1e-9))
             for h in world.holds]
        ).reshape(len(world.holds), len(times))  # fmt: skip
        nobody = ~self.held.any(axis=0)
        if nobody.any():
            raise ValueError(f"nothing holds the object at {times[nobody][0]} s")
        self.hold = self.held.argmax(axis=0)
        R, p = np.empty((len(times), 3, 3)), np.empty((len(times), 3))
        for k in range(len(world.holds)):
            rows = np.flatnonzero(self.hold == k)
            R[rows], p[rows] = self.carried(k, rows)
        self.object = R, p
        self._place()

    def carried(self, k: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return where a hold has the object at some of the times."""
        hold, T = self.world.holds[k], self.world.hold_T[k]
        if hold["who"] == "world":
            R, p = np.eye(3)[None], np.zeros((1, 3))
        else:
            R, p = self.links[hold["who"], hold["link"]]
        n = len(self.times)
        R, p = np.broadcast_to(R, (n, 3, 3))[rows], np.broadcast_to(p, (n, 3))[rows]
        return R @ T[:3, :3], R @ T[:3, 3] + p

    def _links(self) -> dict:
        """Return (R, p) of every link; one row where it never moves."""
        found, column = {}, 0
        for who, urdf in self.world.urdf.items():
            T = np.array(self.world.record[who]["T_world_base"], float)
            found[who, urdf.root] = T[None, :3, :3], T[None, :3, 3]
            for child, joint in urdf.order:
                R, p = found[who, joint["parent"]]
                T = joint["T"]
                R, p = R @ T[:3, :3], R @ T[:3, 3] + p
                if joint["kind"] != "fixed":
                    value = self.q[:, column]
                    if (value == value[0]).all():
                        value = value[:1]
                    R, p = _moved_by(joint, value, R, p)
                    column += 1
                found[who, child] = R, p
        return found

    def _place(self) -> None:
        world = self.world
        S, n = len(world.solids), len(self.times)
        self.R, self.p = np.empty((S, n, 3, 3)), np.empty((S, n, 3))
        still = np.eye(3)[None], np.zeros((1, 3))
        for s, (solid, who) in enumerate(zip(world.solids, world.whose, strict=True)):
            R, p = (
                still
                if who == "scenery"
                else self.links.get((who, solid.link), self.object)
            )
            T = solid.T_link_solid
            self.R[s], self.p[s] = R @ T[:3, :3], R @ T[:3, 3] + p

    def relative(self, a: int, b: int, rows: np.ndarray) -> tuple:
        """Return the poses (R, p) of solid b in the frame of a."""
        back = self.R[a, rows].transpose(0, 2, 1)
        off = (self.p[b, rows] - self.p[a, rows])[..., None]
        return back @ self.R[b, rows], (back @ off)[..., 0]

    def moves(self, a: int, b: int, row: int) -> np.ndarray:
        """Return the weight of each joint that moves b in the frame of a."""
        one, other = (self._chain(s, self.hold[row]) for s in (a, b))
        return self.world.weight * (one != other)

    def turned(self, a: int, b: int | None = None) -> np.ndarray:
        """Return how far joints turn between moments that move a (or a to b)."""
        found = np.empty(len(self.q) - 1)
        for k, rows in self._turns:
            one = self._chain(a, k)
            other = np.zeros_like(one) if b is None else self._chain(b, k)
            weight = self.world.weight * (one != other)
            found[rows] = self._dq[rows] @ weight
        return found

    @cached_property
    def _dq(self) -> np.ndarray:
        return np.abs(np.diff(self.q, axis=0))

    @cached_property
    def _turns(self) -> list:
        """Return (hold, steps during it)."""
        ends = np.flatnonzero(np.diff(self.hold[:-1])) + 1
        parts = np.r_[0, ends], np.r_[ends, len(self.hold) - 1]
        return [(self.hold[a], slice(a, b)) for a, b in zip(*parts, strict=True)]

    def _chain(self, s: int, hold: int) -> np.ndarray:
        of_object = self.world.whose[s] == "object"
        return self.world.of_hold[hold] if of_object else self.world.of_solid[s]

    def may_not_touch(self, a: int, b: int, rows: np.ndarray) -> np.ndarray:
        """Return (n,) bool: when a pair is tested, of an object and who may hold it."""
        world, free = self.world, np.ones(len(rows), bool)
        for s, other in ((a, b), (b, a)):
            if world.whose[s] != "object":
                continue
            for k, hold in enumerate(world.holds):
                mine = hold["who"] == world.whose[other]
                if mine and world.solids[other].link in hold["touching"]:
                    free &= ~self.held[k, rows]
        return free


def _chords(R: np.ndarray, p: np.ndarray, radius: object) -> np.ndarray:
    """Bound how far points of a ball about each origin are from one pose to the next.

    A turn moves a point by at most its distance times the largest singular value of
    the difference of both rotations: its Frobenius norm over the root of 2.
    """
    turn = np.linalg.norm(np.diff(R, axis=-3), axis=(-2, -1)) / np.sqrt(2.0)
    return np.linalg.norm(np.diff(p, axis=-2), axis=-1) + turn * radius


def _moved_by(joint: dict, value: np.ndarray, R: np.ndarray, p: np.ndarray) -> tuple:
    """Return poses (R, p) behind a joint at values (n,)."""
    x, y, z = joint["axis"] / np.linalg.norm(joint["axis"])
    if joint["kind"] == "prismatic":
        return R, p + (R @ np.array([x, y, z])) * value[:, None]
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sine, rest = np.sin(value)[:, None, None], 1.0 - np.cos(value)[:, None, None]
    return R @ (np.eye(3) + sine * K + rest * (K @ K)), p


# --- reading ------------------------------------------------------------------


def read_urdf(path: str) -> Urdf:
    """Read links, joints, solids and neighbours of a URDF."""
    tree = ET.fromstring(Path(path).read_bytes())
    joints, limits = {}, {}
    for node in tree.findall("joint"):
        kind, mimic, limit = node.get("type"), node.find("mimic"), node.find("limit")
        axis = node.find("axis")
        joints[node.find("child").get("link")] = {
            "name": node.get("name"),
            "kind": kind,
            "parent": node.find("parent").get("link"),
            "T": _origin(node),
            "axis": _numbers(axis.get("xyz")) if axis is not None else np.eye(3)[0],
            "mimic": None if mimic is None else (
                mimic.get("joint"), float(mimic.get("multiplier", 1)),
                float(mimic.get("offset", 0)),
            ),
        }  # fmt: skip
        if limit is not None:
            turns = kind == "continuous"
            limits[node.get("name")] = (
                -np.inf if turns else float(limit.get("lower", 0)),
                np.inf if turns else float(limit.get("upper", 0)),
                float(limit.get("velocity", np.inf)),
            )
    links = [node.get("name") for node in tree.findall("link")]
    root = next(name for name in links if name not in joints)
    order, reached = [], [root]
    for parent in reached:
        for child, joint in joints.items():
            if joint["parent"] == parent:
                order.append((child, joint))
                reached.append(child)
    solids = []
    for node in tree.findall("link"):
        shapes = node.findall("collision") or node.findall("visual")
        solids += [_link_solid(node.get("name"), s, Path(path)) for s in shapes]
    group = {root: root}
    for child, joint in order:
        group[child] = group[joint["parent"]] if joint["kind"] == "fixed" else child
    urdf = Urdf(root, order, solids, limits, group)
    urdf.neighbours = _neighbours(urdf)
    return urdf


def _neighbours(urdf: Urdf) -> set:
    """Return pairs of links with geometry with no third between them, both ways."""
    full = {urdf.group[s.link] for s in urdf.solids}
    up = {urdf.root: None}
    for child, joint in urdf.order:
        if urdf.group[child] == child:
            up[child] = urdf.group[joint["parent"]]

    def way(link: str) -> list:
        found = []
        while link is not None:
            found.append(link)
            link = up[link]
        return found

    pairs = set()
    links = {s.link for s in urdf.solids}
    for a in links:
        for b in links:
            wa, wb = way(urdf.group[a]), way(urdf.group[b])
            meet = next(x for x in wa if x in wb)
            between = wa[: wa.index(meet) + 1] + wb[: wb.index(meet)]
            between = [x for x in between if x in full]
            if set(between) <= {urdf.group[a], urdf.group[b]}:
                pairs.add((a, b))
    return pairs


def _motion(kind: str, axis: np.ndarray, value: float) -> np.ndarray:
    T, (x, y, z) = np.eye(4), axis / np.linalg.norm(axis)
    if kind == "prismatic":
        T[:3, 3] = value * np.array([x, y, z])
        return T
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    T[:3, :3] += np.sin(value) * K + (1 - np.cos(value)) * K @ K
    return T


def _numbers(text: str) -> np.ndarray:
    return np.array([float(x) for x in text.split()])


def _origin(node: object) -> np.ndarray:
    T, origin = np.eye(4), node.find("origin")
    if origin is None:
        return T
    for k, angle in enumerate(_numbers(origin.get("rpy", "0 0 0"))):
        T[:3, :3] = _motion("revolute", np.eye(3)[k], angle)[:3, :3] @ T[:3, :3]
    T[:3, 3] = _numbers(origin.get("xyz", "0 0 0"))
    return T


def _link_solid(link: str, node: object, urdf: Path) -> Solid:
    shape, T = node.find("geometry")[0], _origin(node)
    if shape.tag == "box":
        return _made(link, T, "box", _numbers(shape.get("size")))
    if shape.tag == "sphere":
        return _made(link, T, "sphere", float(shape.get("radius")))
    if shape.tag in ("cylinder", "capsule"):
        sizes = float(shape.get("radius")), float(shape.get("length"))
        return _made(link, T, shape.tag, sizes)
    import trimesh

    name = shape.get("filename").split("://")[-1]
    places = [up / name for up in (urdf.parent, *urdf.parents)]
    file = next(place for place in places if place.is_file())
    mesh = trimesh.load(file, force="mesh")
    scale = _numbers(shape.get("scale", "1 1 1"))
    return _made(link, T, "hull", np.asarray(mesh.vertices) * scale)


def _shape(entry: dict, name: str) -> Solid:
    T, kind = np.array(entry["pose"]), entry["type"]
    if kind == "mesh":
        triangles = np.array(entry["vertices"]), np.array(entry["faces"])
        return _made(name, T, "mesh", triangles)
    if kind == "box":
        return _made(name, T, kind, np.array(entry["size"]))
    if kind == "sphere":
        return _made(name, T, kind, entry["radius"])
    return _made(name, T, kind, (entry["radius"], entry["length"]))


def _made(link: str, T: np.ndarray, kind: str, size: object) -> Solid:
    """Return a solid with its frame in the middle of a box around it."""
    if kind == "box":
        return Solid(link, fcl.Box(*size), T, 0.5 * np.array(size), False)
    if kind == "sphere":
        return Solid(link, fcl.Sphere(size), T, np.full(3, size), True)
    if kind in ("cylinder", "capsule"):
        shape = fcl.Cylinder if kind == "cylinder" else fcl.Capsule
        high = 0.5 * size[1] + (size[0] if kind == "capsule" else 0.0)
        return Solid(link, shape(*size), T, np.array([size[0], size[0], high]), True)
    points, faces = size if kind == "mesh" else _hull(size)
    # a mesh that is convex is a solid; another one is its surface
    solid = kind == "hull" or _is_convex(points, faces)
    if solid:
        points, faces = _hull(points)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    points, to_middle = points - middle, np.eye(4)
    to_middle[:3, 3] = middle
    if solid:
        rows = np.insert(faces, 0, 3, axis=1).ravel()
        geometry = fcl.Convex(points, len(faces), rows)
    else:
        geometry = fcl.BVHModel()
        geometry.beginModel(len(points), len(faces))
        geometry.addSubModel(points, faces)
        geometry.endModel()
    return Solid(link, geometry, T @ to_middle, points.max(axis=0), False)


def _box(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    ends = np.stack([low, high])
    return np.array([[ends[i, 0], ends[j, 1], ends[k, 2]]
                     for i in (0, 1) for j in (0, 1) for k in (0, 1)])  # fmt: skip


def _hull(points: np.ndarray) -> tuple:
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    place = np.full(len(points), -1)
    place[hull.vertices] = np.arange(len(hull.vertices))
    corners, faces = points[hull.vertices], place[hull.simplices]
    a, b, c = (corners[faces[:, k]] for k in range(3))
    inward = np.einsum("ni,ni->n", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    return corners, np.where(inward[:, None], faces[:, ::-1], faces)


def _is_convex(points: np.ndarray, faces: np.ndarray) -> bool:
    from scipy.spatial import ConvexHull

    a, b, c = (points[faces[:, k]] for k in range(3))
    volume = abs(np.einsum("ni,ni->n", a, np.cross(b, c)).sum()) / 6.0
    return bool(ConvexHull(points).volume - volume <= 1e-9)


def main() -> int:
    """Check the plans that are named and print what was found."""
    wrong = 0
    for name in sys.argv[1:]:
        found = check_plan(json.loads(Path(name).read_text(encoding="utf-8")))
        wrong += not found["ok"]
        print(name, "is free" if found["ok"] else "is NOT free", found["collisions"])
        for kind, row in found["distances"].items():
            print(f"  {kind}: {row['distance_m'] * 1e3:.2f} mm at {row['time_s']} s,",
                  *row["between"])  # fmt: skip
        for fault in found["faults"]:
            print(f"  {fault}")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
