"""The last frames of a run without an end, for its tables."""

from collections import deque
from dataclasses import replace

from sim.loop.loop import Frame, Loop, light, result_of
from sim.loop.run_result import RunResult


class KeptFrames:
    """Keeps the last frames without what is large in them.

    Args:
        most: How many.
    """

    def __init__(self, most: int) -> None:
        """Keep none yet."""
        self._frames: deque[Frame] = deque(maxlen=most)

    def __len__(self) -> int:
        """Return how many are kept."""
        return len(self._frames)

    def add(self, frame: Frame) -> None:
        """Keep a frame; every frame of a hold knows its reason."""
        kept = light(frame.answer, self._frames)
        before = self._frames[-1].answer if self._frames else kept
        if kept.status == before.status == "holding":
            kept = replace(kept, reason=kept.reason or before.reason)
        self._frames.append(replace(frame, answer=kept))

    def result(self, loop: Loop) -> RunResult | None:
        """Return the frames kept and their figures, None if there are none."""
        return result_of(loop, list(self._frames), {}) if self._frames else None
