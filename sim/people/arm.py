"""A human arm as two closed capsules, posed by shoulder and elbow angles."""

from dataclasses import dataclass

import numpy as np

from handover.human.anthropometry import (
    FOREARM,
    HAND,
    RADII,
    UPPER_ARM,
    check_height,
    check_thickness,
)
from roadmap.arrays import frozen
from roadmap.errors import BadInput
from roadmap.transforms import moved_points, pose_of


@dataclass(frozen=True, eq=False)
class HumanArm:
    """Lengths and radii of an arm; poses it forward, from angles to capsules.

    The shoulder frame has x to the front of the person, y to the left and z up. With
    all angles zero the arm hangs straight down. A left and a right arm look the
    same: two capsules, the second from the elbow to the finger tips.
    """

    # (2,) shoulder to elbow, elbow to finger tips of a straight hand [m]
    lengths: np.ndarray
    radii: np.ndarray  # (2,) radius of upper arm, and of forearm with hand [m]

    def __post_init__(self) -> None:
        for name in ("lengths", "radii"):
            array = frozen(getattr(self, name), np.float64)
            if array.shape != (2,) or not (array > 0).all():
                raise BadInput(
                    f"{name} of a human arm are {array.tolist()}, but they must be two "
                    "positive numbers in metres: upper arm, forearm with hand"
                )
            object.__setattr__(self, name, array)
        if self.lengths[1] <= self.radii[1]:
            raise BadInput(
                f"a forearm of {self.lengths[1]} m is shorter than its radius "
                f"{self.radii[1]} m; give a smaller radius"
            )

    @classmethod
    def sized(cls, height: float = 1.75, thickness: str = "conservative") -> "HumanArm":
        """Return the arm of a person of `height` [m].

        Segment lengths are fractions of the height; thickness hardly depends on it
        (correlation 0.2 to 0.4), so that it is chosen by name.

        Args:
            height: Body height [m], 1.2 to 2.2.
            thickness: "conservative" (thick man, clothed) or "mean".

        Raises:
            BadInput: The height is out of range or the thickness unknown.
        """
        check_height(height, "give the arm its own lengths and radii instead")
        _, forearm, upper_arm, *_ = RADII[check_thickness(thickness, "an arm")]
        lengths = np.array([UPPER_ARM, FOREARM + HAND]) * height
        return cls(lengths, np.array([upper_arm, forearm]))

    @property
    def reach(self) -> float:
        """Largest distance of the shoulder from the end of the second axis [m]."""
        return float(self.lengths[0] + self.lengths[1] - self.radii[1])

    def capsules(self, T_base_shoulder: np.ndarray, angles: np.ndarray) -> np.ndarray:
        """Return upper arm and forearm as closed capsules (2, 7) a, b, radius [m].

        `T_base_shoulder` (4, 4) is the shoulder frame in the robot's base; `angles`
        (4,) are flexion (arm forward), abduction (to the left), rotation about the
        upper arm and elbow flexion [rad]. The second one's round end touches the finger
        tips from inside.
        """
        # plain floats where they are the same: arrays of three take ten times as long
        angles = np.asarray(angles, float)
        cf, ca, cr, ce = np.cos(angles).tolist()
        sf, sa, sr, se = np.sin(angles).tolist()
        raised = [[cf, -sf * sa, -sf * ca], [0.0, ca, -sa], [sf, cf * sa, cf * ca]]
        turn = [[cr, -sr, 0.0], [sr, cr, 0.0], [0.0, 0.0, 1.0]]
        R = np.array(raised).dot(np.array(turn))
        upper, fore = self.lengths.tolist()
        radii = self.radii.tolist()
        fore -= radii[1]
        elbow = [0.0 - upper * z for z in R[:, 2].tolist()]
        bent = R.dot(np.array([-se, 0.0, ce])).tolist()
        tips = [p - fore * z for p, z in zip(elbow, bent, strict=True)]
        T = np.asarray(T_base_shoulder, float)
        joints = moved_points(np.array([[0.0, 0.0, 0.0], elbow, tips]), T).tolist()
        return np.array(
            [
                [*joints[0], *joints[1], radii[0]],
                [*joints[1], *joints[2], radii[1]],
            ]
        )


def facing_robot(p_base_shoulder: np.ndarray) -> np.ndarray:
    """Return T_base_shoulder, (4, 4), of a person who looks along -x of the base."""
    return pose_of(p_base_shoulder, (0.0, 0.0, np.pi))
