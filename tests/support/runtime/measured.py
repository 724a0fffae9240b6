"""The geometry that a configuration of a real rover must have: that of the simulated one."""

VEHICLE = """[vehicle]
wheel_radius_left_m = 0.125
wheel_radius_right_m = 0.125
tread_m = 0.5
counts_per_rev = 4096.0
"""
