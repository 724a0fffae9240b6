"""How far did the wheels move the rover, and how sure is that? Begin at odometry.py."""
