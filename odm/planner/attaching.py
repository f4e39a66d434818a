"""Connects configurations to the roadmap: goals when set, starts when first seen."""

from collections.abc import Callable, Iterable

import numpy as np

from odm.cell_map._sweep import sweep_scratch
from odm.cell_map.cell_map import ROUNDING
from odm.cell_map.sweep import swept_by
from odm.close_test.static import ONLINE_TOLERANCE
from odm.frame.frame import Frame
from odm.planner.cached_goals import CachedGoals
from odm.planner.path import CandidatePath, Candidates, PathInUse
from odm.planner.saved_memory import Remembering
from odm.planner.settings import AttachSettings, PlannerSettings
from odm.search import _attach as kernels
from odm.search import _cost_to_go as cost_to_go
from odm.search import _judge as judge
from odm.search import _state as kinds
from odm.search._items import FREE, MAYBE
from odm.search.state import point_motion_bounds

_FAR = 1e6  # [rad or m] stands for a cost to go that is infinite
_NONE = np.zeros(0, np.int64)
CELLS, COSTS = 1, 2  # of `Attacher.owes`


class Attacher(Remembering):
    """The goals, and the motions that join goals and starts to the roadmap.

    Motions are items of the pool: lists of cells, which each frame tests anew. They are
    known by the exact configuration that they were made for.

    Args:
        frame: Scenery, hand and memory.
        path: The path in use; its items are kept.
        candidate: What betters that path; its items are kept, too.
        candidates: Their items are thrown away when the pool runs full.
        wanted: By how many motions goals and starts are joined, and how many goals stay
            attached.

    Attributes:
        goals: (g, dof) best first [rad or m].
        costs: (g,) of the goals, or None.
        without_cells: Whether the start was attached by a few motions without cells.
        is_stale: Whether the hand has changed, so that goals must be attached anew.
        start_waits: Whether the start lacks motions yet; see `attach_more`.
        is_bare: Whether the start's motions lack their cells yet; see `sweep_cells`.
        owes: What goals' motions that a frame joined lack: COSTS, then CELLS; 0: none.
        owes_start: Whether motions that a frame joined the start by lack their cells.
    """

    REMEMBERED = (
        "goals", "next_vertex", "without_cells", "is_stale", "start_waits", "is_bare",
        "owes", "owes_start", "_passes", "_path_first", "_rounds", "_direct_from",
        "_refused",
    )  # fmt: skip

    def __init__(
        self,
        frame: Frame,
        path: PathInUse,
        candidate: CandidatePath,
        candidates: Candidates,
        wanted: PlannerSettings,
    ) -> None:
        self.settings = AttachSettings()
        self.frame, self.path = frame, path
        self.candidate, self.candidates = candidate, candidates
        self.roadmap = frame.cell_map.roadmap
        self._for_goals = wanted.goal_connections
        self._for_starts = wanted.start_connections
        self._wary_clearance = wanted.wary_clearance
        self._resize()
        # goals and the places beside them take turns
        tight = self.settings.kept_tight if wanted.tight_ends else 0
        self.kept = CachedGoals(frame.memory.goals, max(wanted.cached_goals, tight))
        self.near = np.zeros(self.roadmap.n_nodes)
        self._through = np.zeros(self.roadmap.n_nodes)
        # joint by joint, and landmark by landmark: several nodes are taken at a time
        self._joints = np.ascontiguousarray(self.roadmap.nodes.T)
        self._landmarks = np.ascontiguousarray(self.roadmap.landmarks.T)
        lengths = self.roadmap.lengths
        self._edge_lengths = (
            float(lengths.min(initial=1.0)),
            float(lengths.max(initial=1.0)),
        )
        self._to_robot = np.zeros(self.roadmap.n_nodes)
        self.q_attached = frame.memory.robot_state.q_attached
        self._attached_key = b""  # the same as bytes, which are compared faster
        self._chosen = np.zeros(self.settings.moving_nodes, np.int64)
        self._ends = -1, b"", False  # `ends_free`: of which frame and ends
        self.without_cells = self.is_stale = self._passes = False
        self._direct_from = np.full(frame.robot.dof, np.nan)  # where from
        self.beyond: np.ndarray | None = None
        self.next_vertex = self.roadmap.n_nodes + 1
        # nodes that the start or a goal may yet be joined with, by its vertex
        self._later: dict[int, np.ndarray] = {}
        self.start_waits = self.is_bare = self.owes_start = False
        self.owes = 0
        self._path_first = 0  # tests that the path has yet before the motions
        self._refused = _NONE  # nodes that the start cannot go to: what stands still
        self._rounds = 1  # times that the next `join_start` tries a few nodes
        self.goals = np.zeros((0, frame.robot.dof))
        self.costs: np.ndarray | None = None

    def _resize(self) -> None:
        """Follow the arm, whose spheres are more while it carries something."""
        frame, arm = self.frame, self.frame.memory.arm
        safety = frame.cell_map.safety
        self.radii = arm.spheres[:, 3] + safety.rho + safety.m + ROUNDING
        tolerance = max(frame.cell_map.motion_tolerance, ONLINE_TOLERANCE)
        self.swept = swept_by(arm, self.radii, tolerance, frame.cell_map.grid)
        self.sweep_scratch = sweep_scratch(arm, self.swept.grid, frame.robot.dof)
        bounds = point_motion_bounds(arm, frame.robot.dof)
        frame.memory.certificates.motion_bound[:] = bounds
        frame.memory.candidate_certificates.motion_bound[:] = bounds

    def hand_changed(self) -> None:
        """Throw all motions away; the goals are attached anew before they are used."""
        self._resize()
        goals = self.frame.memory.goals
        goals.at[: len(self.goals)] = -1
        goals.count[0] = 0
        self._forget_items()
        self.is_stale, self.owes = True, 0

    # --- goals -----------------------------------------------------------------

    def set_goals(
        self, goals: np.ndarray, costs: np.ndarray | None, at_once: int | None = None
    ) -> None:
        """Attach goals; the path in use stays where its goal does.

        Each new one is joined by up to `at_once` motions, the others follow.
        """
        if self.is_stale:  # what is known of the goals was known of another hand
            self.goals, self.is_stale = self.goals[:0], False
        m, path = self.frame.memory, self.path
        self._pay_all()
        self.tidy()
        on_path = len(path) > 0 and path.goal >= 0
        vertex = int(m.goals.vertex[path.goal]) if on_path else -1
        old = {q.tobytes(): g for g, q in enumerate(self.goals)}
        # copying all would take half a millisecond
        kept_rows = len(self.goals) if any(q.tobytes() in old for q in goals) else 0
        before = [np.copy(a[:kept_rows]) for a in m.goals]
        m.goals.at[: int(m.goals.count[0])] = -1
        direct = np.full(len(goals), kinds.NO_MOTION - 1)  # not known from this start
        for g, q in enumerate(goals):
            m.goals.q[g] = q
            known = old.get(q.tobytes())
            if known is None:
                if not self.kept.restore(m.goals, g):
                    self._attach_goal(g, q, at_once)
                    self.kept.keep(m.goals, g)
            else:
                self._take_over(g, known, before)
                if np.array_equal(self._direct_from, self.q_attached):
                    direct[g] = before[m.goals._fields.index("attached_ref")][known]
            m.goals.cost[g] = 0.0 if costs is None else costs[g]
            m.goals.direct_blocked_at[g] = -1.0
        n = len(goals)
        m.goals.count[0] = n
        m.numbers.joint_costs[0] = 0 if costs is None else 1
        self._set_cost_to_any(n)
        path.goals_changed(vertex, m.goals.vertex[:n])
        used = {*self._vertices(), *self.kept.vertices()}
        self._later = {v: nodes for v, nodes in self._later.items() if v in used}
        self._attach_direct(direct)
        self.goals, self.costs = goals, costs

    def prepare(self, q: np.ndarray) -> bool:
        """Attach a goal that will be set later; False where it cannot be cached."""
        goals = self.frame.memory.goals
        row = int(goals.count[0])
        if not self.kept.most or row == len(goals.q):
            return False
        if q not in self.kept:
            self.tidy()
            goals.q[row] = q
            self._attach_goal(row, q)
            while self._more_of_goal(row, self._for_goals):
                pass
            self.kept.keep(goals, row)
            goals.at[row] = -1
        return True

    def _take_over(self, g: int, known: int, before: list[np.ndarray]) -> None:
        """Keep what is known of a goal that was there already, at rank `known`."""
        goals = self.frame.memory.goals
        kept = ("h", "at", "node", "length", "ref", "blocked_at", "number", "vertex")
        for name in kept:
            index = goals._fields.index(name)
            goals[index][g] = before[index][known]

    def _attach_goal(self, g: int, q: np.ndarray, at_once: int | None = None) -> None:
        """Join a goal to the roadmap, by few motions at first."""
        goals = self.frame.memory.goals
        goals.at[g] = -1
        goals.blocked_at[g] = -1.0
        goals.vertex[g] = self.new_vertex()
        self.distances(q)
        nearest = int(np.argmin(self.near))
        if self.near[nearest] == 0.0:
            goals.number[g] = 1
            goals.node[g, 0], goals.length[g, 0] = nearest, 0.0
            goals.ref[g, 0] = kinds.IS_GOAL
            goals.at[g, nearest] = 0
            goals.h[g] = self.near
            kernels.raise_by_landmarks(self._landmarks, nearest, goals.h[g])
            return
        self._set_beyond(False)
        self._later[int(goals.vertex[g])] = self._candidates(
            self._for_goals, self._for_goals
        )
        goals.number[g] = 0
        at_once = at_once or self.settings.goal_at_once
        while not goals.number[g] and self._more_of_goal(g, at_once):
            pass

    def _more_of_goal(self, g: int, most: int, owed: bool = False) -> int:
        """Join goal g by up to `most` more motions; return how many were tried.

        `owed`: they are for this very frame, whose close test has freed them and whose
        search goes from the goal. It needs neither their cells nor lower costs to go,
        which take longest, and are left to `pay`.
        """
        m = self.frame.memory
        goals, q = m.goals, m.goals.q[g]
        k = int(goals.number[g])
        wanted = self._for_goals - k
        tried, ids, begin, dq = self._next(q, goals.vertex[g], wanted, most, False)
        refs = np.full(len(ids), kinds.NO_ITEM)
        if not owed:
            ids, refs = self._with_cells(ids, begin, dq)
        if not k and tried:
            goals.h[g] = np.inf
        if not len(ids):
            return tried
        n = k + len(ids)
        goals.number[g] = n
        goals.node[g, k:n], goals.ref[g, k:n] = ids, refs
        self._lengths(ids, q, goals.length[g, k:n])
        goals.memo[g, k:n], goals.blocked_at[g, k:n] = 0, -1.0
        goals.at[g, ids] = np.arange(k, n)
        if owed:
            goals.memo[g, k:n] = 4 * m.numbers.frame.item() + MAYBE
            self.owes = COSTS
        else:
            self._lower_costs(g, k)
        return tried

    def _lower_costs(self, g: int, first: int) -> None:
        """Lower the costs to go by the motions into goal g from number `first` on."""
        m = self.frame.memory
        new = slice(first, m.goals.number.item(g))
        cost_to_go.lower_costs(
            m.graph, m.goals.node[g, new], m.goals.length[g, new], m.search,
            m.goals.h[g], *self._edge_lengths,
        )  # fmt: skip

    def pay(self) -> None:
        """Do what is owed next for the motions that a frame joined.

        Those into goals lower the costs to go, then a motion of the start gets its
        cells, last the goals' get theirs: one of these in a frame.
        """
        if self.owes_start and self.owes != COSTS:
            self.sweep_cells(1)
            self.owes_start = self.is_bare
            return
        goals, owed, self.owes = self.frame.memory.goals, self.owes, self.owes - 1
        for g in range(len(self.goals)):
            bare = np.flatnonzero(goals.ref[g, : goals.number[g]] == kinds.NO_ITEM)
            if len(bare) and owed == COSTS:
                self._lower_costs(g, int(bare[0]))
            elif len(bare):
                self._sweep_into(g, int(bare[0]))
            if len(bare):
                self.kept.keep(goals, g)
        if owed == COSTS:
            self._set_cost_to_any(len(self.goals))

    def _pay_all(self) -> None:
        while self.owes or self.owes_start:
            self.pay()

    def _sweep_into(self, g: int, first: int) -> None:
        """Sweep the cells of the motions into goal g from number `first` on."""
        self.tidy()
        goals = self.frame.memory.goals
        nodes = goals.node[g, first : goals.number[g]].copy()
        goals.at[g, nodes] = -1
        begin, dq = self._between(goals.q[g], nodes, outward=False)
        nodes, refs = self._with_cells(nodes, begin, dq)
        n = first + len(nodes)
        goals.number[g], goals.ref[g, first:n] = n, refs
        goals.at[g, nodes] = np.arange(first, n)
        for node, ref in zip(nodes.tolist(), refs.tolist(), strict=True):
            self.path.take_cells(node, goals.vertex[g], ref)

    def _more_of_start(self, most: int) -> int:
        """Join the start by up to `most` more motions, as a goal."""
        m = self.frame.memory
        starts, vertex = m.start_connections, m.goals.count[1]
        k, q = int(starts.count[0]), self.q_attached
        wanted = self._for_starts - k
        tried, ids, begin, dq = self._next(q, vertex, wanted, most, True)
        if self.is_bare:
            refs = np.full(len(ids), kinds.NO_ITEM)
        else:
            ids, refs = self._with_cells(ids, begin, dq)
        self._add_starts(q, ids, refs)
        return tried

    def sweep_cells(self, most: int) -> int:
        """Sweep the cells of up to `most` motions of a bare start; return how many.

        A search tells by them which motions the frame leaves free, before it asks the
        close test.
        """
        if not self.is_bare or not most:
            return 0
        self.tidy()
        m, q = self.frame.memory, self.q_attached
        starts, goals = m.start_connections, m.goals
        k, g, begin = int(starts.count[0]), int(goals.count[0]), int(goals.count[1])
        nodes, direct = starts.node[:k], goals.vertex[:g]
        refs = np.concatenate([starts.ref[:k], goals.attached_ref[:g]])
        ends = np.concatenate([self.roadmap.nodes[nodes], goals.q[:g]])
        bare = np.flatnonzero(refs == kinds.NO_ITEM)
        now = bare[:most]
        here = np.repeat(q[None], len(now), axis=0)
        first = self.sweep(here, self.frame.difference(here, ends[now]))
        self.is_bare = first >= 0 and (len(bare) > len(now) or not k)
        if first >= 0:
            refs[now] = first + np.arange(len(now))
            starts.ref[:k], goals.attached_ref[:g] = refs[:k], refs[k:]
            vertices = np.concatenate([nodes, direct])
            for i in now.tolist():
                self.path.take_cells(begin, vertices[i], refs[i])
        return len(now)

    def _add_starts(self, q: np.ndarray, ids: np.ndarray, refs: np.ndarray) -> None:
        """Let the start have these motions, too."""
        starts = self.frame.memory.start_connections
        k = int(starts.count[0])
        n = k + len(ids)
        starts.count[0] = n
        starts.node[k:n], starts.ref[k:n] = ids, refs
        self._lengths(ids, q, starts.length[k:n])
        starts.static[k:n] = 1
        starts.memo[k:n], starts.blocked_at[k:n] = 0, -1.0

    @property
    def waits(self) -> bool:
        """Whether start or goals may yet have more motions, or the start's cells."""
        return self.is_bare or self.owes > 0 or self.lacks_nodes

    @property
    def lacks_nodes(self) -> bool:
        """Whether the start or a goal may yet have more motions; see `attach_more`."""
        waiting = self._later.keys()
        return self.start_waits or not waiting.isdisjoint(self._vertices())

    def _vertices(self) -> list[int]:
        """Return the vertices of the start and of the goals that are set."""
        goals = self.frame.memory.goals
        return [goals.count.item(1), *goals.vertex[: goals.count.item(0)].tolist()]

    def after_path(self, budget: int) -> int:
        """Return how much of a budget of tests is left for motions beside the path.

        The path from a new start gets the first `path_first` tests alone: each motion
        that gets its cells takes as long as several tests of it.
        """
        alone = min(budget, self._path_first)
        self._path_first -= alone
        return (budget - alone) // 2

    def join_more(self, most: int) -> int:
        """Sweep the cells of a bare start, then join by more motions; return how many.

        At most `most` motions in all. What is owed comes first, and counts for one.
        """
        if not most:
            return 0
        done = int(self.owes > 0)
        self._pay_all()
        done += self.sweep_cells(most - done)
        return done + (self.attach_more(most - done) if most > done else 0)

    def attach_more(self, most: int) -> int:
        """Join start and goals by more motions, `most` in all; return the nodes tried.

        A goal that is set, and a start that is new, have only a few at once; the best
        goals come first.
        """
        self._pay_all()
        self.tidy()
        m, left = self.frame.memory, most
        n = int(m.goals.count[0])
        if self.start_waits and left > 0:
            done = self._more_of_start(left)
            self.start_waits = done == left
            left -= done
        for g in range(n):
            if left > 0 and int(m.goals.vertex[g]) in self._later:
                left -= self._more_of_goal(g, left)
                self.kept.keep(m.goals, g)
        self._set_cost_to_any(len(self.goals))
        return most - left

    def attach_free(self, most: int) -> int:
        """Join start and goals by up to `most` motions that the frame leaves free.

        Nodes that wait count if they may lead on, by what this frame's search knows; a
        few of them are looked at by the close test, which costs a hundredth of what
        joining does. The goals have their turn one after the other. Returns how many
        nodes were tried.
        """
        self.tidy()
        m, left = self.frame.memory, most
        n, number = int(m.goals.count[0]), self.frame.number
        if self.start_waits:
            vertex, looks = m.goals.count.item(1), self.settings.waiting_tests
            free, _ = self._free_first(vertex, self.q_attached, looks)
            if free:
                done = self._free_start(min(free, left))
                self.start_waits, left = done > 0, left - done
        looks = self.settings.waiting_tests
        for g in range(number, number + n):
            g %= n
            if not left or not looks:
                break
            vertex = int(m.goals.vertex[g])
            free, looked = self._free_first(vertex, m.goals.q[g], looks)
            looks -= looked
            if free:
                had, owed = m.goals.number.item(g), self._is_shut(g)
                left -= self._more_of_goal(g, min(free, left), owed)
                if m.goals.number.item(g) > had and not owed:
                    self.kept.keep(m.goals, g)
                    self._set_cost_to_any(n)
        return most - left

    def _free_start(self, most: int) -> int:
        """Join the start by up to `most` motions that this frame has found free.

        Beside points, where `improve` does not sweep cells first, they are used so now,
        and get their cells in the next frame. Returns how many nodes were tried.
        """
        m, starts = self.frame.memory, self.frame.memory.start_connections
        had = starts.count.item(0)
        if self._asks_close_test and self.frame.n_given > 0 and not self.is_bare:
            self.is_bare = self.owes_start = True
        done = self._more_of_start(most)
        if self.is_bare:
            now = slice(had, starts.count.item(0))
            starts.memo[now] = 4 * m.numbers.frame.item() + FREE
        return done

    def _is_shut(self, g: int) -> bool:
        """Whether no motion into goal g is free in this frame.

        Then the search goes from the goal: see `search_to`.
        """
        m = self.frame.memory
        n, now = m.goals.number.item(g), m.numbers.frame.item()
        free = (m.goals.memo[g, :n] == 4 * now + FREE).any()
        asked = self._asks_close_test and not m.numbers.joint_costs[0]
        return bool(n > 0 and asked and not free)

    @property
    def n_motions(self) -> int:
        """How many motions join the start, and the goals that are set, to nodes."""
        m = self.frame.memory
        of_goals = m.goals.number[: m.goals.count.item(0)]
        return m.start_connections.count.item(0) + sum(of_goals.tolist())

    def _free_first(self, vertex: int, q: np.ndarray, looks: int) -> tuple[int, int]:
        """Let the waiting nodes of a vertex begin with those reachable in this frame.

        Returns how many these are, and how many of at most `looks` were looked at.
        """
        waiting = self._later.get(vertex, _NONE)
        if not len(waiting):
            return 0, 0
        table = self.frame.memory.table
        ordered, scratch = np.empty((2, len(waiting)), np.int64)
        said = kernels.free_first(table, q, waiting, vertex, looks, ordered, scratch)
        self._later[vertex] = ordered
        return said & kernels.FREE_NODES, said >> kernels.LOOKED_AT

    @property
    def ends_free(self) -> bool:
        """Whether the robot can stand where it is, and at one of the goals.

        Else no search helps. Looked at once a frame.
        """
        m = self.frame.memory
        goals = m.goals.vertex[: m.goals.count.item(0)]
        asked = goals.tobytes() + self.frame.q.tobytes()
        number, known, free = self._ends
        if number != self.frame.number or known != asked:
            free = bool(judge.ends_free(m.table))
            self._ends = self.frame.number, asked, free
        return free

    def _set_cost_to_any(self, n: int) -> None:
        """Let h_any be the least cost to go to one of the first `n` goals."""
        goals, least = self.frame.memory.goals, self.frame.memory.robot_state.h_any
        if not n:
            least.fill(np.inf)
            return
        np.add(goals.h[0], goals.cost[0], out=least)
        for h, cost in zip(goals.h[1:n], goals.cost[1:n], strict=True):
            np.minimum(least, h + cost if cost else h, out=least)

    # --- starts ----------------------------------------------------------------

    def is_attached(self, q: np.ndarray) -> bool:
        """Return True if q is the configuration that was attached last, in full."""
        return not self.without_cells and self.is_at(q)

    def is_at(self, q: np.ndarray) -> bool:
        """Return True if q is the configuration that was attached last."""
        return q.tobytes() == self._attached_key

    def forget_start(self) -> None:
        """Drop the attached start."""
        self.q_attached[:] = np.nan
        self._attached_key, self.start_waits, self.is_bare = b"", False, False
        self.owes_start = False
        self._refused = _NONE
        self._path_first = 0
        self._later.pop(int(self.frame.memory.goals.count[1]), None)
        self.frame.memory.start_connections.count[0] = 0
        self.path.forget_off_path()

    def forget_all(self) -> None:
        """Attach everything again: the scenery, or the hand, has changed."""
        self.path.drop()
        self.forget_start()
        self._forget_items()
        goals, costs, self.is_stale = self.goals, self.costs, False
        self.goals = goals[:0]
        if len(goals):
            self.set_goals(goals, costs)

    @property
    def lacks_motions(self) -> bool:
        """Whether some goal has fewer motions to the roadmap than are wanted."""
        goals, n = self.frame.memory.goals, len(self.goals)
        full = (goals.number[:n] >= self._for_goals) | (
            goals.ref[:n, 0] == kinds.IS_GOAL
        )
        return self.is_stale or not bool(full.all())

    def keep_clear(self, clear: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> None:
        """Let go of the motions that something new in the scenery blocks.

        What is left of each goal's motions stays as it is: the cost to go by all of
        them is a lower bound of that by some.

        Args:
            clear: Tells which motions (k, dof), from q by dq, keep clear of it.
        """
        self._pay_all()
        path, goals = self.path, self.frame.memory.goals
        path.forget_behind()  # the robot may go back to where nobody looked
        certified = self.frame.memory.certificates
        ahead = slice(max(0, len(path) - 1))
        begin, end = certified.begin[ahead], certified.end[ahead]
        if len(begin) and not clear(begin, end - begin).all():
            path.drop()
        path.withdraw()
        self.forget_start()
        self.kept.clear()
        self.candidates.forget_all()
        if self.is_stale:
            return
        for g in range(int(goals.count[0])):
            k = int(goals.number[g])
            nodes = goals.node[g, :k].copy()
            begin, dq = self._between(goals.q[g], nodes, outward=False)
            good = clear(begin, dq)
            goals.at[g, nodes] = -1
            left = int(good.sum())
            for name in ("node", "length", "ref"):
                rows = getattr(goals, name)[g]
                rows[:left] = rows[:k][good]
            goals.number[g] = left
            goals.at[g, goals.node[g, :left]] = np.arange(left)
            goals.blocked_at[g] = -1.0

    def _forget_items(self) -> None:
        self.frame.memory.pool.used[:] = 0
        self.frame.memory.found.count[:] = 0
        self.kept.clear()
        self._later.clear()
        self.candidates.forget_cuts()

    def attach_start(
        self, q: np.ndarray, without_cells: bool = False, passes: bool = False
    ) -> None:
        """Attach a configuration never seen before.

        `without_cells`: the cells of its motions are not swept; the close test decides
        about a few of them. Cheaper for a robot that moves, which uses them once.
        `passes`: the robot will not be there any more in the next frame.
        Beside shapes alone the cells of the other motions, too, are left for later:
        there the close test costs little. Where the straight motion to the best goal is
        free now and no path has to avoid the history, no others are needed yet:
        `join_start` makes them, or `attach_more`.
        """
        self.tidy()
        m = self.frame.memory
        self.is_bare = self.can_wait_for_cells and not without_cells
        self.without_cells, self.start_waits = without_cells, not without_cells
        self.owes_start = False
        self._passes = passes
        self._path_first = self.settings.path_first
        if not self.is_at(q):
            self._refused = _NONE
        self.q_attached[:] = q
        self._attached_key = self.q_attached.tobytes()
        self._later.pop(int(m.goals.count[1]), None)
        m.goals.count[1] = self.new_vertex()
        m.goals.count[2] = m.goals.count[1] + 1
        self.new_vertex()
        self._set_beyond(True)
        m.robot_state.from_attached[:] = self.distances(q)
        m.start_connections.count[0] = 0
        self._attach_direct()
        if without_cells:
            self._add_starts(q, *self._motions_without_cells(q))
            return
        nodes = self._candidates(self._for_starts, self._for_starts)
        if len(self._refused):
            nodes = nodes[~np.isin(nodes, self._refused)]
        self._later[int(m.goals.count[1])] = nodes
        self._rounds = self.settings.start_rounds
        if not self._goes_straight():
            self.join_start(at_once=True)

    @property
    def can_wait_for_cells(self) -> bool:
        """Whether the frame has shapes alone, whose close test costs little."""
        return self._asks_close_test and self.frame.n_given == 0

    @property
    def _asks_close_test(self) -> bool:
        """Whether searches ask the close test of motions; else cells alone decide."""
        return self.frame.memory.rules.close_test_connections.item() > 0

    def join_start(self, at_once: bool = False) -> bool:
        """Join the start by its first motions, if it has none; True: now it has.

        Where all the nodes that are tried are refused, others wait for the next call.
        The cells of these motions wait for `sweep_cells`, beside points, too, unless
        the start is new (`at_once`): they take longer than all else of a frame.
        """
        starts = self.frame.memory.start_connections
        if not self.lacks_start:
            return False
        if not at_once and self._asks_close_test:
            self.is_bare = True
        rounds, self._rounds = self._rounds, 1
        for _ in range(rounds):
            self.start_waits = self._more_of_start(self.settings.start_at_once) > 0
            if not self.lacks_start:
                break
        return starts.count[0] > 0

    @property
    def lacks_start(self) -> bool:
        """Whether the start has no motion yet, though nodes wait; see `join_start`."""
        return self.start_waits and not self.frame.memory.start_connections.count[0]

    def _goes_straight(self) -> bool:
        """Return whether the path to the best goal is the straight motion, surely."""
        m = self.frame.memory
        goals, rules = m.goals, m.rules
        if m.numbers.joint_costs[0] or not goals.count[0]:
            return False
        if not rules.always[0] and rules.history_s[0] > 0.0:
            return False
        if goals.attached_ref[0] == kinds.NO_MOTION:
            return False
        return self._is_clear(goals.q[0])

    def _is_clear(self, goal: np.ndarray) -> bool:
        """Return whether the frame leaves the motion from the start to a goal free."""
        frame, q = self.frame, self.q_attached
        dq = frame.difference(q, goal)
        return judge.close_free(frame.memory.table, q, dq)

    def _attach_direct(self, known: np.ndarray | None = None) -> None:
        """Sweep the straight motions from the attached start to the goals.

        Where the start has no cells yet, only motions that this frame leaves free.
        `known` (g,) are references that were swept from this very start before, below
        NO_MOTION where there is none; None: there are none.
        """
        m, frame = self.frame.memory, self.frame
        g = int(m.goals.count[0])
        m.goals.attached_ref[:g] = kinds.NO_MOTION
        m.goals.direct_blocked_at[:g] = -1.0
        # a robot that has moved on does not begin where the start was attached
        if g == 0 or not np.array_equal(self.q_attached, frame.q):
            self._direct_from[:] = np.nan
            return
        self._direct_from[:] = self.q_attached
        new = np.arange(g)
        if known is not None:
            m.goals.attached_ref[:g] = np.maximum(known, kinds.NO_MOTION)
            new = np.flatnonzero(known < kinds.NO_MOTION)
        if not len(new):
            return
        if self.without_cells and self._passes:
            self._attach_some_direct(new)
            return
        dq = frame.difference(self.q_attached, m.goals.q[new])
        q = np.repeat(self.q_attached[None], len(new), axis=0)
        free = frame.static.motions_free(q, dq)
        if self.without_cells:
            m.goals.attached_ref[new[free]] = kinds.NO_ITEM
            return
        if self.is_bare:
            m.goals.attached_ref[new[free]] = kinds.NO_ITEM
            free &= [self._is_clear(q_goal) for q_goal in m.goals.q[new]]
        first = self.sweep(q[free], dq[free]) if free.any() else -1
        if first >= 0:
            m.goals.attached_ref[new[free]] = first + np.arange(int(np.sum(free)))

    def _attach_some_direct(self, new: np.ndarray) -> None:
        """Join the start to goals straight, for a robot that uses it now only.

        So only motions that are free in this frame, to goals that no free one outranks.
        """
        m, frame, q = self.frame.memory, self.frame, self.q_attached
        ranks = not m.numbers.joint_costs[0]
        for g in new.tolist():
            if not self._is_clear(m.goals.q[g]):
                continue
            if frame.static.motion_free(q, frame.difference(q, m.goals.q[g])):
                m.goals.attached_ref[g] = kinds.NO_ITEM
                if ranks:
                    break

    # --- inside ----------------------------------------------------------------

    def distances(self, q: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Return how far q is from each node, weighted; the next call overwrites it.

        With `out` (n,) they are written there alone.
        """
        roadmap, out = self.roadmap, self.near if out is None else out
        continuous = self.frame.robot.continuous
        kernels.distances(self._joints, q, roadmap.weights, continuous, out)
        return out

    def _lengths(self, ids: np.ndarray, q: np.ndarray, out: np.ndarray) -> None:
        """Write how far q is from the nodes `ids` (k,), weighted, to `out` (k,)."""
        roadmap, continuous = self.roadmap, self.frame.robot.continuous
        kernels.lengths_to(roadmap.nodes, ids, q, roadmap.weights, continuous, out)

    def _candidates(self, wanted: int, first: int = 0) -> np.ndarray:
        """Return nodes to connect q with, the nearest first, ties by number.

        The next `first` are those with the least cost from q through the node to
        where the path leads, the motion to the node itself counted `nearer` times:
        short paths leave through them. Then in turn the nearest and such.
        """
        k = min(self.settings.looked_at * wanted, self.roadmap.n_nodes)
        near = self._least(self.near, k)
        if self.beyond is None:
            return near
        nearer = self.settings.nearer
        kernels.cost_through(self.near, self.beyond, nearer, _FAR, self._through)
        ahead = self._least(self._through, k)
        turns = np.stack([near, ahead], 1).ravel()
        both = np.concatenate([near[:1], ahead[:first], turns])
        return np.array(list(dict.fromkeys(both.tolist())))

    def _least(self, cost: np.ndarray, k: int) -> np.ndarray:
        few = np.empty(k, np.int64)
        kernels.least(cost, few)
        return few

    def _set_beyond(self, towards_goals: bool) -> None:
        """Set the cost beyond each node: to the goals, or to the robot's place.

        The distances of the nodes that were reckoned last stay.
        """
        m = self.frame.memory
        self.beyond = None
        if towards_goals and m.goals.count[0]:
            self.beyond = m.robot_state.h_any
        elif not towards_goals and np.isfinite(self.frame.q).all():
            self.beyond = self._to_robot
            self.distances(self.frame.q, self.beyond)

    def _next(
        self, q: np.ndarray, vertex: int, wanted: int, most: int, outward: bool
    ) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
        """Certify motions between q and the next near nodes that wait.

        `vertex` is that of q, `wanted` how many motions it may have yet, `most` how
        many nodes are tried now. `outward`: from q to the nodes; else the other way.

        Returns:
            How many were tried, the nodes (k,) and the motions' begins and
            displacements (k, dof) of those that are free of all that stands still.
        """
        waiting = self._later.pop(int(vertex), _NONE)
        part, rest = waiting[:most], waiting[most:]
        begin, dq = self._between(q, part, outward)
        if len(part):
            free = self._first_free(begin, dq, wanted)
            nodes, begin, dq = part[free], begin[free], dq[free]
            if len(rest) and len(nodes) < wanted:
                self._later[int(vertex)] = rest
            return len(part), nodes, begin, dq
        return 0, part, begin, dq

    def _first_free(self, begin: np.ndarray, dq: np.ndarray, wanted: int) -> np.ndarray:
        """Return (n,) which motions are the first `wanted` free of what stands still.

        No more are tested than that takes: each takes 0.1 to 0.2 ms.
        """
        free, at, missing = np.zeros(len(begin), np.bool_), 0, wanted
        while at < len(begin) and missing > 0:
            now = slice(at, at + missing)
            free[now] = self.frame.static.motions_free(begin[now], dq[now])
            at += missing
            missing = wanted - int(np.count_nonzero(free))
        return free

    def _with_cells(
        self, nodes: np.ndarray, begin: np.ndarray, dq: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Sweep motions; return (nodes, items), both empty where that fails."""
        first = self.sweep(begin, dq) if len(nodes) else -1
        if first < 0:
            return nodes[:0], nodes[:0]
        return nodes, first + np.arange(len(nodes))

    def _motions_without_cells(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (nodes, no items) of certified motions to a few near nodes.

        Only what the frame leaves free is certified, the best first. No cells tell a
        search which of these lead close past somebody, so where some keep
        `PlannerSettings.wary_clearance` more, there are no others.
        """
        frame, most = self.frame, self.settings.moving_nodes
        ids = self._candidates(most)[: self.settings.looked_at * most]
        table = frame.memory.table
        n = judge.clear_nodes(table, q, ids, most, self._chosen)
        more = 0.0 if frame.memory.rules.always[0] else self._wary_clearance
        close: list[int] = []

        def is_wide(node: int) -> bool:
            dq = frame.difference(q, self.roadmap.nodes[node])
            wide = not more or frame.motion_clear(q, dq, None, more)
            if not wide:
                close.append(node)
            return wide

        chosen = self._chosen[:n].tolist()
        nodes, refused = self._certified(q, filter(is_wide, chosen))
        if not nodes:
            nodes, others = self._certified(q, close)
            refused += others
        self._refused = np.array(refused, np.int64)
        return np.array(nodes, np.int64), np.full(len(nodes), kinds.NO_ITEM)

    def _certified(
        self, q: np.ndarray, nodes: Iterable[int]
    ) -> tuple[list[int], list[int]]:
        """Return the first nodes that q can go to, past what stands still.

        At most `moving_connections` of them, and those before them that are refused.
        """
        good, refused = [], []
        for node in nodes:
            dq = self.frame.difference(q, self.roadmap.nodes[node])
            free = self.frame.static.motion_free(q, dq)
            (good if free else refused).append(node)
            if len(good) == self.settings.moving_connections:
                break
        return good, refused

    def _between(
        self, q: np.ndarray, ids: np.ndarray, outward: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        nodes = self.roadmap.nodes[ids]
        here = np.repeat(q[None], len(ids), axis=0)
        a, b = (here, nodes) if outward else (nodes, here)
        return a, self.frame.difference(a, b)

    def sweep(self, q: np.ndarray, dq: np.ndarray) -> int:
        """Add motions to the pool; return the first item, or -1 where that fails."""
        m = self.frame.memory
        return kernels.sweep_into_pool(
            self.swept,
            np.ascontiguousarray(q),
            np.ascontiguousarray(dq),
            m.graph.region,
            m.pool,
            self.sweep_scratch,
        )

    def nearest(self, q: np.ndarray, count: int) -> np.ndarray:
        """Return the nodes nearest to q, at most `count`, nearest first."""
        self.distances(q)
        return self._least(self.near, min(count, self.roadmap.n_nodes))

    def new_vertex(self) -> int:
        """Return a number that no vertex had before."""
        self.next_vertex += 1
        return self.next_vertex

    def tidy(self) -> None:
        """Throw old items away before the pool or the table of cuts runs full."""
        m = self.frame.memory
        items, entries = m.pool.used
        full = 2 * items > len(m.pool.begin) or 2 * entries > len(m.pool.block)
        if not full and not self.candidates.is_filling:
            return
        self.candidates.forget_cuts()
        refs = [self.path.items(), self.candidate.items()]
        refs.append(m.start_connections.ref[: m.start_connections.count[0]])
        g = int(m.goals.count[0])
        refs.append(m.goals.attached_ref[:g])
        refs.extend(m.goals.ref[k, : m.goals.number[k]] for k in range(g))
        refs.extend(self.kept.refs())
        refs.extend(
            m.found.ref[k, : max(0, n - 1)] for k, n in enumerate(m.found.count)
        )
        self._compact(refs)

    def _compact(self, refs: list[np.ndarray]) -> None:
        """Keep only the items named in `refs`, and renumber them there."""
        pool = self.frame.memory.pool
        used = np.unique(np.concatenate(refs))
        used = used[used >= 0]
        end = 0
        for new, item in enumerate(used):
            a, b = pool.begin[item], pool.end[item]
            size = b - a
            pool.block[end : end + size] = pool.block[a:b].copy()
            pool.mask[end : end + size] = pool.mask[a:b].copy()
            pool.signature[4 * new : 4 * new + 4] = pool.signature[
                4 * item : 4 * item + 4
            ]
            pool.begin[new], pool.end[new] = end, end + size
            end += size
        pool.used[:] = len(used), end
        for ref in refs:
            used_items = ref >= 0
            ref[used_items] = np.searchsorted(used, ref[used_items])

    # --- memory ----------------------------------------------------------------

    def save(self) -> dict[str, np.ndarray]:
        """Return what is remembered of goals and start beside their arrays."""
        later = [np.r_[vertex, ids] for vertex, ids in self._later.items()]
        kept = {f"kept_{k}": array for k, array in self.kept.save().items()}
        return (
            super().save()
            | kept
            | {
                "later": np.concatenate([_NONE, *later]),
                "later_sizes": np.array([len(one) for one in later], np.int64),
                "costs": np.zeros(0) if self.costs is None else self.costs.copy(),
            }
        )

    def load(self, saved: dict[str, np.ndarray]) -> None:
        """Take up goals and a start whose arrays were loaded."""
        super().load(saved)
        self.costs = saved["costs"].copy() if len(saved["costs"]) else None
        rows = np.split(saved["later"], np.cumsum(saved["later_sizes"]))[:-1]
        self._later = {int(row[0]): row[1:].copy() for row in rows}
        known = not np.isnan(self.q_attached).any()
        if known:
            self.distances(self.q_attached, self.frame.memory.robot_state.from_attached)
        self._attached_key = self.q_attached.tobytes() if known else b""
        self.kept.load({k[5:]: a for k, a in saved.items() if k.startswith("kept_")})
