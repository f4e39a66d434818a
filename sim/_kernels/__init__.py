"""Compiled loops of a frame's execution."""
