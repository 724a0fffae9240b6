"""How do bytes on a wire become measurements in SI units? Begin at measurements.py, which has the types that
everything else takes; `laser` and `wheels` hold the two drivers, `simulated` the devices that speak the same bytes.
"""
