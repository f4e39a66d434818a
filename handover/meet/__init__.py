"""Where robot and person can meet, and how comfortable that is."""
