"""Garbage is collected between frames: in one it would be a millisecond or more."""

import gc


class NotCollected:
    """While this holds, no garbage is collected; what is due is, right after it."""

    def __enter__(self) -> None:
        self._was = gc.isenabled()
        gc.disable()

    def __exit__(self, *_: object) -> None:
        """Collect again, if that was so before."""
        if self._was:
            gc.enable()
