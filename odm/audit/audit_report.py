"""What an audit found: cases that can be run again, and sums over all pairs."""

from dataclasses import dataclass, fields

import numpy as np


@dataclass(frozen=True, eq=False)
class Case:
    """One pair of the audit, enough to run it again.

    Attributes:
        motion: Edge, or -1 - node.
        t: Where on the edge, in [0, 1].
        q: (dof,) that configuration.
        family, specimen: Which obstacle of the seed's library.
        T_base_obstacle: (4, 4) its pose.
        link: The nearest link.
        distance: Exact separation [m], at most 0 in contact.
    """

    motion: int
    t: float
    q: np.ndarray
    family: str
    specimen: int
    T_base_obstacle: np.ndarray
    link: str
    distance: float

    def __str__(self) -> str:
        what = f"edge {self.motion}" if self.motion >= 0 else f"node {-1 - self.motion}"
        return (
            f"{self.distance * 1e3:7.2f} mm: {what} at t = {self.t:.6f}, {self.link} "
            f"and {self.family} {self.specimen}"
        )


@dataclass(frozen=True, eq=False)
class AuditReport:
    """What an audit found.

    Attributes:
        asked: "cells" or "close test".
        pairs, free: Pairs asked, and those that the map called free.
        boundary: Pairs moved by bisection to the free side of the map's own boundary.
        violations: Pairs called free whose exact separation is below m.
        unresolved: Pairs whose two exact bounds lie on different sides of m.
        smallest: Smallest exact separation among the pairs called free [m].
        m: The clearance it is compared with [m].
        worst: The nearest pairs called free, nearest first.
        families: Family -> (pairs, free, violations, smallest separation).
        seed, seconds, sabotage, complete: How it was run; not complete if interrupted.
    """

    asked: str
    pairs: int
    free: int
    boundary: int
    violations: int
    unresolved: int
    smallest: float
    m: float
    worst: tuple[Case, ...]
    families: dict[str, tuple[int, int, int, float]]
    seed: int
    seconds: float
    sabotage: str | None = None
    complete: bool = True

    @property
    def free_share(self) -> float:
        """Share of the pairs that the map called free."""
        return self.free / max(1, self.pairs)

    @property
    def passed(self) -> bool:
        """True if nothing called free comes nearer than m, and enough was free."""
        clean = self.violations == 0 and self.unresolved == 0
        return clean and self.complete and self.free_share >= 0.2

    def as_dict(self) -> dict:
        """Return everything but the poses as plain JSON data."""
        plain = {f.name: getattr(self, f.name) for f in fields(self)}
        plain["smallest"] = _number(self.smallest)
        families = {k: [*v[:3], _number(v[3])] for k, v in self.families.items()}
        worst = [str(case) for case in self.worst]
        return plain | {
            "free_share": self.free_share,
            "passed": self.passed,
            "families": families,
            "worst": worst,
        }

    def __str__(self) -> str:
        verdict = "passed" if self.passed else "FAILED"
        if not self.complete and not self.violations:
            verdict = "was interrupted"
        return (
            f"audit of the {self.asked} {verdict}: {self.violations} of {self.pairs} "
            f"pairs called free come nearer than m = {self.m * 1e3:.1f} mm, "
            f"{self.free_share:.0%} called free, {self.boundary} tested at the map's "
            f"boundary, smallest separation {self.smallest * 1e3:.2f} mm"
        )


def _number(distance: float) -> float | None:
    """Return a distance as JSON knows it: none where nothing was called free."""
    return distance if np.isfinite(distance) else None
