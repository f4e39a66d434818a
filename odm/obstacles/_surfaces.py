"""Patterns of points on closed surfaces of revolution with a proved covering radius.

Tube. Rings of k points at axial distance d, each turned by half a step against the
next. With alpha = pi / k and the squared chord C = (2 r sin(alpha / 2))^2, a point of
the tube between a ring point (0, 0) and the next ring's (alpha, d) is, on the line
where both are equally far (angle s = phi - alpha / 2), at squared distance

    2 r^2 (1 - cos s cos(alpha / 2)) + d^2 / 4 + (2 r^2 sin(alpha / 2) sin s / d)^2,

which is even and grows with |s|; towards its ends it is (d + C / d)^2 / 4 where
C <= d^2, and at most C otherwise. So rho holds if C <= rho^2 and
d <= rho + sqrt(rho^2 - C).

Cap. A ring of k points covers, at *every* azimuth, the colatitudes (radii on a flat
cap) at which the farthest azimuth, half a step away, is within rho: an interval, since
that distance has one minimum along the meridian. Intervals from the rim to the pole
without a gap cover the cap, whatever the rings' phases are.
"""

import heapq
import math

import numpy as np
from numba import njit

from roadmap.compiling.jit_options import FULL, FULL_INNER, INNER

# the patterns aim a little below the spacing, so that rounding stays inside it
SHRINK = 1.0 - 1e-9


@njit(**INNER)
def tube_step(radius, k, rho):
    """Return the largest axial distance of two rings of k points; -1 if none holds."""
    half = math.sin(math.pi / (2.0 * k))
    slack = rho * rho - 4.0 * radius * radius * half * half
    if slack < 0.0:
        return -1.0
    return rho + math.sqrt(slack)


@njit(**INNER)
def round_reach(at, cos_step, chord):
    """Return the colatitudes (low, high) a ring at `at` covers; low > high: none."""
    a, b = math.cos(at), math.sin(at) * cos_step
    size = math.sqrt(a * a + b * b)
    need = 1.0 - 0.5 * chord * chord
    if need <= -size:
        return 0.0, math.pi
    if need > size:
        return 1.0, 0.0
    middle, width = math.atan2(b, a), math.acos(need / size)
    return middle - width, middle + width


@njit(**INNER)
def flat_reach(at, cos_step, chord):
    """Return the radii (low, high) a ring at `at` covers; low > high: none."""
    slack = chord * chord - at * at * (1.0 - cos_step * cos_step)
    if slack < 0.0:
        return 1.0, 0.0
    width = math.sqrt(slack)
    return at * cos_step - width, at * cos_step + width


@njit(**INNER)
def next_ring(flat, top, chord):
    """Choose the ring that continues a cap covered down to `top`.

    Returns:
        Points k, position of the ring, and the end of its interval. k is 1 for the
        pole. The choice is the least k plus an estimate for the rest.
    """
    pole = chord if flat else 2.0 * math.asin(min(1.0, 0.5 * chord))
    if top <= pole:
        return 1, 0.0, 0.0
    size = top if flat else math.sin(top)
    need = min(1.0, chord / size)
    first = max(3, int(math.pi / math.asin(need)))
    best, best_k, best_at, best_low = np.inf, 0, 0.0, top
    for k in range(first, 2 * first + 4):
        step = math.cos(math.pi / k)
        # seen from a point at `top`, the ring lies at the near end of its own reach
        reach = flat_reach(top, step, chord) if flat else round_reach(top, step, chord)
        at = reach[0]
        if reach[0] > reach[1] or at <= 0.0 or at >= top:
            continue
        back = flat_reach(at, step, chord) if flat else round_reach(at, step, chord)
        low = back[0]
        if back[1] < top - 1e-9 or low >= top:
            continue
        cost = float(k)
        if low > pole:
            area = low * low if flat else 2.0 - 2.0 * math.cos(low)
            cost += max(2.0, math.pi * area / (2.0 * chord * chord))
        elif low > 0.0:
            cost += 1.0
        if cost < best:
            best, best_k, best_at, best_low = cost, k, at, low
    return best_k, best_at, best_low


