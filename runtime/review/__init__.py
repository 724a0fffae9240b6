"""How is a run drawn for rerun? Begin at writer.py."""
