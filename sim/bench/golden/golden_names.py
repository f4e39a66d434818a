"""Golden items by public names: `import roadmap, odm, handover` and their names alone.

A part of `golden_work.py`, which runs in any checkout: nothing of `sim` is imported.
Each item is a function of the `Shop` that yields lines, equal where nothing changed.
"""

import copy
import inspect
import pickle
import re
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import golden_scenes as scenes
import numpy as np
from golden_scenes import digest, fields, told

import handover
import odm
import roadmap

Lines = Iterator[str]
FRAMES = 160  # of each setting
_SETTINGS = {
    "as it comes": {},
    "no memory": {
        "history_s": 0.0,
        "history_clearance": 0.0,
        "smoothing_clearance": 0.0,
    },
    "more clearance": {"extra_clearance": 0.03},
    "few motions": {"goal_connections": 4, "start_connections": 4, "cached_goals": 8},
    "eager": {
        "hysteresis": 0.0,
        "confirmations": 1,
        "persistence_frames": 0,
        "close_test_connections": 0,
    },
}


# --- what is public ----------------------------------------------------------------


_MADE = (  # by users, so that how they are made is public
    "Box", "Capsule", "Cylinder", "Mesh", "Sphere", "DepthCamera", "SeenSpace", "Above",
    "Inside", "Upright", "HeldObject", "Human", "InteractionWorkspace", "LiveTargets",
    "NodeIndex", "PlannerValidity", "ReactivePlanner",
)  # fmt: skip
_METHODS = {
    odm.ReactivePlanner: (
        "set_goals", "step", "improve", "reset", "take_over", "prepare_goal",
        "is_prepared", "attach", "detach", "set_extra_clearance", "set_base",
        "set_static", "is_free", "approach", "stands_clear", "separation",
        "invalid_nodes", "invalid_edges", "blocked_leg", "see", "expect", "evasion",
        "clear_of_others", "save_memory", "load_memory", "use_tight_ends",
    ),
    odm.SeenSpace: ("update", "cells", "counts", "reset"),
    roadmap.Motion: (
        "at", "sample", "path_from", "place", "speed", "stop", "rescaled", "commit",
        "join",
    ),
    handover.InteractionWorkspace: (
        "update", "build", "best", "rated", "quality_of", "remove", "restore", "forget",
    ),
    handover.LiveTargets: ("step", "look", "note"),
}  # fmt: skip


def names(shop: object) -> Lines:  # noqa: ARG001
    """Tell every public name of a package, and how it is called."""
    for package in (roadmap, odm, handover):
        found = sorted(package.__all__)
        yield f"{package.__name__}: {', '.join(found)}"
        for name in found:
            yield f"{package.__name__}.{name}: {_shown(name, getattr(package, name))}"
    for kind, methods in _METHODS.items():
        for name in methods:
            yield f"{kind.__name__}.{name}: {_called(getattr(kind, name, None))}"


def _shown(name: str, value: object) -> str:
    """Return the value of a name, or how it is called where users call it."""
    if not inspect.isclass(value):
        return _called(value) if callable(value) else told(value)
    return _called(value) if name in _MADE or name.endswith("Settings") else "class"


def _called(value: object) -> str:
    if value is None:
        return "gone"
    rows = inspect.signature(value).parameters.values()
    return ", ".join(f"{p.name}{_default(p.default)}" for p in rows)


def _default(value: object) -> str:
    if value is inspect.Parameter.empty:
        return ""
    return f"={told(value) if not callable(value) else 'callable'}"


# --- roadmap --------------------------------------------------------------------------


