"""Where robot and person meet: hand-over targets; comes with a later version."""
