"""Numbers of settings and arguments are checked here, by one sentence."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import fields
from numbers import Integral, Real
from typing import Any

from roadmap.errors import BadInput


def is_between(value: object, low: float, high: float) -> bool:
    """Return whether a value is a real number from low to high; NaN is not."""
    if type(value) is not float and (
        not isinstance(value, Real) or isinstance(value, bool)
    ):
        return False
    return bool(low <= value <= high)  # type: ignore[operator]


def is_number(word: str) -> bool:
    """Return whether a word of a file reads as a number."""
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
        return value
    kind = "a whole number" if whole else "a number"
    limits = f"from {low:g}" + ("" if high == float("inf") else f" to {high:g}")
    raise BadInput(
        f"{name} is {value!r}, but must be {kind} {limits}; change it"
        f"{f' in {where}' if where else ''}"
    )


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
        shown = repr(value)
        shown = shown if len(shown) <= 40 else f"{shown[:37]}..."
        raise BadInput(f"{name} is {shown} ({type(value).__name__}); {remedy}")


def check_settings(
    settings: Any, ranges: Mapping[str, tuple[float, float, str]]
) -> None:
    """Check numbers of a frozen settings object: `ranges` are (least, largest, unit).

    Fields declared as `int` must be whole; a sentence names field, value and limits.
    """
    kinds = {field.name: field.type for field in fields(settings)}
    for field, (low, high, unit) in ranges.items():
        value = getattr(settings, field)
        name = f"{field} [{unit}]" if unit else field
        where = type(settings).__name__
        check_number(name, value, low, high, kinds[field] is int, where)


def check_row(
    settings: object, field: str, low: float, high: float, unit: str = ""
) -> None:
    """Check a tuple of numbers of a frozen settings object."""
    row, where = getattr(settings, field), type(settings).__name__
    if not isinstance(row, tuple) or not row:
        raise BadInput(
            f"{field} is {row!r}, but must be a tuple of numbers; change it in {where}"
        )
    name = f"{field} [{unit}]" if unit else field
    for value in row:
        check_number(f"a value of {name}", value, low, high, False, where)
