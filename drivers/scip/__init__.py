"""What do the bytes of SCIP 2 say? Pure functions without port, thread or clock; begin at codec.py."""
