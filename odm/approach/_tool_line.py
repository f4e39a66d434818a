"""Loops of `odm.approach.tool_line`: follow a tool's line, bound the deviation from it.

Poses are rows of 12 numbers: rotation (9, row-major) and origin (3) [m].
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap.compiling._rows import copy_row
from roadmap.compiling.jit_options import BARE, BARE_INNER
from roadmap.kinematics._chain import ChainArrays, forward, jacobian
from roadmap.kinematics._forward import motion_bounds
from roadmap.kinematics._inverse import Descent, descend
from roadmap.kinematics._six import outer, root_of_determinant

SAMPLES = 4  # parts of a leg between which the deviation is bounded
NEAR = 1e-5  # [m or rad] what counts as reached


class Tool(NamedTuple):
    """A robot's tool, with working memory for one thread."""

    chain: ChainArrays
    rows: np.ndarray  # (k,) places of the chain's joints in q
    limits: np.ndarray  # (dof, 2); infinite where a joint is continuous
    continuous: np.ndarray  # (dof,)
    tree_i: np.ndarray
    tree_f: np.ndarray
    reach: np.ndarray  # (1, n_bodies) of the tool, see `motion_bounds`
    turns: np.ndarray  # (dof,) how much a joint's motion turns the tool
    scale: np.ndarray  # (2,) and goal: see `descend`
    goal: tuple[float, float]
    work: Descent
    trial: np.ndarray  # (k,)
    rates: np.ndarray  # (2, n_bodies) and two (1,): of `motion_bounds`
    first: np.ndarray
    second: np.ndarray
    pose: np.ndarray  # (12,)
    dq: np.ndarray  # (dof,)
    place: np.ndarray  # (dof,)


class LineRows(NamedTuple):
    """A line of the tool; see `odm.approach.tool_line.Line`."""

    begin: np.ndarray  # (12,)
    end: np.ndarray  # (12,)
    turn: np.ndarray  # (3,) rotation vector from the one to the other [rad]


class Asked(NamedTuple):
    """From where to where a line is followed."""

    s_from: float
    s_to: float
    parts: int  # legs at first; each is halved up to four times
    max_m: float  # largest deviation
    max_rad: float


class Followed(NamedTuple):
    """What following a line finds, and room for it."""

    q: np.ndarray  # (n + 1, dof) corners, the first given; behind the last a failed one
    s: np.ndarray  # (n + 1,) share of the line at each
    waiting: np.ndarray  # (m,) shares that are still to be reached
    worst: np.ndarray  # (2,) largest deviation [m], [rad]
    left: np.ndarray  # (2,) what the last descent left [m], [rad]
    tried: np.ndarray  # (1,) descents


@njit(**BARE)
def line_pose(line, s, pose):
    """Write the pose at share s of a line."""
    begin, end, turn = line.begin, line.end, line.turn
    for k in range(3):
        pose[9 + k] = begin[9 + k] + s * (end[9 + k] - begin[9 + k])
    angle = math.sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])
    if angle == 0.0:
        for k in range(9):
            pose[k] = end[k]
        return
    x, y, z = turn[0] / angle, turn[1] / angle, turn[2] / angle
    sine, cosine = math.sin(s * angle), math.cos(s * angle)
    for k in range(3):  # each column turns about the axis (Rodrigues)
        u, v, w = begin[k], begin[3 + k], begin[6 + k]
        along = (1.0 - cosine) * (x * u + y * v + z * w)
        pose[k] = cosine * u + sine * (y * w - z * v) + along * x
        pose[3 + k] = cosine * v + sine * (z * u - x * w) + along * y
        pose[6 + k] = cosine * w + sine * (x * v - y * u) + along * z


@njit(**BARE)
def reach_pose(tool, pose, q, left):
    """Bring q in place to a pose, within limits; write and tell what is left."""
    limits, work, rows, scale = tool.limits, tool.work, tool.rows, tool.scale
    for j in range(q.shape[0]):
        q[j] = min(max(q[j], limits[j, 0]), limits[j, 1])
    for j in range(rows.shape[0]):
        work.q[j] = q[rows[j]]
    descend(tool.chain, pose, scale, tool.goal, work, tool.trial)
    for j in range(rows.shape[0]):
        q[rows[j]] = work.q[j]
    e = work.error
    left[0] = scale[0] * math.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
    left[1] = scale[1] * math.sqrt(e[3] * e[3] + e[4] * e[4] + e[5] * e[5])
    return left[0] <= NEAR and left[1] <= NEAR


@njit(**BARE_INNER)
def place_tool(tool, q):
    """Write the tool's pose at q to the last row of work.frames."""
    rows, work = tool.rows, tool.work
    for j in range(rows.shape[0]):
        work.q[j] = q[rows[j]]
    forward(tool.chain, work.q, work.frames)


