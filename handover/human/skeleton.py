"""Lengths between a person's joints: of a body height, or measured."""

from dataclasses import dataclass, fields
from functools import cached_property, lru_cache

import numpy as np

from handover.human import anthropometry as body
from roadmap.arrays import frozen
from roadmap.errors import BadInput


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Where a person's joints are against each other [m].

    The pelvis and chest frames have x to the front, y to the left, z up the trunk.
    The first row of a pair is the left side.

    Attributes:
        trunk: Pelvis to the joint that bends the chest against it, along z.
        shoulders: (2, 3) that joint to the shoulders' centres, in the chest frame.
        neck: (3,) that joint to the base of the neck, in the chest frame.
        skull: (3,) base of the neck to the base of the skull, in the chest frame.
        hips: (2, 3) pelvis to the hip joints, in the pelvis frame.
        arms: (2, 3) shoulder to elbow, elbow to wrist, wrist to grip.
        hands: (2,) wrist to finger tips of straight hands.
        legs: (4,) hip to knee, knee to ankle, ankle to sole, heel to toes.
    """

    trunk: float
    shoulders: np.ndarray
    neck: np.ndarray
    skull: np.ndarray
    hips: np.ndarray
    arms: np.ndarray
    hands: np.ndarray
    legs: np.ndarray

    def __post_init__(self) -> None:
        shapes = {
            "shoulders": (2, 3),
            "neck": (3,),
            "skull": (3,),
            "hips": (2, 3),
            "arms": (2, 3),
            "hands": (2,),
            "legs": (4,),
        }
        for name, shape in shapes.items():
            array = frozen(getattr(self, name), np.float64)
            lengths = name in ("arms", "hands", "legs")
            good = np.isfinite(array).all() and (not lengths or (array > 0).all())
            if array.shape != shape or not good:
                kind = "positive " if lengths else ""
                raise BadInput(
                    f"{name} of a skeleton are {array.tolist()}; give {kind}metres "
                    f"of shape {shape}"
                )
            object.__setattr__(self, name, array)

    @cached_property
    def hip(self) -> np.ndarray:
        """(3,) pelvis to the middle between the hip joints, in the pelvis frame."""
        return frozen(self.hips.mean(axis=0), np.float64)

    @classmethod
    def of_height(cls, height: float) -> "Skeleton":
        """Return the skeleton of a person of `height` [m], 1.2 to 2.2."""
        body.check_height(height, "give a Skeleton with the person's own lengths")
        return _of_height(float(height))

    def scaled(self, factor: float) -> "Skeleton":
        """Return the skeleton with all lengths times `factor`."""
        lengths = {f.name: factor * getattr(self, f.name) for f in fields(self)}
        return Skeleton(**lengths)


@lru_cache(maxsize=64)
def _of_height(height: float) -> Skeleton:
    side = np.array([[1.0], [-1.0]])
    shoulder = [0.0, body.SHOULDER_HALF_BREADTH, body.TRUNK_TO_SHOULDER]
    hip = [0.0, body.HIP_HALF_BREADTH, -body.PELVIS_TO_HIP]
    mirror = np.hstack([side * side, side, side * side])
    whole = Skeleton(  # of a height of 1
        trunk=body.PELVIS_TO_TRUNK,
        shoulders=mirror * shoulder,
        neck=np.array([0.0, 0.0, body.TRUNK_TO_NECK]),
        skull=np.array([0.0, 0.0, body.NECK_TO_SKULL]),
        hips=mirror * hip,
        arms=np.tile([body.UPPER_ARM, body.FOREARM, body.GRIP], (2, 1)),
        hands=np.full(2, body.HAND),
        legs=np.array([body.THIGH, body.SHANK, body.ANKLE, body.FOOT]),
    )
    return whole.scaled(height)
