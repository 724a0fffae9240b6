"""Which laser and which wheels are connected, and which configuration fits them? Begin at wizard.py."""
