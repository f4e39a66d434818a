"""The tables of docs/robots.md, from the JSON that the `odm` commands there write.

python -m sim.bench.robots_table FOLDER docs/robots.md

FOLDER holds NAME.build.json, NAME.info.json, NAME.audit.json and NAME.run.json for each
robot, from `odm build`, `odm info`, `odm audit` and `odm run` with --json.
"""

import json
import sys
from pathlib import Path

from roadmap.errors import BadInput
from sim.bench.command import fill_section

PARTS = ("build", "info", "audit", "run")
_HEADS = (
    "recipe", "joints", "spheres", "worst excess", "mean excess", "overhead, cells",
    "overhead, close test", "nodes", "edges", "build", "bytes per edge", "false free",
    "contacts", "p50", "p99",
)  # fmt: skip


def read_results(folder: Path) -> dict[str, dict]:
    """Return {name: {part: what the command wrote}} of every robot in a folder.

    Raises:
        BadInput: The folder holds no robot, or one of its four files is missing.
    """
    names = sorted(f.name.removesuffix(".build.json") for f in folder.glob("*.build.*"))
    if not names:
        raise BadInput(
            f"{folder} holds no NAME.build.json; run the commands in docs/robots.md"
        )
    results = {}
    for name in names:
        files = {part: folder / f"{name}.{part}.json" for part in PARTS}
        missing = [str(f) for f in files.values() if not f.is_file()]
        if missing:
            raise BadInput(
                f"{', '.join(missing)} is missing; run the commands in docs/robots.md"
            )
        results[name] = {k: json.loads(f.read_text()) for k, f in files.items()}
    return results


def markdown(results: dict[str, dict]) -> str:
    """Return both tables: one line a robot, then one line a link."""
    rows = [_robot_row(name, parts) for name, parts in results.items()]
    links = [
        (name, row["link"], row["spheres"], _mm(row["excess"]), _mm(row["protrusion"]))
        for name, parts in results.items()
        for row in _moving(parts["info"])
    ]
    setting = next(iter(results.values()))["run"]["setting"]
    versions = ", ".join(f"{k} {v}" for k, v in setting.items())
    heads = ("recipe", "link", "spheres", "worst excess", "mean excess")
    return "\n\n".join([_table(_HEADS, rows), f"{versions}.", _table(heads, links)])


def _robot_row(name: str, parts: dict) -> tuple:
    info, build = parts["info"], parts["build"]
    links, overhead = _moving(info), info["clearance_overhead"]
    total = parts["run"]["run"]["timing"]["latency_s"]["cpu"]
    return (
        name,
        len(info["robot"]["joints"]),
        info["robot"]["moving_spheres"],
        _mm(max(row["excess"] for row in links)),
        _mm(sum(row["protrusion"] for row in links) / len(links)),
        *(_cm(overhead[f"edges, {test}"]["mean"]) for test in ("cells", "close test")),
        build["nodes"],
        build["edges"],
        f"{build['seconds']:.0f} s",
        f"{build['bytes_per_edge']['edge_major']:.0f}",
        f"{parts['audit']['violations']} of {parts['audit']['pairs']}",
        parts["run"]["run"]["contacts"],
        *(f"{1e6 * total[share]:.0f} us" for share in ("p50", "p99")),
    )


def _moving(info: dict) -> list[dict]:
    return [row for row in info["cover"] if row["moving"]]


def _mm(length: float) -> str:
    return f"{1000 * length:.1f} mm"


def _cm(length: float | None) -> str:
    return "-" if length is None else f"{100 * length:.1f} cm"


def _table(heads: tuple, rows: list[tuple]) -> str:
    lines = [heads, ["---"] + ["---:"] * (len(heads) - 1), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def main() -> None:
    """Fill the section of a Markdown file; see the module."""
    if len(sys.argv) != 3:
        sys.exit("usage: python -m sim.bench.robots_table FOLDER FILE.md")
    folder, file = map(Path, sys.argv[1:])
    try:
        fill_section(file, "robots", markdown(read_results(folder)))
    except BadInput as error:
        sys.exit(f"odm: {error}")


if __name__ == "__main__":
    main()
