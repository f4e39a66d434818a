"""How fast each pair of a robot's sphere and a person's capsule may come together."""

import math

from numba import njit

from roadmap.jit_options import LEAN


@njit(**LEAN)
def allowed_share(centers, moved, radii, capsules, rates, rule):
    """Return the share of a motion's speed that all pairs allow, at most 1.

    Args:
        centers: (n, 3) centres of the robot's spheres [m].
        moved: (n, 3) their velocities at full speed [m/s].
        radii: (n,) radii of the spheres [m].
        capsules: (k, 7) the person: a, b, radius [m].
        rates: (k, 6) velocities of a and b [m/s]; NaN where they are not known.
        rule: (5,) reaction and stopping time [s], distance that is lost to errors [m],
            least speed that is always allowed, speed of what is not known [m/s].
    """
    reaction, stopping, lost, least, unknown = rule
    share = 1.0
    for k in range(len(capsules)):
        ax, ay, az, bx, by, bz, radius = capsules[k]
        ux, uy, uz = bx - ax, by - ay, bz - az
        length = ux * ux + uy * uy + uz * uz
        for i in range(len(centers)):
            vx, vy, vz = moved[i]
            speed = math.sqrt(vx * vx + vy * vy + vz * vz)
            if not speed > least:
                continue
            cx, cy, cz = centers[i]
            t = 0.0
            if length > 0.0:
                t = ((cx - ax) * ux + (cy - ay) * uy + (cz - az) * uz) / length
                t = min(1.0, max(0.0, t))
            nx, ny, nz = ax + t * ux - cx, ay + t * uy - cy, az + t * uz - cz
            far = math.sqrt(nx * nx + ny * ny + nz * nz)
            gap = far - radius - radii[i]
            toward, coming = speed, unknown
            if far > 1e-9:
                nx, ny, nz = nx / far, ny / far, nz / far
                toward = vx * nx + vy * ny + vz * nz
                rate = rates[k]
                px = rate[0] + t * (rate[3] - rate[0])
                py = rate[1] + t * (rate[4] - rate[1])
                pz = rate[2] + t * (rate[5] - rate[2])
                known = -(px * nx + py * ny + pz * nz)
                if known == known:
                    coming = max(known, 0.0)
            if not toward > least:
                continue
            room = gap - coming * (reaction + stopping) - lost
            may = max(room / (reaction + 0.5 * stopping), least)
            share = min(share, may / toward)
    return share
