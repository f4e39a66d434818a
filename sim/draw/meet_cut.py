"""Where a robot hands something to a person, for tables and pictures: plain data."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from handover import Human, InteractionWorkspace, ReachMap, Target
from handover.human.body import ARM_LABELS
from roadmap.geometry.gaps import moved_rods
from roadmap.geometry.self_collision import configuration_free
from roadmap.robot.robot import Robot
from sim.loop.loop import exact_audit

TALL_BASE = 0.5  # [m] a robot whose own base is higher stands on the floor
TABLE = 0.75  # [m] else its base is this high above it
TRIES = 60  # targets looked at for one that can be drawn
NEAR = 0.02  # [m] the drawn robot keeps from the person, the taking hand aside


@dataclass(frozen=True, eq=False)
class Meeting:
    """One place of a person before a robot, and what they share there."""

    meet: InteractionWorkspace  # the interaction workspace
    # from the robot's base to the person's pelvis, along the base's x [m]
    distance: float
    best: list[Target]  # the best targets, best first
    # for each of them joints of the robot, or None where it cannot be there exactly
    robot_q: list[np.ndarray | None]
    # index of the first whose robot keeps clear of the person; None: none
    drawn: int | None
    # reach map of a person's arm; None: a coarse one
    human_reach: ReachMap | None = None

    @property
    def human(self) -> Human:
        """The person, arms as they are now."""
        return self.meet.human

    @property
    def taking(self) -> Human:
        """The person taking the object at the target that is drawn."""
        side = self.meet.settings.side
        return self.human.with_arm(side, self.best[self.drawn].arm_q)

    @cached_property
    def counts(self) -> dict[str, int]:
        """Cells the robot reaches, those that are targets, positions of these."""
        value = self.meet.build()
        n = self.meet.grid.rotations.n_cells
        shared = np.unique(self.meet.keys[value >= 0] // n)
        return {
            "reached": len(value),
            "targets": int((value >= 0).sum()),
            "positions": len(shared),
        }


def base_height(robot: Robot) -> float:
    """Return the default height of a robot's base above the floor [m].

    On the floor where its own fixed part is tall, else on a table.
    """
    of_base = robot.link_body[robot.shell_link] == 0
    top = 0.0
    for i in np.flatnonzero(of_base):
        part = robot.shell_points[robot.shell_ptr[i] : robot.shell_ptr[i + 1]]
        top = max(top, float(part[:, 2].max()))
    return 0.0 if top > TALL_BASE else TABLE


def find_meeting(
    meet: InteractionWorkspace,
    robot: Robot,
    distance: float,
    k: int,
    human_reach: ReachMap | None = None,
) -> Meeting:
    """Return the best k targets of a workspace and the robot's joints there.

    `human_reach` is what the workspace was given; `distance` as in `Meeting`.
    """
    best = meet.best(max(k, TRIES))
    T_base_world = np.linalg.inv(meet.settings.T_world_base)
    distance_to = exact_audit(robot)
    answers, drawn = [], None
    for i, target in enumerate(best):
        if i >= k and drawn is not None:
            break
        found = [s.q for s in robot.ik(T_base_world @ target.T_world_tool)]
        found = [q for q in found if configuration_free(robot, q)[0]]
        answers.append(found[0] if found else None)
        if found and drawn is None:
            rods = _in_the_way(meet, target, T_base_world)
            clear = [q for q in found if distance_to(q, rods) >= NEAR]
            if clear:
                drawn, answers[-1] = i, clear[0]
    told = max(k, 0 if drawn is None else drawn + 1)
    return Meeting(meet, distance, best[:told], answers[:told], drawn, human_reach)


def quality_by_position(meet: InteractionWorkspace) -> np.ndarray:
    """Return (nx, ny, nz) best quality over all rotations; NaN where nothing is."""
    grid, value = meet.grid, meet.build()
    best = np.full(grid.n_positions, -1.0)
    np.maximum.at(best, meet.keys // grid.rotations.n_cells, value)
    return np.where(best < 0, np.nan, best).reshape(grid.shape)


def fine_workspace(meeting: Meeting, cell: float) -> InteractionWorkspace:
    """Return the same workspace in position cells of `cell` [m], for a picture."""
    meet = meeting.meet
    settings = replace(meet.settings, cell=cell)
    given = meet.reach, meet.human, meet.obj, meet.grasps, settings
    return InteractionWorkspace(*given, meeting.human_reach)


def layer_at(meet: InteractionWorkspace, axis: int, at: float) -> int:
    """Return the layer of cells across an axis that holds a world coordinate."""
    grid = meet.grid
    local = at - meet.settings.T_world_base[axis, 3]
    layer = int(np.floor((local - grid.origin[axis]) / grid.cell))
    return min(max(layer, 0), grid.shape[axis] - 1)


def _in_the_way(
    meet: InteractionWorkspace, target: Target, T_base_world: np.ndarray
) -> np.ndarray:
    """Return the person's capsules in the base frame, without the taking forearm."""
    side = meet.settings.side
    taking = meet.human.with_arm(side, target.arm_q)
    keep = ~np.isin(taking.labels, ARM_LABELS[side][:2])
    return moved_rods(taking.capsules_of("mean")[keep], T_base_world)
