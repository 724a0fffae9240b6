"""How is a run kept, so that nothing is lost, and how is it read again? Begin at writing/recorder.py to write, and
at reader.py to read.
"""
