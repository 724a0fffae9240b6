"""How do scans become an occupancy grid? Begin at occupancy_grid.py."""
