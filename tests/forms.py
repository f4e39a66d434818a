"""Slow checks have a short form, which `make test` runs, and a long one: `LONG=1`."""

import os
from collections.abc import Iterable
from typing import TypeVar

T = TypeVar("T")
LONG = os.environ.get("LONG", "0") not in ("", "0")  # reaches pytest-xdist's workers


def some(values: Iterable[T], *places: int) -> list[T]:
    """Return the values at `places`; in the long form all."""
    values = list(values)
    return values if LONG else [values[k] for k in places]


def size(short: int, long: int) -> int:
    """Return how many of something are looked at."""
    return long if LONG else short
