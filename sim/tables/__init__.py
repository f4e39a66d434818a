"""Clocks, headers and tables of everything that is measured."""
