"""The three scenes of [Huaman2014], section V, drawn at random by seed.

World: Crichton's base is the origin, x to its front, y to its left, the floor at 0.
What the paper leaves open is chosen once, with a reason each, in
`docs/decisions/0038-scenes.md`; it is not tuned to pass.
"""

from functools import cache

import numpy as np

from handover.grasps.agents import load_agent
from handover.grasps.objects import load_object
from handover.scenes.agent_body import agent_body, reach_pose, upright
from handover.scenes.scene import GAP, Fixture, PlacedAgent, Scene, stand
from odm.obstacles.shapes import Box, Cylinder
from roadmap.transforms import pose_of, pose_with

TABLE_MIDDLE = (0.50, 0.10)  # [m] read: the world's origin of the lab's table
TABLE_TOP = 0.72  # [m] read: rest height of objects on it
TABLE_SIZE = (0.40, 1.60)  # [m] depth; length: the range of Hubo's translation
STANDS_BEHIND = 0.15  # [m] from the table's far rim to the middle of a standing body
CART_MIDDLE = (0.05, 0.85)  # [m] at Crichton's left
CART_TOP, CART_SIZE = 0.70, (0.45, 0.45)  # [m]
TRAY_RADIUS, TRAY_THICKNESS = 0.20, 0.012  # [m] a round waiter's tray
TRAY_AHEAD, TRAY_TOP = 0.46, 0.95  # [m] before Hubo's middle; above the floor
TRAY_GRIP = np.radians(75.0)  # direction of the holding hand, from ahead to the left
STEP_RISE, STEP_DEPTH, STEP_WIDTH = 0.20, 0.26, 0.40  # [m]
# [m] to a body on the third step: the turned stool clears the table
STOOL_BEHIND = 0.25
STOOL_RANGE = 0.30  # [m] each way, along the table
LIFT = (0.45, 0.0, -0.15)  # [m] the lifted hammer, from between the shoulders
PLATE_BEHIND = 0.20  # [m] from the table's far rim to the plate's middle
KNEELS_BEHIND = 0.30  # [m] from there to the middle of the kneeling body
PLATE_RADIUS, PLATE_HEIGHT = 0.10, 0.04  # [m]
POUR_ABOVE, POUR_TILT = 0.25, np.radians(30.0)  # the jar's bottom above floor [m]
_SHOULDER = 0.372  # [m] of Hubo's shoulders above its base

_BOARD = 0.03  # [m] thickness of table, cart and step
# how Hubo's right arm holds the tray: where inverse kinematics begins
_TRAY_ARM = dict(
    zip(
        ("SP", "SR", "SY", "EP", "WY", "WP", "WR"),
        (-0.243, -0.771, 0.456, -1.72, 0.796, -0.88, 1.601),
        strict=True,
    )
)
# its other one waits beside the body, above the table: elbow back, forearm level
_FREE_ARM = {"left_SP": 0.3, "left_SR": 0.3, "left_EP": -1.9}
# fingers 1 and 2 above the tray, 3 and 4 below, their last joints level, 1 mm away
_PINCH = float(np.arcsin((0.032 - 0.011 - 0.5 * TRAY_THICKNESS - GAP) / 0.07))
_TRAY_HAND = {
    f"right_finger_{k}_{name}": sign * _PINCH
    for k in range(1, 5)
    for name, sign in (("flexion", 1.0), ("bend", -1.0))
}


