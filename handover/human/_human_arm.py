"""A human arm's forward kinematics and Jacobian: seven hinges, one form for both sides.

Everything is in the *canonical shoulder frame*: origin in the shoulder's centre, x to
the front, y to the body's middle, z up the trunk. For the right arm it is the trunk's
own frame, for the left one its mirror image, so that one arm serves both sides.

`arm` is one flat array, `packed_arm` in `handover/human/human_arm.py` fills it: three
lengths (shoulder to elbow, elbow to wrist, wrist to grip), lower and upper ends of the
seven ranges, and the sines and cosines of these ends.
"""

import math

from numba import njit

from roadmap.compiling.jit_options import BARE, BARE_INNER

LENGTHS, LOWER, UPPER = 0, 3, 10
SIN_LOWER, COS_LOWER, SIN_UPPER, COS_UPPER = 17, 24, 31, 38
ARM_SIZE = 45


@njit(**BARE)
def arm_axes(q):
    """Return the arm's directions at `q`, 21 numbers: e, u, elbow, v, d, w, h.

    u, v, h (from shoulder to elbow, elbow to wrist, wrist to fingers) and the axes of
    elbow, deviation and wrist flexion. The shoulder's three axes are (0, -1, 0),
    -(cos f, 0, sin f) and -u, the forearm's is -v.
    """
    cf, sf = math.cos(q[0]), math.sin(q[0])
    ca, sa = math.cos(q[1]), math.sin(q[1])
    cr, sr = math.cos(q[2]), math.sin(q[2])
    ce, se = math.cos(q[3]), math.sin(q[3])
    cp, sp = math.cos(q[4]), math.sin(q[4])
    cd, sd = math.cos(q[5]), math.sin(q[5])
    cw, sw = math.cos(q[6]), math.sin(q[6])
    # columns a, b, c of R = Ry(-f) Rx(-a) Rz(r)
    ax, ay, az = cf * cr + sf * sa * sr, ca * sr, sf * cr - cf * sa * sr
    bx, by, bz = sf * sa * cr - cf * sr, ca * cr, -sf * sr - cf * sa * cr
    cx, cy, cz = -sf * ca, sa, cf * ca
    # the elbow bends by Ry(-e)
    gx, gy, gz = ax * ce + cx * se, ay * ce + cy * se, az * ce + cz * se
    kx, ky, kz = cx * ce - ax * se, cy * ce - ay * se, cz * ce - az * se
    # the forearm turns by Rz(p)
    mx, my, mz = gx * cp + bx * sp, gy * cp + by * sp, gz * cp + bz * sp
    nx, ny, nz = bx * cp - gx * sp, by * cp - gy * sp, bz * cp - gz * sp
    # the wrist deviates by Ry(-d), then flexes by Rx(w)
    ox, oy, oz = mx * cd + kx * sd, my * cd + ky * sd, mz * cd + kz * sd
    px, py, pz = kx * cd - mx * sd, ky * cd - my * sd, kz * cd - mz * sd
    hx, hy, hz = nx * sw - px * cw, ny * sw - py * cw, nz * sw - pz * cw
    return (
        (-cx, -cy, -cz),
        (-bx, -by, -bz),
        (-kx, -ky, -kz),
        (-nx, -ny, -nz),
        (ox, oy, oz),
        (hx, hy, hz),
        (cf, sf),
    )


@njit(**BARE)
def arm_pose(arm, q, pose):
    """Write T_shoulder_hand to `pose` (12,): rotation (9, by rows), origin (3).

    The hand frame sits at the grip: x out of the palm, z towards the fingers, y = z x x
    (towards the thumb of a right hand).
    """
    u, _, v, _, w, h, _ = arm_axes(q)
    for i in range(3):
        # the wrist's axis is the hand's y; x = y x z
        j, k = (i + 1) % 3, (i + 2) % 3
        pose[3 * i] = w[j] * h[k] - w[k] * h[j]
        pose[3 * i + 1] = w[i]
        pose[3 * i + 2] = h[i]
        pose[9 + i] = arm[0] * u[i] + arm[1] * v[i] + arm[2] * h[i]


@njit(**BARE)
def arm_poses(arm, joints, poses):
    """Write `arm_pose` of every row of joints (n, 7) to poses (n, 12)."""
    for i in range(joints.shape[0]):
        arm_pose(arm, joints[i], poses[i])


