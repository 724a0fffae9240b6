"""What went wrong in a run, and what is to be done about it? Begin at build.py."""
