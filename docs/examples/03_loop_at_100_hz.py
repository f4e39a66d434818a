"""A loop of 100 frames a second: a person moves, the planner answers in each frame.

    python docs/examples/03_loop_at_100_hz.py [MAP]

The robot follows each answer at a fixed speed and stands while the planner holds. It
stops at once, which no real one does: example 4 brakes.
"""

import importlib

import numpy as np

import odm
import roadmap

plan_once = importlib.import_module("01_plan_once")
PERIOD, SPEED = 0.01, 0.6  # [s], [rad/s]


def forearm(t: float, p_reached: np.ndarray) -> np.ndarray:
    """Return a capsule (1, 7) that reaches to a place and back every 4 s [m]."""
    hand = p_reached + [0.5 + 0.4 * np.cos(2.0 * np.pi * t / 4.0), 0.0, 0.0]
    return np.concatenate([hand + [0.25, 0.1, 0.05], hand, [0.05]])[None]


def main(cell_map: odm.CellMap, seconds: float = 20.0) -> dict[str, float]:
    """Go to and fro; return trips, and how near the person came meanwhile."""
    planner = odm.ReactivePlanner(cell_map)
    places = plan_once.two_places(planner)
    tools = [roadmap.tool_pose(cell_map.robot, q)[:3, 3] for q in places]
    q, place, trips, held, closest = places[0], 1, 0, 0, np.inf
    planner.set_goals([places[place]])
    obstacles = odm.Obstacles(capsules=forearm(0.0, np.mean(tools, axis=0)))
    for now in np.arange(0.0, seconds, PERIOD):
        obstacles.capsules[:] = forearm(now, np.mean(tools, axis=0))
        answer = planner.step(obstacles, q=q, stamp=now, now=now)
        if answer.status == "holding":  # answer.reason says why
            held += 1
            continue
        step = answer.path[1] - q
        q = q + step * min(1.0, SPEED * PERIOD / max(np.abs(step).max(), 1e-12))
        closest = min(closest, planner.separation(q))
        planner.improve(4)  # what is left of the frame: shorten the path
        if np.abs(q - places[place]).max() < 1e-6:
            trips, place = trips + 1, 1 - place
            planner.set_goals([places[place]])
    print(f"{trips} trips, held in {held} frames, {100 * closest:.1f} cm kept at least")
    return {"trips": trips, "held": held, "closest": closest}


if __name__ == "__main__":
    main(plan_once.the_map())
