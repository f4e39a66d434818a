"""Frames timed for `odm bench golden --latency`, once for every line on stdin.

A part of `golden_work.py`, which runs in any checkout: nothing of `sim` is imported.
"""

import gc
import json
import sys
import time

import golden_scenes as scenes
import numpy as np

import odm

PAIRS, FRAMES = 12, 100  # of starts and goals, and frames of each


def answer(cell_map: odm.CellMap) -> None:
    """Time all frames for every line that comes; answer with a line of JSON.

    It holds the CPU time of the thread in each frame [ns], by kind of frame.
    """
    pairs = _pairs(cell_map)
    _pass(cell_map, pairs)  # loads what is compiled
    print("ready", flush=True)
    for _ in sys.stdin:
        gc.collect()
        gc.disable()
        times = _pass(cell_map, pairs)
        gc.enable()
        print(json.dumps(times), flush=True)


def _pairs(cell_map: odm.CellMap) -> list[tuple]:
    """Return start, goal and the points of every frame, of each pair."""
    rng, pairs = np.random.default_rng(900), []
    planner = odm.ReactivePlanner(cell_map)
    for _ in range(PAIRS):
        clip = [scenes.points_of(c) for c in scenes.clip(rng, FRAMES)]
        planner.step(clip[0], q=cell_map.roadmap.nodes[0], closed=True)
        start, goal = (scenes.draw_free(planner, rng) for _ in range(2))
        pairs.append((start, goal, clip))
    return pairs


def _pass(cell_map: odm.CellMap, pairs: list[tuple]) -> dict[str, list[int]]:
    """Time frames replanned from scratch, of a robot that moves, and its improving."""
    times: dict[str, list[int]] = {"replanned": [], "followed": [], "improved": []}
    always = odm.ReactivePlanner(cell_map, always_replan=True)
    moving = odm.ReactivePlanner(cell_map)
    for start, goal, clip in pairs:
        for name, planner in (("replanned", always), ("followed", moving)):
            planner.reset()
            planner.set_goals([goal])
            planner.step(clip[0], q=start)  # a q never seen: another kind of frame
            q = start
            for points in clip:
                begun = time.thread_time_ns()
                found = planner.step(points, q=q, closed=True)
                times[name].append(time.thread_time_ns() - begun)
                if name == "replanned":
                    continue
                begun = time.thread_time_ns()
                scenes.improve(planner, 4)
                times["improved"].append(time.thread_time_ns() - begun)
                if len(found.path):
                    q = scenes.advance(found.path)
    return times
