"""Golden items of frames of shapes: as a loop asks that writes them in place.

A part of `golden_work.py`, which runs in any checkout: nothing of `sim` is imported.
Without times and with the same obstacles in each frame these are the frames that one
compiled call takes and answers, other than those of points in `golden_names`.
"""

from collections.abc import Iterator

import golden_scenes as scenes
import numpy as np
from golden_names import answer_words, outcome
from golden_scenes import digest, told

import odm
import roadmap

Lines = Iterator[str]
FRAMES = 120  # of each planner
_AWAY = np.array([9.0, 9.0, 9.0, 9.0, 9.0, 9.1, 0.05])  # of a capsule that has gone
_SETTINGS = {
    "as it comes": ({}, False),
    "always": ({}, True),
    "tight ends": ({"tight_ends": True, "cached_goals": 2}, False),
    "no search": ({"search": 0, "history_s": 0.0}, False),
}


def obstacles(shop: object) -> Lines:
    """Drive planners beside shapes of all kinds, in a scene that changes."""
    for k, (name, (asked, always)) in enumerate(_SETTINGS.items()):
        planner = odm.ReactivePlanner(
            shop.loaded("arm"), always, odm.PlannerSettings(**asked)
        )
        yield from _driven(name, planner, 400 + k)
    yield from _remembered(shop.loaded("arm"))


def _around(rng: np.random.Generator, capsules: int) -> odm.Obstacles:
    """Return room for capsules, and one shape of each other kind that stands about."""
    places = [
        scenes.pose(*p) for p in rng.uniform(-0.8, 0.8, (4, 5)) + [0, 0, 0.9, 0, 0]
    ]
    corners = np.array([[0, 0, 0], [0.2, 0, 0], [0, 0.2, 0], [0, 0, 0.3]], float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    others = odm.Obstacles.of(
        [
            odm.Sphere(0.08, places[0]),
            odm.Box([0.1, 0.2, 0.15], places[1]),
            odm.Cylinder(0.05, 0.3, places[2]),
        ]
    )
    return odm.Obstacles(
        capsules=np.tile(_AWAY, (capsules, 1)),
        spheres=others.spheres,
        boxes=others.boxes,
        cylinders=others.cylinders,
        meshes=[odm.Mesh(corners, faces, places[3])],
    )


def _driven(name: str, planner: odm.ReactivePlanner, seed: int) -> Lines:
    """Follow the answers to frames whose shapes are written in place."""
    rng = np.random.default_rng(seed)
    clip = scenes.clip(rng, FRAMES)
    about = _around(rng, max(map(len, clip)))
    q = scenes.draw_free(planner, rng)
    for k, capsules in enumerate(clip):
        at = f"{name}, frame {k}"
        yield from _between(at, k, planner, rng)
        about.capsules[:] = _AWAY
        about.capsules[: len(capsules)] = capsules
        about.spheres[0, :3] += rng.normal(0.0, 0.004, 3)
        if k % 23 == 22:
            about.points = scenes.points_of(capsules) if k % 2 else np.zeros((0, 3))
        answer = planner.step(about, q)
        yield f"{at}: {answer_words(answer)}, {answer.stage}, {told(answer.by_links)}"
        yield from _questions(at, k, planner, q, capsules)
        if len(answer.path):
            q = scenes.advance(answer.path)
        elif answer.retreat is not None:
            q = scenes.advance(answer.retreat, 0.3 * scenes.SPEED)
        if k % 3 == 0:
            yield f"{at}: improve {scenes.improve(planner, 6)}"


def _between(
    at: str, k: int, planner: odm.ReactivePlanner, rng: np.random.Generator
) -> Lines:
    """Set goals, as poses too; let things of the scene come, move and go."""
    if k % 40 == 0:
        goals = [scenes.draw_free(planner, rng) for _ in range(2)]
        yield f"{at}: goals {outcome(planner.set_goals, goals)}"
    if k % 40 == 20:
        T = scenes.pose(*rng.uniform([0.3, -0.4, 0.3], [0.6, 0.4, 0.7]), tilt=np.pi)
        report = outcome(lambda: planner.set_goals(poses=[T], most=2).goals)
        yield f"{at}: poses {report}"
    if k == 30:
        planner.scene.add("box", odm.Box([0.15, 0.15, 0.3]), scenes.pose(0.4, 0.3, 0.3))
        ball, there = odm.Sphere(0.1), scenes.pose(0, 0.5, 0.6)
        yield f"{at}: {outcome(planner.scene.add, 'ball', ball, there)}"
    if k == 50:
        planner.scene.move("box", scenes.pose(0.35, -0.35, 0.4, 0.5))
    if k == 70:
        planner.scene.remove("box")
    if 30 <= k <= 75 and k % 5 == 0:
        yield f"{at}: scene {list(planner.scene)}, {planner.scene.waiting} wait"


def _questions(
    at: str, k: int, planner: odm.ReactivePlanner, q: np.ndarray, capsules: np.ndarray
) -> Lines:
    """Ask what a loop asks beside paths."""
    if k % 4 == 0:
        yield f"{at}: {planner.separation(q)!r}, {planner.stands_clear(q)}"
    if k % 10 == 5 and len(capsules):
        tool = roadmap.tool_pose(planner.robot, q)[:3, 3]
        hands = tool + np.arange(0.24, 0.0, -0.08)[:, None] * [0.7, 0.7, 0.1]
        coming = [
            (0.1 * j, odm.Obstacles(capsules=np.array([[*p, *(p + 0.2), 0.05]])))
            for j, p in enumerate(hands, 1)
        ]
        yield f"{at}: evasion {outcome(planner.evasion, q, coming, 0.5)}"
        there = np.stack([q, planner.goals[0]])
        clear = outcome(planner.clear_of_others, there, 0.0, capsules[:1])
        yield f"{at}: clear of others {clear}"
        planner.expect(odm.Obstacles(capsules=capsules))
    if k % 15 == 7:
        yield f"{at}: edges {digest(planner.invalid_edges())}"


def _remembered(cell_map: odm.CellMap) -> Lines:
    """Go on with another planner that took the memory of the first; and only see."""
    rng = np.random.default_rng(430)
    one, other = (odm.ReactivePlanner(cell_map) for _ in range(2))
    q = scenes.draw_free(one, rng)
    one.set_goals([scenes.draw_free(one, rng)])
    for k, capsules in enumerate(scenes.clip(rng, 40)):
        about = odm.Obstacles(capsules=capsules, points=scenes.points_of(capsules[:1]))
        if k == 20:
            other.load_memory(one.save_memory())
        if k >= 20:
            yield f"remembered, frame {k}: {answer_words(other.step(about, q))}"
        if k % 8 == 6:
            yield f"remembered, frame {k}: {outcome(one.see, about, q)}"
        answer = one.step(about, q)
        yield f"remembers, frame {k}: {answer_words(answer)}"
        if len(answer.path):
            q = scenes.advance(answer.path)


ITEMS = {"obstacles": obstacles}
