"""How often is a place recognised, how often wrongly, and at what cost? Begin at study.py."""
