"""How fast each pair of a robot's sphere and a person's capsule may come together."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap.compiling.jit_options import INNER, LEAN
from roadmap.geometry._gaps import nearest
from roadmap.kinematics._forward import body_frames, place_points

_STILL = 1e-9  # [rad or m] of a step: no joint moves


class Mover(NamedTuple):
    """A robot whose speed is limited, and scratch."""

    tree_i: np.ndarray
    tree_f: np.ndarray
    spheres: np.ndarray  # (n, 4) of the cover
    body: np.ndarray  # (n,) of each
    max_velocity: np.ndarray  # (dof,) [rad/s or m/s]
    moving: np.ndarray  # (i,) which spheres joints move
    q: np.ndarray  # (dof,)
    frames: np.ndarray  # (bodies, 12)
    balls: np.ndarray  # (n, 4), whose radii are those of `spheres`
    ahead: np.ndarray  # (n, 3)


@njit(**LEAN)
def share_along(robot, here, step, speed_scale, person, hands, rule):
    """Return the share of `speed_scale` that a robot may use along a step.

    From `here` (dof,) by `step` (dof,) [rad or m]; `person` is capsules and rates, and
    the rest as `allowed_share` takes it. 1 where no joint moves.
    """
    far = 0.0
    for j in range(len(step)):
        far = max(far, abs(step[j]))
    if not far > _STILL:
        return 1.0
    full = math.inf
    for j in range(len(step)):
        if step[j] != 0.0:
            full = min(full, speed_scale * robot.max_velocity[j] / abs(step[j]))
    # a small step, so that the velocities are those of this moment
    short = 1e-3 / far
    place_both(robot, here, step, short)
    rate = full / short
    moves = robot.balls, robot.ahead, rate, robot.moving
    return allowed_share(*moves, person[0], person[1], hands, rule)


@njit(**LEAN)
def fastest_near(robot, q, direction, hands, near, small):
    """Return the highest speed of the points of a robot that are near a hand.

    It goes from q (dof,) along `direction` (dof,), and speeds are by `small` of that;
    `hands` (k, 7) [m] are near within `near` [m]. 0 where no point is.
    """
    place_both(robot, q, direction, small)
    balls, ahead, most = robot.balls, robot.ahead, 0.0
    for i in robot.moving:
        x, y, z = balls[i, 0], balls[i, 1], balls[i, 2]
        for k in range(len(hands)):
            far = nearest(x, y, z, hands[k])[1]
            if far - hands[k, 6] - balls[i, 3] < near:
                vx, vy = (ahead[i, 0] - x) / small, (ahead[i, 1] - y) / small
                vz = (ahead[i, 2] - z) / small
                # in the order in which numpy adds, for the same bytes as ever
                most = max(most, vx * vx + vz * vz + vy * vy)
                break
    return math.sqrt(most)


@njit(**INNER)
def place_both(robot, q, direction, share):
    """Write where the spheres are at q, and at a share of the way along a direction."""
    for j in range(len(q)):
        robot.q[j] = q[j] + share * direction[j]
    body_frames(robot.tree_i, robot.tree_f, q, robot.frames)
    place_points(robot.frames, robot.body, robot.spheres, robot.balls)
    body_frames(robot.tree_i, robot.tree_f, robot.q, robot.frames)
    place_points(robot.frames, robot.body, robot.spheres, robot.ahead)


@njit(**INNER)
def allowed_share(balls, ahead, rate, moving, capsules, rates, hands, rule):
    """Return the share of a motion's speed that all pairs allow, at most 1.

    Args:
        balls: (n, 4) the robot's spheres: centre and radius [m].
        ahead: (n, 3) their centres a little farther along the motion [m].
        rate: How often in a second the motion goes that far, at full speed [1/s].
        moving: (i,) which of the spheres count.
        capsules: (k, 7) the person: a, b, radius [m].
        rates: (k, 6) velocities of a and b [m/s]; NaN where they are not known.
        hands: (j, 7) capsules of the hands that take part [m].
        rule: (9,) reaction and stopping time [s], distance that is lost to errors [m],
            least speed that is always allowed, speed of what is not known [m/s]; how
            near to a hand is near [m], and the speed allowed there [m/s]; the same two
            of any capsule.
    """
    share, least = 1.0, rule[3]
    for i in moving:
        x, y, z = balls[i, 0], balls[i, 1], balls[i, 2]
        vx, vy, vz = ahead[i, 0] - x, ahead[i, 1] - y, ahead[i, 2] - z
        vx, vy, vz = vx * rate, vy * rate, vz * rate
        speed = math.sqrt(vx * vx + vy * vy + vz * vz)
        place, velocity = (x, y, z, balls[i, 3]), (vx, vy, vz, speed)
        if speed > least:
            for k in range(len(capsules)):
                one = _pair_share(place, velocity, capsules[k], rates[k], rule)
                share = min(share, one)
        if speed * share > rule[6]:
            for k in range(len(hands)):
                far = nearest(x, y, z, hands[k])[1]
                if far - hands[k, 6] - balls[i, 3] < rule[5]:
                    share = rule[6] / speed
                    break
    return share


@njit(**INNER)
def _pair_share(place, velocity, rod, rates, rule):
    """Return the share of its speed that one ball may have for one capsule."""
    reaction, stopping, lost = rule[0], rule[1], rule[2]
    least, coming = rule[3], rule[4]
    t, far = nearest(place[0], place[1], place[2], rod)
    vx, vy, vz, toward = velocity
    gap = far - rod[6] - place[3]
    if far > 1e-9:
        nx = (rod[0] + t * (rod[3] - rod[0]) - place[0]) / far
        ny = (rod[1] + t * (rod[4] - rod[1]) - place[1]) / far
        nz = (rod[2] + t * (rod[5] - rod[2]) - place[2]) / far
        toward = vx * nx + vy * ny + vz * nz
        px = rates[0] + t * (rates[3] - rates[0])
        py = rates[1] + t * (rates[4] - rates[1])
        pz = rates[2] + t * (rates[5] - rates[2])
        known = -(px * nx + py * ny + pz * nz)
        if known == known:
            coming = max(known, 0.0)
    beside = rule[8] / velocity[3] if gap < rule[7] else 1.0
    if not toward > least:
        return beside
    room = gap - coming * (reaction + stopping) - lost
    may = max(room / (reaction + 0.5 * stopping), least)
    return min(may / toward, beside)
