"""A mesh of the user's as what is handed over: how a gripper holds it, and its rods."""

from collections.abc import Sequence

import numpy as np

from handover.grasps.grasp_build import GraspSettings, build_grasps
from handover.grasps.grasp_set import GraspSet
from handover.grasps.hand import Hand, make_hand
from handover.grasps.hands import HandSpec
from handover.grasps.objects import GraspObject
from handover.meet.held_object import HeldObject, fist_grasps
from odm.frame.last_phase import GRIPPER_KEEPS, gripper_links
from roadmap.errors import BadInput
from roadmap.kinematics.forward import cover_balls, tool_pose
from roadmap.loading.body_tree import drive
from roadmap.robot.description import MOVABLE, Description, read_description
from roadmap.robot.known import robot_file
from roadmap.robot.robot import Robot
from roadmap.transforms import moved_points, pose_of, pose_with

GRASPING = GraspSettings(samples=60)  # enough for one good grasp, in seconds
_MOST_RODS = 12  # each costs every frame
FIST = 0.06  # [m] of the object must stick out of the gripper for a person's hand
_CLEAR_FIST = 0.07  # [m] from the gripper to the middle of that hand, or it is in it
_ENOUGH = 0.15  # [m] more than this is no better
_FIST_FROM_END = 0.06  # [m] from the object's end to the middle of that hand, at most
_FINE = 0.006  # [m] longest edge of the triangles that rods are laid around
_SLACK = 1.15  # a rod's radius, over the farthest point from its axis
# the object's x points out of the hand, along the tool's z
_OUT_OF_HAND = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])


def held_mesh(
    thing: GraspObject, robot: Robot, urdf: str, tip: str, pads: Sequence[str]
) -> HeldObject:
    """Return an object as a robot's gripper holds it, to be taken where it sticks out.

    The grasp is one of those that `build_grasps` finds for the gripper as the robot's
    description has it: by force closure, the one that leaves most of the object before
    the fingers, near the tool's axis.

    Args:
        thing: The object, of `handover.load_object`.
        robot: The robot.
        urdf: Its known name, or its URDF.
        tip: Link of its tool.
        pads: Links that touch an object.

    Raises:
        BadInput: The gripper cannot hold it, or it leaves no room for a person's hand.
    """
    grasps, hand, T_tool_palm = _grasps_of(thing, robot, urdf, tip, pads)
    corners = np.concatenate(thing.triangles())
    best, most = None, -np.inf
    for T_object_palm in grasps.T_object_palm:
        T = T_tool_palm @ np.linalg.inv(T_object_palm)  # of the object, in the tool
        points = moved_points(corners.reshape(-1, 3), T)
        out = float(points[:, 2].max() - T_tool_palm[2, 3]) - hand.reach
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        score = min(out, _ENOUGH) - float(np.linalg.norm(middle[:2]))
        if score > most:
            best, most, sticks_out = T, score, out
    if sticks_out < FIST:
        raise BadInput(
            f"{thing.name} sticks out of {robot.name}'s gripper by "
            f"{100 * max(sticks_out, 0.0):.1f} cm however it is held, but a person's "
            f"hand needs {100 * FIST:.0f} cm; give a longer object"
        )
    return _held(thing, moved_points(corners, best), len(pads), sticks_out)


def _held(
    thing: GraspObject, corners: np.ndarray, n_pads: int, sticks_out: float
) -> HeldObject:
    """Return what is held, by its triangles (m, 3, 3) in the tool frame [m].

    It sticks out of the gripper by `sticks_out` [m]; a person's hand takes it near the
    end of that, or at the very end where the hand would be in the gripper.
    """
    points = corners.reshape(-1, 3)
    T = pose_with(_OUT_OF_HAND, 0.5 * (points.min(axis=0) + points.max(axis=0)))
    local = (corners - T[:3, 3]) @ T[:3, :3]
    end = float(local[..., 0].max())
    place = end - min(max(sticks_out - _CLEAR_FIST, 0.0), _FIST_FROM_END)
    turns = 2 if n_pads == 2 else 1  # two jaws hold it turned by half a turn as well
    grasps = fist_grasps([place])
    return HeldObject(thing.name, rods_around(local), thing.mass_kg, T, grasps, turns)


