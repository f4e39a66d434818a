"""Arrays: read-only ones of dataclasses, as loops take them, and of any numbers."""

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from roadmap.errors import BadInput


def frozen(array: np.ndarray, dtype: np.dtype | type) -> np.ndarray:
    """Return `array` as a read-only C-contiguous array of `dtype`.

    A memory-mapped or already frozen array of the right type is not copied.
    """
    result = np.ascontiguousarray(array, dtype=dtype)
    if result is array and result.flags.writeable:
        result = result.copy()
    result.flags.writeable = False
    return result


def writable(array: np.ndarray) -> np.ndarray:
    """Return `array` C-contiguous and open to be written; a copy where it is not.

    To numba a read-only array is another type, and a loop is compiled again for it.
    """
    result = np.ascontiguousarray(array)
    return result if result.flags.writeable else result.copy()


def freeze(data: object, **kinds: np.dtype | type) -> None:
    """Make arrays of a frozen dataclass read-only, each of the type that is given."""
    for name, kind in kinds.items():
        object.__setattr__(data, name, frozen(getattr(data, name), kind))


class _Lent:
    """What numpy takes an array from that it then believes may be written to."""

    def __init__(self, array: np.ndarray) -> None:
        self.array = array  # kept as long as the view
        described = array.__array_interface__
        self.__array_interface__ = described | {"data": (described["data"][0], False)}


def is_lendable(array: object) -> bool:
    """Return whether an array is as compiled loops take it, read-only or not."""
    if type(array) is not np.ndarray or array.dtype != np.float64:
        return False
    return array.flags.c_contiguous and array.flags.aligned


def lent(array: np.ndarray) -> np.ndarray:
    """Return a view of a read-only array for loops that read it and write nothing.

    To numba a read-only array is another type; a copy in each frame takes 0.2 us.
    """
    return np.asarray(_Lent(array))


def as_floats(name: str, values: object) -> np.ndarray:
    """Return real numbers as a float64 array that loops take: writeable, aligned.

    An array that is one already comes back as it is; rows of unequal length are
    refused. What is masked is NaN: nobody knows what stands there.
    """
    try:
        array = np.asarray(values)
    except (ValueError, TypeError, OverflowError):
        array = np.empty(0, object)  # rows of unequal length
    if array.dtype.kind not in "fiu":
        raise BadInput(
            f"{name} must be an array of real numbers, not {shown(values)}; give "
            "float64, all rows of the same length"
        )
    array = np.asarray(array, np.float64)
    if isinstance(values, np.ma.MaskedArray):
        array = np.where(np.ma.getmaskarray(values), np.nan, array)
    return array if array.flags.carray else array.copy(order="C")


def shown(values: object) -> str:
    """Describe a value in a few words."""
    kind = getattr(values, "dtype", None)
    if kind is not None:
        return f"an array of dtype {kind}"
    text = repr(values)
    return text if len(text) < 60 else f"{text[:56]} ..."


def brief(data: Any) -> str:
    """Return a dataclass on one line, the `__repr__` of large ones.

    Arrays are told by their shape, other dataclasses by their class.
    """
    shown = [f for f in fields(data) if f.repr]
    told = (f"{f.name}={_brief(getattr(data, f.name))}" for f in shown)
    return f"{type(data).__name__}({', '.join(told)})"


def _brief(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"array{value.shape}"
    if is_dataclass(value):
        return type(value).__name__
    text = " ".join(repr(value).split())
    return text if len(text) < 80 else f"{text[:76]} ..."
