"""How is a run kept, so that nothing is lost, and how is it read again? Begin at recorder.py to write and reader.py to
read.
"""
