"""The base of every error a user can meet, and the words that a remedy begins with."""

import difflib
from collections.abc import Collection


def did_you_mean(given: object, known: Collection[str]) -> str:
    """Return how a remedy begins: "give", or the nearest known word before it."""
    near = difflib.get_close_matches(str(given), known, n=1)
    return f"did you mean {near[0]!r}? Give" if near else "give"


class PlanningError(Exception):
    """Base class: one sentence with the value, the limit and the remedy."""

    def __str__(self) -> str:
        """Return it on one line, whatever value it shows."""
        return " ".join(map(str.strip, super().__str__().splitlines()))


class BadInput(PlanningError, ValueError):
    """An argument has the wrong shape, type or range; the program must change."""


class BadRobot(PlanningError):
    """A robot description cannot be read or used."""


class BadConfiguration(BadInput):
    """A joint configuration is unusable: length, NaN, limits or self-collision."""


class BadMap(PlanningError):
    """A stored map is truncated, altered, of another version or another robot."""


class BadRecipe(BadInput):
    """A recipe holds an unknown key or a value out of range."""


class BuildRefused(PlanningError):
    """A build would not fit in memory, or its grid does not hold the robot."""


class NothingFree(BuildRefused):
    """Hardly any configuration or motion is free: no second try would change that."""