def butler(seed: int) -> Scene:
    """A cup upside down on a cart; to be put upright on the tray that Hubo carries.

    Random, in this order: Hubo along the table's rim, within 1.6 m; its turn, within 15
    degrees of facing Crichton; the tray's height, within 6 cm.
    """
    rng = np.random.default_rng(seed)
    along, turn, rise = rng.uniform(-1.0, 1.0, 3) * (0.8, np.radians(15.0), 0.03)
    x = TABLE_MIDDLE[0] + 0.5 * TABLE_SIZE[0] + STANDS_BEHIND
    y = TABLE_MIDDLE[1] + along
    T_floor = upright(x, y, GAP, float(np.arctan2(-y, -x) + turn))
    top = TRAY_TOP + rise
    receiver = tray_bearer(T_floor, top)
    T_tray = T_floor @ upright(TRAY_AHEAD, 0.0, top - GAP)
    tray = T_tray @ upright(0.0, 0.0, -0.5 * TRAY_THICKNESS)
    cup = load_object("cup")
    over = pose_of((*CART_MIDDLE, CART_TOP + 0.095 + GAP), (np.pi, 0.0, 0.0))
    scenery = (
        *floor(),
        *table(),
        *cart(),
        Fixture("tray", Cylinder(TRAY_RADIUS, TRAY_THICKNESS, tray)),
    )
    goal = T_tray @ upright(0.0, 0.0, GAP)
    return Scene(
        "butler", seed, crichton(), receiver, cup, over, goal, scenery, goal_held=False
    )


def stool(seed: int) -> Scene:
    """A hammer on the table; Hubo, on a stool, lifts it before itself, head right.

    Random, in this order: step 1, 2 or 3; the stool along the table; its turn, within
    20 degrees.
    """
    rng = np.random.default_rng(seed)
    step = int(rng.integers(1, 4))
    along, turn = rng.uniform(-1.0, 1.0, 2) * (STOOL_RANGE, np.radians(20.0))
    x = TABLE_MIDDLE[0] + 0.5 * TABLE_SIZE[0] + STOOL_BEHIND
    T_third = upright(x, TABLE_MIDDLE[1] + along, 0.0, np.pi + turn)
    T_floor = T_third @ upright(-(3 - step) * STEP_DEPTH, 0.0, GAP)
    receiver = stand(load_agent("drchubo"), T_floor, f"step_{step}")
    head_right = pose_of(np.add(LIFT, (0.0, 0.0, _SHOULDER)), (0.0, 0.0, -0.5 * np.pi))
    hammer = load_object("hammer")
    start = upright(*TABLE_MIDDLE, TABLE_TOP + 0.0145 + GAP, 0.5 * np.pi)
    scenery = (*floor(), *table(), *steps(T_third))
    goal = receiver.T_world_base @ head_right
    return Scene(
        "stool", seed, crichton(), receiver, hammer, start, goal, scenery, True
    )


def kneeling(seed: int) -> Scene:
    """A food jar on the table; Hubo kneels, and holds it tilted over the dog's plate.

    Random, in this order: the goal's place, within a ball of 3 cm; its roll about the
    axis from the table to Hubo, within 20 degrees of the tilt.
    """
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=3)
    shift = 0.03 * rng.uniform() ** (1.0 / 3.0) * direction / np.linalg.norm(direction)
    roll = POUR_TILT + rng.uniform(-1.0, 1.0) * np.radians(20.0)
    x = TABLE_MIDDLE[0] + 0.5 * TABLE_SIZE[0] + PLATE_BEHIND
    y = TABLE_MIDDLE[1]
    T_floor = upright(x + KNEELS_BEHIND, y, GAP, np.pi)
    receiver = stand(load_agent("drchubo"), T_floor, "kneeling")
    jar = load_object("food_jar")
    start = upright(*TABLE_MIDDLE, TABLE_TOP + GAP)
    goal = pose_of(np.add((x, y, POUR_ABOVE), shift), (roll, 0.0, 0.0))
    at = upright(x, y, 0.5 * PLATE_HEIGHT)
    plate = Fixture("plate", Cylinder(PLATE_RADIUS, PLATE_HEIGHT, at))
    scenery = (*floor(), *table(), plate)
    return Scene(
        "kneeling", seed, crichton(), receiver, jar, start, goal, scenery, True
    )


PAPER_SCENES = {"butler": butler, "stool": stool, "kneeling": kneeling}


def crichton() -> PlacedAgent:
    """Return Crichton at the world's origin; both arms may give."""
    return stand(load_agent("crichton"), np.eye(4), "fixed")


