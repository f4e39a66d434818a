"""How travelling joints carry a link: its poses, and bounds on their derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadmap.loading.body_tree import BodyTree, drive
from roadmap.robot.description import MOVABLE, Description, Joint
from roadmap.transforms import joint_motion

_SAG = 5e-4  # [m] what a hull is grown by, where poses enough can be had
_BULGE = 5e-3  # [m] an arc that leaves its chord by more is held by several hulls
_MOST_HULLS = 12
_MOST_POSES = 800  # corners of small cells that go into one hull


@dataclass(frozen=True, eq=False)
class Step:
    """A travelling joint that carries a link, `T_before` its frame in the last one's.

    Its value is `factor * v + offset`, v that of driver number `driver`.
    """

    T_before: np.ndarray
    joint: Joint
    driver: int
    factor: float
    offset: float


@dataclass(frozen=True, eq=False)
class Carried:
    """How travelling joints carry a link, from its body on.

    Attributes:
        drivers: (k,) names of the joints that travel.
        lower, upper: (k,) their limits [rad or m].
        steps: The joints that follow them, the base's first.
        T_last_link: The link in the last joint's frame.
    """

    drivers: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    steps: tuple[Step, ...]
    T_last_link: np.ndarray

    def poses(self, values: np.ndarray) -> np.ndarray:
        """Return T_body_link (n, 4, 4) for values (n, k) of the drivers."""
        T = np.broadcast_to(np.eye(4), (len(values), 4, 4))
        for step in self.steps:
            value = step.factor * values[:, step.driver] + step.offset
            T = (
                T
                @ step.T_before
                @ joint_motion(step.joint.kind, step.joint.axis, value)
            )
        return T @ self.T_last_link

    def derivatives(self, radius: float) -> tuple[np.ndarray, np.ndarray]:
        """Bound |dp / dv_i| and |d2p / dv_i2| over the whole travel.

        For revolute joints j before k, d2p / dq_j dq_k is axis_j x dp / dq_k, no
        longer than the lever of joint k; it is 0 where j is prismatic.

        Args:
            radius: p is this near to the link's origin [m].

        Returns:
            (k,) and (k,) [m per unit, m per unit squared].
        """
        first, second = np.zeros(len(self.drivers)), np.zeros(len(self.drivers))
        reach = radius + np.linalg.norm(self.T_last_link[:3, 3])
        for step in self.steps[::-1]:
            i, size, slide = step.driver, abs(step.factor), 0.0
            if step.joint.kind == "prismatic":
                ends = step.factor * np.array([self.lower[i], self.upper[i]])
                slide, rate = np.abs(ends + step.offset).max(), size
            else:
                rate = size * reach
                second[i] += size * (rate + 2.0 * first[i])
            first[i] += rate
            reach += slide + np.linalg.norm(step.T_before[:3, 3])
        return first, second

    def motion_bounds(self, radius: float) -> np.ndarray:
        """Return how far each driver moves points at most, (k,) [m]."""
        return self.derivatives(radius)[0] * (self.upper - self.lower)

    def cells(self, radius: float) -> tuple[np.ndarray, np.ndarray, float]:
        """Return (k,) hulls a driver, (k,) cells a hull, and a hull's growth [m]."""
        span, bend = self.upper - self.lower, self.derivatives(radius)[1]
        k = len(span)
        hulls = _counts(span * np.sqrt(bend / (8 * _BULGE)), _MOST_HULLS, 0)
        small = span / hulls * np.sqrt(k * bend / (8 * _SAG))
        small = _counts(small, _MOST_POSES, 1)
        sag = ((span / hulls / small) ** 2 * bend).sum() / 8
        return hulls, small, float(sag) + 1e-9


def _counts(wanted: np.ndarray, most: int, ends: int) -> np.ndarray:
    """Return counts (k,) of at least 1, as wanted or as (count + ends) multiply to."""
    counts = np.maximum(1, np.ceil(np.minimum(wanted, most))).astype(int)
    while np.prod(counts + ends) > most and counts.max() > 1:
        counts[counts.argmax()] -= 1
    return counts


def carried_links(
    description: Description, tree: BodyTree, travel: Sequence[str]
) -> dict[str, Carried]:
    """Return the links that the joints named in `travel` carry."""
    found = {}
    for link in description.links:
        steps: list[Step] = []
        names: list[str] = []
        T = np.eye(4)
        for joint in description.path(link):
            name, factor, offset = (
                drive(description, joint) if joint.kind in MOVABLE else ("", 0.0, 0.0)
            )
            T = T @ joint.T_parent_joint
            if name in tree.joint_names:
                steps, names, T = [], [], np.eye(4)
            elif name in travel:
                names += [] if name in names else [name]
                steps.append(Step(T, joint, names.index(name), factor, offset))
                T = np.eye(4)
            elif name:
                value = factor * tree.fixed_values[name] + offset
                T = T @ joint_motion(joint.kind, joint.axis, value)
        if steps:
            joints = [description.joints[name] for name in names]
            lower, upper = np.array([(j.lower, j.upper) for j in joints], float).T
            found[link] = Carried(tuple(names), lower, upper, tuple(steps), T)
    return found


def has_limits(joint: Joint) -> bool:
    """Say if a joint has two limits."""
    ends = joint.kind != "continuous", joint.lower is not None, joint.upper is not None
    return all(ends)