def robots(shop: object) -> Lines:
    """Load robots by name; tool poses and inverse kinematics at random places."""
    yield told(roadmap.robot_names())
    rng = np.random.default_rng(5)
    for name in ("arm", "rail", "kawasaki", "gross"):
        robot = shop.loaded(name).robot
        yield f"{name}: {robot.fingerprint()[:16]} {told(robot.joint_names)}"
        yield f"{name}: limits {digest(robot.lower)} {digest(robot.upper)}"
        for k in range(4):
            q = rng.uniform(robot.lower, robot.upper)
            T = roadmap.tool_pose(robot, q)
            yield f"{name} {k}: tool {digest(T)}"
            seed = q + rng.normal(0.0, 0.3, robot.dof)
            found = robot.ik(T, seed, attempts=3, steps=60)
            yield f"{name} {k}: ik {told([digest(s.q) for s in found])}"
    for name in ("armar3", "xarm6"):
        robot = roadmap.load_robot(name, cover_excess=0.1)
        yield f"{name}: {robot.fingerprint()[:16]} {told(robot.notes)}"
    bent = {"locked": {"joint6": 0.3}, "velocity": {"joint1": 0.5}}
    robot = roadmap.load_robot("kawasaki_fs003n", cover_excess=0.1, **bent)
    yield f"bent: {robot.fingerprint()[:16]} {told(robot.joint_names)}"


def motions(shop: object) -> Lines:
    """Time paths; stop, rescale, commit and join them at random times."""
    rng = np.random.default_rng(6)
    for name in ("arm", "rail"):
        cell_map = shop.loaded(name)
        robot, nodes = cell_map.robot, cell_map.roadmap.nodes
        for k in range(12):
            path = nodes[rng.integers(len(nodes), size=2 + k % 5)]
            blend, scale = (0.0, 0.004, 0.02)[k % 3], (1.0, 0.6, 0.25)[k % 3]
            motion = roadmap.time_path(robot, path, blend=blend, speed_scale=scale)
            yield f"{name} {k}: {_motion(motion)}"
            t = float(rng.uniform(0.0, motion.duration))
            yield f"{name} {k}: stop {_motion(motion.stop(t))}"
            yield f"{name} {k}: slower {_motion(motion.rescaled(t, 0.3))}"
            commit = motion.commit(t, 0.05, through_blends=bool(k % 2))
            yield f"{name} {k}: commit {told(list(commit))}"
            goal = nodes[rng.integers(len(nodes))]
            rest = np.array([commit.q, 0.5 * (commit.q + goal), goal])
            joined = motion.join(t, commit, rest, blend=blend)
            yield f"{name} {k}: join {_motion(joined)}"
            yield f"{name} {k}: left {digest(joined.path_from(0.3 * joined.duration))}"


def _motion(motion: roadmap.Motion) -> str:
    times = np.linspace(0.0, motion.duration + 0.05, 17)
    points = " ".join(digest(rows) for rows in motion.sample(times))
    figures = fields(motion, "duration", "speed_scale", "deviation", "length")
    return f"{figures}, {points}"


# --- the planner, frame by frame ------------------------------------------------------


def frames(shop: object) -> Lines:
    """Drive planners of several settings among people who move, and question them."""
    for k, (name, settings) in enumerate(_SETTINGS.items()):
        planner = odm.ReactivePlanner(
            shop.loaded("arm"), settings=odm.PlannerSettings(**settings)
        )
        yield from _driven(f"arm, {name}", planner, 100 + k)
    planner = odm.ReactivePlanner(shop.loaded("arm"), always_replan=True)
    yield from _driven("arm, always", planner, 110)
    for k, name in enumerate(("rail", "gross", "fingers")):
        planner = odm.ReactivePlanner(shop.loaded(name))
        yield from _driven(name, planner, 120 + k)


def _driven(name: str, planner: odm.ReactivePlanner, seed: int) -> Lines:
    """Follow the answers to a clip of frames; tell them and everything asked."""
    rng = np.random.default_rng(seed)
    clip = scenes.clip(rng, FRAMES)
    q = scenes.draw_free(planner, rng)
    for k, capsules in enumerate(clip):
        at = f"{name}, frame {k}"
        yield from _between(at, k, planner, rng)
        points, options = _given(k, capsules)
        answer = planner.step(points, q=q, **options)
        yield f"{at}: {answer_words(answer)}"
        yield from _questions(at, k, planner, q, answer, rng)
        q = _moved(k, answer, q)
        if k % 3 == 0:
            yield f"{at}: improve {scenes.improve(planner, 6)}"


