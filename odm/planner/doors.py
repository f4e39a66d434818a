"""What a planner is told between frames: its hand, its base, its distance, its place.

No map is built again for any of these.
"""

import numpy as np

from odm.checks import check_configuration, goals_of
from odm.obstacles.surfaces import rounded_covering
from odm.obstacles.world_frame import WorldFrame
from odm.planner.attaching import Attacher
from odm.planner.carrying import Carrier
from odm.planner.goal_checks import check_goals
from odm.planner.place import place_points
from odm.planner.settings import MOST_EXTRA
from odm.search import _frame as frame
from roadmap.errors import BadInput
from roadmap.ranges import check_number, is_between


class Doors:
    """Methods of `ReactivePlanner`."""

    carrier: Carrier
    attacher: Attacher

    def prepare_goal(self, q: np.ndarray) -> bool:
        """Attach a goal ahead, in a frame that can afford it; True: it is kept.

        Attaching takes milliseconds, `set_goals` with a goal that is kept does not.
        `PlannerSettings.kept_goals` says how many are kept, those set before too.

        Args:
            q: (dof,) a valid configuration [rad or m].

        Raises:
            BadConfiguration: As of `set_goals`.
        """
        self.memory.owner.check()
        goals, _ = goals_of(self.robot, [q], None)
        if goals[0] in self.attacher.kept:
            return True
        check_goals(self, goals)
        return self.attacher.prepare(goals[0])

    def is_prepared(self, q: np.ndarray) -> bool:
        """Return whether a goal is kept attached, so that to set it costs little."""
        self.memory.owner.check()
        return check_configuration(self.robot, q, None) in self.attacher.kept

    def attach(self, thing: object, T_tool_object: np.ndarray | None = None) -> None:
        """Take an object into the hand: from now on all motions heed it.

        Edges are judged by the cells of the map's payload envelope, all other motions
        by the spheres of the object itself. The object may touch the links that the
        tool's body carries, no others, and no scenery. The path in use is dropped; the
        goals stay and are joined anew in the next frame.

        Args:
            thing: (n, 4) spheres, centre and radius [m]; a shape of `odm`; or what
                `odm.carried_object` made of one, which saves the time for its cover.
            T_tool_object: (4, 4) where it is held, tool frame; None: at the tool.

        Raises:
            BadInput: The map has no payload layer, something is attached already, or
                the object is larger than the envelope (both sizes are named).
        """
        self.memory.owner.check()
        T = np.eye(4) if T_tool_object is None else T_tool_object
        self.carrier.attach(thing, T)

    def detach(self) -> None:
        """Let go of what is attached; the path in use is dropped.

        Raises:
            BadInput: Nothing is attached.
        """
        self.memory.owner.check()
        self.carrier.detach()

    @property
    def attached(self) -> np.ndarray | None:
        """(n, 4) spheres of what is attached, tool frame [m]; None for nothing."""
        thing = self.carrier.thing
        return None if thing is None else thing.spheres

    def hand_changed(self) -> None:
        """Take up the table's new groups; what was planned before is gone."""
        self.memory.owner.check()
        self._set_radii(*self._sampled)
        self.attacher.resize()
        self.memory.search.memo[:] = -1
        self.memory.past.vertex[:] = -1
        self.memory.goals.at[: len(self.goals)] = -1
        self.memory.goals.count[0] = 0
        self.memory.pool.used[:] = 0
        self.attacher.kept.clear()
        self.attacher.forget_shortcuts()
        self._rejoin = True
        if self._approacher is not None:
            self._approacher.legs.forget_fine()
        self.reset()

    def set_extra_clearance(self, extra: float) -> None:
        """Keep more distance from the frame's points and from `set_static`'s scenery.

        Cells are dilated and the close test's radii grow, so a larger value never
        frees anything. The recipe's own scenery keeps the map's clearance.

        Args:
            extra: Distance beyond the map's clearance m [m], 0 to 0.5.

        Raises:
            BadInput: Out of range.
        """
        self.memory.owner.check()
        if not is_between(extra, 0.0, MOST_EXTRA):
            raise BadInput(
                f"an extra clearance of {extra} m is not between 0 and {MOST_EXTRA} m; "
                "give metres"
            )
        self.extra = float(extra)
        self.memory.terms.extra[0] = self.extra
        self._set_radii(*self._sampled)
        if self._approacher is not None:
            self._approacher.legs.forget_fine()
        self.carrier.set_extra(self.extra)
        self._mark()  # points just outside the grid may count now
        self._place()

    def set_base(self, T_world_base: np.ndarray) -> None:
        """Say where the base stands: points and poses are given in the world from here.

        That holds for the points of `step` and `blocked_leg`, for `set_static` (also
        for what was set before: it stays where it is in the world) and the poses of
        `approach`. The recipe's own scenery moves with the base. Call it between runs;
        the path in use is dropped.

        Args:
            T_world_base: (4, 4) pose of the base in the world [m].

        Raises:
            BadInput: Not a rigid motion.
        """
        self.memory.owner.check()
        before = self.world.T_world_base
        self.world = WorldFrame(T_world_base)
        self._world_ahead = WorldFrame(T_world_base)
        p_world = self.points @ before[:3, :3].T + before[:3, 3]
        self._keep(self.world.points(p_world))  # the person stays
        self._mark()
        self._place()
        self.reset()

    def _mark(self) -> None:
        """Mark the frame's points anew, as they are kept."""
        if len(self.points) > len(self.memory.cloud.where):
            self.make_room(2 * len(self.points))
        frame.take_points(self.memory.table, self.points)

    def set_static(self, points_or_shapes: object) -> None:
        """Set the scenery of this place, once: (n, 3) points or closed shapes.

        Points must cover their surfaces within the map's rho. Nodes and edges that
        the scenery blocks are closed for good; call again to replace it.
        """
        self.memory.owner.check()
        self._p_world_place = place_points(points_or_shapes, self.rho)
        self._place()

    def _place(self) -> None:
        """Close what the scenery of this place blocks, where the base stands now."""
        if self._p_world_place is None:
            return
        points = self._world_ahead.points(self._p_world_place).copy()
        self.static_outside = self.carrier.set_place(points)
        self.attacher.forget_all()

    def _set_radii(self, covering_radius: float | None, rounding: float | None) -> None:
        """Let the close test's radii follow how the points were sampled."""
        if rounding is not None:
            rounding = check_number("rounding in m", rounding, 0.0, np.inf)
        self._sampled = (covering_radius, rounding)
        m = self.cell_map.safety.m + self.extra
        balls = self.memory.arm.spheres[:, 3] + m
        needed = [self.covering(ball) for ball in balls]
        self.radii[:] = balls + needed
        self.keep = m + float(np.max(needed))

    def covering(self, ball: float) -> float:
        """Return how far a surface may be from its samples, for a ball's radius [m]."""
        declared, rounding = self._sampled
        rho = self.rho if declared is None else declared
        return rounded_covering(rho, rounding or 0.0, ball)