@njit(**BARE)
def tool_poses(tool, qs, out):
    """Write the tool's poses (k, 12) at qs (k, dof)."""
    for k in range(qs.shape[0]):
        place_tool(tool, qs[k])
        copy_row(tool.work.frames[-1], out[k])


@njit(**BARE)
def manipulability(tool, q):
    """Return sqrt(det(J J^T)) of the tool's Jacobian at q, of six joints or more."""
    chain, work = tool.chain, tool.work
    place_tool(tool, q)
    jacobian(chain, work.frames, work.jac)
    for j in range(work.jac.shape[1]):
        for i in range(6):
            work.weighted[j, i] = work.jac[i, j]
        work.weighted[j, 6] = 1.0
    outer(work.weighted, 0.0, work.gram)
    return root_of_determinant(work.gram, 0.0)


@njit(**BARE_INNER)
def difference(tool, q_from, q_to, dq):
    """Write q_to - q_from, continuous joints by the shorter turn."""
    for j in range(dq.shape[0]):
        dq[j] = q_to[j] - q_from[j]
        if tool.continuous[j]:
            dq[j] -= 2.0 * math.pi * math.floor(dq[j] / (2.0 * math.pi) + 0.5)


@njit(**BARE)
def leg_error(tool, line, s_a, s_b, q_a, q_b):
    """Bound how far the tool gets from the line on a leg [m], [rad]: `tool_line`."""
    dq, place, pose, at = tool.dq, tool.place, tool.pose, tool.work.frames[-1]
    difference(tool, q_a, q_b, dq)
    off = turned = 0.0
    for k in range(SAMPLES + 1):
        t = k / SAMPLES
        for j in range(dq.shape[0]):
            place[j] = q_a[j] + t * dq[j]
        place_tool(tool, place)
        line_pose(line, s_a + t * (s_b - s_a), pose)
        squares = columns = 0.0
        for i in range(9):
            columns += (at[i] - pose[i]) * (at[i] - pose[i])
        for i in range(9, 12):
            squares += (at[i] - pose[i]) * (at[i] - pose[i])
        off, turned = max(off, math.sqrt(squares)), max(turned, math.sqrt(columns))
    motion_bounds(
        tool.tree_i, tool.tree_f, tool.reach, dq, tool.rates, tool.first, tool.second
    )
    share, w, turn = 1.0 / (8 * SAMPLES**2), 0.0, 0.0
    for j in range(dq.shape[0]):
        w += tool.turns[j] * abs(dq[j])
    for k in range(3):
        turn += line.turn[k] * line.turn[k]
    turn *= (s_b - s_a) * (s_b - s_a)
    turned += share * (math.sqrt(3.0) * 1.5 * w * w + math.sqrt(2.0) * turn)
    angle = 2.0 * math.asin(min(1.0, turned / math.sqrt(8.0)))
    return off + share * tool.second[0], angle


@njit(**BARE)
def follow(tool, line, asked, out):
    """Follow a line from out.q[0]; return the corners written, -n where it stops.

    A leg begins where the leg before would lead on to, and is halved where it leaves
    the line too far; what was halved is not tried at full length again.
    """
    q, s, waiting = out.q, out.s, out.waiting
    span, parts = asked.s_to - asked.s_from, asked.parts
    for k in range(parts):
        waiting[k] = asked.s_from + span * (parts - k) / parts
    smallest, fits = abs(span) / parts / 16.0, 2.0
    s[0], out.worst[0], out.worst[1] = asked.s_from, 0.0, 0.0
    at, left, stepped = 0, parts, False
    while left > 0:
        while abs(waiting[left - 1] - s[at]) > 1.5 * fits:
            waiting[left] = 0.5 * (waiting[left - 1] + s[at])
            left += 1
        share, new = waiting[left - 1], q[at + 1]
        ahead = 0.0
        if stepped:
            difference(tool, q[at - 1], q[at], tool.dq)
            ahead = (share - s[at]) / (s[at] - s[at - 1])
        for j in range(new.shape[0]):
            new[j] = q[at, j]
            if stepped:
                new[j] += tool.dq[j] * ahead
        line_pose(line, share, tool.pose)
        off = angle = math.inf
        out.tried[0] += 1
        if reach_pose(tool, tool.pose, new, out.left):
            off, angle = leg_error(tool, line, s[at], share, q[at], new)
        if off > asked.max_m or angle > asked.max_rad:
            if abs(share - s[at]) > 1.5 * smallest:
                fits = 0.5 * abs(share - s[at])
                continue
            return -(at + 1)
        out.worst[0] = max(out.worst[0], off)
        out.worst[1] = max(out.worst[1], angle)
        at, left, stepped = at + 1, left - 1, True
        s[at] = share
    return at + 1