def _given(k: int, capsules: np.ndarray) -> tuple[np.ndarray, dict]:
    """Return a frame's points and how they are given: not the same way every time."""
    points, now = scenes.points_of(capsules), scenes.PERIOD * k
    options = {"stamp": now, "now": now, "closed": True}
    if k % 5 == 1 and len(capsules):
        options["rounding"] = float(capsules[:, 6].min())
    if k % 37 == 30:
        options["stamp"] = now - 0.5  # too old
    if k % 41 == 20:
        points = np.vstack([points, [[np.nan, 0.0, 0.0]]])
    if k % 43 == 11:
        points = np.vstack([points, [[5.0, 0.0, 0.0]]])  # outside the grid
        options["covering_radius"] = 0.02
    if k % 7 == 3:
        options["labels"] = np.arange(len(points)) % 3
    return points, options


def _between(
    at: str, k: int, planner: odm.ReactivePlanner, rng: np.random.Generator
) -> Lines:
    """Set goals and whatever else is told between frames."""
    if k % 29 == 0:
        goals = [scenes.draw_free(planner, rng) for _ in range(1 + k % 3)]
        costs = rng.uniform(0.0, 1.0, len(goals)).tolist() if k % 2 else None
        yield f"{at}: goals {told(goals)} {outcome(planner.set_goals, goals, costs)}"
    if k % 31 == 30:
        goal = scenes.draw_free(planner, rng)
        yield f"{at}: prepare {outcome(planner.prepare_goal, goal)}"
        yield f"{at}: prepared {planner.is_prepared(goal)}"
    if k in (60, 75):
        planner.set_extra_clearance(0.02 if k == 60 else 0.0)
    if k == 90:
        box = odm.Box([0.2, 0.2, 0.4], scenes.pose(0.5, 0.4, 0.2, 0.3))
        ball = odm.Sphere(0.1, scenes.pose(0.3, -0.5, 0.5))
        planner.set_static([box, ball])
    if k == 105:
        planner.set_static(np.zeros((0, 3)))
    if k in (115, 130):
        planner.set_base(scenes.pose(0.1, -0.05, 0.0, 0.4) if k == 115 else np.eye(4))
    if k == 140:
        planner.reset()


def _moved(k: int, answer: odm.Answer, q: np.ndarray) -> np.ndarray:
    if k % 29 < 4:  # it looks around before it leaves
        return q
    if len(answer.path):
        return scenes.advance(answer.path)
    if answer.retreat is not None:
        return scenes.advance(answer.retreat, 0.3 * scenes.SPEED)
    return q


def _questions(
    at: str,
    k: int,
    planner: odm.ReactivePlanner,
    q: np.ndarray,
    answer: odm.Answer,
    rng: np.random.Generator,
) -> Lines:
    """Ask what can be asked between frames."""
    if k % 4 == 0:
        nodes = planner.cell_map.roadmap.nodes
        there = nodes[rng.integers(len(nodes))]
        free = planner.is_free(q, there)
        yield f"{at}: free {fields(free, 'free', 'failed', 'reason')}"
        yield f"{at}: clear {planner.stands_clear(there)}, {planner.separation(q)!r}"
    if k % 6 == 0:
        legs = answer.path if len(answer.path) else q[None]
        blocked = [outcome(planner.blocked_leg, legs, more) for more in (0.0, 0.05)]
        yield f"{at}: blocked leg {told(blocked)}"
        near = roadmap.tool_pose(planner.robot, there := legs[-1])[None, :3, 3]
        asked = outcome(planner.blocked_leg, legs, -0.005, points=near)
        yield f"{at}: blocked leg by its own tool at {digest(there)}: {asked}"
    if k % 9 == 0:
        yield f"{at}: nodes {digest(planner.invalid_nodes())}"
        yield f"{at}: edges {digest(planner.invalid_edges())}"


