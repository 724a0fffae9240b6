"""How do a phone and a laptop see a running rover without anything installed? Begin at serve.py."""
