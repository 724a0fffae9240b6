"""Can this rover drive, and how does it become a service? Begin at preflight.py."""
