"""A planner's memory as plain arrays: written to a file, read back, and compared.

A frame is a function of map, memory, obstacles, configuration and goals. So a fresh
planner that was told the same of its hand, base and place, and that loads the memory of
another one, answers as that one does, byte for byte.
"""

import hashlib
import re
from collections.abc import Mapping
from typing import ClassVar, Protocol

import numpy as np

from odm._groups import FRAME, GOAL, declared, length
from odm.search.state import KINDS, Memory
from roadmap.errors import BadInput
from roadmap.ranges import check_kind

_SETTING, _DIGEST = "setting.", "digest"
# of how it is laid out: another one where any part saves something else, or in another
# order
_VERSION = {"version": b"9"}
NOT_SAVED = ("graph", "direct")  # counted anew from the frame's points
# groups whose verdicts of a frame are void
_VERDICTS = "search", "goals", "start_connections", "recent", "slacks"


class StateArrays:
    """The arrays of the compiled loops that are declared to be remembered.

    Of pool, goals and trees only what is in use is saved.
    """

    def __init__(self, memory: Memory) -> None:
        self.memory = memory

    def save(self) -> dict[str, np.ndarray]:
        """Return copies of the arrays as "group.name"."""
        m = self.memory
        items, entries = m.pool.used.tolist()
        used = {"items": items, "item_entries": entries, "goals": int(m.goals.count[0])}
        used["branches"] = int(m.trees.count.max())
        saved = {}
        for name, array in m.arrays(GOAL).items():
            group, _, key = name.partition(".")
            if group not in NOT_SAVED:
                axes = declared(KINDS[group])[key].axes
                saved[name] = array[tuple(_part(axis, used) for axis in axes)].copy()
        return saved

    def load(self, saved: dict[str, np.ndarray]) -> None:
        """Write the arrays; no verdict of a frame is known any more."""
        void = {
            name: array
            for name, array in self.memory.arrays(FRAME).items()
            if name.partition(".")[0] in _VERDICTS
        }
        arrays = self.memory.arrays(GOAL)
        for name, array in {**void, **{n: arrays[n] for n in saved}}.items():
            group, _, key = name.partition(".")
            array[...] = declared(KINDS[group])[key].fill
            if name in saved:
                array[tuple(slice(n) for n in saved[name].shape)] = saved[name]


def _part(axis: str, used: dict[str, int]) -> slice:
    """Return how much of an axis is in use; see `odm._groups.Declared`."""
    names = re.findall("[a-z_]+", axis)
    return slice(length(axis, used) if names and set(names) <= set(used) else None)


class Remembers(Protocol):
    """What owns a part of the memory."""

    def save(self) -> dict[str, np.ndarray]:
        """Return copies of what it remembers, by name."""

    def load(self, saved: dict[str, np.ndarray]) -> None:
        """Remember what `save` returned, and nothing else."""


class Remembering:
    """Remembers its attributes that REMEMBERED names: numbers, bytes and arrays."""

    REMEMBERED: ClassVar[tuple[str, ...]] = ()

    def save(self) -> dict[str, np.ndarray]:
        """Return copies of what it remembers, by name."""
        values = ((name, getattr(self, name)) for name in self.REMEMBERED)
        return {
            name: np.array(np.frombuffer(v, np.uint8) if isinstance(v, bytes) else v)
            for name, v in values
        }

    def load(self, saved: dict[str, np.ndarray]) -> None:
        """Remember what `save` returned."""
        for name in self.REMEMBERED:
            now, value = getattr(self, name), saved[name]
            if isinstance(now, np.ndarray):
                setattr(self, name, value.copy())
            else:
                is_bytes = isinstance(now, bytes)
                setattr(self, name, value.tobytes() if is_bytes else value.item())


def pack(
    parts: dict[str, Remembers], setting: dict[str, bytes]
) -> dict[str, np.ndarray]:
    """Return what all parts, by name, remember, as arrays "part.name".

    `setting` is what the memory is good for, by what it is called in a message.
    """
    saved = {
        f"{part}.{name}": array
        for part, owner in parts.items()
        for name, array in owner.save().items()
    }
    for name, content in (_VERSION | setting).items():
        saved[_SETTING + name] = np.array(hashlib.sha256(content).hexdigest())
    return saved | {_DIGEST: np.array(_digest(saved))}


def unpack(
    saved: Mapping[str, np.ndarray],
    parts: dict[str, Remembers],
    setting: dict[str, bytes],
) -> None:
    """Let all parts remember what `pack` returned.

    BadInput for another setting, or damage; then nothing is changed.
    """
    remedy = "give what save_memory returned, or what numpy.load made of it"
    check_kind("saved", saved, Mapping, remedy)
    arrays = {name: np.asarray(saved[name]) for name in saved}
    digest = arrays.pop(_DIGEST, None)
    if digest is None or str(digest) != _digest(arrays):
        raise BadInput(
            "this is no memory of a planner, or it is damaged; give what save_memory "
            "returned"
        )
    for name, content in (_VERSION | setting).items():
        if str(arrays.get(_SETTING + name)) != hashlib.sha256(content).hexdigest():
            raise BadInput(
                f"the memory was saved with another {name}; load it into a planner "
                f"that has the same {name}"
            )
    for part, owner in parts.items():
        start = f"{part}."
        owner.load({n[len(start) :]: arrays[n] for n in arrays if n.startswith(start)})


def differences(
    one: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray]
) -> list[str]:
    """Return the names of the arrays in which two saved memories differ."""
    return [
        name
        for name in sorted({*one, *other} - {_DIGEST})
        if name not in one
        or name not in other
        or one[name].dtype != other[name].dtype
        or one[name].shape != other[name].shape
        or one[name].tobytes() != other[name].tobytes()
    ]


def _digest(arrays: Mapping[str, np.ndarray]) -> str:
    whole = hashlib.sha256()
    for name in sorted(arrays):
        array = arrays[name]
        whole.update(f"{name} {array.dtype.str} {array.shape}".encode())
        whole.update(array.tobytes())
    return whole.hexdigest()
