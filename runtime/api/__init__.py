"""How does another program use runs, scans and wheels from Python? Begin at run.py."""
