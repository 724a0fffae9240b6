"""How does a rover that drives look in rerun? Begin at view.py."""
