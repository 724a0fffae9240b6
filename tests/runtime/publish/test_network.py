"""What a network may do to the rover costs the loop nothing; the figures are printed with -s."""

import json
import signal
import subprocess
import sys

import pytest

from runtime.source_tree import ROOT
from tests.support.runtime.network_trials import Trial, accepts, trials
from tests.support.zenoh.wire import free_port, start_module

PUT_P99_MS = 1.0
BACK_S = 2.0
CLOSE_S = 4.0  # of which 3 s are waited for a peer that has stopped reading

FORGETFUL = """
import sys
from runtime.publish.publisher import ZenohPublisher
from tests.support.zenoh.wire import opened, put_ticks, settings_on, start_module
port = int(sys.argv[1])
publisher = ZenohPublisher(settings_on(port), "r1")
assert opened(publisher)
put_ticks(publisher, range(3), 0.0)
asker = start_module("tests.support.zenoh.asker", f"tcp/127.0.0.1:{port}", "infant/r1/pose", "10")
put_ticks(publisher, range(20), 0.01)
"""


def check(trial: Trial) -> dict[str, float]:
    figures = trial.summary()
    assert figures.get("dropped", 0) == 0
    assert figures.get("heard", 0) == figures.get("came", 0), "each who came heard the rover"
    return figures


def test_whoever_comes_and_goes_is_served() -> None:
    check(trials(short=True)["visitors"]())


@pytest.mark.soak
@pytest.mark.parametrize("name", list(trials(short=False)))
def test_put_takes_less_than_a_millisecond_whatever_the_network_does(name: str) -> None:
    figures = check(trials(short=False)[name]())
    sys.stdout.write(json.dumps({"trial": name, **figures}) + "\n")
    assert figures["close_s"] < CLOSE_S
    assert figures["put_p99_ms"] < PUT_P99_MS
    assert figures.get("back_max_s", 0.0) < BACK_S


@pytest.mark.parametrize("times", [2, pytest.param(30, marks=pytest.mark.soak)])
def test_a_process_that_forgot_to_close_ends_while_it_is_being_asked(times: int) -> None:
    """Without closing before the end, half of such processes aborted: an answer met an interpreter that was gone."""
    for _ in range(times):
        port = free_port()
        arguments = [sys.executable, "-c", FORGETFUL, str(port)]
        ended = subprocess.run(arguments, cwd=ROOT, timeout=600.0, check=False)
        assert ended.returncode == 0


STALLED = """
import os, signal, sys
from runtime.publish.publisher import ZenohPublisher
from tests.support.zenoh.wire import Listener, put_ticks, settings_on, until
port = int(sys.argv[1])
publisher = ZenohPublisher(settings_on(port), "r1")
listener = Listener(f"tcp/127.0.0.1:{port}", "infant/**", 60.0)
assert until(lambda: bool(put_ticks(publisher, range(1), 0.0)) and len(listener.messages) > 0)
os.kill(listener.process.pid, signal.SIGSTOP)
put_ticks(publisher, range(1200), 0.002)
publisher.close()
print(listener.process.pid, flush=True)
"""


@pytest.mark.soak
def test_a_process_ends_in_order_while_a_subscriber_is_stalled() -> None:
    arguments = [sys.executable, "-c", STALLED, str(free_port())]
    ended = subprocess.run(arguments, cwd=ROOT, timeout=600.0, check=False, stdout=subprocess.PIPE)
    subprocess.run(["kill", "-9", ended.stdout.decode().strip()], check=True)
    assert ended.returncode == 0


def test_a_killed_router_is_noticed_by_the_trial() -> None:
    """The trials would prove nothing if the router lived on."""
    port = free_port()
    router = start_module("tests.support.zenoh.router", f"tcp/127.0.0.1:{port}")
    assert accepts(port)
    router.send_signal(signal.SIGKILL)
    router.wait()
    assert not accepts(port)
