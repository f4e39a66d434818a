"""The last centimetres: a straight tool motion to a pose, proved by the close test.

A candidate is a configuration that has the tool at the pose; the line is followed
from it back to where the approach begins (`odm.approach.tool_line`). Every leg must
pass what `is_free` asks: limits, self-collision, scenery and the frame's points, with
the bound of motion over its whole length. Where the map's cover says no, the finer
cover of `odm.approach.fine_cover` decides. Work is counted, not timed: the same input
gives the same bytes.
"""

from dataclasses import dataclass, replace

import numpy as np

from odm.approach.approach_answer import Approach, ApproachSettings, Obstruction
from odm.approach.legs import LegTest, Tested
from odm.approach.tool_line import (
    LENGTH,
    Follow,
    Line,
    NearPoses,
    ToolKinematics,
)
from odm.checks import check_numbers
from odm.frame.frame import Frame
from odm.frame.freedom import is_free
from roadmap.errors import BadInput
from roadmap.kinematics.forward import difference, tool_pose
from roadmap.ranges import is_between, settings_of


@dataclass
class _Search:
    """The failure that came nearest to an approach, by the share of the line.

    Below 0: not even the pose itself was free.
    """

    best: tuple = ((-1.0, 0.0), "", None)

    def failed(self, share: float, text: str, what: Obstruction | None = None) -> None:
        key = (share, -what.missing_m if what else 0.0)
        if key > self.best[0]:
            self.best = (key, text, what)