@njit(**INNER)
def walk_cap(flat, k_rim, chord, out, start):
    """Count the points of a unit cap within its rim ring; write them if there is room.

    A disc where it is flat, else a hemisphere; the tube provides the `k_rim` points of
    the rim ring. `chord` is the covering radius over the radius. They go to rows of
    `out` from `start` on: radial x, radial y, height; no rows: they are only counted.
    """
    top = 0.0
    if k_rim >= 3:  # a rim of one or two points holds only if it covers the whole cap
        step = math.cos(math.pi / k_rim)
        if flat:
            top = flat_reach(1.0, step, chord)[0]
        else:
            top = round_reach(0.5 * math.pi, step, chord)[0]
    n = 0
    while top > 0.0:
        k, at, low = next_ring(flat, top, chord)
        if out.shape[0] > 0:
            size = at if flat else math.sin(at)
            height = 0.0 if flat else math.cos(at)
            for i in range(k):
                angle = 2.0 * math.pi * i / k
                out[start + n + i, 0] = size * math.cos(angle)
                out[start + n + i, 1] = size * math.sin(angle)
                out[start + n + i, 2] = height
        n += k
        top = low
    return n


@njit(**FULL_INNER)
def plan_tube(flat, radius, length, rho):
    """Return points per ring, number of rings, and points of one cap: fewest in all."""
    k = 1
    if 2.0 * radius > rho:
        k = max(1, int(math.pi / (2.0 * math.asin(rho / (2.0 * radius)))) - 1)
    while tube_step(radius, k, rho) < 0.0:
        k += 1
    nothing = np.empty((0, 3))
    best, best_k, best_rings, best_cap = -1, 0, 0, 0
    last = k + max(4, k // 2)
    while k <= last:
        rings = 1
        if length > 0.0:
            rings = 1 + max(1, int(math.ceil(length / tube_step(radius, k, rho))))
        if best < 0 or k * rings < best:
            cap = walk_cap(flat, k, rho / radius, nothing, 0)
            total = k * rings + 2 * cap
            if best < 0 or total < best:
                best, best_k, best_rings, best_cap = total, k, rings, cap
        k += 1
    return best_k, best_rings, best_cap


@njit(**INNER)
def tube_frame(rod, frame):
    """Write two normals and the axis of a rod to `frame`; return its length."""
    x, y, z = rod[3] - rod[0], rod[4] - rod[1], rod[5] - rod[2]
    length = math.sqrt(x * x + y * y + z * z)
    if length > 1e-12:
        x, y, z = x / length, y / length, z / length
    else:
        x, y, z, length = 0.0, 0.0, 1.0, 0.0
    # a normal from the axis's smallest component never degenerates
    if abs(x) <= abs(y) and abs(x) <= abs(z):
        u, v, w = 0.0, -z, y
    elif abs(y) <= abs(z):
        u, v, w = z, 0.0, -x
    else:
        u, v, w = -y, x, 0.0
    size = math.sqrt(u * u + v * v + w * w)
    u, v, w = u / size, v / size, w / size
    frame[0, 0], frame[0, 1], frame[0, 2] = u, v, w
    frame[1, 0], frame[1, 1] = y * w - z * v, z * u - x * w
    frame[1, 2] = x * v - y * u
    frame[2, 0], frame[2, 1], frame[2, 2] = x, y, z
    return length


@njit(**INNER)
def write_rod(flat, radius, length, plan, rho, points, start):
    """Write the pattern of a rod along z, its end a at 0; return the next free row."""
    k, rings, cap = plan
    n = start
    for ring in range(rings):
        for j in range(k):
            angle = (2.0 * j + ring % 2) * math.pi / k
            points[n, 0] = radius * math.cos(angle)
            points[n, 1] = radius * math.sin(angle)
            points[n, 2] = 0.0 if ring == 0 else length * ring / (rings - 1.0)
            n += 1
    for end in range(2):
        if cap > 0:
            walk_cap(flat, k, rho / radius, points, n)
        for j in range(n, n + cap):
            points[j, 0] *= radius
            points[j, 1] *= radius
            height = radius * points[j, 2]
            points[j, 2] = -height if end == 0 else length + height
        n += cap
    return n


@njit(**FULL)
def sample_rods(flat, rods, spacing):
    """Return points (n, 3) on capsules, or on `flat`-ended cylinders, (k, 7).

    Their covering radius is at most `spacing` [m].
    """
    rho = spacing * SHRINK
    plans = np.empty((rods.shape[0], 3), np.int64)
    frame = np.empty((3, 3))
    n = 0
    for i in range(rods.shape[0]):
        length = tube_frame(rods[i], frame)
        plan = plan_tube(flat, rods[i, 6], length, rho)
        plans[i, 0], plans[i, 1], plans[i, 2] = plan
        n += plan[0] * plan[1] + 2 * plan[2]
    points = np.empty((n, 3))
    n = 0
    for i in range(rods.shape[0]):
        length = tube_frame(rods[i], frame)
        first = n
        n = write_rod(flat, rods[i, 6], length, plans[i], rho, points, first)
        for j in range(first, n):
            x, y, z = points[j, 0], points[j, 1], points[j, 2]
            for c in range(3):
                points[j, c] = (
                    rods[i, c] + x * frame[0, c] + y * frame[1, c] + z * frame[2, c]
                )
    return points


@njit(**FULL)
def cover_lists(pairs, centers, radii, reach):
    """Return which balls each ball covers, and which cover it, as lists (CSR).

    A ball covers itself, and another one that lies within `reach` of its own centre.

    Args:
        pairs: (m, 2) balls that may cover each other: each two once, in any order.
        centers: (n, 3) [m].
        radii: (n,) [m].
        reach: How far around its centre a ball covers [m].

    Returns:
        Where the list of each ball begins, and the end, (n + 1,), and the balls named,
        ascending in each list; then the same of those that cover it.
    """
    n, m = radii.shape[0], pairs.shape[0]
    fits, ptr = np.zeros((m, 2), np.bool_), np.zeros(n + 1, np.int64)
    for k in range(m):
        total = 0.0
        for c in range(3):
            apart = centers[pairs[k, 0], c] - centers[pairs[k, 1], c]
            total += apart * apart
        for side in range(2):
            if math.sqrt(total) + radii[pairs[k, 1 - side]] <= reach:
                fits[k, side] = True
                ptr[pairs[k, side] + 1] += 1
    for i in range(n):
        ptr[i + 1] += ptr[i] + 1
    covers, free = np.empty(ptr[n], np.int64), ptr.copy()
    for i in range(n):
        covers[free[i]] = i
        free[i] += 1
    for k in range(m):
        for side in range(2):
            if fits[k, side]:
                i = pairs[k, side]
                covers[free[i]] = pairs[k, 1 - side]
                free[i] += 1
    back_ptr, covered_by = turned_lists(ptr, covers)
    ptr, covers = turned_lists(back_ptr, covered_by)  # once more: ascending
    return ptr, covers, back_ptr, covered_by


@njit(**FULL_INNER)
def turned_lists(ptr, named):
    """Return the lists (CSR) of what names each of n things, ascending."""
    n = ptr.shape[0] - 1
    back_ptr, by = np.zeros(n + 1, np.int64), np.empty(named.shape[0], np.int64)
    for at in range(named.shape[0]):
        back_ptr[named[at] + 1] += 1
    for i in range(n):
        back_ptr[i + 1] += back_ptr[i]
    free = back_ptr.copy()
    for i in range(n):
        for at in range(ptr[i], ptr[i + 1]):
            by[free[named[at]]] = i
            free[named[at]] += 1
    return back_ptr, by


@njit(**FULL)
def greedy_cover(ptr, covers, back_ptr, covered_by, weight, chosen):
    """Choose rows until every column is covered, by the weight each newly covers.

    `ptr`, `covers` are the columns of each row (CSR), its own among them; `back_ptr`,
    `covered_by` the rows of each column; `weight` (n,) is above 0. The rows chosen are
    written to `chosen` (n,), first to last, and their number is returned.
    """
    n = weight.shape[0]
    gain = np.zeros(n)
    missing = np.ones(n, np.bool_)
    for i in range(n):
        for at in range(ptr[i], ptr[i + 1]):
            gain[i] += weight[covers[at]]
    queue = [(-gain[i], i) for i in range(n)]
    heapq.heapify(queue)
    n_chosen = 0
    while len(queue) > 0:
        value, best = heapq.heappop(queue)
        # gains only fall: an entry that is up to date is the largest
        if -value > gain[best]:
            heapq.heappush(queue, (-gain[best], best))
            continue
        fresh = False
        for at in range(ptr[best], ptr[best + 1]):
            j = covers[at]
            if missing[j]:
                missing[j] = False
                fresh = True
                for back in range(back_ptr[j], back_ptr[j + 1]):
                    gain[covered_by[back]] -= weight[j]
        if fresh:
            chosen[n_chosen] = best
            n_chosen += 1
    return n_chosen
