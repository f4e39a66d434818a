"""Set-points beside a person: joined, timed and braked before anyone is touched."""
