"""Where on the map do the scans of the last metres lie, and how sure is that? Begin at laying.py."""
