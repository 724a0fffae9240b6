"""How is a run written while it drives? Begin at recorder.py."""
