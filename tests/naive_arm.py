"""Slow twins of the human arm: forward kinematics by matrices, IK by sampling."""

import numpy as np

from roadmap.transforms import rotation_rpy

HAND = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def rot_x(angle):
    return rotation_rpy(angle, 0.0, 0.0)


def rot_y(angle):
    return rotation_rpy(0.0, angle, 0.0)


def rot_z(angle):
    return rotation_rpy(0.0, 0.0, angle)


def naive_fk(lengths, q):
    """Return T_shoulder_hand of a right arm."""
    f, a, r, e, p, d, w = q
    down = np.array([0.0, 0.0, -1.0])
    upper = rot_y(-f) @ rot_x(-a) @ rot_z(r)
    fore = upper @ rot_y(-e)
    hand = fore @ rot_z(p) @ rot_y(-d) @ rot_x(w)
    T = np.eye(4)
    T[:3, :3] = hand @ HAND
    T[:3, 3] = lengths[0] * upper @ down + lengths[1] * fore @ down
    T[:3, 3] += lengths[2] * hand @ down
    return T


def swivels_that_work(lengths, ranges, T, n, slack=0.0):
    """Return phi (n,) and whether each has joints in the ranges, by trying them all.

    Nothing of the kernels' algebra is used: the elbow is put on its circle, the two
    readings of the shoulder's angles and of the wrist's are tried.
    """
    wrist = T[:3, 3] - lengths[2] * T[:3, 2]
    distance = np.linalg.norm(wrist)
    a, b = lengths[:2]
    phi = np.linspace(-np.pi, np.pi, n, endpoint=False)
    cos_e = (distance**2 - a**2 - b**2) / (2 * a * b)
    works = np.zeros(n, bool)
    if abs(cos_e) > 1:
        return phi, works
    e = np.arccos(cos_e)
    w = wrist / distance
    along = (a**2 + distance**2 - b**2) / (2 * distance)
    radius = np.sqrt(max(a**2 - along**2, 0.0))
    up = np.array([0.0, 0.0, 1.0])
    below = -(up - (up @ w) * w)
    below /= np.linalg.norm(below)
    out = np.outer(np.cos(phi), below) + np.outer(np.sin(phi), np.cross(w, below))
    elbow = along * w + radius * out
    z = -elbow / a
    x = (wrist - elbow) / b
    x = x - (x * z).sum(axis=1)[:, None] * z
    x /= np.linalg.norm(x, axis=1)[:, None]
    upper = np.stack([x, np.cross(z, x), z], axis=2)
    return phi, _fits(upper, e, T, ranges, slack)


def _fits(upper, e, T, ranges, slack):
    """Return which upper arms (n, 3, 3) have joints in the ranges, (n,)."""
    hand = rot_y(e) @ upper.transpose(0, 2, 1) @ T[:3, :3] @ HAND.T
    u, h = upper.transpose(1, 2, 0), hand.transpose(1, 2, 0)
    found = np.zeros(len(upper), bool)
    for s in (1, -1):
        q = [
            np.arctan2(-s * u[0, 2], s * u[2, 2]),
            np.arctan2(u[1, 2], s * np.hypot(u[1, 0], u[1, 1])),
            np.arctan2(s * u[1, 0], s * u[1, 1]),
            np.full(len(upper), e),
        ]
        for t in (1, -1):
            wrist = [
                np.arctan2(t * h[1, 0], t * h[0, 0]),
                np.arctan2(h[2, 0], t * np.hypot(h[0, 0], h[1, 0])),
                np.arctan2(t * h[2, 1], t * h[2, 2]),
            ]
            found |= _inside(np.array([*q, *wrist]), ranges, slack)
    return found


def _inside(q, ranges, slack):
    """Return which columns of q (7, n) are in the ranges, whole turns aside."""
    turns = q[:, :, None] + 2 * np.pi * np.array([-1, 0, 1])
    low, high = ranges[:, :1, None] - slack, ranges[:, 1:, None] + slack
    return ((turns >= low) & (turns <= high)).any(axis=2).all(axis=0)


def pinocchio_arm(lengths, masses=None):
    """Return a pinocchio model of the right arm and its data.

    masses: mass and distance of its centre from the near joint, of upper arm, forearm
    and hand [kg, m].
    """
    import pinocchio as pin

    axes = [(0, -1, 0), (-1, 0, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1), (0, -1, 0)]
    axes.append((1, 0, 0))
    drops = {3: lengths[0], 4: lengths[1]}
    model = pin.Model()
    parent = 0
    for n, axis in enumerate(axes):
        at = pin.SE3(np.eye(3), np.array([0.0, 0.0, -drops.get(n, 0.0)]))
        joint = pin.JointModelRevoluteUnaligned(np.array(axis, float))
        parent = model.addJoint(parent, joint, at, f"j{n}")
    tip = pin.SE3(HAND, np.array([0.0, 0.0, -lengths[2]]))
    model.addFrame(pin.Frame("grip", parent, tip, pin.FrameType.OP_FRAME))
    if masses is not None:
        for joint, (mass, centre) in zip((3, 4, 7), masses, strict=True):
            point = pin.Inertia(mass, np.array([0.0, 0.0, -centre]), np.zeros((3, 3)))
            model.appendBodyToJoint(joint, point, pin.SE3.Identity())
    return model, model.createData()