def answer_words(answer: odm.Answer) -> str:
    """Return all of an answer but its times."""
    words = f"{answer.status}, goal {answer.goal}, path {digest(answer.path)}"
    work = fields(answer.work, "points", "outside", "blocks", "edge_tests", "popped")
    words += f", {answer.certified}, {work}, "
    words += fields(answer.work, "flooded", "close_tests", "searches")
    if answer.status == "holding":
        told_by = fields(answer.blockers, "edges", "cells", "points", "link", "goal")
        words += f", {answer.reason}, {told_by}, retreat {told(answer.retreat)}"
    return words


def outcome(call: Callable, *values: object, **options: object) -> str:
    """Return what a call returns, or the sentence with which it refuses."""
    try:
        return told(call(*values, **options))
    except Exception as error:
        told_by = re.sub(r"thread [0-9]+", "thread N", str(error))
        return f"{type(error).__name__}: {told_by}"


# --- more of the planner --------------------------------------------------------------


def layers(shop: object) -> Lines:
    """Take things into the hand and let them go; touch what may be touched."""
    pads = ("panda_leftfinger", "panda_rightfinger")
    settings = {"fingers": odm.PlannerSettings(finger_pads=pads), "carry": None}
    things = {
        "balls": np.array([[0.0, 0.0, 0.05, 0.06], [0.0, 0.04, 0.06, 0.04]]),
        "box": odm.Box([0.06, 0.05, 0.1], scenes.pose(0.0, 0.0, 0.05)),
        "cylinder": odm.Cylinder(0.03, 0.1, scenes.pose(0.0, 0.0, 0.05)),
        "capsule": odm.Capsule(0.03, 0.06, scenes.pose(0.0, 0.0, 0.05)),
        "too large": odm.Box([0.6, 0.1, 0.1]),
    }
    for k, (name, thing) in enumerate(things.items()):
        for robot, asked in settings.items():
            planner = odm.ReactivePlanner(shop.loaded(robot), settings=asked)
            made = odm.carried_object(thing)
            yield f"{robot}, {name}: {digest(made.spheres)} {outcome(planner.detach)}"
            at = f"{robot}, {name}: attach"
            yield f"{at} {outcome(planner.attach, made, scenes.pose(0, 0, 0.01, 0.3))}"
            yield f"{at}ed {told(planner.attached)}"
            yield from _carried(f"{robot}, {name}", planner, 200 + k)
    planner = odm.ReactivePlanner(shop.loaded("arm"))
    yield f"no layer: {outcome(planner.attach, things['balls'])}"


