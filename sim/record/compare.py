"""Whether two recordings are the same run, and where they part."""

from dataclasses import dataclass

import numpy as np

from sim.record.run_record import OUTCOME, TARGET_OUTCOME, RunRecord


@dataclass(frozen=True)
class Difference:
    """Where the outcome of a run first differs from another.

    Attributes:
        frame: The first frame that differs; None: only what was summed up does.
        time_s: Its time [s].
        names: What differs in it.
        sentence: All that in words, with the values of the first name.
    """

    frame: int | None
    time_s: float | None
    names: tuple[str, ...]
    sentence: str


def first_difference(was: RunRecord, now: RunRecord) -> Difference | None:
    """Return where the outcomes of a recording and of its replay part, None: nowhere.

    Numbers are compared as bytes.
    """
    n = min(was.frames, now.frames)
    names = [*OUTCOME, *(name for name in TARGET_OUTCOME if name in was.arrays)]
    unlike = {name: _unlike(was.arrays[name], now.arrays[name], n) for name in names}
    some = np.any(list(unlike.values()), axis=0)
    if some.any():
        frame = int(some.argmax())
        names = tuple(name for name, rows in unlike.items() if rows[frame])
        return _at(was, now, frame, names)
    if was.frames != now.frames:
        told = f"the run has {was.frames} frames, its replay {now.frames}"
        return Difference(None, None, ("frames",), told)
    return _summed_up(was, now)


def _unlike(a: np.ndarray, b: np.ndarray, n: int) -> np.ndarray:
    """Return (n,) whether the bytes of a frame differ."""
    a, b = np.ascontiguousarray(a[:n]), np.ascontiguousarray(b[:n])
    if a.shape != b.shape or a.dtype != b.dtype:
        return np.ones(n, bool)
    rows = [x.view(np.uint8).reshape(n, -1) for x in (a, b)]
    return (rows[0] != rows[1]).any(axis=1)


def _at(
    was: RunRecord, now: RunRecord, frame: int, names: tuple[str, ...]
) -> Difference:
    time = frame / was.rate_hz
    told = "; ".join(_values(was, now, frame, name) for name in names[:3])
    more = f"; also {', '.join(names[3:])}" if len(names) > 3 else ""
    sentence = f"frame {frame} ({time:.3f} s) is the first that differs: {told}{more}"
    return Difference(frame, time, names, sentence)


def _values(was: RunRecord, now: RunRecord, frame: int, name: str) -> str:
    a, b = was.arrays[name][frame], now.arrays[name][frame]
    if a.ndim:
        if a.shape != b.shape:
            return f"{name} has {len(a)} values in the recording and {len(b)} now"
        j = int((a.view(np.uint64) != b.view(np.uint64)).argmax())
        joints = was.head["robot"]["joint_names"]
        name = f"{name} of joint {joints[j]}"
        a, b = a[j], b[j]
    words = was.head.get(f"{name}_names")
    if words:
        a, b = (words[v] if v < len(words) else v for v in (a, b))
    else:
        a, b = repr(a.item()), repr(b.item())
    return f"{name} was {a} and is {b}"


def _summed_up(was: RunRecord, now: RunRecord) -> Difference | None:
    old, new = was.head["outcome"], now.head["outcome"]
    for name in sorted(old.keys() | new.keys()):
        a, b = old.get(name), new.get(name)
        if a == b:
            continue
        told = f"{name} was {a} and is {b}"
        if isinstance(a, list) and isinstance(b, list):
            told = f"there were {len(a)} of {name} and are {len(b)}"
            for i, (x, y) in enumerate(zip(a, b, strict=False)):
                if x != y:
                    told = f"{name}, number {i + 1}, was {x} and is {y}"
                    break
        return Difference(None, None, (name,), f"no frame differs, but {told}")
    return None