class Approacher:
    """Looks for approaches in the present frame; see `ReactivePlanner.approach`."""

    def __init__(self, frame: Frame, settings: ApproachSettings | None = None) -> None:
        """Compute the tool's pose at every node of the roadmap."""
        self.frame = frame
        self.settings = settings_of(settings, ApproachSettings)
        self.tool = ToolKinematics(frame.robot)
        self._nodes = frame.cell_map.roadmap.nodes
        self._near = NearPoses(self.tool.tools(self._nodes))
        self.legs = LegTest(frame, self.settings.use_fine_cover)

    def run(
        self,
        T_base_tool: np.ndarray,
        q: np.ndarray | None = None,
        distance: float = 0.15,
        direction: np.ndarray | None = None,
        phase: str | None = None,
    ) -> Approach:
        """Find a proved straight motion; see `ReactivePlanner.approach`."""
        frame = self.frame
        if q is not None:
            q = check_numbers(frame.robot, q)
        line = self._line(np.asarray(T_base_tool, float), q, distance, direction)
        self.legs.look(phase)
        nothing = np.empty((0, frame.robot.dof))
        if frame.trouble is not None:
            text = f"the last frame could not be used: {frame.trouble}"
            return Approach(nothing, reason=text)
        search, before = _Search(), self.tool.descents
        self.legs.motions = 0
        if q is not None:
            found = self._from_start(line, q.copy(), search)
        else:
            found = self._from_end(line, search)
        work = {"descents": self.tool.descents - before, "motions": self.legs.motions}
        if found is None:
            _, text, what = search.best
            return Approach(nothing, reason=text, blocker=what, **work)
        followed, fine = found
        return Approach(
            followed.q, followed.error_m, followed.error_rad, fine=fine, **work
        )

    # --- inside ----------------------------------------------------------------

    def _line(self, T, q, distance, direction) -> Line:
        if q is not None:
            if direction is not None:
                raise BadInput(
                    "q and direction were both given; the line runs from q's tool "
                    "pose: leave direction out"
                )
            return Line.between(tool_pose(self.frame.robot, q), T)
        if not (is_between(distance, 0.0, 2.0) and distance > 0.0):
            raise BadInput(
                f"a distance of {distance} m is not above 0 and at most 2 m; 0.15 m "
                "suits most approaches"
            )
        along = T[:3, 2] if direction is None else np.asarray(direction, float)
        length = np.linalg.norm(along) if along.shape == (3,) else 0.0
        if not (np.isfinite(length) and length > 1e-9):
            raise BadInput(
                f"the direction {direction} is no (3,) vector with a length; give the "
                "direction that the tool moves in, base frame"
            )
        start = T.copy()
        start[:3, 3] -= distance * along / length
        return Line.between(start, T)

    def _from_start(self, line: Line, q: np.ndarray, search: _Search):
        followed = self._follow(line, q, 0.0, 1.0)
        if followed.stopped:
            search.failed(float(followed.s[-1]), followed.stopped)
            return None
        return self._prove(followed, line, search)

    def _from_end(self, line: Line, search: _Search):
        """Try solutions of the pose, best first; return (way, fine cover needed)."""
        target, tried = line.pose(1.0), []
        nearest = (np.inf, np.inf)
        for seeds in self._seeds(target):
            new, nearest = self._solutions(target, seeds, tried, nearest)
            for q in self._ranked(new):
                if not self._free_at_end(q, search):
                    continue
                followed = self._follow(line, q, 1.0, 0.0)
                if followed.stopped:
                    search.failed(0.0, followed.stopped)
                    continue
                followed = replace(followed, q=followed.q[::-1], s=followed.s[::-1])
                if not self._starts_free(followed.q[0].copy(), search):
                    continue
                found = self._prove(followed, line, search)
                if found is not None or self._is_spent():
                    return found
        if not tried:
            off, turned = nearest
            text = (
                "no configuration within limits has the tool at the pose: the nearest "
                f"found is {100 * off:.1f} cm and {np.degrees(turned):.0f} deg away; "
                "move the pose nearer or turn it"
            )
            search.failed(-0.9, text)
        return None

    def _starts_free(self, q: np.ndarray, search: _Search) -> bool:
        """Test the pre-pose by the map's cover: the planner must get there by it."""
        free = is_free(self.frame, q, q)
        self.legs.motions += 1
        if not free:
            text = (
                f"the start of the approach is not free: {free.reason}; give a longer "
                "distance or another direction"
            )
            search.failed(0.0, text, Obstruction(-1, 0, free.failed))
        return bool(free)

    def _follow(self, line: Line, q: np.ndarray, s_from: float, s_to: float) -> Follow:
        s = self.settings
        limits = (s.max_deviation_m, s.max_deviation_rad)
        return self.tool.follow(line, q, (s_from, s_to), s.step_m, limits)

    def _seeds(self, target: np.ndarray) -> list[list[np.ndarray]]:
        """Return seeds round by round: here, then nodes whose tool is near the pose.

        A round takes every so-manieth of the near ones, so that postures differ.
        """
        n, rounds = self.settings.ik_starts, self.settings.rounds
        near = self._near.nearest(target, 4 * n * rounds)
        here = self.frame.q
        first = [here] if np.isfinite(here).all() else []
        chosen = [
            [self._nodes[k] for k in near[r :: 4 * rounds]] for r in range(rounds)
        ]
        chosen[0] = [*first, *chosen[0]]
        return [seeds[:n] for seeds in chosen]

    def _solutions(self, target, seeds, tried, nearest):
        new = []
        for seed in seeds:
            q = np.array(seed, float)
            reached, off, turned = self.tool.reach(target, q)
            if not reached:
                errors = nearest, (off, turned)
                nearest = min(errors, key=lambda e: e[0] + LENGTH * e[1])
                continue
            if tried:
                apart = np.abs(difference(self.frame.robot, tried, q)).max(axis=1)
                if apart.min() < self.settings.same:
                    continue
            tried.append(q)
            new.append(q)
        return new, nearest

    def _ranked(self, solutions: list[np.ndarray]) -> list[np.ndarray]:
        """Return the clear first, by whole centimetres, then the most manipulable."""
        rows = []
        for k, q in enumerate(solutions):
            gap = self.legs.gap(q, self.settings.ample_m)
            room = np.floor(gap / self.settings.class_m)
            rows.append((-room, -self.tool.manipulability(q), k))
        return [solutions[k] for *_, k in sorted(rows)]

    def _is_spent(self) -> bool:
        return self.legs.motions >= self.settings.max_tests

    def _free_at_end(self, q: np.ndarray, search: _Search) -> bool:
        tested = self.legs.test(q, np.zeros_like(q))
        if tested.failed:
            share = -0.5 if tested.failed == "frame" else -0.6
            self._tell(tested, -1, 0, "the pose itself is not free", share, search)
        return not tested.failed

    def _prove(self, followed: Follow, line: Line, search: _Search):
        """Test every leg; return (way, whether the fine cover was needed) or None."""
        legs, fine = len(followed.q) - 1, False
        for k in range(legs):
            if self._is_spent():
                text = (
                    f"the budget of {self.settings.max_tests} motions was spent before "
                    "a line was proved; allow more motions, or give a start q"
                )
                search.failed(float(followed.s[k]), text)
                return None
            dq = np.ascontiguousarray(
                difference(self.frame.robot, followed.q[k], followed.q[k + 1])
            )
            tested = self.legs.test(followed.q[k].copy(), dq, fine)
            if tested.failed:
                left = 100 * (1.0 - followed.s[k]) * line.length
                place = f"leg {k} of {legs} is blocked, {left:.1f} cm before the end"
                self._tell(tested, k, legs, place, float(followed.s[k]), search)
                return None
            fine |= tested.fine
        return followed, fine

    def _tell(self, tested: Tested, leg, legs, place, share, search) -> None:
        text = f"{place}: {tested.text}"
        if tested.failed == "frame":
            text += f"; move it at least {1e3 * tested.missing_m + 0.1:.1f} mm away"
        text += ", or give another pose or direction"
        what = Obstruction(
            leg, legs, tested.failed, tested.link, tested.point, tested.missing_m
        )
        search.failed(share, text, what)
