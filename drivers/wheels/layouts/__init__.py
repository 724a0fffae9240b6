"""Which bytes of which frame hold a count? Begin at choose.py."""
