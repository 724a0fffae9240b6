"""What a network may do to a rover that publishes, with figures.

python -m tests.support.runtime.network_trials [--short].

Each trial returns seconds that the loop spent in every put, and what else it measured.
"""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from runtime.publish.publisher import ZenohPublisher
from runtime.source_tree import ROOT
from runtime.tick import CompletedTick
from tests.support.runtime.recorded_values import make_estimate, make_tick, make_timing
from tests.support.zenoh.wire import (
    free_port,
    listening,
    opened,
    publishing,
    put_ticks,
    settings_on,
    start_module,
    until,
)

PUT_PERIOD_S = 0.01  # ten times the rover's rate: more puts to measure


@dataclass
class Trial:
    """What was measured: seconds of each put, seconds that closing took, and further figures by name."""

    put_s: list[float]
    close_s: float = 0.0
    figures: dict[str, float] = field(default_factory=dict)

    def summary(self) -> dict[str, float]:
        put_ms = np.array(self.put_s) * 1e3
        return {
            "puts": len(self.put_s),
            "put_p50_ms": round(float(np.percentile(put_ms, 50)), 4),
            "put_p99_ms": round(float(np.percentile(put_ms, 99)), 4),
            "put_max_ms": round(float(put_ms.max()), 3),
            "close_s": round(self.close_s, 3),
            **self.figures,
        }


class Putting:
    """Puts ticks from a thread of its own, as the loop does, while something else happens."""

    def __init__(self, publisher: ZenohPublisher) -> None:
        self.put_s: list[float] = []
        self._publisher = publisher
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        rng, seq = np.random.default_rng(1), 0
        values = [(make_tick(k, rng), make_estimate(k * 100_000_000, rng), make_timing(k)) for k in range(50)]
        while not self._stop.wait(PUT_PERIOD_S):
            tick, estimate, timing = values[seq % len(values)]
            began_s = time.perf_counter()
            self._publisher.put(CompletedTick(tick, estimate, timing, bytes(16), None))
            self.put_s.append(time.perf_counter() - began_s)
            seq += 1

    def stop(self) -> list[float]:
        self._stop.set()
        self._thread.join()
        return self.put_s


def close_seconds(publisher: ZenohPublisher) -> float:
    began_s = time.monotonic()
    publisher.close()
    return time.monotonic() - began_s


def nobody_listens(puts: int) -> Trial:
    with publishing(settings_on(free_port())) as publisher:
        assert opened(publisher)
        trial = Trial(put_ticks(publisher, range(puts), PUT_PERIOD_S))
        trial.close_s = close_seconds(publisher)
    return trial


def one_listens(puts: int) -> Trial:
    port = free_port()
    with publishing(settings_on(port)) as publisher, listening(f"tcp/127.0.0.1:{port}", "infant/**") as listener:
        assert until(lambda: bool(put_ticks(publisher, range(1), 0.0)) and len(listener.messages) > 0)
        trial = Trial(put_ticks(publisher, range(puts), PUT_PERIOD_S))
        trial.close_s = close_seconds(publisher)
    return trial


def many_come_and_go(visitors: int, within_s: float) -> Trial:
    """Sessions that connect, subscribe, hear something and leave, one after the other."""
    port = free_port()
    with publishing(settings_on(port)) as publisher:
        assert opened(publisher)
        putting = Putting(publisher)
        arguments = [sys.executable, "-m", "tests.support.zenoh.visitors", f"tcp/127.0.0.1:{port}"]
        arguments += [str(visitors), str(within_s)]
        said = json.loads(subprocess.run(arguments, cwd=ROOT, stdout=subprocess.PIPE, check=True).stdout)
        trial = Trial(putting.stop())
        trial.close_s = close_seconds(publisher)
    trial.figures = {"came": said["came"], "heard": said["heard"], "first_message_max_s": round(said["longest_s"], 3)}
    return trial


def one_stalls(seconds: float) -> Trial:
    """A subscriber that is stopped (SIGSTOP) while it is being sent to."""
    port = free_port()
    with publishing(settings_on(port)) as publisher, listening(f"tcp/127.0.0.1:{port}", "infant/**") as listener:
        assert until(lambda: bool(put_ticks(publisher, range(1), 0.0)) and len(listener.messages) > 0)
        os.kill(listener.process.pid, signal.SIGSTOP)
        trial = Trial(put_ticks(publisher, range(round(seconds / PUT_PERIOD_S)), PUT_PERIOD_S))
        trial.figures = {"dropped": publisher.health().dropped}
        trial.close_s = close_seconds(publisher)
    return trial


def accepts(port: int) -> bool:
    """Whether someone listens on this port of the loopback."""
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def router_dies_and_returns(times: int) -> Trial:
    """The router is killed and started again; how long until a listener behind it hears the rover again."""
    port = free_port()
    endpoint = f"tcp/127.0.0.1:{port}"
    back_s = []
    router = start_module("tests.support.zenoh.router", endpoint)
    try:
        with (
            publishing(settings_on(free_port(), connect=(endpoint,))) as publisher,
            listening(endpoint, "infant/**", 20.0 + 10.0 * times) as listener,
        ):
            putting = Putting(publisher)
            assert until(lambda: len(listener.messages) > 0)
            for _ in range(times):
                router.kill()
                router.wait()
                time.sleep(1.0)
                heard = len(listener.messages)
                command = [sys.executable, "-m", "tests.support.zenoh.router", endpoint]
                router = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL)
                assert until(lambda: accepts(port))
                began_s = time.monotonic()
                assert until(lambda heard=heard: len(listener.messages) > heard)  # type: ignore[misc]
                back_s.append(time.monotonic() - began_s)
            trial = Trial(putting.stop())
            trial.close_s = close_seconds(publisher)
    finally:
        router.kill()
        router.wait()
    median_s = round(float(np.median(back_s)), 3)
    trial.figures = {"restarts": times, "back_p50_s": median_s, "back_max_s": round(max(back_s), 3)}
    return trial


def trials(short: bool) -> dict[str, Callable[[], Trial]]:
    """By name; the short ones take some seconds together."""
    return {
        "nobody listens": lambda: nobody_listens(200 if short else 2000),
        "one listens": lambda: one_listens(200 if short else 2000),
        "visitors": lambda: many_come_and_go(*(20, 120.0) if short else (1000, 2.0)),
        "one stalls": lambda: one_stalls(2.0 if short else 20.0),
        "router restarts": lambda: router_dies_and_returns(1 if short else 10),
    }


if __name__ == "__main__":
    for name, trial in trials("--short" in sys.argv).items():
        sys.stdout.write(json.dumps({"trial": name, **trial().summary()}) + "\n")
        sys.stdout.flush()
