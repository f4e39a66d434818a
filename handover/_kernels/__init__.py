"""Compiled loops of the handover package; bare on purpose, checks stand outside."""
