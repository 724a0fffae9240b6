"""How does a lost rover find its way back, and how do two maps become one? Begin at relocaliser.py."""
