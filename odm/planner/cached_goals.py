"""Cache of attached goals: to set one of them again costs next to nothing.

To attach a goal takes milliseconds: certified motions to near nodes, their cells, and
the cost to go from every node. None of that depends on the frame, so it can be done in
a frame that has the time, and kept for one that has not.
"""

import numpy as np

from odm.search import _state as kinds

_KEPT = ("h", "node", "length", "ref", "number", "vertex")


class CachedGoals:
    """What is known of the goals attached last; the least recently used one goes."""

    def __init__(self, goals: kinds.Goals, most: int) -> None:
        self.most = most
        self._rows = {
            name: np.empty_like(getattr(goals, name)[:1]).repeat(most, axis=0)
            for name in _KEPT
        }
        self._row_of: dict[bytes, int] = {}  # by configuration; last used last

    def __contains__(self, q: np.ndarray) -> bool:
        return q.tobytes() in self._row_of

    def clear(self) -> None:
        """Forget all: the hand, the scenery or the pool has changed."""
        self._row_of.clear()

    def keep(self, goals: kinds.Goals, g: int) -> None:
        """Keep what stands at rank `g` of the table of goals."""
        if not self.most:
            return
        key = goals.q[g].tobytes()
        row = self._row_of.pop(key, None)
        if row is None:
            row = len(self._row_of)
            if row == self.most:
                row = self._row_of.pop(next(iter(self._row_of)))
        self._row_of[key] = row
        for name, rows in self._rows.items():
            rows[row] = getattr(goals, name)[g]

    def restore(self, goals: kinds.Goals, g: int) -> bool:
        """Write what is kept of the goal at rank `g`; False where nothing is."""
        key = goals.q[g].tobytes()
        row = self._row_of.pop(key, None)
        if row is None:
            return False
        self._row_of[key] = row
        for name, rows in self._rows.items():
            getattr(goals, name)[g] = rows[row]
        goals.blocked_at[g] = -1.0
        goals.at[g] = -1
        number = int(goals.number[g])
        goals.at[g, goals.node[g, :number]] = np.arange(number)
        return True

    def refs(self) -> list[np.ndarray]:
        """Return views of the pool items that are kept, to be renumbered in place."""
        ref, number = self._rows["ref"], self._rows["number"]
        return [ref[row, : number[row]] for row in self._row_of.values()]

    def vertices(self) -> list[int]:
        """Return the vertices of the goals that are kept."""
        return self._rows["vertex"][list(self._row_of.values())].tolist()

    def save(self) -> dict[str, np.ndarray]:
        """Return the goals that are kept, last used last."""
        keys, used = list(self._row_of), list(self._row_of.values())
        saved = {name: rows[used] for name, rows in self._rows.items()}
        return saved | {"q": np.array([np.frombuffer(key) for key in keys])}

    def load(self, saved: dict[str, np.ndarray]) -> None:
        """Keep the goals that were saved, and no others."""
        self._row_of = {q.tobytes(): row for row, q in enumerate(saved["q"])}
        for name, rows in self._rows.items():
            rows[: len(saved["q"])] = saved[name]
