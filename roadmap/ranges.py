"""Numbers of settings and arguments are checked here, by one sentence."""

import math
import os
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from numbers import Integral, Real
from pathlib import Path
from typing import Any, TypeVar

from roadmap.errors import BadInput

_T = TypeVar("_T")


def is_between(value: object, low: float, high: float) -> bool:
    """Return whether a value is a real number from low to high; NaN is not."""
    if type(value) is float:
        return low <= value <= high
    if not is_real(value):
        return False
    return bool(low <= plain(value) <= high)  # type: ignore[operator]


def is_real(value: object) -> bool:
    """Return whether a value is a number that a float can hold; NaN is, True is not."""
    if type(value) is float:
        return True
    if isinstance(value, bool) or not isinstance(value, Real):
        return False
    return not isinstance(value, int) or abs(value) <= sys.float_info.max


def plain(value: _T) -> _T:
    """Return a number of numpy's as Python's own, anything else as it is.

    Python's are written to files, and do not overflow at 127.
    """
    numpys = type(value).__module__ == "numpy" and getattr(value, "shape", None) == ()
    return value.item() if numpys else value  # type: ignore[attr-defined]


def told(value: object) -> str:
    """Return a value as messages name it, the beginning of a long one."""
    try:
        text = repr(value)
    except ValueError:  # Python writes no whole number of so many digits
        return "a number of thousands of digits"
    return text if len(text) <= 40 else f"{text[:37]}..."


def is_number(word: str) -> bool:
    """Return whether a word of a file reads as a number, to other programs, too."""
    if "_" in word or not word.isascii():  # Python takes 1_0 for 10
        return False
    try:
        float(word)
    except ValueError:
        return False
    return True


def check_number(
    name: str,
    value: float,
    low: float,
    high: float,
    whole: bool = False,
    where: str = "",
) -> float:
    """Return a number, or a whole one, from low to high; else refuse it.

    `name` says what it is, with its unit; `where` in what to change it, empty: in the
    call.
    """
    sound = is_between(value, low, high)
    if sound and not (whole and not isinstance(value, Integral)):
        return plain(value)
    kind = "a whole number" if whole else "a number"
    limits = f"from {low:g}" + ("" if high == float("inf") else f" to {high:g}")
    raise BadInput(
        f"{name} is {told(value)}, but must be {kind} {limits}; change it"
        f"{f' in {where}' if where else ''}"
    )


def check_seconds(name: str, value: float) -> float:
    """Return a time [s], which may be NaN or infinite; refuse what is no number."""
    if not is_real(value):
        raise BadInput(f"{name} is {told(value)}; give seconds as a number")
    return float(value)


def check_rpy(
    where: str, rpy: Iterable[float], error: type[BadInput] = BadInput
) -> None:
    """Refuse roll, pitch and yaw beyond a whole turn [rad]: a person wrote degrees."""
    angles = [float(angle) for angle in rpy]
    if max(map(abs, angles)) > 2.0 * math.pi:
        raise error(
            f"{where} {angles} goes beyond a whole turn; this looks like degrees, give "
            "radians"
        )


def check_kind(
    name: str, value: object, kinds: type | tuple[type, ...], remedy: str
) -> None:
    """Refuse a value of another class, such as a path for a map, with the remedy."""
    if not isinstance(value, kinds):
        raise BadInput(f"{name} is {told(value)} ({type(value).__name__}); {remedy}")


def check_path(
    name: str, path: str | os.PathLike, remedy: str = "give its path"
) -> Path:
    """Return a path as one; refuse what is none."""
    check_kind(name, path, (str, os.PathLike), remedy)
    return Path(path)


def check_yes(name: str, value: object) -> bool:
    """Return what a value says as yes or no; refuse what says neither: an array."""
    if value is True or value is False:
        return value
    try:
        return bool(value)
    except (TypeError, ValueError) as error:
        raise BadInput(
            f"{name} is {told(value)}, which says neither yes nor no; give True or "
            "False"
        ) from error


def settings_of(given: _T | None, kind: type[_T]) -> _T:
    """Return settings of a kind, the default ones for None; else BadInput."""
    if given is None:
        return kind()
    check_kind("settings", given, kind, f"give {kind.__name__}(...)")
    return given


def setting(default: _T, low: float, high: float, unit: str = "") -> _T:
    """Declare a field of a settings class, whose numbers are from `low` to `high`."""
    return field(default=default, metadata={"range": (low, high, unit)})


@dataclass(frozen=True, eq=False)
class CheckedSettings:
    """Settings whose fields that `setting` declares are checked when they are made.

    A field declared as `int` must be whole; None is sound where it is the default. What
    is True or False by default must be one of them, and settings within settings must
    be of their kind. Numbers of numpy's are kept as Python's own, which recordings can
    hold.
    """

    def __post_init__(self) -> None:
        where = type(self).__name__
        for one in fields(self):
            value = self._plainly(one.name)
            if isinstance(one.default, bool):
                check_kind(one.name, value, bool, "give True or False")
            kind = one.default_factory
            if isinstance(kind, type) and issubclass(kind, CheckedSettings):
                check_kind(one.name, value, kind, f"give {kind.__name__}(...)")
            if "range" not in one.metadata or (value is None and one.default is None):
                continue
            low, high, unit = one.metadata["range"]
            name = f"{one.name} [{unit}]" if unit else one.name
            if not isinstance(one.default, tuple):
                check_number(name, value, low, high, one.type is int, where)
                continue
            if not isinstance(value, tuple) or not value:
                raise BadInput(
                    f"{one.name} is {value!r}, but must be a tuple of numbers; change "
                    f"it in {where}"
                )
            for number in value:
                check_number(f"a value of {name}", number, low, high, False, where)

    def _plainly(self, name: str) -> Any:  # noqa: ANN401 (whatever the field holds)
        """Return a field, whose numbers of numpy's are Python's from now on."""
        value = getattr(self, name)
        many = type(value) is tuple
        found = tuple(map(plain, value)) if many else plain(value)
        if many or found is not value:
            object.__setattr__(self, name, found)
        return found
