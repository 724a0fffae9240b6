"""What does each fault look like in the facts of a run? One file for each component; judge.py, next to this folder,
asks them all.
"""
