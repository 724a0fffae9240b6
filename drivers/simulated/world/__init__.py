"""What stands and who walks around the simulated rover, and where does it drive? Begin at rover_path.py."""
