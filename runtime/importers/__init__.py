"""How does a recording of others become a run? Begin at data_set.py."""
