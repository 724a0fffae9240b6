"""The Unscented FastSLAM of the paper: how is each particle moved, weighed and kept? Begin at fastslam.py."""
