"""What do scans alone tell of the laser and its motion? Begin at match.py."""
