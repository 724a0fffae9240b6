"""How soon does a lost rover say so, and how often wrongly? Begin at study.py."""
