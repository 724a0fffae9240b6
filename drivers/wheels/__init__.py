"""How do CAN frames become totals of two wheels that can be trusted? Begin at encoders.py."""