def rods_around(corners: np.ndarray) -> np.ndarray:
    """Return capsules (k, 7) that hold all triangles (m, 3, 3), along the x axis [m].

    Around as few strips as allowed, of about square sections: the finer, the less
    sticks out.
    """
    import trimesh

    vertices = corners.reshape(-1, 3)
    faces = np.arange(len(vertices)).reshape(-1, 3)
    v, f = trimesh.remesh.subdivide_to_size(vertices, faces, _FINE, max_iter=30)
    fine = v[f]
    low, size = fine.min(axis=(0, 1)), np.ptp(fine, axis=(0, 1))
    best: np.ndarray | None = None
    for ny in range(1, _MOST_RODS + 1):
        for nz in range(1, _MOST_RODS // ny + 1):
            n = np.array([ny, nz])
            cell = (fine.mean(axis=1)[:, 1:] - low[1:]) / np.maximum(size[1:], 1e-9) * n
            which = np.clip(cell.astype(int), 0, n - 1) @ [nz, 1]
            rows = [_rod(fine[which == k].reshape(-1, 3)) for k in np.unique(which)]
            found = np.array(rows)
            if best is None or found[:, 6].max() < 0.9 * best[:, 6].max():
                best = found
    assert best is not None
    return best


def _rod(points: np.ndarray) -> np.ndarray:
    """Return a capsule (7,) along x that holds points (n, 3)."""
    y, z = 0.5 * (points[:, 1:].min(axis=0) + points[:, 1:].max(axis=0))
    off = np.linalg.norm(points[:, 1:] - [y, z], axis=1)
    r = max(_SLACK * float(off.max()), 1e-3)
    half = np.sqrt(r * r - off * off)  # its ends are round: so far beyond the segment
    a, b = (points[:, 0] + half).min(), (points[:, 0] - half).max()
    if a > b:
        a = b = 0.5 * (a + b)
        r = float(np.linalg.norm(points - [a, y, z], axis=1).max())
    return np.array([a, y, z, b, y, z, r + 1e-6])


def _grasps_of(
    thing: GraspObject, robot: Robot, urdf: str, tip: str, pads: Sequence[str]
) -> tuple[GraspSet, Hand, np.ndarray]:
    """Return the grasps by a robot's own gripper, the gripper, and (4, 4) T_tool_palm.

    Which way its joints close is not in a URDF: the way that holds the object does.
    """
    _check_axis(robot, tip, pads)
    balls, _ = _balls_of_hand(robot, pads)
    front = float((balls[:, 2] + balls[:, 3]).max()) if len(balls) else 0.0
    T_tool_palm = pose_of((0.0, 0.0, front + GRIPPER_KEEPS - GRASPING.gap))
    found, why = None, ""
    for closes in (0, 1):
        hand = make_hand(_spec_of(robot.name, urdf, tip, pads, T_tool_palm, closes))
        if hand.reach <= 0.0:
            continue
        try:
            grasps = build_grasps(thing, hand, GRASPING)
        except BadInput as error:
            why = str(error)
            continue
        if found is None or len(grasps.T_object_palm) > len(found[0].T_object_palm):
            found = grasps, hand, T_tool_palm
    if found is None:
        sides = np.ptp(np.concatenate(thing.triangles()).reshape(-1, 3), axis=0)
        size = " x ".join(f"{100 * side:.0f}" for side in sides)
        raise BadInput(
            f"{robot.name}'s gripper ({', '.join(pads)}) cannot hold {thing.name} of "
            f"{size} cm: {why or 'its pads do not reach beyond the hand'}; "
            "give an object that fits between the pads"
        )
    return found


def _check_axis(robot: Robot, tip: str, pads: Sequence[str]) -> None:
    """Refuse a tool frame whose z does not point out of the hand, to the pads."""
    hand, fingers = _balls_of_hand(robot, pads)
    if not (len(hand) and len(fingers)):
        return
    out = fingers[:, :3].mean(axis=0) - hand[:, :3].mean(axis=0)
    if out[2] >= 0.5 * np.linalg.norm(out):
        return
    k = int(np.abs(out).argmax())
    axis = ("-" if out[k] < 0.0 else "") + "xyz"[k]
    raise BadInput(
        f"{robot.name}'s pads ({', '.join(pads)}) lie along the {axis} axis of its "
        f"tool {tip}, but a hand reaches out along z; build the map with another "
        "--tip, whose z points out of the hand (a fixed link of that kind can be added "
        "to the URDF)"
    )


def _balls_of_hand(robot: Robot, pads: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return the covers (n, 4) of hand without pads, and of pads, tool frame [m]."""
    q = 0.5 * (robot.lower + robot.upper)  # wherever it is: the hand is the same
    others = gripper_links(robot) - set(pads)
    links = [robot.link_names[k] for k in robot.sphere_link[robot.moving].tolist()]
    balls = cover_balls(robot, q)[robot.moving]
    T = np.linalg.inv(tool_pose(robot, q))
    balls[:, :3] = moved_points(balls[:, :3], T)
    return balls[[n in others for n in links]], balls[[n in pads for n in links]]


def _spec_of(
    name: str,
    urdf: str,
    tip: str,
    pads: Sequence[str],
    T_tool_palm: np.ndarray,
    closes: int,
) -> HandSpec:
    """Return a gripper as its URDF has it; it closes to the lower (0) or upper end."""
    description = read_description(robot_file(urdf))
    root = _carrier_of(description, [*pads, tip])
    ends, fingers = {}, []
    for joint in description.below(root):
        if joint.kind in MOVABLE:
            driver = description.joints[drive(description, joint)[0]]
            ends[driver.name] = driver.lower, driver.upper
    for pad in pads:
        moved = [j for j in description.path(pad) if j.kind in MOVABLE]
        drivers = [drive(description, j)[0] for j in moved]
        finger = tuple(dict.fromkeys(d for d in drivers if d in ends))
        if finger and finger not in fingers:
            fingers.append(finger)
    # as a float a limit that is not there is NaN
    if not fingers or not np.isfinite(np.array([*ends.values()], float)).all():
        raise BadInput(
            f"{name}'s pads ({', '.join(pads)}) are moved by no joint with limits, "
            "so the gripper cannot be closed on a mesh; name its fingers with --pads"
        )
    drives = {d for finger in fingers for d in finger}
    closed = {d: ends[d][closes] for d in drives}
    opened = {d: ends[d][1 - closes] for d in drives}
    others = {d: 0.5 * sum(e) for d, e in ends.items() if d not in drives}
    args = name, urdf, root, tip, tuple(fingers), closed, ({**others, **opened},)
    return HandSpec(*args, T_tool_palm)


def _carrier_of(description: Description, links: Sequence[str]) -> str:
    """Return the last link that carries all of some links."""
    chains = []
    for link in links:
        joints = description.path(link)
        chains.append(
            [joints[0].parent, *(j.child for j in joints)] if joints else [link]
        )
    common = [row[0] for row in zip(*chains, strict=False) if len(set(row)) == 1]
    return common[-1]
