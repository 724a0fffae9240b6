"""Does `infant setup` end in a rover that drives? Begin at study.py."""
