"""The simulated laser: sensor, clock, ports and faults, in one thread that waits for whatever comes next."""

import os
import selectors
import threading
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.scip.scan import CodeArray
from drivers.settings.simulated_laser import FaultKind, LaserFault, SimulatedLaserSettings
from drivers.simulated.laser.fault_injector import FaultInjector, Faults
from drivers.simulated.laser.faults import FaultSchedule, as_fault
from drivers.simulated.laser.motor import LaserMotor
from drivers.simulated.laser.ports import PtyPort, TcpPort, Wire
from drivers.simulated.laser.profiles import LaserProfile, profile_of
from drivers.simulated.laser.protocol import LaserProtocol, Sweep

PREPARE_NS = 6_000_000  # casting the rays of a sweep takes up to 3 ms
RESTING_S = 0.5

Order = Callable[[int], None]


class LaserDevice:
    """Speaks SCIP over TCP and, if asked for, over a pseudo-terminal.

    ranges_at(t_ns): true ranges in metres, (steps of the profile,), of the sweep whose step 0 is at host time t_ns;
    inf where nothing is, NaN where nothing could be measured; called from the device's own thread. Faults begin at
    start() or with inject().
    """

    def __init__(
        self,
        settings: SimulatedLaserSettings,
        ranges_at: Callable[[int], NDArray[np.float64]],
        now_ns: Callable[[], int],
    ) -> None:
        self._settings = settings
        self._profile = profile_of(settings)
        self._ranges_at = ranges_at
        self._now_ns = now_ns
        self._tcp = TcpPort(settings.host, settings.port)
        self._pty = PtyPort(settings.pty) if settings.pty is not None else None
        self._schedule = FaultSchedule()
        self._injector = FaultInjector(np.random.default_rng(settings.seed))
        self._orders: deque[Order] = deque()
        self._selector = selectors.DefaultSelector()
        self._wake_read, self._wake_write = os.pipe()
        self._thread = threading.Thread(target=self._run, name="simulated-laser", daemon=True)
        self.tap: Callable[[bytes], None] | None = None  # gets what is sent
        self._closing = self._listening = False
        self._powered = True
        self._faults: Faults = {}
        self._restart_ns: int | None = None
        self._streaming: Wire | None = None
        self._due = 0
        self._prepared: tuple[int, CodeArray] | None = None
        self._power_on(now_ns(), settings.clock_start_ms)

    @property
    def profile(self) -> LaserProfile:
        """The model that it is."""
        return self._profile

    @property
    def url(self) -> str:
        """Where it listens; its port is known after start()."""
        return self._tcp.url

    @property
    def pty_url(self) -> str | None:
        """The pseudo-terminal as a URL of the driver; None without one."""
        return self._pty.url if self._pty is not None else None

    @property
    def has_faults(self) -> bool:
        """True while something is wrong with it."""
        return bool(self._faults) or bool(self._orders)

    @property
    def is_listening(self) -> bool:
        """True while it has power, has booted and is plugged in."""
        return self._listening and self._powered and self._restart_ns is None

    @property
    def next_scan_ns(self) -> int | None:
        """Host time at which the next scan is sent; None while nobody asks for any."""
        asked = self._protocol.request is not None and self._streaming is not None
        return self._motor.sweep_end_ns(self._due) if asked else None

    def recheck_clock(self) -> None:
        """Look at the clock again at once: it has leapt."""
        self._wake()

    def start(self) -> None:
        """Begin to listen and to turn. Raises LinkError if the address or the path is taken."""
        os.set_blocking(self._wake_read, False)
        self._selector.register(self._wake_read, selectors.EVENT_READ, self._drain_wake)
        self._plug_in()
        for fault in self._settings.faults:
            self._schedule.add(fault, self._now_ns())
        self._thread.start()

    def inject(self, fault: LaserFault | Mapping[str, Any]) -> None:
        """Let something go wrong. Raises pydantic.ValidationError for a fault that does not exist."""
        known = as_fault(fault)
        self._order(lambda now_ns: self._schedule.add(known, now_ns))

    def clear(self) -> None:
        """End all faults."""
        self._order(lambda _: self._schedule.clear())

    def close(self) -> None:
        """Stop, and release ports and thread."""
        self._closing = True
        if self._thread.is_alive():
            self._wake()
            self._thread.join()
        self._unplug(reset=False)
        self._selector.close()
        for descriptor in (self._wake_read, self._wake_write):
            os.close(descriptor)

    def _order(self, order: Order) -> None:
        self._orders.append(order)
        self._wake()

    def _wake(self) -> None:
        os.write(self._wake_write, b"!")

    def _drain_wake(self, now_ns: int) -> None:
        os.read(self._wake_read, 4096)
        while self._orders:
            self._orders.popleft()(now_ns)

    def _run(self) -> None:
        while not self._closing:
            now_ns = self._now_ns()
            self._faults = self._schedule.now(now_ns)
            self._apply_power(self._faults, now_ns)
            self._stream_sweeps(self._faults, now_ns)
            self._injector.deliver(now_ns)
            self._watch_for_write()
            for key, _ in self._selector.select(self._waiting_s(self._now_ns())):
                key.data(self._now_ns())

    def _watch_for_write(self) -> None:
        """Wait for room to write as well where a client is behind."""
        for wire in (self._tcp.wire, self._pty.wire if self._pty is not None else None):
            if wire is not None:
                key = self._selector.get_key(wire.descriptor)
                events = selectors.EVENT_READ | (selectors.EVENT_WRITE if wire.has_unsent else 0)
                if key.events != events:
                    self._selector.modify(wire.descriptor, events, key.data)

    def _waiting_s(self, now_ns: int) -> float:
        times = [self._schedule.next_change_ns(now_ns), self._restart_ns, self._injector.next_ns]
        if self._protocol.request is not None and self._streaming is not None:
            end_ns = self._motor.sweep_end_ns(self._due)
            times.append(end_ns if self._prepared is not None else end_ns - PREPARE_NS)
        until_ns = min((time for time in times if time is not None), default=None)
        return RESTING_S if until_ns is None else max(0.0, min(RESTING_S, (until_ns - now_ns) * 1e-9))

    def _power_on(self, now_ns: int, counter_ms: int) -> None:
        settings = self._settings
        self._motor = LaserMotor(self._profile.parameters, settings.skew_ppm, settings.pace, counter_ms, now_ns)
        self._protocol = LaserProtocol(self._profile, self._motor, self._latest_sweep)
        self._streaming, self._prepared = None, None

    def _apply_power(self, faults: Faults, now_ns: int) -> None:
        """Ports and clock after power, cable and reboots."""
        boot_ns = round(self._settings.boot_s * 1e9)
        if FaultKind.OFF in faults:
            self._unplug(reset=False)
            self._powered, self._restart_ns = False, None
            return
        if FaultKind.POWER_CYCLE in faults or not self._powered:
            self._unplug(reset=False)
            self._powered, self._restart_ns = True, now_ns + boot_ns
        elif self._protocol.rebooting and self._restart_ns is None:
            self._restart_ns = now_ns + boot_ns + round(self._settings.reboot_disconnect_s * 1e9)
            self._schedule.remove(FaultKind.STATUS)
        if self._restart_ns is not None:
            if self._listening and now_ns >= self._restart_ns - boot_ns:
                self._unplug(reset=False)
            if now_ns < self._restart_ns:
                return
            self._restart_ns = None
            self._power_on(now_ns, 0)
        if FaultKind.CUT in faults:
            self._unplug(reset=True)
        elif not self._listening:
            self._plug_in()
        if FaultKind.STATUS not in faults and not self._protocol.rebooting:
            self._protocol.recover()
        if FaultKind.CLOCK_RESET in faults:
            self._motor.reset_counter(now_ns)

    def _plug_in(self) -> None:
        self._tcp.open()
        assert self._tcp.listener is not None
        self._selector.register(self._tcp.listener, selectors.EVENT_READ, self._accept)
        if self._pty is not None:
            self._register(self._pty.open())
        self._listening = True

    def _unplug(self, reset: bool) -> None:
        if not self._listening:
            return
        self._forget(self._tcp.wire)
        if self._tcp.listener is not None:
            self._selector.unregister(self._tcp.listener)
        self._tcp.close(reset)
        if self._pty is not None:
            self._forget(self._pty.wire)
            self._pty.close()
        self._listening = False

    def _register(self, wire: Wire) -> None:
        wire.tap = self.tap
        self._selector.register(wire.descriptor, selectors.EVENT_READ, lambda now_ns: self._answer(wire, now_ns))

    def _forget(self, wire: Wire | None) -> None:
        """A client is gone: its descriptor, its stream and what was on its way to it."""
        if wire is None:
            return
        self._selector.unregister(wire.descriptor)
        self._injector.forget(wire)
        if self._streaming in (wire, None):
            self._protocol.disconnect()
            self._streaming = None

    def _accept(self, now_ns: int) -> None:
        if self._tcp.wire is not None:
            self._answer(self._tcp.wire, now_ns)  # it may have gone without having been noticed
        wire = self._tcp.accept()
        if wire is not None:
            self._register(wire)

    def _answer(self, wire: Wire, now_ns: int) -> None:
        """Answer the commands that have come over one port."""
        wire.flush()
        lines = wire.commands()
        if lines is None:
            self._forget(wire)
            if wire is self._tcp.wire:
                self._tcp.hang_up()
            return
        for line in lines:
            if not self._is_at_baud(wire):
                self._injector.send_noise(wire)
                continue
            before = self._protocol.request
            reply = self._protocol.reply(line, now_ns)
            if reply:
                self._injector.send(wire, reply, self._faults, now_ns)
            if self._protocol.request is not None and self._protocol.request is not before:
                self._streaming, self._prepared = wire, None
                self._due = self._motor.next_start(now_ns)  # the laser has just gone on

    def _is_at_baud(self, wire: Wire) -> bool:
        """False on a serial line at another rate than the sensor's."""
        if self._pty is None or wire is not self._pty.wire or not self._profile.bauds:
            return True
        return self._pty.baud in (None, self._protocol.baud)

    def _stream_sweeps(self, faults: Faults, now_ns: int) -> None:
        """Prepare the sweep that is about to end, and send it when it has."""
        request, wire = self._protocol.request, self._streaming
        if request is None or wire is None:
            return
        wire.flush()
        end_ns = self._motor.sweep_end_ns(self._due)
        if self._prepared is None and now_ns >= end_ns - PREPARE_NS:
            self._prepared = (self._due, self._codes(self._due))
        if self._prepared is None or now_ns < end_ns:
            return
        sweep = self._injector.sweep(Sweep(self._motor.sweep_counter_ms(self._due), self._prepared[1]), faults)
        self._injector.send_scan(wire, self._protocol, sweep, faults, now_ns)
        slow = faults.get(FaultKind.SLOW)
        stride = (request.interval + 1) * (slow.keep_every if slow is not None else 1)
        # after a stall of this program the sweeps in between are lost, as they are when a sensor's buffer overflows
        self._due = max(self._due + stride, self._motor.last_complete(now_ns))
        self._prepared = None

    def _latest_sweep(self) -> Sweep:
        sweep = max(0, self._motor.last_complete(self._now_ns()))
        return Sweep(self._motor.sweep_counter_ms(sweep), self._codes(sweep))

    def _codes(self, sweep: int) -> CodeArray:
        ranges_m = self._ranges_at(self._motor.sweep_start_ns(sweep))
        parameters = self._profile.parameters
        steps = parameters.last_step - parameters.first_step + 1
        if ranges_m.shape != (steps,):
            raise ValueError(f"{ranges_m.shape=} but {parameters.model} has {steps} steps")
        return self._profile.codes_mm(ranges_m)
