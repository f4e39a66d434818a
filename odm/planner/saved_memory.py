"""A planner's memory as plain arrays: written to a file, read back, and compared.

A frame is a function of map, memory, obstacles, configuration and goals. So a fresh
planner that was told the same of its hand, base and place, and that loads the memory of
another one, answers as that one does, byte for byte.
"""

import hashlib
from collections.abc import Mapping
from typing import Protocol

import numpy as np

from roadmap.errors import BadInput

_SETTING, _DIGEST = "setting.", "digest"


class Remembers(Protocol):
    """What owns a part of the memory."""

    def save(self) -> dict[str, np.ndarray]:
        """Return copies of what it remembers, by name."""

    def load(self, saved: dict[str, np.ndarray]) -> None:
        """Remember what `save` returned, and nothing else."""


def pack(
    parts: dict[str, Remembers], setting: dict[str, bytes]
) -> dict[str, np.ndarray]:
    """Return what all parts remember as arrays "part.name", and what it rests on.

    Args:
        parts: The owners by name.
        setting: What the memory is good for, by what it is called in a message.
    """
    saved = {
        f"{part}.{name}": array
        for part, owner in parts.items()
        for name, array in owner.save().items()
    }
    for name, told in setting.items():
        saved[_SETTING + name] = np.array(hashlib.sha256(told).hexdigest())
    return saved | {_DIGEST: np.array(_digest(saved))}


def unpack(
    saved: Mapping[str, np.ndarray],
    parts: dict[str, Remembers],
    setting: dict[str, bytes],
) -> None:
    """Let all parts remember what `pack` returned.

    Raises:
        BadInput: It belongs to another setting, or is damaged; nothing is changed then.
    """
    arrays = {name: np.asarray(saved[name]) for name in saved}
    digest = arrays.pop(_DIGEST, None)
    if digest is None or str(digest) != _digest(arrays):
        raise BadInput(
            "this is no memory of a planner, or it is damaged; give what save_memory "
            "returned"
        )
    for name, told in setting.items():
        if str(arrays[_SETTING + name]) != hashlib.sha256(told).hexdigest():
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
        array = np.ascontiguousarray(arrays[name])
        whole.update(f"{name} {array.dtype.str} {array.shape}".encode())
        whole.update(array)
    return whole.hexdigest()
