"""Benches of the human model and the interaction workspace."""
