"""What cells that are not seen now still count as: memory, growing with its age."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from odm.cameras._seen import FREE, UNSEEN
from roadmap.compiling._rows import copy_row
from roadmap.compiling.jit_options import INNER, LEAN

WAS_FREE, WAS_BLOCKED = 1, 2  # last content of a cell that is not seen now
GO_FREE, GO_OCCUPIED, GO_ON = 0, 1, 2  # policies


class Kept(NamedTuple):
    """What cells held when they were seen last; see `note_content`."""

    kept8: np.ndarray  # (n / 8,) `kept`, eight cells at a time
    kept: np.ndarray  # (n,)
    since: np.ndarray  # (n,) [s]


class Ageing(NamedTuple):
    """What becomes of a content that is remembered."""

    memory_s: float  # how long it is kept [s]
    speed: float  # at which it may have moved [m/s]
    h: float  # side of a cell [m]
    policy: int  # what an expired content becomes


class Sources(NamedTuple):
    """Cells by how many cells they are dilated, most first.

    Those dilated by j cells, at most k, are cells[ptr[k - j]:ptr[k - j + 1]].
    """

    cells: np.ndarray  # (n,)
    ptr: np.ndarray  # (k + 2,)


@njit(**LEAN)
def note_content(state8, before8, state, before, kept, since, when):
    """Keep what cells held that were seen in the frame before and are not seen now.

    `state` and `before` (n,) uint8 are what is seen now and was then, at `when` [s];
    `state8` and `before8` (n / 8,) the same, eight cells at a time. `kept` and `since`
    as in `Kept`; 0 is kept of cells seen now or never.
    """
    for w in range(state8.shape[0]):
        if state8[w] == before8[w]:
            continue
        for c in range(8 * w, 8 * w + 8):
            if state[c] == before[c]:
                continue
            if state[c] != UNSEEN:
                kept[c] = 0
            elif before[c] != UNSEEN:
                kept[c] = WAS_FREE if before[c] == FREE else WAS_BLOCKED
                since[c] = when


@njit(**LEAN)
def list_sources(content, now, ageing, sources):
    """List remembered cells by how many cells they are dilated; drop those expired now.

    `now` [s] is by the clock of `since`.
    """
    kept8, kept, since = content
    memory_s, speed, h, policy = ageing
    cells, ptr = sources
    most = ptr.shape[0] - 2
    for j in range(ptr.shape[0]):
        ptr[j] = 0
    for turn in range(2):  # count, then fill
        for w in range(kept8.shape[0]):
            if kept8[w] == 0:
                continue
            for c in range(8 * w, 8 * w + 8):
                if kept[c] != WAS_BLOCKED:
                    continue
                age = now - since[c]
                if age > memory_s:
                    if policy == GO_FREE:
                        kept[c] = 0
                    if policy != GO_ON:
                        continue
                    age = memory_s
                j = min(most, int(math.ceil(speed * age / h - 1e-9)))
                if turn == 0:
                    ptr[most - j + 1] += 1
                else:
                    at = ptr[most - j]
                    cells[at] = c
                    ptr[most - j] = at + 1
        if turn == 0:
            for j in range(most + 1):
                ptr[j + 1] += ptr[j]
    for j in range(most + 1, 0, -1):
        ptr[j] = ptr[j - 1]
    ptr[0] = 0


@njit(**INNER)
def dilate(bits, spare, words):
    """Grow a set of cells by one in all 26 directions.

    `bits` (nx, ny * words) uint64 has 64 cells along z in a word; `spare` is
    overwritten.
    """
    nx, n = bits.shape
    one, last = np.uint64(1), np.uint64(63)
    for x in range(nx):
        row, out = bits[x], spare[x]
        for i in range(n):
            out[i] = row[i] | (row[i] << one) | (row[i] >> one)
        if words > 1:
            for i in range(n):
                if i % words > 0:
                    out[i] |= row[i - 1] >> last
                if i % words < words - 1:
                    out[i] |= row[i + 1] << last
    for x in range(nx):
        row, out = spare[x], bits[x]
        for i in range(n):
            out[i] = row[i]
        for i in range(words, n):
            out[i] |= row[i - words]
        for i in range(n - words):
            out[i] |= row[i + words]
    for x in range(nx):
        row, out = bits[x], spare[x]
        back, on = bits[max(0, x - 1)], bits[min(nx - 1, x + 1)]
        for i in range(n):
            out[i] = row[i] | back[i] | on[i]


@njit(**LEAN)
def grow_sources(sources, ptr, shape, bits, spare):
    """Set `bits` to all sources, each dilated by its own number of cells.

    Those to be dilated most begin; after every dilation the next ones join. What grows
    beyond the grid is cut off only there: no source lies outside. `ptr` as in
    list_sources; `spare` has the shape of `bits` and is overwritten.
    """
    ny, nz = shape[1], shape[2]
    words = bits.shape[1] // ny
    most = ptr.shape[0] - 2
    bits[:] = 0
    for j in range(most + 1):
        for k in range(ptr[j], ptr[j + 1]):
            row, z = sources[k] // nz, sources[k] % nz
            word = np.uint64(1) << np.uint64(z & 63)
            bits[row // ny, (row % ny) * words + (z >> 6)] |= word
        if ptr[j + 1] > 0 and j < most:
            dilate(bits, spare, words)
            for i in range(bits.shape[0]):
                copy_row(spare[i], bits[i])


@njit(**LEAN)
def list_unknown(state, kept, since, now, memory_s, spared, bits):
    """Set `bits` of unseen cells without a fresh content, but for `spared` ones."""
    nx, ny, nz = state.shape
    bits[:] = 0
    for x in range(nx):
        for y in range(ny):
            for z in range(nz):
                if state[x, y, z] != UNSEEN or spared[x, y, z] != 0:
                    continue
                c = (x * ny + y) * nz + z
                if kept[c] == 0 or now - since[c] > memory_s:
                    bits[x, y, z >> 6] |= np.uint64(1) << np.uint64(z & 63)


@njit(**LEAN)
def spare_robot(centers, radii, origin, h, spared):
    """Mark the cells whose cubes come within `radii` (n,) [m] of the centres (n, 3)."""
    nx, ny, nz = spared.shape
    spared[:] = 0
    for n in range(centers.shape[0]):
        r = radii[n]
        cx, cy, cz = centers[n, 0], centers[n, 1], centers[n, 2]
        low_x, low_y, low_z = cx - r - origin[0], cy - r - origin[1], cz - r - origin[2]
        for x in range(max(0, int(low_x / h)), min(nx, int((low_x + 2 * r) / h) + 1)):
            dx = max(0.0, max(origin[0] + h * x - cx, cx - origin[0] - h * (x + 1)))
            for y in range(
                max(0, int(low_y / h)), min(ny, int((low_y + 2 * r) / h) + 1)
            ):
                dy = max(0.0, max(origin[1] + h * y - cy, cy - origin[1] - h * (y + 1)))
                for z in range(
                    max(0, int(low_z / h)), min(nz, int((low_z + 2 * r) / h) + 1)
                ):
                    dz = max(
                        0.0, max(origin[2] + h * z - cz, cz - origin[2] - h * (z + 1))
                    )
                    if dx * dx + dy * dy + dz * dz <= r * r:
                        spared[x, y, z] = 1
