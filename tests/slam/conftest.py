"""Compilation on the first call is no reason for a property test to fail."""

from hypothesis import settings

settings.register_profile("compiled", deadline=None)
settings.load_profile("compiled")
