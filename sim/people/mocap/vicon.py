"""Vicon's exported tracks (.csv): places of rigid bodies or markers, with gaps."""

import csv
from itertools import pairwise

import numpy as np

from roadmap.ranges import is_number
from sim.people.mocap.tracks import UNITS, BadMocap, Tracks, number

HEADER = ("Objects", "Segments", "Trajectories", "Model Outputs")  # of the first line
_LAST_FRAME = 2**53  # whole numbers up to here are told apart


def parse_csv(text: str, source: str) -> Tracks:
    """Return the tracks of a Vicon export; z is up; a body is named with its subject.

    Line 1 names the section, 2 the rate, 3 the bodies, 4 the columns, 5 the units;
    data follow up to the first empty line. An empty cell is a gap, and so is a frame
    whose number is left out.

    Raises:
        BadMocap: A line is missing, cut off or not numeric, a rate of 0, no frames.
    """
    rows = _rows(text, source)
    if len(rows) < 5:
        raise BadMocap(
            f"{source} ends after line {len(rows)}; a Vicon .csv has five lines of "
            "header: section, rate, names, columns, units"
        )
    first = rows[1][0] if rows[1] else ""
    rate = number(first, f"the rate in line 2 of {source}")
    names, axes, units = (row + [""] * 3 for row in rows[2:5])
    columns = _columns(names, axes, source)
    frames, cells = _data(rows, len(rows[3]), source)
    scale = _scale(units, columns, source)
    places = {}
    for name, column in columns.items():
        found = np.full((int(frames[-1] - frames[0]) + 1, 3), np.nan)
        found[frames - frames[0]] = cells[:, column : column + 3]
        found[~np.isfinite(found).all(axis=1)] = np.nan
        places[name] = found
    return Tracks(source, rate, places, scale, "z")


def _rows(text: str, source: str) -> list[list[str]]:
    try:
        return list(csv.reader(text.splitlines()))
    except csv.Error as error:  # such as a quotation mark that is never closed
        raise BadMocap(f"{source} is no .csv: {error}; export it anew") from None


def _columns(names: list[str], axes: list[str], source: str) -> dict[str, int]:
    """Return body -> column of its x place."""
    starts = [i for i, name in enumerate(names) if name.strip()]
    columns: dict[str, int] = {}
    for i, stop in pairwise([*starts, len(axes)]):
        block = [axis.strip().upper() for axis in axes[i:stop]]
        for wanted in (["TX", "TY", "TZ"], ["X", "Y", "Z"]):
            if wanted[0] in block:
                k = block.index(wanted[0])
                if block[k : k + 3] == wanted:
                    columns.setdefault(_body(names[i]), i + k)
    if not columns and any(x in "".join(axes) for x in (";", "\t")):
        raise BadMocap(
            f"the columns of {source} are not separated by commas; export it anew with "
            "commas between columns and points in numbers"
        )
    if not columns:
        raise BadMocap(
            f"{source} names no body in line 3 with columns TX, TY, TZ in line 4; "
            "export positions from Vicon"
        )
    return columns


def _body(name: str) -> str:
    """Return 'hip' for 'Global Angle hip:hip', and 'Bob:hip' for 'Bob:hip'."""
    space, _, body = name.strip().removeprefix("Global Angle ").rpartition(":")
    space, body = space.strip(), body.strip()
    return body if space in ("", body) else f"{space}:{body}"


def _scale(units: list[str], columns: dict[str, int], source: str) -> float | None:
    """Return the length of the file's unit [m]; None: it names none."""
    column = next(iter(columns.values()))
    unit = units[column].strip().lower() if column < len(units) else ""
    if unit and unit not in UNITS:
        raise BadMocap(
            f"line 5 of {source} gives positions in {unit!r}; write {', '.join(UNITS)} "
            "there, or nothing: the unit is then told by the length of the arm"
        )
    return UNITS.get(unit)


def _data(
    rows: list[list[str]], width: int, source: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return the frame numbers (n,) and all cells (n, width), NaN where empty."""
    frames, cells = [], []
    for line, row in enumerate(rows[5:], start=6):
        if not any(cell.strip() for cell in row):
            break
        if len(row) < width:
            raise BadMocap(
                f"line {line} of {source} has {len(row)} of {width} cells: the file is "
                "cut off, or a comment stands there; get the whole of it, frames alone"
            )
        try:
            values = [float(cell) if cell.strip() else np.nan for cell in row[:width]]
        except ValueError:
            bad = next(c for c in row if c.strip() and not is_number(c))
            raise BadMocap(
                f"line {line} of {source} holds {bad.strip()[:40]!r}, which is no "
                "number; an empty cell is a gap"
            ) from None
        frame = values[0]
        rises = not frames or frame > frames[-1]
        if not (frame.is_integer() and abs(frame) < _LAST_FRAME and rises):
            raise BadMocap(
                f"line {line} of {source} is frame {row[0]!r} after "
                f"{frames[-1] if frames else 'the header'}; frame numbers must rise"
            )
        frames.append(int(frame))
        cells.append(values)
    if not frames:
        raise BadMocap(f"{source} holds a header and no frames; record again")
    if frames[-1] - frames[0] > 20 * len(frames) + 1000:
        raise BadMocap(
            f"{source} holds {len(frames)} frames numbered {frames[0]} to "
            f"{frames[-1]}: nearly all are left out; check the first column"
        )
    return np.array(frames), np.array(cells)
