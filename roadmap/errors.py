"""The base of every error a user of the planner can meet."""


class PlanningError(Exception):
    """Base class: one sentence with the value, the limit and the remedy."""


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
