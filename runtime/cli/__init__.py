"""Which commands are there, and what do they take? Begin at __main__.py."""
