"""Scenes of a hand-over: who gives, who takes, what, from where to where, what stands there."""
