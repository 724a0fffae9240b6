"""How is the simulated rover started, with a run or alone? Begin at rover_process.py."""
