"""How do lines, stamps and arrays of others become numbers that can be trusted? Begin at left_out.py."""
