"""What was the path, seen from the end of the run, and which matches does that refute? Begin at smooth.py."""
