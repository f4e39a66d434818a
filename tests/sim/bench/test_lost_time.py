"""Where the time goes, and the oracle of trips: against people whose ways are known."""

from types import SimpleNamespace

import numpy as np
import pytest

import odm
from roadmap.kinematics.forward import difference, tool_pose
from sim.bench.lost_time import lost_time, lost_time_table
from sim.bench.trip_oracle import TripOracle
from sim.loop.loop import exact_audit

NOBODY = np.zeros((0, 7))
SCALE = 0.5


@pytest.fixture(scope="module")
def planner(small_map):
    return odm.ReactivePlanner(small_map)


@pytest.fixture(scope="module")
def places(planner):
    """Two nodes whose tools are far apart, and that a free straight motion joins."""
    roadmap = planner.cell_map.roadmap
    tools = [tool_pose(planner.robot, q)[:3, 3] for q in roadmap.nodes]
    a, b = max(roadmap.edges, key=lambda e: np.linalg.norm(tools[e[0]] - tools[e[1]]))
    return roadmap.nodes[[a, b]]


@pytest.fixture(scope="module")
def oracle(planner, places):
    return TripOracle(planner, places, SCALE)


def straight(planner, places):
    """Return the time of the straight motion between the places [s]."""
    way = difference(planner.robot, *places)
    return float((np.abs(way) / (SCALE * planner.robot.max_velocity)).max())


def ball(p, radius=0.03):
    return np.r_[p, p, radius][None]


def tool(planner, q):
    return tool_pose(planner.robot, q)[:3, 3]


def test_with_nobody_about_every_trip_is_possible(planner, places, oracle):
    way = straight(planner, places)
    assert oracle.way_alone(0) == oracle.way_alone(1) == pytest.approx(way)
    for trip_s in (way, way + 0.5):
        trips = oracle.trips(lambda t: NOBODY, 10.0, trip_s)
        assert trips == pytest.approx(10.0 / trip_s)
        # the last one counts by how much of its way is done
        by_sight = oracle.trips_by_sight(lambda t: NOBODY, 10.0, trip_s)
        assert int(trips) <= by_sight <= trips + 1e-9


def test_whoever_sits_at_a_place_for_half_of_the_time_costs_it(planner, places, oracle):
    at = ball(tool(planner, places[1]))
    way = straight(planner, places)
    trips = oracle.trips(lambda t: at if t < 5.0 else NOBODY, 10.0, way)
    # it arrives soon after they leave, since it keeps m on its way in, and goes on
    assert 1 + (5.0 - 0.2) / way < trips <= 1 + 5.0 / way
    # the trip that nobody can make is told by the share that is over in time
    assert oracle.trips(lambda t: at, 10.0, way) < 1.0


def test_who_sees_the_present_alone_sets_off_when_the_place_is_free(
    planner, places, oracle
):
    at, way = ball(tool(planner, places[1])), straight(planner, places)
    trips = oracle.trips_by_sight(lambda t: at if t < 5.0 else NOBODY, 10.0, way)
    assert 5.0 / way - 0.2 < trips <= 5.0 / way + 0.1  # and no sooner
    assert oracle.trips_by_sight(lambda t: at, 10.0, way) <= 0.0


def test_who_sees_the_present_alone_is_stopped_by_who_steps_into_the_way(
    planner, places, oracle
):
    way = straight(planner, places)
    middle = ball(tool(planner, 0.5 * (places[0] + places[1])), 0.3)
    steps_in = 0.2 * way  # and stays: nothing leads past them
    trips = oracle.trips_by_sight(
        lambda t: middle if t >= steps_in else NOBODY, 4.0, way
    )
    assert 0.0 < trips < 0.6


@pytest.mark.parametrize("yields", [False, True])
def test_who_must_be_able_to_stop_loses_nothing_with_nobody_about(
    planner, places, oracle, yields
):
    way, ticks = straight(planner, places), 0.02  # of each trip, and what it begins in
    trips = oracle.trips_with_stops(lambda t: NOBODY, 10.0, way, yields)
    assert 10.0 / (way + ticks) - 0.1 < trips <= 10.0 / way + 1e-9


def test_who_must_be_able_to_stop_waits_for_a_place_as_well(planner, places, oracle):
    at, way = ball(tool(planner, places[1])), straight(planner, places)
    trips = oracle.trips_with_stops(lambda t: at if t < 5.0 else NOBODY, 10.0, way)
    assert 5.0 / (way + 0.02) - 0.3 < trips <= 5.0 / way + 0.1
    assert oracle.trips_with_stops(lambda t: at, 10.0, way) <= 0.0


