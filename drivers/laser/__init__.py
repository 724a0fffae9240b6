"""How does the Hokuyo become a stream of stamped scans that never gives up? Begin at hokuyo.py."""
