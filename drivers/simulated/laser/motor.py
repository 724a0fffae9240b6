"""The simulated laser's own clock, and the turns of its mirror by that clock."""

from drivers.scip.codec import COUNTER_MS
from drivers.scip.model import Parameters

NS_PER_MS = 1_000_000
RATE_SCALE = 10**12


class LaserMotor:
    """Which sweep is when; all in integers, so that nothing drifts over hours.

    Device time runs from power-on at `pace` times (1 + skew) of host time. Sweep k starts at its own multiple of
    the period. The 24-bit counter of milliseconds is device time plus an origin that resets move.
    """

    def __init__(self, parameters: Parameters, skew_ppm: float, pace: float, counter_ms: int, power_on_ns: int) -> None:
        self._parameters = parameters
        self._rate = round(pace * (1.0 + skew_ppm * 1e-6) * RATE_SCALE)
        self._power_on_ns = power_on_ns
        self._counter_origin_ms = counter_ms
        self._turn_origin_ns = 0
        self._turn_origin = 0
        self._turn_ns = round(parameters.period_s * 1e9)
        self._steps_ns = self._turn_ns * (parameters.last_step + 1) // parameters.steps_per_turn

    def device_ns(self, host_ns: int) -> int:
        """Device time at a host time."""
        return (host_ns - self._power_on_ns) * self._rate // RATE_SCALE

    def host_ns(self, device_ns: int) -> int:
        """The first host time at which this device time has come."""
        return self._power_on_ns - (-device_ns * RATE_SCALE // self._rate)

    def counter_ms(self, host_ns: int) -> int:
        """The 24-bit counter at a host time."""
        return self._counter(self.device_ns(host_ns))

    def sweep_counter_ms(self, sweep: int) -> int:
        """The stamp of a sweep: the counter at its step 0."""
        return self._counter(self._start_ns(sweep))

    def sweep_start_ns(self, sweep: int) -> int:
        """Host time of step 0."""
        return self.host_ns(self._start_ns(sweep))

    def sweep_end_ns(self, sweep: int) -> int:
        """Host time at which the last step has been measured."""
        return self.host_ns(self._start_ns(sweep) + self._steps_ns)

    def last_complete(self, host_ns: int) -> int:
        """The newest sweep whose last step has been measured; -1 before the first."""
        elapsed_ns = self.device_ns(host_ns) - self._steps_ns - self._turn_origin_ns
        return self._turn_origin + elapsed_ns // self._turn_ns

    def next_start(self, host_ns: int) -> int:
        """The first sweep whose step 0 is still to come."""
        return self._turn_origin - (self._turn_origin_ns - self.device_ns(host_ns)) // self._turn_ns

    def reset_counter(self, host_ns: int) -> None:
        """Counter to zero (RS, RT)."""
        self._counter_origin_ms = -(self.device_ns(host_ns) // NS_PER_MS)

    def slow_down(self, percent: int, host_ns: int) -> None:
        """Turn so much slower than nominal from the next sweep on (CR)."""
        sweep = self.last_complete(host_ns) + 2
        self._turn_origin_ns, self._turn_origin = self._start_ns(sweep), sweep
        self._turn_ns = round(self._parameters.period_s * 1e9 / (1.0 - percent / 100.0))
        self._steps_ns = self._turn_ns * (self._parameters.last_step + 1) // self._parameters.steps_per_turn

    def _start_ns(self, sweep: int) -> int:
        return self._turn_origin_ns + (sweep - self._turn_origin) * self._turn_ns

    def _counter(self, device_ns: int) -> int:
        # a sweep that had begun before a reset has the counter's first value, not one from before zero
        return max(0, self._counter_origin_ms + device_ns // NS_PER_MS) % COUNTER_MS
