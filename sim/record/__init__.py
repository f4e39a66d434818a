"""Runs in one file: record them, read them, run them again, and compare."""

from sim.record.again import run_again
from sim.record.compare import Difference, first_difference
from sim.record.file import is_record, read_record, write_record
from sim.record.recorder import Recorder, recording, saved
from sim.record.run_record import RunRecord

__all__ = [
    "Difference",
    "Recorder",
    "RunRecord",
    "first_difference",
    "is_record",
    "read_record",
    "recording",
    "run_again",
    "saved",
    "write_record",
]
