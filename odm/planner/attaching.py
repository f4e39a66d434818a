"""Joining configurations to the roadmap: goals when set, starts when first seen."""

from typing import TYPE_CHECKING

import numpy as np

from odm.cell_map._sweep import sweep_room
from odm.cell_map.cell_map import ROUNDING
from odm.cell_map.sweep import swept_by
from odm.planner.kept_goals import KeptGoals
from odm.search import _attach as kernels
from odm.search import _cost_to_go as cost_to_go
from odm.search import _judge as judge
from odm.search import _state as kinds
from odm.search.state import MAX_ATTACHMENTS, point_motion

if TYPE_CHECKING:
    from odm.planner.planner import ReactivePlanner

_LOOKED_AT = 4  # times as many near nodes are looked at as are attached
_QUICK = 6  # near nodes that a robot in motion may be joined with,
_PASSED = 3  # and how many of them it is
_ROOM = 0.01  # [m] a robot beside its segment by less needs no test of its own
_TOLERANCE = 0.01  # [m] inflation of a piece of motion; coarser than edges, done online


class Attacher:
    """Keeps a planner's attachments: pool items of motions to and from the roadmap."""

    def __init__(self, planner: "ReactivePlanner") -> None:
        """Keep the planner; its memory must have been laid out."""
        self.planner = planner
        memory = planner.memory
        self.roadmap = planner.cell_map.roadmap
        self.resize()
        self.kept = KeptGoals(memory.goals, planner.settings.kept_goals)
        self.near = np.zeros(self.roadmap.n_nodes)
        self.q_fresh = memory.own.q_fresh
        self._fresh_key = b""  # the same as bytes, which are compared faster
        self._room_key = b""  # end and begin of a segment, and
        self._has_room = False  # whether it is free with room around it
        self._kept = np.zeros(_QUICK, np.int64)
        self.quick = False
        self._direct_from = np.full(planner.robot.dof, np.nan)  # where from
        self.beyond: np.ndarray | None = None
        self.next_vertex = self.roadmap.n_nodes + 1

    def resize(self) -> None:
        """Follow the arm, whose spheres are more while it carries something."""
        planner, arm = self.planner, self.planner.memory.arm
        safety = planner.cell_map.safety
        self.radii = arm.spheres[:, 3] + safety.rho + safety.m + ROUNDING
        tolerance = max(planner.cell_map.motion_tolerance, _TOLERANCE)
        self.swept = swept_by(arm, self.radii, tolerance, planner.cell_map.grid)
        self.room = sweep_room(arm, self.swept.grid, planner.robot.dof)
        planner.memory.proof.motion[:] = point_motion(arm, planner.robot.dof)

    # --- goals -----------------------------------------------------------------

    def set_goals(self, goals: np.ndarray, costs: np.ndarray | None) -> None:
        """Attach goals; keeps the way in use where its goal stays."""
        m = self.planner.memory
        self.tidy()
        on_way = m.way.count[0] > 0 and m.way.count[1] >= 0
        kept = int(m.goals.vertex[m.way.count[1]]) if on_way else -1
        old = {
            self.planner.goals[g].tobytes(): g for g in range(len(self.planner.goals))
        }
        kept_rows = len(self.planner.goals)  # copying all would take half a millisecond
        before = [np.copy(a[:kept_rows]) for a in m.goals]
        m.goals.at[: int(m.goals.count[0])] = -1
        direct = np.full(len(goals), kinds.NO_WAY - 1)  # not known from this start
        for g, q in enumerate(goals):
            m.goals.q[g] = q
            known = old.get(q.tobytes())
            if known is None:
                if not self.kept.restore(m.goals, g):
                    self._attach_goal(g, q)
                    self.kept.keep(m.goals, g)
            else:
                self._take_over(g, known, before)
                if self._is_direct_known():
                    direct[g] = before[m.goals._fields.index("fresh_ref")][known]
            m.goals.cost[g] = 0.0 if costs is None else costs[g]
            m.goals.direct_stuck[g] = -1.0
        n = len(goals)
        m.goals.count[0] = n
        m.numbers.joint_costs[0] = 0 if costs is None else 1
        np.min(m.goals.h[:n] + m.goals.cost[:n, None], axis=0, out=m.own.h_any)
        if m.way.count[0]:
            same = np.flatnonzero(m.goals.vertex[:n] == kept)
            m.way.count[1] = same[0] if len(same) else -1
        self._attach_direct(direct)

    def prepare(self, q: np.ndarray) -> bool:
        """Attach a goal that will be set later; False where no room is kept for it."""
        goals = self.planner.memory.goals
        spare = int(goals.count[0])
        if not self.kept.most or spare == len(goals.q):
            return False
        if q not in self.kept:
            self.tidy()
            goals.q[spare] = q
            self._attach_goal(spare, q)
            self.kept.keep(goals, spare)
            goals.at[spare] = -1
        return True

    def _take_over(self, g: int, known: int, before: list[np.ndarray]) -> None:
        """Keep what is known of a goal that was there already, at rank `known`."""
        goals = self.planner.memory.goals
        kept = ("h", "at", "node", "length", "ref", "stuck", "number", "vertex")
        for name in kept:
            index = goals._fields.index(name)
            goals[index][g] = before[index][known]

    def _attach_goal(self, g: int, q: np.ndarray) -> None:
        m = self.planner.memory
        goals, roadmap = m.goals, self.roadmap
        goals.at[g] = -1
        goals.stuck[g] = -1.0
        goals.vertex[g] = self.new_vertex()
        self._measure(q)
        nearest = int(np.argmin(self.near))
        if self.near[nearest] == 0.0:
            goals.number[g] = 1
            goals.node[g, 0], goals.length[g, 0] = nearest, 0.0
            goals.ref[g, 0] = kinds.IS_GOAL
            goals.at[g, nearest] = 0
            kernels.landmark_cost(
                roadmap.landmarks,
                nearest,
                roadmap.nodes,
                q,
                roadmap.weights,
                self.planner.robot.continuous,
                goals.h[g],
            )
            return
        self._look_beyond(False)
        self._measure(q)
        ids, refs = self._motions(q, self._wanted(), outward=False)
        k = len(ids)
        goals.number[g] = k
        goals.node[g, :k], goals.ref[g, :k] = ids, refs
        goals.length[g, :k] = self.near[ids]
        goals.at[g, ids] = np.arange(k)
        cost_to_go.exact_cost(
            m.graph, goals.node[g], goals.length[g], k, m.search, goals.h[g]
        )

    # --- starts ----------------------------------------------------------------

    def is_fresh(self, q: np.ndarray) -> bool:
        """Return True if q is the configuration that was attached last, in full."""
        return not self.quick and self.is_at(q)

    def is_at(self, q: np.ndarray) -> bool:
        """Return True if q is the configuration that was attached last."""
        return q.tobytes() == self._fresh_key

    def forget_start(self) -> None:
        """Drop the attached start."""
        self.q_fresh[:] = np.nan
        self._fresh_key = self._room_key = b""
        m = self.planner.memory
        m.fresh.count[0] = 0
        m.beside.q[:] = np.nan

    def forget_all(self) -> None:
        """Attach everything again: the scenery has changed."""
        planner = self.planner
        m = planner.memory
        planner._rejoin = False
        m.way.count[0] = 0
        self.forget_start()
        m.pool.used[:] = 0
        self.kept.clear()
        self.forget_shortcuts()
        goals, costs = planner.goals, planner.costs
        planner.goals = goals[:0]
        if len(goals):
            self.set_goals(goals, costs)
            planner.goals = goals

    def attach_start(self, q: np.ndarray, quick: bool = False) -> None:
        """Attach a configuration never seen before.

        `quick` leaves the cells of its motions out, which a robot that is passing
        through would use once: the close test decides on a few of them.
        """
        self.tidy()
        m = self.planner.memory
        self.quick = quick
        self.q_fresh[:] = q
        self._fresh_key = self.q_fresh.tobytes()
        m.goals.count[1] = self.new_vertex()
        m.goals.count[2] = m.goals.count[1] + 1
        self.new_vertex()
        self._look_beyond(True)
        self._measure(q)
        if quick:
            ids, refs = self._quick_motions(q)
        else:
            ids, refs = self._motions(q, self._wanted_here(), outward=True)
        k = len(ids)
        m.fresh.count[0] = k
        m.fresh.node[:k], m.fresh.ref[:k] = ids, refs
        m.fresh.length[:k] = self.near[ids]
        m.fresh.static[:k] = 1
        m.fresh.memo[:k] = 0
        m.fresh.stuck[:k] = -1.0
        self._attach_direct()

    def certify_beside(self, q: np.ndarray) -> None:
        """Test the motions from q, beside its segment, to that segment's two ends.

        They are new, so that they are tested against all that stands still; the
        frame's points are asked where they are used. One test of the segment with room
        around it answers for all motions that stay within that room.

        Args:
            q: (dof,) inside its limits, as `judge` found it.
        """
        m, static = self.planner.memory, self.planner.static
        segment, beside = int(m.numbers.where[0]), m.beside
        beside.q[0] = q
        beside.q[1:] = m.way.q[segment + 1], m.way.q[segment]
        end, begin = beside.q[1:]
        along = end - begin
        key = beside.q[1:].tobytes()
        if key != self._room_key:
            self._room_key = key
            self._has_room = static.motion_free(begin, along, _ROOM)
        length2 = float(along @ along)
        share = float((q - begin) @ along) / length2 if length2 > 0.0 else 0.0
        off = np.abs(q - begin - min(max(share, 0.0), 1.0) * along)
        if self._has_room and off @ m.proof.motion <= _ROOM:
            beside.free[:] = 1
        else:
            beside.free[:] = static.motions_free(np.stack([q, q]), beside.q[1:] - q)

    def _attach_direct(self, known: np.ndarray | None = None) -> None:
        """Sweep the straight motions from the attached start to the goals.

        known: (g,) references that were swept from this very start before, below NO_WAY
        where there is none; None: there are none.
        """
        m, planner = self.planner.memory, self.planner
        g = int(m.goals.count[0])
        m.goals.fresh_ref[:g] = kinds.NO_WAY
        m.goals.direct_stuck[:g] = -1.0
        # a robot that has moved on does not begin where the start was attached
        if g == 0 or not np.array_equal(self.q_fresh, planner._q):
            self._direct_from[:] = np.nan
            return
        self._direct_from[:] = self.q_fresh
        new = np.arange(g)
        if known is not None:
            m.goals.fresh_ref[:g] = np.maximum(known, kinds.NO_WAY)
            new = np.flatnonzero(known < kinds.NO_WAY)
        if not len(new):
            return
        dq = planner._difference(self.q_fresh, m.goals.q[new])
        q = np.repeat(self.q_fresh[None], len(new), axis=0)
        free = planner.static.motions_free(q, dq)
        if self.quick:
            m.goals.fresh_ref[new[free]] = kinds.NO_ITEM
            return
        first = self.sweep(q[free], dq[free])
        if first >= 0:
            m.goals.fresh_ref[new[free]] = first + np.arange(int(np.sum(free)))

    def _is_direct_known(self) -> bool:
        return bool(np.array_equal(self._direct_from, self.q_fresh))

    # --- inside ----------------------------------------------------------------

    def _measure(self, q: np.ndarray) -> None:
        roadmap = self.roadmap
        kernels.distances(
            roadmap.nodes, q, roadmap.weights, self.planner.robot.continuous, self.near
        )

    def _candidates(self, wanted: int) -> np.ndarray:
        """Return nodes to join q with, in turn the nearest and those on the way.

        On the way are those with the least cost from q through the node to where the
        motion leads: short paths leave through them. Ties go by number.
        """
        k = min(_LOOKED_AT * wanted, self.roadmap.n_nodes)
        near = self._least(self.near, k)
        if self.beyond is None:
            return near
        by_way = self._least(self.near + self.beyond, k)
        return np.array(
            list(dict.fromkeys(np.stack([near, by_way], 1).ravel().tolist()))
        )

    def _least(self, cost: np.ndarray, k: int) -> np.ndarray:
        few = np.argpartition(cost, k - 1)[:k]
        return few[np.lexsort((few, cost[few]))]

    def _look_beyond(self, towards_goals: bool) -> None:
        """Set what lies beyond a node: the goals, or the robot's configuration."""
        m = self.planner.memory
        self.beyond = None
        if towards_goals and m.goals.count[0]:
            self.beyond = m.own.h_any
        elif not towards_goals and np.isfinite(self.planner._q).all():
            self._measure(self.planner._q)
            self.beyond = self.near.copy()

    def _wanted(self) -> int:
        return min(self.planner.settings.attachments, MAX_ATTACHMENTS)

    def _wanted_here(self) -> int:
        return min(self.planner.settings.start_attachments, MAX_ATTACHMENTS)

    def _motions(
        self, q: np.ndarray, wanted: int, outward: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return (nodes, pool items) of certified motions to or from near nodes."""
        planner, ids = self.planner, self._candidates(wanted)
        kept: list[np.ndarray] = []
        n_kept = 0
        for k in range(0, len(ids), wanted):
            part = ids[k : k + wanted]
            begin, dq = self._between(q, part, outward)
            good = part[planner.static.motions_free(begin, dq)]
            kept.append(good)
            n_kept += len(good)
            if n_kept >= wanted:
                break
        nodes = np.concatenate(kept)[:wanted] if kept else ids[:0]
        begin, dq = self._between(q, nodes, outward)
        first = self.sweep(begin, dq)
        if first < 0:
            return nodes[:0], nodes[:0]
        return nodes, first + np.arange(len(nodes))

    def _quick_motions(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (nodes, no items) of certified motions to a few near nodes.

        Only what the frame leaves free is certified, the best first.
        """
        planner = self.planner
        ids = self._candidates(_QUICK)[: _LOOKED_AT * _QUICK]
        table, points = planner.memory.table, planner.points
        n = judge.clear_starts(table, points, q, ids, _QUICK, self._kept)
        good = []
        for node in self._kept[:n]:
            dq = planner._difference(q, self.roadmap.nodes[node])
            if planner.static.motion_free(q, dq):
                good.append(node)
            if len(good) == _PASSED:
                break
        nodes = np.array(good, np.int64)
        return nodes, np.full(len(nodes), kinds.NO_ITEM)

    def _between(
        self, q: np.ndarray, ids: np.ndarray, outward: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        nodes = self.roadmap.nodes[ids]
        here = np.repeat(q[None], len(ids), axis=0)
        a, b = (here, nodes) if outward else (nodes, here)
        return a, self.planner._difference(a, b)

    def sweep(self, q: np.ndarray, dq: np.ndarray) -> int:
        """Add motions to the pool; return the first item, or -1 where that fails."""
        m = self.planner.memory
        return kernels.sweep_into_pool(
            self.swept,
            np.ascontiguousarray(q),
            np.ascontiguousarray(dq),
            m.graph.region,
            m.pool,
            self.room,
        )

    def nearest(self, q: np.ndarray, count: int) -> np.ndarray:
        """Return the nodes nearest to q, at most `count`, nearest first."""
        self._measure(q)
        return self._least(self.near, min(count, self.roadmap.n_nodes))

    def new_vertex(self) -> int:
        """Return a number that no vertex had before."""
        self.next_vertex += 1
        return self.next_vertex

    def tidy(self) -> None:
        """Throw old items away before the pool or the shortcuts run full."""
        m = self.planner.memory
        items, entries = m.pool.used
        full = 2 * items > len(m.pool.begin) or 2 * entries > len(m.pool.block)
        if not full and 4 * m.short.count[0] < len(m.short.key):
            return
        self.forget_shortcuts()
        refs = [m.way.ref[: max(0, int(m.way.count[0]) - 1)]]
        refs.append(m.fresh.ref[: m.fresh.count[0]])
        g = int(m.goals.count[0])
        refs.append(m.goals.fresh_ref[:g])
        refs.extend(m.goals.ref[k, : m.goals.number[k]] for k in range(g))
        refs.extend(self.kept.refs())
        self._compact(refs)

    def _compact(self, refs: list[np.ndarray]) -> None:
        """Keep only the items named in `refs`, and renumber them there."""
        pool = self.planner.memory.pool
        used = np.unique(np.concatenate(refs))
        used = used[used >= 0]
        end = 0
        for new, item in enumerate(used):
            a, b = pool.begin[item], pool.end[item]
            size = b - a
            pool.block[end : end + size] = pool.block[a:b].copy()
            pool.mask[end : end + size] = pool.mask[a:b].copy()
            pool.sign[4 * new : 4 * new + 4] = pool.sign[4 * item : 4 * item + 4]
            pool.begin[new], pool.end[new] = end, end + size
            end += size
        pool.used[:] = len(used), end
        for ref in refs:
            own = ref >= 0
            ref[own] = np.searchsorted(used, ref[own])

    def forget_shortcuts(self) -> None:
        """Forget the shortcuts that were found: their items are another hand's."""
        short = self.planner.memory.short
        short.key[:] = -1
        short.count[0] = 0
