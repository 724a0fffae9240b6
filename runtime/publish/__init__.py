"""How do pose, map and state reach other programs over zenoh? Begin at publisher.py."""
