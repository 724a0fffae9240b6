"""How far is the pose from the truth? Begin at evaluate.py."""
