"""Distances of the solids themselves: what all proofs are held against.

It shares no arithmetic with the frame it judges (no sphere, cell or sample), and no
part of a frame may import it; `tests/test_walls.py` sees to both.
"""
