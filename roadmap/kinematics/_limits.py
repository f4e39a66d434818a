"""How far out joint values may be: shared by compiled loops and Python."""

LIMIT_TOLERANCE = 1e-3  # [rad or m] a start this far outside its limits is tolerated
# [rad] of a joint that turns without end: at 1e8 numbers are 1.5e-8 apart, and farther
# out the sum of a place and a motion is another place
MOST_TURNED = 1e8
