"""What in a scan is worth remembering? Differencing, trunks, corners, alignment; begin at front_ends.py."""