def tray_bearer(T_world_floor: np.ndarray, top: float) -> PlacedAgent:
    """Return Hubo standing, a tray in its right hand; its left one takes.

    Args:
        T_world_floor: Where it stands, (4, 4) [m].
        top: Height of the tray's upper side above the floor [m].
    """
    agent = load_agent("drchubo")
    joints = {**_tray_joints(round(float(top), 12)), **_FREE_ARM}
    return stand(agent, T_world_floor, "standing", joints, ("left",))


@cache
def _tray_joints(top: float) -> dict[str, float]:
    """Return how Hubo's right arm holds a tray by its rim."""
    agent = load_agent("drchubo")
    body = agent_body(agent.source)
    hip = agent.posture("standing").T_floor_base[2, 3]
    ahead = np.array([np.cos(TRAY_GRIP), np.sin(TRAY_GRIP), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    place = np.array([TRAY_AHEAD, 0.0, top - GAP - 0.5 * TRAY_THICKNESS - hip])
    place -= (TRAY_RADIUS + 2 * GAP) * ahead
    T = pose_with(np.column_stack([up, np.cross(ahead, up), ahead]), place)
    arm = {f"right_{name}": value for name, value in _TRAY_ARM.items()}
    joints = body.checked({**agent.waiting("standing"), **arm, **_TRAY_HAND}, "drchubo")
    held = reach_pose(body, joints, tuple(arm), "right_palm", T)
    return {name: held[name] for name in (*arm, *_TRAY_HAND)}


def floor() -> tuple[Fixture, ...]:
    """Return the floor, as a slab."""
    return (Fixture("floor", Box((8.0, 8.0, 0.1), upright(0.0, 0.0, -0.05))),)


def table(
    middle: tuple[float, float] = TABLE_MIDDLE,
    size: tuple[float, float] = TABLE_SIZE,
    top: float = TABLE_TOP,
    name: str = "table",
) -> tuple[Fixture, ...]:
    """Return a board on four legs of 5 cm, 8 cm inside its rim: room for feet."""
    x, y = middle
    at = upright(x, y, top - 0.5 * _BOARD)
    found = [Fixture(name, Box((*size, _BOARD), at))]
    height = top - _BOARD
    for k, (i, j) in enumerate(((-1, -1), (-1, 1), (1, -1), (1, 1))):
        side = 0.5 * np.array(size) - 0.105
        foot = upright(x + i * side[0], y + j * side[1], 0.5 * height)
        found.append(Fixture(f"{name} leg {k}", Box((0.05, 0.05, height), foot)))
    return tuple(found)


def cart() -> tuple[Fixture, ...]:
    """Return a serving cart at Crichton's left: a table with a second board."""
    x, y = CART_MIDDLE
    low = Fixture("cart shelf", Box((*CART_SIZE, _BOARD), upright(x, y, 0.25)))
    return (*table(CART_MIDDLE, CART_SIZE, CART_TOP, "cart"), low)


def steps(T_third: np.ndarray) -> tuple[Fixture, ...]:
    """Return a stool of three steps between two side boards.

    Args:
        T_third: Floor below the middle of a body on the third step, (4, 4) [m]; the
            stool is climbed towards x.
    """
    found = []
    for k in (1, 2, 3):
        ahead = 0.025 - (3 - k) * STEP_DEPTH  # a foot reaches from -0.09 to 0.15
        at = T_third @ upright(ahead, 0.0, k * STEP_RISE - 0.5 * _BOARD)
        board = Box((STEP_DEPTH, STEP_WIDTH, _BOARD), at)
        found.append(Fixture(f"step {k}", board))
        for side in (-1, 1):
            height = k * STEP_RISE
            across = side * (0.5 * STEP_WIDTH + 0.01)
            at = T_third @ upright(ahead, across, 0.5 * height)
            found.append(
                Fixture(f"side of step {k}", Box((STEP_DEPTH, 0.02, height), at))
            )
    return tuple(found)
