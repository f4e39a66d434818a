"""The experiment of the obstacle direct mapping paper, again."""
