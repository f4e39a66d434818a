"""Whether two checkouts decide the same, byte for byte."""
