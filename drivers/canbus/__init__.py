"""How do frames come off a CAN bus, with honest stamps, and what does it mean when they do not? Begin at bus.py."""
