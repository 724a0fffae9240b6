"""What stands in each kind of place that a simulated rover drives in? Begin at choose.py."""
