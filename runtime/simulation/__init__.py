"""How is the simulated rover started beside a run or alone at a desk? Begin at rover_process.py."""
