"""How does a map outlive its run, and how do other programs read it? Begin at draw.py."""
