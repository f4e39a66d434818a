"""A person at the keyboard: keys move a human arm while the simulation runs.

`live.KeyboardPerson` is the person of a run. `bindings` tells which key does what,
`control` how the arm follows keys, `motion` makes it a human motion, `session` runs it
in real time.
"""

from sim.keyboard.control import KeyEvent
from sim.keyboard.key_motion import KeyboardArm
from sim.keyboard.live import KeyboardPerson
from sim.keyboard.terminal import NoTerminal

__all__ = ["KeyEvent", "KeyboardArm", "KeyboardPerson", "NoTerminal"]
