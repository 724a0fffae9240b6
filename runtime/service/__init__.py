"""What does the operating system want of a service and give to it? Begin at systemd.py."""
