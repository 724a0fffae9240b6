"""How do pose, scan and map look to stock ROS 2 tools? Begin at vehicle.py."""
