"""Recorded people: motion capture as closed capsules beside the robot."""

from sim.people.mocap.loading import MocapSettings, load_mocap, read_tracks
from sim.people.mocap.mocap_motion import MocapMotion, Sight
from sim.people.mocap.tracks import BadMocap, Tracks

__all__ = [
    "BadMocap",
    "MocapMotion",
    "MocapSettings",
    "Sight",
    "Tracks",
    "load_mocap",
    "read_tracks",
]
