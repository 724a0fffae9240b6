"""How is a saved map kept, and how does a run begin in one? Begin at start.py."""
