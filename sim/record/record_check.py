"""What must hold of the arrays of a recording."""

from pathlib import Path

import numpy as np

from sim.loop.recording import BadRecording
from sim.record.run_record import OUTCOME, TARGET_OUTCOME


class BadRecord(BadRecording):
    """A recording of a run cannot be used; says what is wrong with it."""


def check_arrays(path: str | Path, head: dict, arrays: dict[str, np.ndarray]) -> None:
    """Refuse arrays that are no run.

    Raises:
        BadRecord: A clip shorter than the run, time that goes backwards, a shape that
            does not fit, a number that is none.
        KeyError: An array is missing.
    """
    n, places = head["frames"], arrays["places"]
    if not isinstance(n, int) or n < 1:
        raise BadRecord(f"{path} holds {n} frames; record a run of at least one")
    if places.ndim != 2 or len(places) < 2:
        raise BadRecord(
            f"the work places of {path} have the shape {places.shape}; there must be "
            "at least two configurations (n, dof)"
        )
    dof = places.shape[1]
    wide = {name: (dof,) if name in ("q", "dq", "ddq") else () for name in OUTCOME}
    for name, shape in {"time_s": (), **wide}.items():
        _shape(path, name, arrays[name], n, shape)
    _time(path, arrays["time_s"], head["settings"]["rate_hz"])
    for name in ("capsules", "guess"):
        if name == "capsules" or name in arrays:
            _person(path, name, arrays, n)
    if "payload" in arrays:
        _payload(path, arrays["payload"])
    if "targets" in head:
        _targets(path, arrays, n)
    for name in ("places", "capsules", "guess"):
        if name in arrays and not np.isfinite(arrays[name]).all():
            raise BadRecord(f"{name} of {path} holds NaN or infinity; record again")


def _payload(path: object, spheres: np.ndarray) -> None:
    sound = spheres.ndim == 2 and spheres.shape[1] == 4 and len(spheres) > 0
    if not sound or not np.isfinite(spheres).all() or spheres[:, 3].min() <= 0:
        raise BadRecord(
            f"the payload of {path} must be spheres (n, 4) with radii above 0, not "
            f"{spheres.tolist()}; record again"
        )


def _targets(path: object, arrays: dict[str, np.ndarray], n: int) -> None:
    """Refuse targets, or a person, that are none; see `sim.run.meet_record`."""
    person = {"pelvis": (4, 4), "bend": (3,), "arms": (2, 7), "gaze": (3,)}
    shapes = {f"person.{name}": shape for name, shape in person.items()}
    shapes |= dict.fromkeys(TARGET_OUTCOME, ())
    body = [name for name in arrays if name.startswith("person.body.")]
    shapes |= {name: arrays[name].shape[1:] for name in body}
    for name, shape in shapes.items():
        _shape(path, name, arrays[name], n, shape)
        if name != "person.gaze" and not np.isfinite(arrays[name]).all():
            raise BadRecord(f"{name} of {path} holds NaN or infinity; record again")
    shown, ends = arrays["targets.shown"], arrays["targets.shown_at"]
    sound = shown.ndim == 2 and shown.shape[1] == 5 and ends.ndim == 1 and len(ends) > 1
    sound = sound and ends.dtype.kind == "i" and ends[0] == 0 and ends[-1] == len(shown)
    if not sound or (np.diff(ends) < 0).any():
        raise BadRecord(
            f"targets.shown_at of {path} must ascend from 0 to the number of rows of "
            f"targets.shown, {len(shown)}, and these have 5 columns; record again"
        )


def _shape(path: object, name: str, array: np.ndarray, n: int, shape: tuple) -> None:
    if array.ndim and array.shape[1:] == shape and len(array) < n:
        raise BadRecord(
            f"{name} of {path} is a clip of {len(array)} frames, shorter than the run "
            f"of {n}; copy the file again or record again"
        )
    if array.shape != (n, *shape):
        raise BadRecord(
            f"{name} of {path} has the shape {array.shape}, but must have "
            f"{(n, *shape)}; record again"
        )


def _time(path: object, time: np.ndarray, rate: float) -> None:
    back = np.flatnonzero(~(np.diff(time) > 0))
    if len(back):
        i = int(back[0])
        raise BadRecord(
            f"time goes backwards in {path}: {time[i]:g} s in frame {i}, then "
            f"{time[i + 1]:g} s; the times of frames must ascend"
        )
    off = np.abs(time - np.arange(len(time)) / rate) > 1e-9
    if off.any():
        i = int(off.argmax())
        raise BadRecord(
            f"frame {i} of {path} is at {time[i]:g} s, but at {rate:g} frames per "
            f"second it must be at {i / rate:g} s"
        )


def _person(path: object, name: str, arrays: dict[str, np.ndarray], n: int) -> None:
    rows, offsets = arrays[name], arrays.get(f"{name}_at")
    if offsets is None:
        _shape(path, name, rows, n, (rows.shape[1] if rows.ndim == 3 else 0, 7))
        return
    _shape(path, f"{name}_at", offsets, n + 1, ())
    sound = offsets.dtype.kind == "i" and offsets[0] == 0
    sound = sound and (np.diff(offsets) >= 0).all() and offsets[-1] == len(rows)
    if not sound or rows.shape[1:] != (7,):
        raise BadRecord(
            f"{name}_at of {path} must ascend from 0 to the number of rows of {name}, "
            f"{len(rows)}, and these have 7 columns; record again"
        )