@njit(**BARE)
def arm_jacobian(arm, q, jacobian):
    """Write the Jacobian (6, 7) at the grip: its velocity (3), then the hand's spin."""
    u, elbow, v, d, w, h, (cf, sf) = arm_axes(q)
    axes = (
        (0.0, -1.0, 0.0),
        (-cf, 0.0, -sf),
        (-u[0], -u[1], -u[2]),
        elbow,
        (-v[0], -v[1], -v[2]),
        d,
        w,
    )
    for n in range(7):
        # lever: from a point on the axis to the grip
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            lj, lk = arm[2] * h[j], arm[2] * h[k]
            if n < 4:
                lj += arm[1] * v[j]
                lk += arm[1] * v[k]
            if n < 3:
                lj += arm[0] * u[j]
                lk += arm[0] * u[k]
            jacobian[i, n] = axes[n][j] * lk - axes[n][k] * lj
            jacobian[3 + i, n] = axes[n][i]


@njit(**BARE)
def body_places(given, T_pelvis, T_chest, left, right, places):
    """Write the places of a person's joints, world frame, to places (11, 3) [m].

    In the order of `handover.human.body.JOINTS`: hip, neck, head, then shoulder, elbow,
    wrist and tip of the left arm and of the right one.

    Args:
        given: (23,) hip in the pelvis frame; neck in the chest frame, and from there
            the skull; both shoulders; the arms' three lengths [m]; and how far each tip
            is from the wrist, as a share of the last length.
        T_pelvis: (4, 4) pose of the pelvis [m].
        T_chest: (4, 4) pose of the chest [m].
        left: (7,) joints of the left arm [rad].
        right: (7,) joints of the right one.
        places: Result.
    """
    p, c = T_pelvis, T_chest
    for i in range(3):
        hip = p[i, 0] * given[0] + p[i, 1] * given[1] + p[i, 2] * given[2]
        neck = c[i, 0] * given[3] + c[i, 1] * given[4] + c[i, 2] * given[5]
        skull = c[i, 0] * given[6] + c[i, 1] * given[7] + c[i, 2] * given[8]
        places[0, i] = p[i, 3] + hip
        places[1, i] = c[i, 3] + neck
        places[2, i] = places[1, i] + skull
    for side in range(2):
        u, _, v, _, _, h, _ = arm_axes(left if side == 0 else right)
        at, far = 9 + 3 * side, 15 + 3 * side
        mirror = 1.0 if side == 1 else -1.0
        x, y, z = given[at], given[at + 1], given[at + 2]
        row = 3 + 4 * side
        for step in range(4):
            if step > 0:
                d = u if step == 1 else (v if step == 2 else h)
                long = given[far + step - 1] * (given[21 + side] if step == 3 else 1.0)
                x, y, z = x + long * d[0], y + mirror * long * d[1], z + long * d[2]
            for i in range(3):
                there = c[i, 0] * x + c[i, 1] * y + c[i, 2] * z
                places[row + step, i] = c[i, 3] + there


@njit(**BARE_INNER)
def write_axis(p, q, out):
    """Write the direction from q to p, straight up where there is none; their distance.

    p, q: (3,) [m]. out: (3,).
    """
    x, y, z = p[0] - q[0], p[1] - q[1], p[2] - q[2]
    length = math.sqrt(x * x + y * y + z * z)
    if not length > 1e-9:
        out[0], out[1], out[2] = 0.0, 0.0, 1.0
        return length
    out[0], out[1], out[2] = x / length, y / length, z / length
    return length


@njit(**BARE)
def body_rods(places, limbs, lengths, legs, T_pelvis, rows):
    """Write the ends of a whole person's capsules to rows (9 + n, 7) [m].

    In order: hand, forearm and upper arm of both sides, torso, shoulders, head, legs.

    Args:
        places: (11, 3) of `handover.human.body.JOINTS`, z is up [m].
        limbs: (7, 2) joints at the ends of the rods of arms, and across the shoulders.
        lengths: (2,) most that the torso's axis reaches down from the neck, and least
            that the head's reaches up from it [m].
        legs: (n, 7) capsules of the legs in the pelvis frame [m].
        T_pelvis: (4, 4) pose of the pelvis [m].
        rows: Result; its radii stay.
    """
    for i in range(7):
        row = 7 if i == 6 else i
        for a in range(3):
            rows[row, a] = places[limbs[i, 0], a]
            rows[row, 3 + a] = places[limbs[i, 1], a]
    hip, neck, head, axis = places[0], places[1], places[2], rows[8, 3:6]
    length = write_axis(neck, hip, axis)
    below = min(length, lengths[0])
    for a in range(3):
        rows[6, a], rows[6, 3 + a] = hip[a], neck[a] - below * axis[a]
    reach = max(write_axis(head, neck, axis), lengths[1])
    for a in range(3):
        rows[8, a], axis[a] = neck[a], neck[a] + reach * axis[a]
    for i in range(legs.shape[0]):
        for end in range(2):
            for a in range(3):
                at = T_pelvis[a, 3]
                for b in range(3):
                    at += T_pelvis[a, b] * legs[i, 3 * end + b]
                rows[9 + i, 3 * end + a] = at
