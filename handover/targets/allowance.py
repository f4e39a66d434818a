"""What a frame may yet do of the work that can wait for another frame.

A frame answers first. What is left of its time goes to work that no answer waits for:
to rank targets, to join goals ahead, to better the path. It is counted and not timed,
so the same frames do the same work on every machine.
"""

# what things take, in units of about a microsecond
LOOK_OUT = 600  # the executor looks whether somebody comes
MOVES = 500  # stops of a robot that is on its way are tested
TELL = 250  # the planner is told where the person will be
SET_GOALS = 600  # goals are set: the step looks for a path to them
RANK = 300  # a ranking begins
SOLVE = 500  # a start of the inverse kinematics
REACH = 900  # ... of a place before an object and one at it
PREPARE = 1500  # a goal is joined to the roadmap
TEST = 500  # a test of `improve`
JOIN = 1500  # the step joined the robot to the roadmap
TIME_PATH = 900  # the executor times a new path

_LEAST = 150  # a share of work that goes on over frames is not less
_PATIENCE = 4  # times that work is put off


class Allowance:
    """Holds what is left of a frame for work that can wait.

    Args:
        units: For a whole frame, about a microsecond each.

    Attributes:
        left: Of this frame; less than 0 where it did more.
    """

    def __init__(self, units: int = 1500) -> None:
        """Have all of it."""
        self.units = units
        self._put_off = 0
        self.begin()

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
        now = max(_LEAST, min(units, self.left))
        self.spend(now)
        return now

    def grants(self, units: int) -> bool:
        """Whether work that cannot be divided is done now; then it is spent.

        What is more than a whole frame's is done in one that has done nothing yet. What
        was put off four times is done in any case.
        """
        if self.left < min(units, self.units) and self._put_off < _PATIENCE:
            self._put_off += 1
            return False
        self._put_off = 0
        self.spend(units)
        return True
