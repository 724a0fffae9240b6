"""What was the path, seen from the end of the run, and which matches contradict that? Begin at smooth.py."""
