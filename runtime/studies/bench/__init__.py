"""How fast are the parts of a tick? Begin at measures.py."""
