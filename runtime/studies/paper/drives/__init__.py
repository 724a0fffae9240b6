"""Which drives do the studies consist of? One file for each world and each arm."""
