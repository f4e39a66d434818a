"""Selects and orders the targets offered as goals, with hysteresis in quality.

Plain bookkeeping over numbers of cells and qualities, so that what changes when can be
read and tested without a robot. The planner takes the first goal that it can reach, and
goes over to an earlier one when that becomes free; this decides what it is offered.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from handover.targets.settings import ChoiceSettings
from handover.targets.target_offers import Offer
from roadmap.ranges import settings_of


class TargetChoice:
    """Keeps the cells on offer, best first, from frame to frame."""

    def __init__(self, settings: ChoiceSettings | None = None) -> None:
        self.settings = settings_of(settings, ChoiceSettings)
        self.keys: tuple[int, ...] = ()
        self._frame = 0
        self._waited_for: tuple[int, int] | None = None  # last pursued, and when
        self._since: dict[int, int] = {}  # frame in which a key was offered
        self._reached: set[int] = set()  # of those on offer
        self._shelf: dict[int, int] = {}  # frame from which on it may be offered again

    def decide(
        self,
        ranked: Sequence[tuple[int, float]],
        worth: Mapping[int, float],
        pursued: int | None,
        offer: Callable[[int], Offer],
        is_cheap: Callable[[int], bool],
    ) -> tuple[int, ...]:
        """Return the cells on offer from now on, best first: those to be goals.

        Args:
            ranked: (cell, quality) of the best targets, best first.
            worth: Quality now of each cell on offer; left out: no target now.
            pursued: The cell that the planner is on its way to or at; None: to none.
            offer: Offers a cell, if that can be, and says what came of it.
            is_cheap: Whether offering it costs nothing.
        """
        s, self._frame = self.settings, self._frame + 1
        if pursued is not None:
            self._reached.add(pursued)
        pursued = self._or_waited_for(pursued, worth)
        least = (
            max((quality for _, quality in ranked[:1]), default=0.0)
            - s.max_quality_loss
        )
        alive = [k for k in self.keys if k in worth]
        if pursued not in alive:
            pursued = None
        else:
            alive = [k for k in alive if k == pursued or worth[k] >= least]
        bar = -np.inf if pursued is None else worth[pursued] + s.quality_hysteresis
        if s.patience_frames and pursued is not None:
            alive = [k for k in alive if k == pursued or worth[k] > bar]
        worth = dict(worth) | dict(ranked)
        for key, quality in ranked:
            if not quality > bar or not self._may_offer(alive, worth, bar):
                break
            if key in alive or self._shelf.get(key, 0) > self._frame:
                continue
            if offer(key) is Offer.MADE:
                alive = self._with(alive, key, worth, bar)
                break
        if pursued is not None and not s.patience_frames:
            alive = self._spared(alive, ranked, worth, bar, is_cheap)
        self._take(self._ordered(alive, worth, pursued))
        return self.keys

    def put_off(self, key: int) -> None:
        """Take a cell off the offers for a while, though the planner found a path."""
        self._shelf[key] = self._frame + self.settings.retry_frames
        self.keys = tuple(k for k in self.keys if k != key)
        self._waited_for = None

    def _or_waited_for(self, pursued: int | None, worth: Mapping) -> int | None:
        """Return the pursued cell, or one that was until lately and may be again."""
        if pursued is not None:
            self._waited_for = pursued, self._frame
            return pursued
        if self._waited_for is None:
            return None
        key, when = self._waited_for
        late = self._frame - when > self.settings.patience_frames
        return key if key in self.keys and key in worth and not late else None

    def _may_offer(self, alive: list[int], worth: Mapping, bar: float) -> bool:
        """Whether another one may be offered: a place is free, or one had its time."""
        patience, ahead = self.settings.untried_frames, self._ahead(alive, worth, bar)
        if np.isinf(bar):
            patience = max(1, patience // 5)  # nothing to lose: the robot stands
        if len(ahead) < self._most(bar):
            return True
        return self._frame - self._since[ahead[0]] >= patience

    def _with(self, alive: list[int], key: int, worth: Mapping, bar: float) -> list:
        """Return them with one more; if full, without those unreached for longest."""
        ahead = self._ahead(alive, worth, bar)
        for old in ahead[: max(0, len(ahead) + 1 - self._most(bar))]:
            if old not in self._reached:
                self._shelf[old] = self._frame + self.settings.retry_frames
            alive = [k for k in alive if k != old]
        return [*alive, key]

    def _ahead(self, alive: list[int], worth: Mapping, bar: float) -> list[int]:
        """Return those better than the pursued one, the longest on offer first."""
        ahead = (k for k in alive if worth[k] > bar)
        return sorted(ahead, key=lambda k: (self._since[k], k))

    def _most(self, bar: float) -> int:
        return self.settings.goals if np.isinf(bar) else self.settings.max_untried

    def _spared(
        self,
        alive: list[int],
        ranked: Sequence[tuple[int, float]],
        worth: Mapping,
        bar: float,
        is_cheap: Callable[[int], bool],
    ) -> list[int]:
        """Return them with fallbacks behind the pursued one that cost nothing."""
        spares = [key for key in alive if worth[key] <= bar]
        missing = 1 + self.settings.fallbacks - len(spares)
        if missing < 1 or self._frame % self.settings.untried_frames:
            return alive
        room = self.settings.goals - len(alive)
        more = [
            key
            for key, quality in ranked
            if quality <= bar and key not in alive
            if self._shelf.get(key, 0) <= self._frame and is_cheap(key)
        ]
        return [*alive, *more[: min(missing, room)]]

    def _ordered(
        self, alive: list[int], worth: Mapping[int, float], pursued: int | None
    ) -> list[int]:
        """Return them by quality, the pursued one raised by the margin; or as they are.

        An order in which nothing is wrong by the margin stays.
        """
        margin = self.settings.quality_hysteresis

        def rank(key: int) -> tuple[float, int]:
            return -(worth[key] + (margin if key == pursued else 0.0)), key

        before = [key for key in self.keys if key in alive]
        if len(before) == len(alive) and _holds(before, worth, pursued, margin):
            return before
        return sorted(alive, key=rank)[: self.settings.goals]

    def _take(self, keys: list[int]) -> None:
        now = self._frame
        self._since = {key: self._since.get(key, now) for key in keys}
        self._reached &= self._since.keys()
        self._shelf = {k: until for k, until in self._shelf.items() if until > now}
        self.keys = tuple(keys)


def _holds(
    keys: list[int], worth: Mapping[int, float], pursued: int | None, margin: float
) -> bool:
    """Whether no two keys are in the wrong order by more than the margin.

    No worse target stands before the pursued one, none behind it is better by the
    margin, and no other two are swapped by more than it.
    """
    if pursued in keys:
        at = keys.index(pursued)
        if any(worth[key] < worth[pursued] for key in keys[:at]):
            return False
        if any(worth[key] > worth[pursued] + margin for key in keys[at + 1 :]):
            return False
    values = [worth[key] for key in keys if key != pursued]
    return all(b <= a + margin for a, b in zip(values, values[1:], strict=False))
