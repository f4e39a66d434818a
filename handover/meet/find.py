"""find_handover: the best target that the robot really reaches.

[Vahrenkamp2016, Algorithm 2]. The workspace ranks cells; whether the robot can go to
the middle of one, and stand there free, is asked of its inverse kinematics and of a
test of validity, best target first.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from handover.chain import chain_of
from handover.meet.constraints import ClearOf
from handover.meet.settings import FindSettings
from handover.meet.validity import Validity, validity_of
from handover.meet.workspace import InteractionWorkspace, Target
from handover.reach.reach_map import ReachMap
from odm.planner.planner import ReactivePlanner
from roadmap.errors import BadInput
from roadmap.ranges import check_kind, check_number, settings_of
from roadmap.robot.robot import Robot

_NO_ROOM = "the hand or forearm that takes the object would be in what stands still"


@dataclass(frozen=True, eq=False)
class Handover:
    """What a search found.

    Attributes:
        target: The best target that passed. Where the time was over: the best one that
            was not refuted. None: there is none, or none is left.
        q: (dof,) configuration of the robot that passed; None where `target` was not
            verified.
        tried: (target, why it was given up) of those that failed, best first; they are
            removed from the workspace until its `restore()`.
        timed_out: Whether the time was over before one passed.
        reason: One sentence where there is no `q`; else empty.
    """

    target: Target | None
    q: np.ndarray | None
    tried: tuple[tuple[Target, str], ...]
    timed_out: bool
    reason: str = ""

    def __bool__(self) -> bool:
        return self.q is not None


def find_handover(
    meet: InteractionWorkspace,
    robot: Robot,
    is_valid: object,
    timeout: float = 0.5,
    *,
    settings: FindSettings | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> Handover:
    """Return the best target that passes, with the robot's configuration.

    Best first: whether the arm that takes is clear of what constraints know, the
    robot's inverse kinematics from the reach map's witness, then the test of validity.
    A target that fails is removed from the workspace and listed.

    Args:
        meet: The targets.
        robot: The robot of the workspace's reach map.
        is_valid: q (dof,) -> bool, or (bool, reason), or an `odm.Freedom`: exact
            geometry, say. Or an `odm.ReactivePlanner`: the configuration must be free
            in its last frame, and joined to its roadmap; see `PlannerValidity`.
        timeout: Time after which no further target is begun [s]. A call of `is_valid`
            is not interrupted.
        settings: How near, and how hard it is tried; see FindSettings.
        clock: Returns the time [s]; for tests.

    Raises:
        BadInput: A timeout that is none, a robot of other joints than the
            reach map's, an `is_valid` that is none.
    """
    settings = settings_of(settings, FindSettings)
    check_kind("meet", meet, InteractionWorkspace, "give an InteractionWorkspace")
    check_number("timeout [s]", timeout, 1e-9, 1e9)
    check_same_robot(meet.reach, robot)
    valid = validity_of(is_valid)
    T_world_base, scene = meet.settings.T_world_base, None
    if isinstance(is_valid, ReactivePlanner):
        scene = ClearOf.of_scene(is_valid, T_world_base)
    T_base_world = np.linalg.inv(T_world_base)
    end = clock() + timeout
    tried: list[tuple[Target, str]] = []
    waiting: list[Target] = []
    while waiting := waiting or meet.best(settings.batch):
        target = waiting[0]
        if clock() >= end:
            why = (
                f"the time of {timeout:g} s was over after {len(tried)} targets; the "
                "best one that was not refuted was not verified either"
            )
            return Handover(target, None, tuple(tried), True, why)
        T_base_tool = T_base_world @ target.T_world_tool
        q, why = None, _NO_ROOM
        if meet.takeable([target], scene):
            q, why = _reaching(meet, robot, T_base_tool, valid, settings)
        if q is not None:
            return Handover(target, q, tuple(tried), False)
        tried.append((target, why))
        meet.remove(target)
        waiting.pop(0)
    return Handover(None, None, tuple(tried), False, _nothing(meet, tried))


def _reaching(
    meet: InteractionWorkspace,
    robot: Robot,
    T_base_tool: np.ndarray,
    valid: Validity,
    settings: FindSettings,
) -> tuple[np.ndarray | None, str]:
    """Return a valid configuration with the tool there, or None and why not."""
    seed = meet.reach.witness(T_base_tool)
    found = robot.ik(
        T_base_tool,
        seed,
        attempts=settings.attempts,
        steps=settings.steps,
        position_tolerance=settings.position_tolerance,
        rotation_tolerance=settings.rotation_tolerance,
    )
    if not found:
        return None, (
            f"inverse kinematics: {robot.name} does not get its tool there, within "
            f"{1e3 * settings.position_tolerance:g} mm and "
            f"{settings.rotation_tolerance:g} rad, from {settings.attempts} starts"
        )
    reasons = []
    for solution in found:
        free, why = valid(solution.q)
        if free:
            return solution.q, ""
        reasons.append(why)
    more = f" (and {len(found) - 1} other configurations)" if len(found) > 1 else ""
    return None, f"{reasons[0] or 'not valid'}{more}"


def _nothing(meet: InteractionWorkspace, tried: list) -> str:
    if tried:
        return f"all {len(tried)} targets failed; the first one by {tried[0][1]}"
    return f"no target: the person would have to come {meet.missing_m:.2f} m nearer"


def check_same_robot(reach: ReachMap, robot: Robot) -> None:
    """Refuse a robot whose joints, limits or tool are not those of a reach map."""
    chain, wanted = reach.chain, chain_of(robot, self_collisions=False)
    q = np.clip(np.full(chain.dof, 0.3), *chain.limits.T)
    same = (
        chain.joint_names == wanted.joint_names
        and np.allclose(chain.limits, wanted.limits, atol=1e-6)
        and np.allclose(chain.tool_pose(q), wanted.tool_pose(q), atol=1e-6)
    )
    if not same:
        raise BadInput(
            f"the reach map is of {chain.name} with {chain.dof} "
            f"joints, not of {robot.name} with its tool {robot.tip_name!r}; "
            "build one for this robot: `odm workspace build`"
        )
