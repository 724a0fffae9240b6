"""How is the simulated rover started, beside a run or alone? Begin at rover_process.py."""
