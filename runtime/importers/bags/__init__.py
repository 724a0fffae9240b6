"""How do messages come out of a recording of ROS, whatever it says of itself? Begin at open_bag.py."""
