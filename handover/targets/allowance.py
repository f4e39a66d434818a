"""What a frame may yet do of the work that can wait for another frame.

A frame answers first. What is left of its time goes to work that no answer waits for:
to rank targets, to join goals ahead, to better the path. It is counted and not timed,
so the same frames do the same work on every machine.
"""

from handover.targets.settings import AllowanceSettings

_UNITS, _PERIOD = 1500, 0.01  # of a frame at 100 Hz, and how long it lasts [s]


class Allowance:
    """What a frame has left for work that can wait, in units of about a microsecond.

    `units` are a whole frame's, `takes` is what each kind of work takes; `left` is
    below 0 where a frame did more.
    """

    def __init__(
        self, units: int = _UNITS, takes: AllowanceSettings = AllowanceSettings()
    ) -> None:
        self.units, self.takes = units, takes
        self._put_off = 0
        self.begin()

    @classmethod
    def lasting(cls, period: float) -> "Allowance":
        """Return that of a frame of `period` [s]: the slower they come, the more.

        A frame of a slow sensor does more beside (it looks out in each), so that with
        no more than at 100 Hz the rest would not be done at all.
        """
        return cls(max(_UNITS, round(_UNITS * period / _PERIOD)))

    @property
    def frames(self) -> int:
        """As many frames at 100 Hz last as long: what goes on by frames does so."""
        return max(1, self.units // _UNITS)

    def begin(self) -> None:
        """Begin a frame."""
        self.left = self.units

    def spend(self, units: int) -> None:
        """Take away what was done, or what surely will be."""
        self.left -= units

    def share(self, units: int) -> int:
        """Return how much of work that goes on over frames is done now; it is spent.

        Never nothing: a frame that has little left leads it on, too.
        """
        now = max(self.takes.least, min(units, self.left))
        self.spend(now)
        return now

    def grants(self, units: int) -> bool:
        """Whether work that cannot be divided is done now; then it is spent.

        What is more than a whole frame's is done in one that has done nothing yet. What
        was put off `patience` times is done in any case.
        """
        patient = self._put_off < self.takes.patience
        if self.left < min(units, self.units) and patient:
            self._put_off += 1
            return False
        self._put_off = 0
        self.spend(units)
        return True
