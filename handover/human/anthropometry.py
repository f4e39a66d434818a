"""Numbers of the human body: the one place that holds them, each with its source.

Lengths are fractions of the body height H, masses of the body mass M. Sources: the MMM
reference model of KIT (after Winter, "Biomechanics and Motor Control of Human
Movement", table 4.1), ANSUR II (4082 men, 1986 women, computed from the public files),
AAOS joint ranges (F. A. Davis goniometry appendix, table A.1).
"""

import numpy as np

from roadmap.arrays import frozen
from roadmap.errors import BadInput
from roadmap.ranges import is_between

HEIGHTS = (1.2, 2.2)  # [m] where the fractions still describe an adult

# arm, [Winter, table 4.1]; MMM differs by 1 % at most
UPPER_ARM, FOREARM, HAND = 0.186, 0.146, 0.108
# wrist to the middle of the closed hand: ANSUR II forearm to grip centre 0.197 (mean of
# men and women) less the forearm; this is where an object is held
GRIP = 0.051

# trunk and head, upwards from the pelvis' frame, and sideways [MMM]
PELVIS_TO_TRUNK = 0.060  # the joint that bends pelvis against chest
TRUNK_TO_SHOULDER = 0.188  # centre of the glenohumeral joint, up
SHOULDER_HALF_BREADTH = 0.110  # Winter's 0.129 is the outer shoulder, too wide
TRUNK_TO_NECK = 0.210  # lower neck
NECK_TO_SKULL, NECK_TO_CROWN = 0.030, 0.030 + 0.130
NECK_TO_EYES = 0.096  # up: eyes at 0.936 H (Winter's figure)
EYES_FORWARD = 0.050  # before the head's axis: half of ANSUR II's head length

# legs, downwards from the pelvis' frame [MMM]; the foot's length is Winter's
PELVIS_TO_HIP, HIP_HALF_BREADTH = 0.040, 0.052
TRUNK = PELVIS_TO_HIP + PELVIS_TO_TRUNK + TRUNK_TO_NECK  # hip to lower neck
THIGH, SHANK, ANKLE = 0.245, 0.246, 0.039
FOOT = 0.152  # heel to toes

# masses / M and centres of mass from the near joint / length [Winter, table 4.1]
SEGMENT_MASSES = {"upper arm": 0.028, "forearm": 0.016, "hand": 0.006}
SEGMENT_CENTRES = {"upper arm": 0.436, "forearm": 0.430, "hand": 0.506}
BODY_MASS_INDEX = 24.0  # [kg/m^2] where no mass is given: upper end of normal weight

ARM_JOINTS = (
    "shoulder flexion",
    "shoulder abduction",
    "shoulder internal rotation",
    "elbow flexion",
    "forearm pronation",
    "wrist radial deviation",
    "wrist flexion",
)
# [deg] AAOS. Two are no goniometer figures. Adduction 45 is the weakest source. Raising
# the arm sideways is abduction up to 120 here and, beyond, flexion past 90 with the
# elbow out: in a chain of hinges an abduction of 180 with flexion 90 would point the
# arm straight backwards. 120 with flexion 90 is the arm drawn back 30 behind the
# frontal plane. Ranges are single-axis extremes: people reach less in combination.
_RANGES_DEG = (
    (-60.0, 180.0),
    (-45.0, 120.0),
    (-90.0, 70.0),
    (0.0, 150.0),
    (-80.0, 80.0),
    (-30.0, 20.0),
    (-70.0, 80.0),
)
ARM_RANGES = frozen(np.radians(_RANGES_DEG), np.float64)  # (7, 2) [rad]

# Radii [m]: hand, forearm, upper arm, torso, shoulders, head, thigh, shank, foot. Arm:
# ANSUR II circumferences, 95th percentile of men and 10 mm of clothing, or the mean of
# men. Trunk and head hold its chest breadth 0.289, waist breadth 0.326 and head length
# 0.200 (means of men); "conservative" adds 35 and 20 mm. Legs: no source was at hand;
# estimates from circumferences of about 0.62 m (thigh) and 0.39 m (calf).
RADII = {
    "conservative": (0.060, 0.065, 0.075, 0.200, 0.090, 0.120, 0.115, 0.080, 0.060),
    "mean": (0.044, 0.049, 0.057, 0.165, 0.070, 0.100, 0.099, 0.062, 0.045),
}


def check_height(height: float, instead: str) -> float:
    """Return the body height [m].

    Args:
        height: Body height [m].
        instead: What to do about a person outside `HEIGHTS`; ends the sentence.

    Raises:
        BadInput: It is outside `HEIGHTS`.
    """
    if not is_between(height, *HEIGHTS):
        told = repr(height) if isinstance(height, str) else height
        raise BadInput(
            f"a body height of {told} m is outside {HEIGHTS[0]} to {HEIGHTS[1]} m; "
            f"{instead}"
        )
    return float(height)


def check_thickness(thickness: str, of: str = "a body") -> str:
    """Return the name of a row of `RADII`; BadInput lists the known ones."""
    if thickness not in RADII:
        raise BadInput(
            f"no thickness {thickness!r} of {of}; choose one of {', '.join(RADII)}"
        )
    return thickness
