"""Do the figures and claims of the paper hold? Begin at study.py."""
