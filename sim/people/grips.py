"""Places that a person's hand reaches, by drawing postures of the arm."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from handover import Human


def grip_points(human: "Human", samples: int) -> "np.ndarray":
    """Return (samples, 3) places the right grip can be at, shoulder frame [m].

    Every second joint value is an end of its range; always the same samples.
    """
    import numpy as np

    from handover.human._human_arm import arm_poses

    arm, rng = human.arm("right"), np.random.default_rng(0)
    q = rng.uniform(arm.lower, arm.upper, (samples, 7))
    ends = np.where(rng.random(q.shape) < 0.5, arm.lower, arm.upper)
    q = np.where(rng.random(q.shape) < 0.5, ends, q)
    # straight arms reach furthest: let some be exactly that
    q[: samples // 4, 3:] = [max(0.0, arm.lower[3]), 0.0, 0.0, 0.0]
    q[: samples // 4, :3] = rng.uniform(arm.lower, arm.upper, (samples // 4, 7))[:, :3]
    poses = np.empty((samples, 12))
    arm_poses(arm.packed, q, poses)
    return poses[:, 9:]
