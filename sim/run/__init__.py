"""A whole run: a robot at work beside a person, with its tables and pictures."""
