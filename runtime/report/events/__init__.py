"""What did the parts of the rover report, in short? repeated.py makes one row of many, states.py sums up health."""
