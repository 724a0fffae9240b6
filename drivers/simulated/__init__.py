"""How is a rover simulated so that nobody behind the wire can tell? Begin at rover.py."""
