"""What `odm bench odm-paper` says of a map and of its figures, as plain data."""

import numpy as np

from odm.cell_map.cell_map import CellMap
from sim.bench.clock import Clock
from sim.bench.paper.paper_rows import Audit, PaperFcl, Race
from sim.tables.table import value_row

FRAME_US, FASTER = 10.0, 300.0  # asked of the map of the figures


def map_facts(built: CellMap, took: float) -> dict:
    """Return counts, bytes and build time of a map."""
    by_edges, by_blocks = built.arm_cells.bytes_by_view()
    return {
        "kept_nodes": built.roadmap.n_nodes,
        "edges": built.roadmap.n_edges,
        "build_cpu_s": round(took, 2),
        "edge_major_bytes": by_edges,
        "direct_bytes": by_blocks,
    }


def audit_facts(found: Audit) -> dict:
    """Return cells, invalid nodes and edges, and contacts."""
    nodes, edges = np.array(found.nodes), np.array(found.edges)
    ways = ("whole", "surface", "dense")
    counts = {f"cells_{w}": float(np.mean(getattr(found, w))) for w in ways}
    counts |= {f"nodes_{w}": float(nodes[:, k].mean()) for k, w in enumerate(ways)}
    counts |= {f"edges_{w}": float(edges[:, k].mean()) for k, w in enumerate(ways)}
    return counts | {
        "asked": found.asked,
        "contacts": found.contacts,
        "contacts_missed": found.missed,
        "within_m": found.near,
        "within_m_missed": found.near_missed,
    }


def time_facts(times: dict, raced: Race) -> dict:
    """Return the times of updates, frames and the competitor [us]."""
    facts = {f"{n}_us": float(np.median(c.cpu)) * 1e-3 for n, c in times.items()}
    frame, fcl = (1e-3 * np.array(c.cpu, float) for c in (raced.ours, raced.theirs))
    wall = 1e-3 * np.array(raced.ours.wall, float)
    straight = raced.vertices == 2
    facts |= {
        "frame_us": _percentiles(wall),
        "frame_cpu_us": _percentiles(frame),
        "fcl_cpu_us": _percentiles(fcl),
        "times_faster": ratio(raced),
        "frames": len(wall),
        "frames_blocked_straight": int((~straight).sum()),
        "frames_without_path": int((raced.vertices == 0).sum()),
        "found": raced.found.tolist(),
        "fcl_contacts_on_our_paths": raced.touching,
    }
    return facts


def _percentiles(values: np.ndarray) -> dict | None:
    if not len(values):
        return None
    p50, p99 = np.percentile(values, [50, 99])
    return {"p50": float(p50), "p99": float(p99), "max": float(values.max())}


def ratio(raced: Race) -> float:
    """Return how many times faster the same frames are, by median CPU time.

    To read the thread's clock twice takes nearly a microsecond of a frame of seven:
    what an empty call takes by the same clock is left out on both sides.
    """
    empty = Clock()
    for _ in range(2000):
        empty(_nothing)
    own = np.median(empty.cpu)
    ours, theirs = (np.median(c.cpu) - own for c in (raced.same, raced.theirs))
    return float(theirs / ours)


def _nothing() -> None:
    pass


def by_spacing(spacings: tuple, h_cm: int, found: list[Audit]) -> dict:
    """Return contacts of nodes that the paper's comparison misses, by spacing."""
    contacts = sum(a.on_nodes for a in found)
    missed = {s: sum(a.uninflated[s] for a in found) for s in spacings}
    shares = {f"{s:g}": n / contacts if contacts else None for s, n in missed.items()}
    counts = {f"{s:g}": n for s, n in missed.items()}
    return {"cell_cm": h_cm, "contacts": contacts, "missed": counts, "share": shares}


_CLOCK = "CPU time, less what reading its clock takes"


def figure_rows(raced: Race, across: Race, sweep: list[dict]) -> list[dict]:
    """Return the rows with what was asked: times, contacts.

    Args:
        raced: Frames between any start and goal.
        across: Frames with start and goal on either side of the arm.
        sweep: The rows of all maps.
    """
    contacts, missed, near = (
        sum(row[k] for row in sweep)
        for k in ("contacts", "contacts_missed", "within_m_missed")
    )
    note = "same q, searched from scratch in every frame"
    touching = raced.touching + across.touching
    return [
        raced.ours.row("points to path", note, p50=FRAME_US),
        *_parts(raced),
        raced.theirs.row("A* with online python-fcl", PaperFcl.what),
        raced.same.row("... points to path, same frames"),
        value_row("... times faster at p50", ratio(raced), "", _CLOCK, least=FASTER),
        across.ours.row("across the arm: points to path"),
        *_parts(across),
        across.theirs.row("A* with online python-fcl, across"),
        value_row("... times faster at p50, across", ratio(across), ""),
        value_row("contacts python-fcl finds on our paths", touching, "", most=0),
        value_row("exact contacts, all maps", contacts, ""),
        value_row("... missed by the surface's cells", missed, "", most=0),
        value_row("... or within the clearance m", near, "", most=0),
    ]


def _parts(raced: Race) -> list[dict]:
    """Return the rows of the frames whose straight motion is blocked, and others."""
    lost = raced.vertices == 0
    turned = raced.vertices > 2
    work = np.median(raced.work[turned], axis=0) if turned.any() else np.zeros(4)
    note = (
        f"in the median of them {work[0]:.0f} cell lists are compared, {work[1]:.0f} "
        f"vertices closed, {work[2]:.0f} close tests run"
    )
    share = 100.0 * float((raced.vertices != 2).mean())
    rows = [
        raced.ours.row("... straight motion free", "", raced.vertices == 2),
        raced.ours.row("... straight motion blocked, a way round", note, turned),
    ]
    if lost.any():
        rows.append(raced.ours.row("... no path", "", lost))
    blocked = value_row("... frames with the straight motion blocked", share, "%")
    none = value_row("... frames without a path", 100.0 * float(lost.mean()), "%")
    return [*rows, blocked, none]
