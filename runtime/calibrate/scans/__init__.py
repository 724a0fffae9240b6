"""What do scans alone say about the laser and its motion? Begin at match.py."""
