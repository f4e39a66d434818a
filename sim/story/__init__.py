"""A hand-over from beginning to end: give to and take from a person who moves."""
