"""Build a cell map from a recipe: robot, roadmap, sweep."""

import logging
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from odm.cell_map.cell_map import CellMap
from odm.cell_map.chunk_work import motion_job
from odm.cell_map.estimate import check_size
from odm.cell_map.payload import build_payload, envelope_spheres
from odm.cell_map.recipe import Recipe, load_recipe
from odm.cell_map.sweep import sweep_roadmap
from odm.close_test.arm import arm_of
from odm.close_test.static import always_touching, with_insides
from odm.obstacles.grid import grid_for
from odm.obstacles.scenery import Scenery, parse_scenery
from roadmap import load_robot
from roadmap.builds.chunks import Chunk, Progress, Threads, Workers, about
from roadmap.graph.connecting import BuildReport, Parts, Stream, build_roadmap
from roadmap.loading.held_link import with_payload
from roadmap.robot.known import known_robot
from roadmap.robot.robot import Robot

log = logging.getLogger(__name__)


def build_map(
    recipe: Recipe | str | Path,
    threads: int = 0,
    progress: Progress | None = None,
    robot: Robot | None = None,
    workers: Workers | None = None,
) -> CellMap:
    """Build the map of a recipe; the same bytes for any number of threads.

    Args:
        recipe: A recipe, or the name or path of one.
        threads: Worker threads; 0 means one per core.
        progress: Called with (stage, done, total).
        robot: Use this robot instead of loading the recipe's.
        workers: Who does the chunks of work, such as `roadmap.builds.chunks.Threads`
            with a store, or `roadmap.builds.cluster.Cluster`; None: `threads` of this
            process.

    Raises:
        BadRecipe, BadRobot: The recipe or its robot cannot be used.
        BuildRefused: The map would not fit in memory, or next to nothing is valid.
    """
    recipe = recipe if isinstance(recipe, Recipe) else load_recipe(recipe)
    begun, busy = time.perf_counter(), time.process_time()
    scenery = parse_scenery(recipe.scenery, recipe.folder)
    if robot is None:
        robot = robot_of(recipe)
    check_size(robot, recipe)
    scenery = with_insides(robot, scenery)
    scenery = always_touching(robot, scenery, recipe.safety)
    workers = workers or Threads(threads)
    tested = _tested_by(workers, robot, scenery, recipe)
    roadmap, report = build_roadmap(robot, recipe.roadmap, tested, progress, workers)
    sampled = time.perf_counter()
    margin = recipe.safety.rho + recipe.safety.m + recipe.safety.mu + 1e-3
    grid = grid_for(_largest(robot, recipe), recipe.safety.h, margin)
    rest = (grid, recipe.safety, workers, progress)
    cells = sweep_roadmap(robot, arm_of(robot), roadmap, *rest)
    built = _facts(report, sampled - begun)
    payload = None
    if recipe.payload is not None:
        rest = (grid, scenery, threads, workers, _with_payload(progress))
        payload = build_payload(robot, recipe, roadmap, *rest)
        n = roadmap.n_nodes
        built["payload_nodes"] = int(n - payload.closed[:n].sum())
        built["payload_edges"] = int(roadmap.n_edges - payload.closed[n:].sum())
    built["seconds"] = round(time.perf_counter() - begun, 2)
    built["cpu_seconds"] = round(time.process_time() - busy, 2)
    return CellMap(robot, roadmap, grid, recipe, cells, scenery, payload, built)


def _facts(report: BuildReport, roadmap_seconds: float) -> dict:
    if len(report.components) > 1:
        kept, total = report.components[0], sum(report.components)
        log.info("kept the largest component: %d of %d nodes", kept, total)
    return {
        "roadmap_seconds": round(roadmap_seconds, 2),
        "drawn": report.drawn,
        "candidate_edges": report.candidates,
        "free_edges": report.edges,
        "components": list(report.components[:8]),
        "n_components": len(report.components),
        "versions": {k: v for k, v in about().items() if k != "program"},
    }


def _tested_by(
    workers: Workers, robot: Robot, scenery: Scenery, recipe: Recipe
) -> Stream:
    """Return the test of motions as workers do it."""

    def stream(stage: str, parts: Parts) -> Iterator[np.ndarray]:
        job = motion_job(robot, scenery, recipe.safety, stage)
        for (free,) in workers.map(job, _numbered(parts)):
            yield free

    return stream


def _numbered(parts: Parts) -> Iterator[Chunk]:
    first = 0
    for q, dq in parts:
        yield Chunk(first, (np.ascontiguousarray(q), np.ascontiguousarray(dq)))
        first += len(q)


def _largest(robot: Robot, recipe: Recipe) -> Robot:
    """Return the robot with the largest payload in hand: all that the grid holds."""
    if recipe.payload is None:
        return robot
    return with_payload(robot, envelope_spheres(recipe), solids=[])


def robot_of(recipe: Recipe) -> Robot:
    """Return the robot of a recipe, read from its URDF.

    It keeps the source as the recipe writes it, so that a map is the same wherever its
    recipe lies.
    """
    asked = recipe.robot
    robot = load_robot(
        _source_of(recipe),
        tip=asked.tip,
        locked=asked.locked or None,
        srdf=None if asked.srdf is None else recipe.path_of(asked.srdf),
        cover_excess=asked.cover_excess,
        velocity=asked.velocity,
        acceleration=asked.acceleration,
        jerk=asked.jerk,
        travel=asked.travel,
    )
    return replace(robot, source=str(asked.source))


def _source_of(recipe: Recipe) -> str | Path:
    """Return a known name as it is; anything with an ending, or there, is a file."""
    source = recipe.robot.source
    file = recipe.path_of(source)
    named = known_robot(source) is not None or not (file.suffix or file.is_file())
    return source if named else file


def _with_payload(progress: Progress | None) -> Progress | None:
    """Return a progress whose stages say that they are those of the payload."""
    if progress is None:
        return None
    return lambda stage, done, total: progress(f"{stage}, with payload", done, total)
