"""What do hours of driving leave behind in memory? Begin at soak.py."""
