"""Where in a known map is the rover, and how sure is that? Begin at attempt.py."""
