"""How do simulated wheel nodes send, and how do they fail? Begin at node.py."""
