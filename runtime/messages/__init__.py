"""How do ticks, estimates and events lie in bytes? Begin at tick.py."""
