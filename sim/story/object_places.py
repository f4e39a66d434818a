"""The object's places: where it is fetched from, and where it is put down."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from handover.targets.allowance import Allowance
from handover.targets.node_index import NodeIndex
from handover.targets.put_down import BESET, UNREACHED, Places, carries
from odm.checks import AVOID
from roadmap.arrays import as_floats
from roadmap.errors import BadInput
from roadmap.geometry.gaps import ball_gaps, beads, moved_rods
from roadmap.transforms import check_pose
from sim.story.frame import Seen
from sim.story.grasping import Reach, Reaches
from sim.story.machine import Step
from sim.story.phase import PhasePlanner
from sim.story.robot_hand import CLOSED, OPEN, Hand
from sim.story.settings import AT_PLACE, HELD_AT_PLACE, ConductSettings


class Progress(NamedTuple):
    """How the state goes on."""

    now: float  # time [s]
    hindered_s: float  # of the state, slowed or stopped for the person [s]


class Placing:
    """Finds the steps that fetch the object from its place, or put it down in one.

    Args:
        view: The planner, by the rules of the phase.
        hand: The robot's.
        index: Nodes of the roadmap by pose of the tool.
        rest: (dof,) where the robot waits [rad or m].
        conduct: See `sim.story.settings`.
        allowance: What a frame may yet do.
        T_places: (n, 4, 4) the object in its own place, then in others [m].
        why_it_stands: Says why the robot does not move now.

    Attributes:
        places: What is known of each, since it is to be put down.
        placeless: Whether there is no place to put it down.
        why_kept: What kept it from the last place that was tried.
        grasps: (k, 4, 4) T_tool_object: first those by which it can be put down again,
        first: ... so many; None: none, or it need not be.
    """

    def __init__(
        self,
        view: PhasePlanner,
        hand: Hand,
        index: NodeIndex,
        rest: np.ndarray,
        conduct: ConductSettings,
        allowance: Allowance,
        T_places: np.ndarray,
        why_it_stands: Callable[[], str],
    ) -> None:
        self.view, self.hand, self.index, self.rest = view, hand, index, rest
        self.settings, self.conduct, self.allowance = hand.settings, conduct, allowance
        self.T_places, self._why_it_stands = T_places, why_it_stands
        self.places = Places(0)
        self.placeless, self.why_kept = False, ""
        self._used: tuple[Reaches, int] | None = None  # of which it uses one
        self._came = Progress(0.0, 0.0)  # when it set out for the place
        placeable = self._placeable()  # the others are taken where none reaches
        self.grasps = hand.grasps[np.argsort(~placeable, kind="stable")]
        self.first = int(placeable.sum()) or None

    def _placeable(self) -> np.ndarray:
        """Return with which grasps (k,) what is taken can be put down again.

        Where there is no place all of them count.
        """
        s, hand, found = self.settings, self.hand, []
        if s.direction == "give" or not len(self.T_places):
            return np.ones(len(hand.grasps), bool)
        beside = None, hand.obj.capsules, s.room, None, HELD_AT_PLACE
        still = np.zeros_like(self.rest)
        planner = self.view.planner
        for grasp in hand.grasps:
            held = planner.carrier.test_with(hand.carried, grasp)
            look = Reaches(planner, self.index, grasp[None], s.back, *beside)
            look.begin(self.T_places[0], self.rest)
            while not look.over:
                look.work()
            found.append(any(held.motion_free(r.q_before, still) for r in look.found))
        return np.array(found)

    def look_for_grasps(self) -> Reaches:
        """Return what looks for grasps in a place, with the grasp by which it is held.

        In a place that is not its own nothing may hold the object: robot and object
        come down to what it stands on, clear of all else.
        """
        hand = self.hand
        grasps = hand.T_tool_object[None] if hand.holding else self.grasps
        settings = HELD_AT_PLACE if hand.holding else AT_PLACE
        beside = hand.obj.capsules, self.settings.room
        args = self.view.planner, self.index, grasps, self.settings.back
        if not self.places.now:
            return Reaches(*args, None, *beside, None, settings)
        T = self.T_places[self.places.now]
        on = carries(self.view.planner.cell_map.scenery, hand.obj.capsules, T)
        return Reaches(*args, hand.carried, *beside, on, settings)

    def fetching(self, q: np.ndarray) -> list[Step]:
        """Return the steps that fetch the object, for a robot at q (dof,).

        Raises:
            BadInput: Its place is out of reach.
        """
        look = self.look_for_grasps()
        if not look.first(self.T_places[0], q):
            raise BadInput(
                "the object's place is out of the robot's reach; give another "
                "T_base_place, or another grasp T_tool_object"
            )
        self._used = look, 0
        return self._steps_by(look.found[0], fetches=True)

    def _steps_by(self, reach: Reach, fetches: bool) -> list[Step]:
        """Return the steps that fetch the object by a grasp, or put it down."""
        above, at = Step("goal", [reach.q_before]), Step("line", reach.q)
        up = Step("line", reach.q_before)
        if fetches:
            self.hand.T_tool_object = reach.T_tool_object
            return [above, at, Step("grip", CLOSED), Step("take"), up]
        return [above, at, Step("grip", OPEN), Step("let"), up]

    def putting_down(self, seen: Seen | None, progress: Progress) -> list[Step]:
        """Return the steps that lead to a place, once it is known how."""
        self.placeless, self._used, self.why_kept = False, None, ""
        n = len(self.T_places)
        self.places = Places(n)
        return self._to_next(seen, progress) if n else [Step("place")]

    def _to_next(self, seen: Seen | None, progress: Progress) -> list[Step]:
        """Return the steps to the next place to try; to rest, where all were tried."""
        gaps = self.gaps(seen)
        self.places.begin_next(gaps, self.view.planner.keep)
        self._came = progress
        if self.places.now is not None:
            self._used = self.look_for_grasps(), 0
            return [Step("place")]
        self._used = None
        self.placeless = self.places.unreached
        rest = Step("goal", [self.rest])
        return [rest] if self.placeless else [rest, Step("pause", gaps)]

    def gaps(self, seen: Seen | None) -> np.ndarray:
        """Return (n,) how far the person is from the object in each place [m]."""
        if seen is None or not seen.people:
            return np.full(len(self.T_places), np.inf)
        rods = [moved_rods(self.hand.obj.capsules, T) for T in self.T_places]
        return np.array([ball_gaps(beads(row, 5), seen.person).min() for row in rods])

    def leave(self, seen: Seen, why: str, progress: Progress) -> list[Step]:
        """Return the steps to another place: this one cannot be come to now."""
        self.places.leave(why)
        self.why_kept = self._why_it_stands() if why != UNREACHED else ""
        return self._to_next(seen, progress)

    def is_beset(self, progress: Progress) -> bool:
        """Whether the person has been in its way to the place for too long."""
        since = progress.now - self._came.now
        hindered = progress.hindered_s - self._came.hindered_s
        return since > self.settings.place_s and 2.0 * hindered > since

    def after_pause(
        self, seen: Seen, gaps: np.ndarray, waited: float, progress: Progress
    ) -> list[Step] | None:
        """Return the steps of another try; None: it waits on.

        Once the person has moved off a place, from `gaps` (n,) [m], or after a while
        that was `waited` [s].
        """
        moved_off = (self.gaps(seen) > gaps + self.conduct.moved_off).any()
        if not moved_off and waited <= self.settings.again_s:
            return None
        self.places.forget()
        return self._to_next(seen, progress)

    def find(self, seen: Seen, q: np.ndarray, progress: Progress) -> list[Step] | None:
        """Look for a way to a place of the object, one costly thing a frame.

        Returns:
            The steps that follow; None: it looks on.
        """
        grants, takes = self.allowance.grants, self.allowance.takes
        if self._used is None:  # it is kept
            self.placeless = True
            return [Step("goal", [self.rest])]
        look, k = self._used
        if look.at is None:
            if grants(takes.reach):
                look.begin(self.T_places[self.places.now], q)
        elif not look.found and not look.over:
            if grants(takes.reach):
                look.work()
        elif not look.found:
            return self.leave(seen, UNREACHED, progress)
        elif not look.is_ready(look.found[k].q_before):
            if grants(takes.prepare):
                self.view.planner.prepare_goal(look.found[k].q_before)
        else:
            return self._try(seen, progress)
        return None

    def _try(self, seen: Seen, progress: Progress) -> list[Step] | None:
        """Set off to a place if its way down is free now; one is looked at a frame.

        The own place is waited for a little, the others are not.
        """
        look, k = self._used
        reach, self.view.at_place = look.found[k], True
        with self.view.receiving(np.full(len(seen.there), AVOID, np.int8)):
            free = self.view.line_free(reach.q_before, reach.q, seen.there)
        self.view.at_place = False
        waited = self.settings.blocked_s if self.places.now == 0 else 0.0
        if free:
            return self._steps_by(reach, fetches=False)
        if k + 1 < len(look.found):
            self._used = look, k + 1
        elif not look.over:
            if self.allowance.grants(self.allowance.takes.reach):
                look.work()
        elif look.pass_by():
            self._used = look, 0
        elif progress.now - self._came.now >= waited:
            return self.leave(seen, BESET, progress)
        else:
            self._used = look, 0
        return None

    def otherwise(self, at: int, fetches: bool) -> list[Step] | None:
        """Return the steps by another grasp or arm: this one is blocked.

        One start of the search a frame; after the last one found comes the first.

        Args:
            at: Which step is blocked.
            fetches: Whether it is to be fetched from there.

        Returns:
            The steps that follow, none where it looks on; None where all ways to put it
            down there have been tried.
        """
        if self._used is None or (not fetches and at > 0):
            return None
        look, k = self._used
        if k + 1 == len(look.found) and not look.over:
            if self.allowance.grants(self.allowance.takes.reach):
                look.work()
            return []
        if k + 1 == len(look.found) and not fetches:
            return None
        if len(look.found) == 1:
            return []
        k = (k + 1) % len(look.found)
        self._used = look, k
        return self._steps_by(look.found[k], fetches)

    def signals(self, over: bool, ended: bool) -> dict[str, bool]:
        """Return what holds of the places; see `machine.SIGNALS`.

        `over`: all steps are done and the robot stands; `ended`: or its time is up.
        """
        placed, known = over and not self.placeless, len(self.T_places) > 0
        return {
            "placed": placed and not self.places.now,
            "placed_elsewhere": placed and bool(self.places.now),
            "no_place": ended and self.placeless and not known,
            "unreached": ended and self.placeless and known,
        }


def checked_places(T_base_place: np.ndarray | None) -> np.ndarray:
    """Return the object's places (n, 4, 4), its own first; none for None."""
    if T_base_place is None:
        return np.zeros((0, 4, 4))
    rows = as_floats("T_base_place", T_base_place)
    if rows.ndim == 2:
        rows = rows[None]
    if rows.ndim != 3 or not len(rows):
        raise BadInput(
            f"T_base_place has shape {np.shape(T_base_place)}; give one pose (4, 4), "
            "or several (n, 4, 4), the object's own place first"
        )
    return np.array([check_pose(T, "T_base_place") for T in rows])
