"""Compiled loops of the odm package; bare on purpose, checks stand outside."""
