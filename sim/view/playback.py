"""Where in a run the page is: play, pause, scrub, and the newest of a live one."""

from roadmap.errors import BadInput

SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0)


class Playback:
    """A place on a time line that may grow while it is watched.

    Args:
        begin, end: First and last moment [s].
        live: Whether the run goes on: then it follows the newest moment.

    Attributes:
        begin, end, at: First, last and present moment [s].
        playing: Whether time passes.
        following: Whether it stays at the newest moment.
        speed: Seconds of the run in one of the clock.
    """

    def __init__(self, begin: float, end: float, live: bool = False) -> None:
        self.begin, self.end = begin, max(begin, end)
        self.live = self.following = live
        self.at = self.end if live else self.begin
        self.playing, self.speed = live, 1.0

    def play(self) -> None:
        """Let time pass; from the end of a recording it begins anew."""
        if self.at >= self.end:
            if self.live:
                self.follow()
            else:
                self.at = self.begin
        self.playing = True

    def pause(self) -> None:
        """Stand still; a live run goes on unseen."""
        self.playing = self.following = False

    def follow(self) -> None:
        """Go to the newest moment and stay there; of a recording, to the end."""
        self.at = self.end
        self.following = self.playing = self.live

    def seek(self, time_s: float) -> None:
        """Go to a moment, the nearest that there is; NaN is none and is ignored."""
        if time_s != time_s:
            return
        self.at = min(max(time_s, self.begin), self.end)
        self.following = False

    def jump(self, times: list[float], direction: int) -> None:
        """Go to the next (+1) or the last (-1) of some times and stand still there."""
        slack = 1e-6
        if direction > 0:
            there = [t for t in times if t > self.at + slack]
            goal = min(there, default=self.end)
        else:
            goal = max((t for t in times if t < self.at - slack), default=self.begin)
        self.pause()
        self.seek(goal)

    def set_speed(self, speed: float) -> None:
        """Let time pass faster or slower, by one of `SPEEDS`."""
        if speed not in SPEEDS:
            known = ", ".join(f"{s:g}" for s in SPEEDS)
            raise BadInput(f"no speed {speed!r}; choose one of {known}")
        self.speed = speed

    def span(self, begin: float, end: float) -> None:
        """Take the first and the last moment that there is now."""
        self.begin, self.end = begin, max(begin, end)
        if self.following:
            self.at = self.end
        self.at = min(max(self.at, self.begin), self.end)

    def advance(self, seconds: float) -> None:
        """Let `seconds` of the clock pass."""
        if not self.playing or self.following or not seconds > 0:
            return
        self.at += seconds * self.speed
        if self.at >= self.end:
            self.at = self.end
            if self.live:
                self.follow()
            else:
                self.playing = False