def _carried(name: str, planner: odm.ReactivePlanner, seed: int) -> Lines:
    rng = np.random.default_rng(seed)
    clip = scenes.clip(rng, 30)
    q = scenes.draw_free(planner, rng)
    planner.set_goals([scenes.draw_free(planner, rng)])
    for k, capsules in enumerate(clip):
        if k == 20 and planner.attached is not None:
            yield f"{name}, frame {k}: detach {outcome(planner.detach)}"
        points = scenes.points_of(capsules)
        classes = (np.arange(len(points)) // 7 % 3).astype(np.int8)
        answer = planner.step(points, q=q, classes=classes, closed=True)
        yield f"{name}, frame {k}: {answer_words(answer)}"
        there = q + rng.normal(0.0, 0.05, len(q))
        for phase in ("give", "receive", "take"):
            asked = outcome(_freedom, planner, q, there, phase)
            yield f"{name}, frame {k}: {phase} {asked}"
        q = _moved(9, answer, q)


def _freedom(
    planner: odm.ReactivePlanner, q: np.ndarray, there: np.ndarray, phase: str
) -> str:
    free = planner.is_free(q, there, phase=phase)
    return fields(free, "free", "failed", "reason")


def approach(shop: object) -> Lines:
    """Ask for straight tool motions to poses, free and blocked."""
    for name in ("kawasaki", "arm"):
        cell_map, rng = shop.loaded(name), np.random.default_rng(300)
        planner = odm.ReactivePlanner(cell_map)
        clip = scenes.clip(rng, 8)
        for k, capsules in enumerate(clip):
            q = scenes.draw_free(planner, rng)
            planner.step(scenes.points_of(capsules[: k % 3]), q=q, closed=True)
            T = roadmap.tool_pose(cell_map.robot, q)
            options = {"distance": (0.1, 0.15)[k % 2]}
            if k % 4 == 3:
                options["direction"] = np.array([0.0, 0.0, -1.0])
            if k % 4 == 2:
                options["q"] = q + rng.normal(0.0, 0.1, len(q))
            way = planner.approach(T, **options)
            found = fields(way, "path", "reason", "error_m", "error_rad", "fine")
            yield f"{name} {k}: {bool(way)}, {found}, {fields(way, 'q_pre', 'q_end')}"


def cameras(shop: object) -> Lines:
    """Let cameras see balls that move; drive a planner by what they see."""
    lens = (160, 120, 130.0, 130.0, 79.5, 59.5)
    eyes = ([0.0, -0.9, 0.9], [1.3, 0.5, 0.8])
    poses = [scenes.look_at(eye, [0.4, 0.0, 0.4]) for eye in eyes]
    seen_by = [odm.DepthCamera(*lens, T, 0.001, f"c{k}") for k, T in enumerate(poses)]
    cell_map = shop.loaded("arm")
    for k, settings in enumerate(
        ({}, {"policy": "occupied", "d_self": 0.01}, {"policy": "keep", "shadow": False,
        "flying_m": 0.05}, {"memory_s": 0.0, "speed": 0.5})
    ):  # fmt: skip
        rng = np.random.default_rng(400 + k)
        cams = seen_by if k % 2 else seen_by[0]
        space = odm.SeenSpace(cell_map, cams, odm.SeenSettings(**settings))
        planner = odm.ReactivePlanner(cell_map)
        planner.set_goals([scenes.draw_free(planner, rng)])
        q = scenes.draw_free(planner, rng)
        for i in range(24):
            ball = [[0.75, 0.4 * np.sin(0.3 * i), 0.5, 0.08], [0.8, -0.3, 0.3, 0.05]]
            views = [scenes.depth_image(T, lens, np.array(ball), 2.0) for T in poses]
            stamp = 0.033 * (i if i != 15 else 3)  # once they come out of order
            images = views if k % 2 else views[0]
            seen = space.update(images, q, stamp)
            names = "covering_radius", "certified", "stamp", "trouble", "readings"
            at = f"{told(settings)}, frame {i}"
            yield f"{at}: {fields(seen, 'points', *names, 'removed')}"
            yield f"{at}: {told(space.counts())} {digest(space.cells())}"
            radius = seen.covering_radius
            options = {"covering_radius": min(radius, 0.03)}
            answer = planner.step(seen.points.copy(), q=q, **options)
            yield f"{at}: {answer_words(answer)}"
            q = _moved(9, answer, q)
    eye = seen_by[0].moved(poses[1])
    image = eye.from_metres(np.where(views[0] % 7, 0.001 * views[0], np.nan))
    yield f"raw points: {digest(eye.points(image))} {eye.covering_radius(1.5)!r}"
    far = odm.SeenSpace(cell_map, odm.DepthCamera(*lens, poses[0], 1.0))
    yield f"wrong unit: {far.update(views[0], q, 0.0).trouble}"


def shapes(shop: object) -> Lines:
    """Sample shapes, capsules and robots; refuse what is none."""
    T = scenes.pose(0.3, 0.1, 0.4, 0.5, 0.2)
    bodies = (
        odm.Box([0.2, 0.1, 0.3], T), odm.Sphere(0.1, T), odm.Cylinder(0.1, 0.3, T),
        odm.Capsule(0.05, 0.3, T), odm.Capsule.between([0, 0, 0], [0.1, 0.2, 0.3], 0.1),
    )  # fmt: skip
    for body in bodies:
        for spacing in (0.01, 0.03):
            surface = odm.surface_of(body, spacing)
            yield f"{type(body).__name__}: {fields(surface, 'points')}"
        yield f"{type(body).__name__}: {digest(body.moved(T).T_base_shape)}"
    rods = np.array([[0, 0, 0, 0.1, 0, 0.3, 0.05], [0.2, 0, 0, 0.2, 0, 0, 0.04]])
    yield f"capsules: {digest(odm.sample_capsules(rods, 0.02))}"
    robot = shop.loaded("gross").robot
    for part in odm.robot_surface(robot, 0.3 * robot.upper, T):
        yield f"robot standing: {fields(part, 'points', 'label', 'closed')}"
    yield f"no size: {outcome(odm.Box, [0.1, 0.1, 0.0])}"
    yield f"no pose: {outcome(odm.Sphere, 0.1, np.ones((4, 4)))}"


def bad_calls(shop: object) -> Lines:
    """Tell with which sentences public calls are refused."""
    cell_map = shop.loaded("arm")
    planner = odm.ReactivePlanner(cell_map)
    q, robot, none = cell_map.roadmap.nodes[0], cell_map.robot, np.zeros((0, 3))
    motion = roadmap.time_path(robot, cell_map.roadmap.nodes[:2])
    calls = (
        (planner.step, none, q[:3]), (planner.step, np.zeros((2, 2)), q),
        (planner.step, "points", q), (planner.set_goals, [q + 10.0]),
        (planner.set_goals, [q[:2]]), (planner.set_goals, [q], [np.nan]),
        (planner.set_goals, [q] * 40), (planner.is_free, q, q * np.nan),
        (planner.is_free, q, q, "take"), (planner.set_extra_clearance, 3.0),
        (planner.set_base, np.ones((4, 4))), (planner.set_static, "wall"),
        (scenes.improve, planner, -1), (planner.blocked_leg, q[:2]),
        (planner.approach, q),
        (planner.separation, q[:1]), (planner.prepare_goal, q + 9.0), (planner.detach,),
        (copy.copy, planner), (pickle.dumps, planner), (_elsewhere, planner.reset),
        (_elsewhere, planner.take_over), (planner.reset,), (planner.take_over,),
        (planner.reset,), (_pickled, cell_map), (repr, planner.step(none, q)),
        (_copied, planner.step(np.full((1, 3), np.nan), q)),
        (odm.PlannerSettings, 0), (odm.SeenSettings, -1.0), (odm.load_map, "nowhere"),
        (odm.load_recipe, "nothing"), (odm.surface_of, "shape"),
        (odm.sample_capsules, np.zeros((2, 6))), (odm.carried_object, "thing"),
        (odm.DepthCamera, 1, 1, 1, 1, 1, 1, np.eye(4)), (roadmap.load_robot, "nobody"),
        (roadmap.time_path, robot, q + 9.0), (motion.at, -1.0), (motion.rescaled, 0, 2),
        (handover.Human, 3.0), (handover.Human, 1.7, "flying"),
        (handover.ReachSettings, -1.0), (handover.load_reach_map, "nowhere"),
        (handover.MeetSettings, "both"), (handover.rotation_grid, 7),
        (handover.Above, "high"), (handover.human_from_joints, np.zeros((2, 3))),
    )  # fmt: skip
    for k, (call, *values) in enumerate(calls):
        yield f"call {k}, {call.__name__}: {outcome(call, *values)}"


def _pickled(cell_map: odm.CellMap) -> str:
    return pickle.loads(pickle.dumps(cell_map)).hash


def _copied(answer: odm.Answer) -> str:
    return answer_words(copy.copy(answer))


def _elsewhere(call: Callable) -> None:
    """Call in another thread, which a planner refuses."""
    with ThreadPoolExecutor(1) as pool:
        pool.submit(call).result()


# --- the person, and where to meet ----------------------------------------------------


def human(shop: object) -> Lines:  # noqa: ARG001
    """Tell bodies, inverse kinematics and quality of people of many sizes."""
    rng = np.random.default_rng(500)
    for k, posture in enumerate(handover.POSTURES):
        person = handover.Human(1.55 + 0.08 * k, posture).placed(0.9, 0.1 * k, 2.5)
        person = person.looking_at(np.array([0.0, 0.0, 1.0]))
        yield f"{posture}: {digest(person.capsules())} {told(person.labels)}"
        yield f"{posture}: {digest(person.surface_points())}"
        for side in ("right", "left"):
            arm = person.arm(side)
            q = rng.uniform(arm.lower, arm.upper)
            moved = person.with_arm(side, q)
            T = moved.T_world_hand(side)
            found = person.arm_ik(side, T)
            yield f"{posture}, {side}: {fields(found, 'q', 'swivel', 'spans')}"
            settings = handover.QualitySettings()
            state = handover.ArmState.of(moved, side, settings)
            quality = handover.posture_quality(state, q)
            yield f"{posture}, {side}: {fields(quality, 'parts', 'online')}"
            total = handover.total_quality(quality.online, 0.3, settings)
            yield f"{posture}, {side}: {total!r} {digest(person.reach_pose(side, T))}"
            yield f"{posture}, {side}: {digest(arm.jacobian(q))} {digest(arm.fk(q))}"
            poses = np.array([arm.fk(rng.uniform(arm.lower, arm.upper)), T])
            yield f"{posture}, {side}: {told(arm.solvable(poses))}"
        large = person.resized(1.9)
        yield f"{posture}: {digest(large.capsules())} {len(large.labels)}"
    grid = handover.rotation_grid(72)
    yield f"rotations: {digest(grid.centers)}"
    for k in range(4):
        places = {
            "hip": (0, 0, 0.95), "neck": (0, 0, 1.45), "head": (0, 0.03, 1.6),
            "left_shoulder": (-0.19, 0, 1.42), "left_elbow": (-0.22, 0, 1.13),
            "left_hand": (-0.22, 0.05 * k, 0.88), "right_shoulder": (0.19, 0, 1.42),
            "right_elbow": (0.22, 0.1, 1.15), "right_hand": (0.1, 0.1 * k, 1.15),
        }  # fmt: skip
        yield f"measured {k}: {outcome(_measured, places)}"


def _measured(places: dict) -> str:
    found = handover.human_from_joints({k: np.array(v) for k, v in places.items()})
    return f"{found.height!r} {digest(found.capsules())} {told(found.arms)}"


def reach(shop: object) -> Lines:
    """Build a reach map twice; look poses up in it."""
    robot = shop.loaded("kawasaki").robot
    settings = handover.ReachSettings(cell=0.15, rotations=72, samples=20_000, seed=3)
    found = handover.build_reach_map(handover.chain_of(robot), settings, threads=2)
    place = found.save(shop.folder / "reach_again")
    again = handover.load_reach_map(place, verify=True)
    yield f"hash {again.hash}, {again.n_marked} cells"
    rng = np.random.default_rng(600)
    T = np.array([
        roadmap.tool_pose(robot, rng.uniform(robot.lower, robot.upper))
        for _ in range(50)
    ])  # fmt: skip
    yield f"quality {digest(again.quality(T))}"
    for k in range(10):
        yield f"witness {k} {told(again.witness(T[k]))}"
    cells = again.marked_cells()
    yield f"cells {digest(cells)} {digest(again.qualities(cells[::50]))}"
    yield f"all {digest(again.dense())}"
    index = handover.NodeIndex(robot, shop.loaded("kawasaki").roadmap.nodes)
    for k in range(10):
        yield f"near nodes {k} {told(index.nearest(T[k], 3))}"
    arm = handover.Human().arm("right").chain()
    small = handover.ReachSettings(cell=0.2, rotations=72, samples=10_000)
    yield f"person {handover.build_reach_map(arm, small, threads=2).n_marked}"


def meet(shop: object) -> Lines:
    """Rank targets of a person who moves; find one that the robot reaches."""
    held = handover.load_reach_map(shop.reach())
    robot = shop.loaded("kawasaki").robot
    constraints = {
        "none": (), "above": (handover.Above(0.5),),
        "inside": (handover.Inside((-1, -1, -1), (1, 1, 2)), handover.Upright(1.4)),
    }  # fmt: skip
    T_world_base = scenes.pose(0.0, 0.0, 0.75)
    for name, asked in constraints.items():
        for side, thing in (("right", handover.wrench()), ("left", handover.mallet())):
            settings = handover.MeetSettings(
                side=side, constraints=asked, T_world_base=T_world_base
            )
            person = handover.Human(1.7).placed(0.8, 0.0, np.pi)
            meeting = handover.InteractionWorkspace(held, person, thing, 4, settings)
            at = f"{name}, {side}"
            yield f"{at}: {len(meeting)} cells {digest(meeting.build())}"
            for k in range(6):
                person = person.placed(0.7 + 0.1 * k, 0.05 * k, np.pi - 0.1 * k)
                meeting.update(person)
                best = meeting.best(8)
                yield f"{at}, step {k}: {told(meeting.work)} {meeting.missing_m!r}"
                for target in best:
                    yield f"{at}, step {k}: {_target(target)}"
                if best:
                    meeting.remove(best[0])
                    keys = [t.key for t in best]
                    rated = [r and r.quality for r in meeting.rated(keys)]
                    yield f"{at}, step {k}: {told(rated)} {told(meeting.removed)}"
                    yield f"{at}, step {k}: {told(meeting.quality_of(keys))}"
            meeting.restore()
            meeting.forget()
            meeting.update(person.placed(0.75, 0.1, np.pi))
            planner = odm.ReactivePlanner(shop.loaded("kawasaki"))
            post = np.array([[0.4, 0.1, 0.2, 0.4, 0.1, 0.6, 0.08]])
            points = scenes.points_of(post)
            planner.step(points, q=planner.cell_map.roadmap.nodes[0], closed=True)
            found = handover.find_handover(meeting, robot, planner, clock=lambda: 0.0)
            tried = [why for _, why in found.tried[:20]]
            yield f"{at}: {fields(found, 'q', 'reason', 'timed_out')} {told(tried)}"


def _target(target: handover.Target) -> str:
    names = "key", "grasp", "quality", "dexterity", "arm_q", "T_world_tool"
    return f"{fields(target, *names)}, {fields(target.parts, 'parts', 'online')}"


def live(shop: object) -> Lines:
    """Let a planner pursue the best targets of a person who moves."""
    held = handover.load_reach_map(shop.reach())
    settings = odm.PlannerSettings(
        goal_connections=4,
        start_connections=4,
        confirmations=1,
        history_s=0.0,
        cached_goals=32,
    )
    T_world_base = scenes.pose(0.0, 0.0, 0.75)
    for k, side in enumerate(("right", "left")):
        planner = odm.ReactivePlanner(shop.loaded("kawasaki"), settings=settings)
        q = planner.cell_map.roadmap.nodes[0].copy()
        person = handover.Human(1.7).placed(0.85, 0.0, np.pi)
        meeting = handover.InteractionWorkspace(
            held,
            person,
            handover.wrench(),
            4,
            handover.MeetSettings(side=side, T_world_base=T_world_base),
        )
        pursuer = handover.LiveTargets(planner, meeting, q)
        for i in range(150):
            turn = np.pi + 0.3 * np.sin(0.03 * i)
            person = person.placed(0.85 + 0.15 * np.sin(0.02 * i + k), 0.1, turn)
            points = person.surface_points(T_world_base=T_world_base)
            answer = pursuer.step(person, points, q, closed=True)
            yield f"{side}, frame {i}: {answer_words(answer)}"
            names = "state", "key", "kind", "quality", "best", "targets", "goals"
            yield f"{side}, frame {i}: {fields(pursuer.pursuit, *names)}"
            q = _moved(9, answer, q)
        yield f"{side}: {told(dict(pursuer.counts))}"


ITEMS = {
    "names": names,
    "robots": robots,
    "shapes": shapes,
    "motions": motions,
    "frames": frames,
    "layers": layers,
    "approach": approach,
    "cameras": cameras,
    "bad calls": bad_calls,
    "human": human,
    "reach": reach,
    "meet": meet,
    "live": live,
}
