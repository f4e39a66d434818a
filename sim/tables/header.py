"""What every table says of the machine and the map."""

import os
import platform
from pathlib import Path

from odm.cell_map.cell_map import CellMap
from sim.tables.versions import version

PACKAGES = ("numpy", "numba", "scipy", "python-fcl", "ompl")


def header(cell_map: CellMap | None = None) -> dict:
    """Return processor, versions, load average and map, as plain data."""
    found = {
        "processor": processor(),
        "cores": os.cpu_count(),
        "load_average": [round(x, 2) for x in os.getloadavg()],
        "python": platform.python_version(),
        "system": platform.platform(terse=True),
        "versions": {name: version(name) for name in PACKAGES},
    }
    if cell_map is not None:
        roadmap = cell_map.roadmap
        found["map"] = {
            "name": cell_map.recipe.name,
            "hash": cell_map.hash,
            "nodes": roadmap.n_nodes,
            "edges": roadmap.n_edges,
            "spheres": len(cell_map.arm.spheres),
            "safety": cell_map.safety.as_dict(),
        }
    return found


def processor() -> str:
    """Return the name of the processor."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()
