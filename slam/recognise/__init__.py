"""Where in a known map is the rover by its landmarks, and how sure is that? Begin at attempt.py."""
