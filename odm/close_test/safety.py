"""The terms of the safety argument: cell size, covering radius, clearance, bounds."""

from dataclasses import dataclass, fields

from roadmap.errors import BadRecipe
from roadmap.ranges import is_between

MARGINS = ("sensor", "tracking", "blending", "user")


TERMS = {"h": (0.002, 1.0), "rho": (0.0, 0.5), "mu": (0.0005, 0.2)}


def between(key: str, value: object, low: float, high: float) -> None:
    """Refuse a value of a recipe outside its range."""
    if not is_between(value, low, high):
        raise BadRecipe(
            f"{key} is {value}, but must lie between {low} and {high}; "
            "change it in the recipe"
        )


@dataclass(frozen=True)
class Safety:
    """The terms of the safety argument, all in metres.

    Attributes:
        h: Side of a cell.
        rho: Largest covering radius of an obstacle's samples.
        sensor, tracking, blending, user: The shares of the clearance m.
        mu: Motion bound: no piece of a motion is inflated by more than mu / 2.
    """

    h: float = 0.04
    rho: float = 0.03
    sensor: float = 0.004
    tracking: float = 0.002
    blending: float = 0.004
    user: float = 0.0
    mu: float = 0.01

    @property
    def m(self) -> float:
        """Clearance beyond contact: the sum of its shares [m]."""
        return self.sensor + self.tracking + self.blending + self.user

    @property
    def rounding(self) -> float:
        """How far below m it may come to static things while rounding a corner [m].

        The share for blending, which is spent once only if the robot is off its path by
        no more than twice that (decision 0102); else nothing.
        """
        return self.blending if self.tracking <= self.blending else 0.0

    def __post_init__(self) -> None:
        shares = {name: (0.0, 0.5) for name in MARGINS}
        for name, (low, high) in {**TERMS, **shares}.items():
            between(f"safety.{name}", getattr(self, name), low, high)

    def as_dict(self) -> dict[str, float]:
        """Return the terms and the clearance m."""
        terms = {f.name: getattr(self, f.name) for f in fields(self)}
        return {**terms, "m": self.m}
