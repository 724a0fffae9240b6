"""A plugin of pytest under which all is a day later: what a test's name takes from the clock is seen by its change."""

import time

DAY_S = 86_400.0
_today = time.time
time.time = lambda: _today() + DAY_S
