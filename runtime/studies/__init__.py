"""What does the method reach, with which spread? Each study has a folder; jobs.py runs their drives."""
