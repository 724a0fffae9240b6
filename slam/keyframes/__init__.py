"""What does an earlier scan from nearby say about where the rover is?"""
