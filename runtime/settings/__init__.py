"""Which keys does a configuration have, and is this one in order? Begin at configuration.py."""
