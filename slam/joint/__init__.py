"""Where are pose and landmarks, all taken together? The joint Gaussian, which is published; begin at gaussian.py."""
