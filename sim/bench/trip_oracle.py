"""How many trips are possible beside a person: an oracle that knows what comes.

It goes to and fro at the speed of a robot with nobody about, by the way that brings it
there soonest: on the roadmap first, then straightened between the corners. It knows
where the person will be; their distance is exact, so neither cover nor cells take space
from it, and it never brakes: it sets off later. It keeps m while it moves; whoever
comes to it while it stands is let come. A robot that has to see, to prove and to brake
cannot do what it does. It is no strict bound: another way may be shorter still, though
all corners are turned at full speed.

A second one sees where the person is, and knows nothing of what comes. It plans past a
person who stays, twenty times a second, and stops at once where the person has come.

A third one sees no more, and cannot stop at once. It brakes as hard as its joints can,
and goes on at a speed only if it keeps m until it stands from all places where the
person may be by then: the bounds are those of the braking test. It may also yield: get
out of the way of who comes along any straight motion that is free, as a robot does.
"""

import heapq
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from odm import ReactivePlanner
from odm.exact.distances import ExactRobot, capsule_obstacles
from odm.execution.settings import ExecutionSettings
from odm.execution.threat import Threat, Watcher
from odm.obstacles.obstacles import Obstacles
from roadmap.kinematics.forward import difference

_JOINED = 24  # nodes that a configuration is joined to
_PARTS = 4  # of each leg of a way, between which it is straightened
_STEP = 0.04  # [s] the distance is looked at so often
_LATER = 0.05  # [s] a motion that is not free is tried again so much later
_MOST_TESTS = 4000  # of motions, for one way
_LOOK = 0.05  # [s] who knows nothing of what comes looks so often
_MOST_AT_A_LOOK = 1000  # of motions, for a way past the person as they are
_SOONER = 0.95  # another way takes so much less time, or is not taken

# of one who must be able to stop
_TICK = 0.01  # [s] it says anew how fast it goes
_STANDS = 1e-6  # share of the full speed
_PACES = (1.0, 0.8, 0.6, 0.45, 0.3, 0.15)  # shares of the full speed it may go at
_OUT = 64  # straight motions to nodes, reached soonest, out of the way of who comes
_AHEAD = (0.12, 0.24, 0.36, 0.48)  # [s] who comes is led on by, at their mean velocity
_PLENTY = 0.12  # [m] a way out that keeps so much more than m need not keep more

PersonAt = Callable[[float], np.ndarray]
Vertices = tuple[int, ...]


class _Graph(NamedTuple):
    """Configurations, and what leads from one to the next.

    Attributes:
        q: Configurations [rad or m].
        ways: Vertex -> (vertex, time needed [s]) of each motion from it.
        left: No way from a vertex to the goal takes less [s].
        goal: The vertex to reach.
        proved: All motions are free of what stands still.
    """

    q: list[np.ndarray]
    ways: Callable[[int], list[tuple[int, float]]]
    left: np.ndarray
    goal: int
    proved: bool


@dataclass
class _Rider:
    """One who must be able to stop.

    Attributes:
        way: Where it is, and the corners ahead [rad or m]; a stop on it is free.
        speed: Of the full speed on it.
        out: Whether this way leads out of somebody's way, not to a place.
    """

    way: list[np.ndarray]
    speed: float = 0.0
    out: bool = False


