"""Which geometry, latency and noise explain the drives that were recorded? Begin at calibration.py."""
