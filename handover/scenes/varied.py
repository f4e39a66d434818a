"""Scenes of our own: other objects and agents, receivers seated or turned away."""

import numpy as np

from handover.grasps.agents import load_agent
from handover.grasps.objects import load_object, object_names
from handover.human.anthropometry import ARM_JOINTS
from handover.human.postures import HANGING
from handover.scenes.agent_body import upright
from handover.scenes.paper import TABLE_TOP, floor
from handover.scenes.scene import GAP, Fixture, PlacedAgent, Scene, stand
from handover.scenes.start_check import start_distances
from odm.obstacles.shapes import Box

_BEHIND = 0.25  # [m] from the board's far rim to the receiver's middle
_TURNED = np.radians(90.0)  # most, from facing the giver's side
_ALONG = 0.3  # [m] each way, of object and receiver
_AHEAD, _BELOW = 0.38, 0.15  # [m] the goal, from between the receiver's shoulders
_BOARDS = {"crichton": (0.30, 0.70), "panda": (-0.15, 0.55)}  # [m] x of both rims
_SHOULDERS = {"drchubo": "left_shoulder_pitch", "person": "left_arm_1"}
_RECEIVERS = (("drchubo", "standing"), ("person", "sitting"), ("person", "standing"))
_FEET = {"drchubo": GAP, "person": 0.0}  # [m] a person's postures have it already
_TRIES = 50


def varied(seed: int) -> Scene:
    """An object on a board at the wall, for a receiver who holds it before the chest.

    Random: giver (Crichton, Panda), receiver (Hubo, a person who sits or stands), the
    object and how it lies, its place and the receiver's along the board, within 30 cm,
    and the receiver's turn, within 90 degrees of facing the giver's side. A draw whose
    start is in collision is drawn again.
    """
    rng = np.random.default_rng(seed)
    for _ in range(_TRIES):
        scene = _draw(rng, seed)
        found = start_distances(scene)
        if not found or found[0][0] > 0.0:
            break
    return scene


def _draw(rng: np.random.Generator, seed: int) -> Scene:
    who = ("crichton", "panda")[int(rng.integers(2))]
    name, posture = _RECEIVERS[int(rng.integers(len(_RECEIVERS)))]
    thing = load_object(object_names()[int(rng.integers(len(object_names())))])
    near, far = _BOARDS[who]
    size = (far - near, 1.6, 0.03)
    board = Box(size, upright(0.5 * (near + far), 0.0, TABLE_TOP - 0.015))
    giver = stand(load_agent(who), np.eye(4), "fixed")
    at, along, turn, spin, goal_spin = rng.uniform(-1.0, 1.0, 5)
    corners = np.concatenate(thing.triangles()).reshape(-1, 3)
    rest = TABLE_TOP - corners[:, 2].min() + GAP
    start = upright(far - 0.2, _ALONG * at, rest, np.pi * spin)
    yaw = np.pi + _TURNED * turn
    T_floor = upright(far + _BEHIND, _ALONG * along, _FEET[name], yaw)
    receiver = _waiting(name, T_floor, posture)
    shoulder = receiver.body.frames(receiver.joints)[_SHOULDERS[name]][2, 3]
    goal = receiver.T_world_base @ upright(
        _AHEAD, 0.0, float(shoulder) - _BELOW, np.pi * goal_spin
    )
    scenery = (*floor(), Fixture("board", board))
    return Scene("varied", seed, giver, receiver, thing, start, goal, scenery, True)


def _waiting(name: str, T_floor: np.ndarray, posture: str) -> PlacedAgent:
    """Return a receiver whose arms are not on the board."""
    joints: dict[str, float] = {}
    if name == "person":
        joints = {
            f"{side}_{joint.replace(' ', '_')}": float(np.radians(angle))
            for side in ("left", "right")
            for joint, angle in zip(ARM_JOINTS, HANGING, strict=True)
        }
    else:  # a hand hangs beside the body, behind the board's rim
        joints = {"left_SP": 0.5, "right_SP": 0.5, "left_EP": -0.3, "right_EP": -0.3}
    return stand(load_agent(name), T_floor, posture, joints)