def test_who_must_be_able_to_stop_is_slow_beside_who_may_come(planner, places, oracle):
    """A person who rests beside the way, just farther than m, may set off."""
    way, audit = straight(planner, places), exact_audit(planner.robot)
    legs = [places[0] + (places[1] - places[0]) * k / 50 for k in range(51)]
    p = tool(planner, 0.5 * (places[0] + places[1]))

    def gap(up):
        return min(audit(q, ball(p + [0.0, 0.0, up])) for q in legs)

    up = next(k / 500 for k in range(500) if gap(k / 500) > 0.02)
    person = ball(p + [0.0, 0.0, up])
    assert planner.cell_map.safety.m < gap(up) < 0.03
    by_sight = oracle.trips_by_sight(lambda t: person, 10.0, way)
    assert oracle.trips_with_stops(lambda t: person, 10.0, way) < 0.9 * by_sight


def test_who_yields_is_not_shut_in_by_who_comes(planner, places, oracle):
    """One is at the next place for 3 s, another comes to where it waits, and stays."""
    here, there = (tool(planner, q) for q in places)
    away = here - there
    away /= np.linalg.norm(away)

    def person(t):
        come = ball(here + away * max(0.5 - 0.25 * t, 0.0))
        return np.vstack([ball(there if t < 3.0 else there + [0.0, 0.0, 3.0]), come])

    run = (person, 6.0, straight(planner, places))
    assert oracle.trips_with_stops(*run) <= 0.0
    assert 1.0 <= oracle.trips_with_stops(*run, yields=True) < 2.0


def test_the_way_of_the_oracle_keeps_m_from_who_stands_in_it(planner, places, oracle):
    middle = 0.5 * (places[0] + places[1])
    person, audit = ball(tool(planner, middle)), exact_audit(planner.robot)
    m = planner.cell_map.safety.m
    assert audit(middle, person) <= 0.0 and min(audit(q, person) for q in places) > m
    trips = oracle.trips(lambda t: person, 10.0, straight(planner, places))
    assert trips < 0.99 * 10.0 / straight(planner, places)


def test_a_way_leads_on_unless_the_person_is_at_its_end(planner, places, oracle):
    nodes = planner.cell_map.roadmap.nodes
    q = 0.7 * places[0] + 0.3 * places[1]
    before = len(oracle._q)
    assert oracle.leads_on(q, 1, NOBODY)
    assert not oracle.leads_on(q, 1, ball(tool(planner, places[1])))
    assert len(oracle._q) == before == len(nodes) + 2  # q was not kept


def result_of(places, q, moving, place, capsules, planner):
    audit = exact_audit(planner.robot)
    gaps = [audit(a, c) if len(c) else np.inf for a, c in zip(q, capsules, strict=True)]
    return SimpleNamespace(
        q=q,
        moving=np.array(moving),
        place=np.array(place),
        capsules=capsules,
        separation=np.array(gaps),
        frames=len(q),
        duration_s=len(q) / 100.0,
        trips=1,
    )


def test_shares_tell_why_it_stood_and_sum_to_the_whole(planner, places):
    robot_at, person_at = tool(planner, places[0]), tool(planner, places[1])
    far = ball(person_at + [0.0, 0.0, 3.0])
    quarters = [ball(person_at), ball(robot_at), far, far]
    capsules = [rows for rows in quarters for _ in range(100)]
    paces = ["standing"] * 300 + ["moving"] * 50 + ["slowed"] * 30 + ["retreating"] * 20
    moving = [False] * 301 + [True] * 99
    result = result_of(places, [places[0]] * 400, moving, [1] * 400, capsules, planner)
    human = SimpleNamespace(capsules=lambda t: capsules[min(int(100 * t), 399)])
    trip_s = straight(planner, places)
    shares = lost_time(planner, places, human, result, paces, SCALE, trip_s)
    possible, by_sight = shares.pop("possible"), shares.pop("by sight")
    assert 0.0 <= by_sight <= possible <= 1.0
    assert 0.0 <= shares.pop("stops") <= shares.pop("yields") <= by_sight
    assert 0.0 <= shares.pop("drives") <= 1.0
    assert sum(shares.values()) == pytest.approx(1.0)
    assert shares["slowed"] == pytest.approx(30 / 400)
    assert shares["evading"] == pytest.approx(20 / 400)
    assert shares["trips"] == pytest.approx(trip_s / 4.0)
    for why in ("taken", "pinned", "waits"):
        assert shares[why] == pytest.approx(0.25, abs=0.01)
    assert shares["no way"] == 0.0


def test_the_table_has_a_row_for_each_motion_with_the_means_of_its_runs():
    names = (
        "possible",
        "by sight",
        "stops",
        "yields",
        "drives",
        "trips",
        "detour",
        "slowed",
        "evading",
    )
    names += ("taken", "pinned", "no way", "waits")
    one = {name: 0.1 for name in names}
    runs = [{"motion": "sweep", "lost": one}, {"motion": "reach", "lost": one}]
    runs += [{"motion": "sweep", "lost": one | {"detour": 0.3}}]
    table = lost_time_table(runs)
    assert [row[0] for row in table["rows"]] == ["sweep", "reach"]
    at = table["head"].index("detour")
    assert [row[at] for row in table["rows"]] == ["20", "10"]
    assert all(len(row) == len(table["head"]) for row in table["rows"])
