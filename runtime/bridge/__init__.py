"""How does a running rover reach stock ROS 2, which does not speak zenoh? Begin at ros2.py."""
