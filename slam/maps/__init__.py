"""How do scans become an occupancy grid, and what of a drive is kept for the next one? Begin at joint_map.py."""
