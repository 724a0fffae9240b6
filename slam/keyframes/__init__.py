"""What does an earlier scan from nearby say of where the rover is?"""
