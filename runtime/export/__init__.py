"""How does a recorded run reach ROS 2, Foxglove, evo or a spreadsheet? Begin at export.py."""
