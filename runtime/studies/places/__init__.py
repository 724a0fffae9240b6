"""How good is the pose where nobody tuned it, and does a "lost" tell the truth? Begin at study.py."""
