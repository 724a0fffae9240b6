"""How does the rover drive: which parts, in which order, ten times a second? Begin at run.py."""
