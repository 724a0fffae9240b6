"""Does a recorded run give the same bits again? Begin at replay.py."""
