"""How soon, how often and how exactly is a rover found in a map that a drive has left? Begin at study.py."""
