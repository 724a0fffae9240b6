"""What did the parts of the rover report, told shortly? repeated.py makes one row of many, states.py sums up health."""
