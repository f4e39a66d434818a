"""The tables of `odm bench odm-paper`, as text."""


def tables(result: dict) -> list[dict]:
    """Return the tables (title, head, rows of text) of the bench's figures."""
    return [
        _obstacles(result["sweep"]),
        _times(result["sweep"]),
        _uninflated(result["uninflated"]),
        _edges(result["edge_rule"]),
    ]


def _obstacles(sweep: list[dict]) -> dict:
    """Cells of the arm, what they invalidate, and what is missed."""
    head = (
        "map", "cells: whole arm", "a cell apart", "surface, rho",
        "invalid nodes: whole / surface", "edges: whole / surface",
        "contacts", "missed",
    )  # fmt: skip
    rows = [
        (
            _map(r), _n(r["cells_whole"]), _n(r["cells_dense"]),
            _n(r["cells_surface"]), _pair(r, "nodes"), _pair(r, "edges"),
            _n(r["contacts"]), str(r["contacts_missed"]),
        )
        for r in sweep
    ]  # fmt: skip
    title = "The whole arm against its sampled surface, mean of the frames"
    return {"title": title, "head": head, "rows": rows}


def _times(sweep: list[dict]) -> dict:
    head = (
        "map", "region expansion", "direct map: whole", "surface", "by changes",
        "frame p50 / p99", "A* with fcl p50", "times", "build", "MB",
    )  # fmt: skip
    rows = [
        (
            _map(r), _us(r["expand_us"]), _us(r["whole_us"]), _us(r["surface_us"]),
            _us(r["changes_us"]), " / ".join(_us(r["frame_us"][k]) for k in _SHARES),
            _us(r["fcl_cpu_us"]["p50"]), f"{r['times_faster']:,.0f}",
            f"{r['build_cpu_s']:.1f} s",
            f"{1e-6 * (r['edge_major_bytes'] + r['direct_bytes']):.1f}",
        )
        for r in sweep
    ]  # fmt: skip
    title = "Update and search, median CPU time (the frame: by the clock)"
    return {"title": title, "head": head, "rows": rows}


_SHARES = ("p50", "p99")


def _uninflated(by_cell: list[dict]) -> dict:
    spacings = list(by_cell[0]["missed"]) if by_cell else []
    head = ("points apart", *(f"cells of {r['cell_cm']} cm" for r in by_cell))
    rows = [
        (f"{100 * float(s):.0f} cm", *(_share(r, s) for r in by_cell)) for s in spacings
    ]
    rows.append(("contacts of nodes", *(f"{r['contacts']:,}" for r in by_cell)))
    title = "Exact contacts that the paper's comparison without inflation misses"
    return {"title": title, "head": head, "rows": rows}


def _edges(rules: list[dict]) -> dict:
    head = (
        "map", "edges", "that lack a cell", "swept cells missed", "middles",
        "wrongly free of the arm", "motion bound misses", "its cells",
    )  # fmt: skip
    rows = [
        (
            f"{r['cell_cm']} cm, {r['nodes']:,}", str(r["edges"]),
            _percent(r["short"], r["edges"]),
            _percent(r["missed"], r["cells"]), f"{r['middles']:.1f}",
            f"{r['passed']:,} of {r['asked']:,}", str(r["bound_missed"]),
            f"+{_percent(r['bound_cells'] - r['cells'], r['cells'])}",
        )
        for r in rules
    ]  # fmt: skip
    title = "Edges by the rule 'until no more cells are added'"
    return {"title": title, "head": head, "rows": rows}


def _map(r: dict) -> str:
    return f"{r['cell_cm']} cm, {r['nodes']:,} {r['sampling']}"


def _pair(r: dict, kind: str) -> str:
    return f"{_n(r[f'{kind}_whole'])} / {_n(r[f'{kind}_surface'])}"


def _n(value: float) -> str:
    return f"{value:,.0f}"


def _us(value: float) -> str:
    return f"{value / 1e3:.3g} ms" if value >= 1e3 else f"{value:.3g} us"


def _share(row: dict, spacing: str) -> str:
    return _percent(row["missed"][spacing], row["contacts"])


def _percent(part: int, whole: int) -> str:
    if not whole:
        return ""
    share = 100.0 * part / whole
    return "0 %" if part == 0 else f"{share:.2g} %"
