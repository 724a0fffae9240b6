"""What does a run look like? drawings.py says what is drawn, plots.py how; begin with the former."""
