"""How does a simulated Hokuyo answer, and how does it fail? Begin at device.py."""