class TripOracle:
    """Finds the soonest trips between work places.

    Args:
        planner: Its robot, roadmap, clearance and scenery count; its frames do not.
        places: (n, dof) the work places [rad or m].
        speed_scale: Share of the joints' speed limits.
    """

    def __init__(
        self, planner: ReactivePlanner, places: np.ndarray, speed_scale: float
    ) -> None:
        """Join the places to the roadmap, and measure all ways with nobody about."""
        self.planner, self.exact = planner, ExactRobot(planner.robot)
        self.scale, self._speed = speed_scale, speed_scale * planner.robot.max_velocity
        self.m = planner.cell_map.safety.m
        self.places = np.array(places)
        roadmap = planner.cell_map.roadmap
        self._q, self._ways = list(roadmap.nodes), [[] for _ in roadmap.nodes]
        for a, b in roadmap.edges.tolist():
            self._link(a, b)
        self._places = [self._add(q) for q in places]
        for k, a in enumerate(self._places):
            for b in self._places[:k]:
                self._link_if_free(a, b)
        self._left = [self._time_to(place) for place in self._places]
        self._known: dict[int, Any] = {}

    def way_alone(self, place: int) -> float:
        """Return how long the way to a place takes with nobody about [s]."""
        return float(self._left[place][self._places[place - 1]])

    def trips(self, person: PersonAt, seconds: float, trip_s: float) -> float:
        """Return the trips in a time, the last one by how much of it was done.

        Args:
            person: Time [s] -> (k, 7) capsules [m].
            seconds: How long it goes to and fro [s].
            trip_s: What a trip takes a robot that has nobody about [s]: what this is
                more than the way, to get up speed and to stop, each trip takes here.
        """
        self._known.clear()
        now, trips, at = 0.0, 0, 0
        while True:
            to = (at + 1) % len(self._places)
            begun = now
            begin = now + max(trip_s - self.way_alone(to), 0.0)
            now = self._arrival(self._places[at], to, begin, person, seconds)
            if now >= seconds:
                return trips + (seconds - begun) / max(now - begun, 1e-9)
            trips, at = trips + 1, to

    def trips_by_sight(self, person: PersonAt, seconds: float, trip_s: float) -> float:
        """Return the trips of one who sees the person as they are, and no more.

        The arguments are those of `trips`. It goes along its way as long as that keeps
        m from the person as they are now, and takes another that is sooner.
        """
        now, trips, to, q = 0.0, 0, 1, self._q[self._places[0]]
        way: list[np.ndarray] = []
        begin = max(trip_s - self.way_alone(to), 0.0)  # to get up speed, and to stop
        while now < seconds:
            here, now = now, min(now + _LOOK, seconds)
            while True:
                way = self.way_by_sight(way, q, to, person(here))
                leaves = max(here, begin)
                if not way or leaves >= now:
                    break
                way, needed = self._gone(way, now - leaves)
                q = way[0]
                if len(way) > 1:
                    break
                trips, way, to = trips + 1, [], (to + 1) % len(self._places)
                begin = leaves + needed + max(trip_s - self.way_alone(to), 0.0)
        return trips + self.done(q, to)

    def trips_with_stops(
        self, person: PersonAt, seconds: float, trip_s: float, yields: bool = False
    ) -> float:
        """Return the trips of one who sees the person as they are, and must brake.

        The other arguments are those of `trips`. It is at full speed at once, and in
        all corners; it slows down within the joints' accelerations.

        Args:
            person: Time [s] -> (k, 7) capsules [m].
            seconds: How long it goes to and fro [s].
            trip_s: What a trip takes a robot that has nobody about [s].
            yields: Whether it gets out of the way of who is about to come within m.
        """
        watcher, rider = Watcher(), _Rider([self._q[self._places[0]]])
        trips, to, ahead = 0, 1, list(rider.way)
        begin = max(trip_s - self.way_alone(to), 0.0)  # to get up speed, and to stop
        for k in range(round(seconds / _TICK)):
            now, looks = k * _TICK, k % round(_LOOK / _TICK) == 0
            rows = person(now)
            threat = watcher.look(rows, now)
            if rider.out or len(ahead) < 2:
                ahead = []
            if looks:
                ahead = self.way_by_sight(ahead, rider.way[0], to, rows)
            if now >= begin and self._rides(rider, ahead, threat, self.m):
                rider.out = False
                ahead = rider.way
                if len(ahead) == 1:
                    trips, to = trips + 1, (to + 1) % len(self._places)
                    rider.speed = 0.0
                    begin = now + _TICK + max(trip_s - self.way_alone(to), 0.0)
                continue
            if not (yields and self._gets_out(rider, to, threat, looks)):
                rider.out = rider.out and rider.speed > _STANDS
                rider.way, rider.speed = self._after(rider, rider.way, 0.0)
                if rider.speed >= _STANDS:
                    ahead = rider.way
        return trips + self.done(rider.way[0], to)

    def leads_on(self, q: np.ndarray, place: int, capsules: np.ndarray) -> bool:
        """Whether a way leads from q (dof,) to a place past a person who stays."""
        return bool(self._past(q, place, capsules, _MOST_TESTS)[1])

    def done(self, q: np.ndarray, place: int) -> float:
        """Return how much of a trip to a place is done at q (dof,), in [0, 1]."""
        left = self._time(q, self._q[self._places[place]]) / self.way_alone(place)
        return max(0.0, 1.0 - left)

    def way_by_sight(
        self,
        way: list[np.ndarray],
        q: np.ndarray,
        place: int,
        capsules: np.ndarray,
        takes: Callable[[list[np.ndarray]], float] | None = None,
    ) -> list[np.ndarray]:
        """Return the way from q to a place, past a person who stays; [] for none."""
        self._known.clear()
        legs = list(zip(way[:-1], way[1:], strict=True))
        if not all(self._is_free(a, b, 0.0, lambda t: capsules) for a, b in legs):
            legs, way = [], []
        ends = q, self._q[self._places[place]]
        if len(legs) == 1 or not all(
            self._keeps_clear(end, 0.0, lambda t: capsules) for end in ends
        ):
            return way  # nothing is shorter, or nothing leads there
        time, other = self._past(q, place, capsules, _MOST_AT_A_LOOK)
        if not other:
            return way
        if takes is not None:
            return way if way and takes(other) > _SOONER * takes(way) else other
        present = sum(self._time(a, b) for a, b in legs)
        return way if way and time > _SOONER * present else other

    def _gets_out(
        self, rider: "_Rider", place: int, threat: Threat, looks: bool
    ) -> bool:
        """Whether it goes on, or begins, to get out of the way of who comes."""
        gap, twice = ExecutionSettings().yield_gap, 1.0 / self.scale
        if rider.out and len(rider.way) > 1:
            if self._rides(rider, rider.way, threat, gap, twice):
                return True
        if not (looks and threat.leads_on):
            return False
        q = rider.way[0]
        coming = threat.likely(0.0, *_AHEAD)
        if not self.exact.collides(q, capsule_obstacles(coming.capsules), self.m):
            return False
        way = self.way_out(q, place, [(t, threat.likely(t)) for t in _AHEAD])
        rider.out = bool(way) and self._rides(rider, way, threat, gap, twice)
        return rider.out

    def way_out(
        self, q: np.ndarray, place: int, coming: Sequence[tuple[float, Obstacles]]
    ) -> list[np.ndarray]:
        """Return the straight motion that keeps most from who comes, or [].

        Of those that keep plenty, it is the one from whose end the place is nearest.
        """
        ways = difference(self.planner.robot, q, self.planner.cell_map.roadmap.nodes)
        needs = (np.abs(ways) / (self._speed / self.scale)).max(axis=1)
        there = [(t, capsule_obstacles(who.capsules)) for t, who in coming]
        most = self.m + _PLENTY

        def keeps(way: np.ndarray, needed: float) -> float:
            near = (
                self.exact.distance(q + way * min(t / needed, 1.0), who, cap=most)
                for t, who in there
            )
            return min(each.distance for each in near)

        stays = keeps(np.zeros_like(q), 1.0)
        found = []
        for k in np.argsort(needs, kind="stable")[:_OUT].tolist():
            kept = keeps(ways[k], max(needs[k], 1e-9))
            if kept > stays:
                found.append((-kept, self._left[place][k], k))
        for _, _, k in sorted(found):
            if self.planner.static.motion_free(q, ways[k]):
                return [q, q + ways[k]]
        return []

    def _rides(
        self,
        rider: "_Rider",
        way: list[np.ndarray],
        threat: Threat,
        gap: float,
        most: float = 1.0,
    ) -> bool:
        """Go along a way at the highest pace from which it can stop; False: at none."""
        if len(way) < 2:
            return False
        there: dict[float, Any] = {}
        for pace in _PACES:
            after, speed = self._after(rider, way, pace * most)
            if self._stops(after, speed, threat, gap, there):
                rider.way, rider.speed = after, speed
                return True
        return False

    def _stops(
        self,
        way: list[np.ndarray],
        speed: float,
        threat: Threat,
        gap: float,
        there: dict[float, Any],
    ) -> bool:
        """Whether a stop behind the next tick keeps a gap from where they may be."""
        t = _TICK
        while True:
            if t not in there:
                room, more = threat.between(t, t)
                there[t] = None if more else capsule_obstacles(room.capsules)
            if there[t] is None or self.exact.collides(way[0], there[t], gap):
                return False
            if speed < _STANDS or len(way) == 1:
                return True
            slows = self._slows(way)
            passed = min(_STEP, speed / slows)
            way, _ = self._gone(way, speed * passed - 0.5 * slows * passed**2)
            speed, t = speed - slows * passed, t + passed

    def _after(
        self, rider: "_Rider", way: list[np.ndarray], pace: float
    ) -> tuple[list[np.ndarray], float]:
        """Return what is left of a way after a tick toward a pace, and the speed."""
        if len(way) < 2:
            return way, 0.0
        speed = max(pace, rider.speed - self._slows(way) * _TICK)
        return self._gone(way, speed * _TICK)[0], speed

    def _slows(self, way: list[np.ndarray]) -> float:
        """Return how fast the share of the full speed can fall on a leg [1/s]."""
        leg = np.abs(difference(self.planner.robot, way[0], way[1]))
        leg = np.maximum(leg, 1e-12)  # a place may be a node: a leg of no length
        most = (self.planner.robot.max_acceleration / leg).min()
        return float(most * (leg / self._speed).max())

    def _past(
        self, q: np.ndarray, place: int, capsules: np.ndarray, most: int
    ) -> tuple[float, list[np.ndarray]]:
        """Return the time [s] and corners from q to a place, past who stays."""

        def person(t: float) -> np.ndarray:
            return capsules

        self._known.clear()
        n, left = len(self._q), self._left[place]
        start = self._add(q)
        self._link_if_free(start, self._places[place])
        own = min((w + left[k] for k, w in self._ways[start]), default=math.inf)
        graph = self._graph(place, np.append(left, own))
        how = {"stays": True, "most": most}
        time, found = self._soonest(graph, start, 0.0, person, **how)
        way = [self._q[k] for k in found]
        for k, _ in self._ways[start]:
            self._ways[k].pop()
        del self._q[n:], self._ways[n:]
        if len(way) > 2:
            straight = self._straightened(way)
            sooner, found = self._soonest(straight, 0, 0.0, person, **how)
            if found and sooner <= time:
                return sooner, [straight.q[k] for k in found]
        return time, way

    def _gone(
        self, way: list[np.ndarray], most: float
    ) -> tuple[list[np.ndarray], float]:
        """Return what is left of a way at full speed, and the time [s] up to `most`."""
        way, passed = list(way), 0.0
        while len(way) > 1:
            needs = self._time(way[0], way[1])
            if passed + needs > most:
                leg = difference(self.planner.robot, way[0], way[1])
                way[0] = way[0] + leg * ((most - passed) / needs)
                return way, most
            del way[0]
            passed += needs
        return way, passed

    def _arrival(
        self, start: int, place: int, now: float, person: PersonAt, end: float
    ) -> float:
        """Return when it can be at a place [s]; from `end` on: not by then."""
        graph = self._graph(place, self._left[place])
        goal, clear = self._q[graph.goal], now + graph.left[start]
        while not self._keeps_clear(goal, clear, person):
            clear += _LATER
            if clear >= end:
                return clear
        at, way = self._soonest(graph, start, now, person, end, clear)
        if not way:
            return at
        straight = self._straightened([self._q[k] for k in way])
        return min(at, self._soonest(straight, 0, now, person, at, clear)[0])

    def _graph(self, place: int, left: np.ndarray) -> _Graph:
        goal = self._places[place]
        return _Graph(self._q, self._ways.__getitem__, left, goal, True)

    def _straightened(self, corners: list[np.ndarray]) -> _Graph:
        """Return all straight motions forward between points of a way."""
        q = [corners[0]]
        for a, b in zip(corners[:-1], corners[1:], strict=True):
            way = difference(self.planner.robot, a, b)
            q += [a + way * (k / _PARTS) for k in range(1, _PARTS + 1)]
        goal, times = len(q) - 1, [[self._time(a, b) for b in q] for a in q]

        def ways(k: int) -> list[tuple[int, float]]:
            return [(j, times[k][j]) for j in range(k + 1, goal + 1)]

        return _Graph(q, ways, np.array([row[goal] for row in times]), goal, False)

    def _soonest(
        self,
        graph: _Graph,
        start: int,
        now: float,
        person: PersonAt,
        end: float = math.inf,
        clear: float = 0.0,
        stays: bool = False,
        most: int = _MOST_TESTS,
    ) -> tuple[float, Vertices]:
        """Return when it can be at the goal [s], and by which vertices.

        Who may wait anywhere loses nothing by being early, so ways are grown in the
        order of the time that they would take if all ahead were free. After `most`
        motions, or at `end`, that time is the answer, without vertices.

        Args:
            graph: What it may go along.
            start: Vertex where it stands.
            now: When it may set off [s].
            person: Time [s] -> (k, 7) capsules [m].
            end: When nobody looks any more [s].
            clear: The goal is not free before [s].
            stays: The person does not move: what is not free will not be.
            most: Motions that are looked at.
        """
        left, came = graph.left, {}
        heap = [(max(now + left[start], clear), left[start], now, start, start)]
        tests = 0
        while heap:
            soonest, _, begin, origin, vertex = heapq.heappop(heap)
            if soonest >= end or tests > most:
                return soonest, ()
            if vertex in came:
                continue
            if vertex != origin:
                tests += 1
                a, b = graph.q[origin], graph.q[vertex]
                if not graph.proved and not self._is_proved(a, b):
                    continue
                if not self._is_free(a, b, begin, person):
                    if not stays:
                        begin += _LATER
                        soonest = max(begin + self._time(a, b) + left[vertex], clear)
                        again = (soonest, left[vertex], begin, origin, vertex)
                        heapq.heappush(heap, again)
                    continue
                begin += self._time(a, b)
            came[vertex] = origin
            if vertex == graph.goal:
                return begin, _way(came, start, vertex)
            for k, needs in graph.ways(vertex):
                if k in came or not left[k] < math.inf:
                    continue
                leaves = begin if k != graph.goal else max(begin, clear - needs)
                soonest = max(leaves + needs + left[k], clear)
                heapq.heappush(heap, (soonest, left[k], leaves, vertex, k))
        return math.inf, ()

    def _is_free(
        self, a: np.ndarray, b: np.ndarray, begin: float, person: PersonAt
    ) -> bool:
        """Whether a motion keeps m; looked at from both ends towards the middle."""
        way, needs = difference(self.planner.robot, a, b), self._time(a, b)
        steps = max(1, math.ceil(needs / _STEP))
        for k in sorted(range(steps + 1), key=lambda k: min(k, steps - k)):
            t = begin + needs * k / steps
            if not self._keeps_clear(a + way * (k / steps), t, person):
                return False
        return True

    def _keeps_clear(self, q: np.ndarray, t: float, person: PersonAt) -> bool:
        return not self.exact.collides(q, self._person(person, t), self.m)

    def _is_proved(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Whether a motion is free of limits, the robot itself and the scenery."""
        dq = difference(self.planner.robot, a, b)
        return bool(self.planner.static.motion_free(a, dq))

    def _person(self, person: PersonAt, t: float) -> Any:  # noqa: ANN401 (of the audit)
        key = round(t / (0.5 * _STEP))
        if key not in self._known:
            rows = person(key * 0.5 * _STEP)
            self._known[key] = capsule_obstacles(rows)
        return self._known[key]

    def _time(self, a: np.ndarray, b: np.ndarray) -> float:
        """Return how long a straight motion takes [s]."""
        way = difference(self.planner.robot, a, b)
        return float((np.abs(way) / self._speed).max())

    def _link(self, a: int, b: int) -> None:
        time = self._time(self._q[a], self._q[b])
        self._ways[a].append((b, time))
        self._ways[b].append((a, time))

    def _link_if_free(self, a: int, b: int) -> None:
        if self._is_proved(self._q[a], self._q[b]):
            self._link(a, b)

    def _add(self, q: np.ndarray) -> int:
        """Add a configuration, joined to the nodes that are reached soonest."""
        nodes = self.planner.cell_map.roadmap.nodes
        ways = np.abs(difference(self.planner.robot, q, nodes)) / self._speed
        near = np.argsort(ways.max(axis=1), kind="stable")[:_JOINED]
        self._q.append(np.asarray(q, float))
        self._ways.append([])
        for node in near.tolist():
            self._link_if_free(len(self._q) - 1, node)
        return len(self._q) - 1

    def _time_to(self, goal: int) -> np.ndarray:
        """Return (n,) how long it takes from each vertex with nobody about [s]."""
        rows = [(a, b, t) for a, ways in enumerate(self._ways) for b, t in ways]
        a, b, t = np.array(rows).T
        n = len(self._q)
        graph = coo_matrix((t, (a.astype(int), b.astype(int))), (n, n)).tocsr()
        return dijkstra(graph, indices=goal)


def _way(came: dict[int, int], start: int, vertex: int) -> Vertices:
    """Return the vertices from the start on."""
    way = [vertex]
    while way[-1] != start:
        way.append(came[way[-1]])
    return tuple(reversed(way))
