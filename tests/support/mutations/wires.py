"""What comes over wires: replies of a laser, frames of a bus, payloads of zenoh to a rover and to its listeners."""

import json
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from random import Random
from tempfile import mkdtemp

import zenoh

from runtime.bridge.frame_prefix import with_prefix
from runtime.bridge.topics import TOPICS
from runtime.live_view.ticks import HEARD as DRAWN
from runtime.live_view.ticks import LiveTicks, path_of
from runtime.maps.live_grid import LiveGrid
from runtime.page.rover_state import HEARD as SHOWN
from runtime.page.rover_state import RoverState
from runtime.publish.commands import answer_of
from runtime.publish.follow import Message
from runtime.publish.publisher import ZenohPublisher
from runtime.publish.rover_status import believed
from runtime.publish.session import tool_config
from runtime.ros2.vehicle import Frames
from slam.settings.slam import SlamSettings
from tests.support.drivers.waiting import wait_until
from tests.support.mutations.commands import BATCH, LONGEST_S, Tally, in_a_process
from tests.support.mutations.files import mutated_bytes, mutated_text
from tests.support.mutations.odd_bus import FRAMES, LAYOUTS, Running, check_frames, check_thread
from tests.support.mutations.odd_laser import OddLaser, check_session
from tests.support.zenoh.wire import free_port, opened, publishing, put_ticks, settings_on, until

SESSIONS = 50  # of a laser, in one process
ANSWERED = ("pose", "status", "configuration", "map", "path", "tf_static")
COMMANDED = ("command/mark", "command/save", "*", "**", "command/*")
HERE = """{access_control: {enabled: true, default_permission: "deny", rules: [{id: "all", permission: "allow",
flows: ["ingress", "egress"], key_exprs: ["**"], messages: ["put", "delete", "declare_subscriber", "query", "reply",
"declare_queryable", "liveliness_token", "liveliness_query", "declare_liveliness_subscriber"]}],
subjects: [{id: "here", interfaces: ["lo"]}], policies: [{rules: ["all"], subjects: ["here"]}]}}"""
Payloads = dict[str, bytes]


def replies(seeds: range) -> Iterator[Tally]:
    """Of a laser, until so many were changed on their way."""
    made, seed = 0, seeds.start
    while made < len(seeds):
        tally = in_a_process(lambda tally, seed=seed: _sessions(seed, tally), f"sessions from {seed}")  # type: ignore[misc]
        made, seed = made + max(1, tally.tried), seed + SESSIONS
        yield tally


def _sessions(first: int, tally: Tally) -> None:
    for seed in range(first, first + SESSIONS):
        before = OddLaser.replies
        _check(lambda seed=seed: check_session(seed), f"session {seed}", tally)  # type: ignore[misc]
        tally.tried += OddLaser.replies - before


def frames(seeds: range) -> Iterator[Tally]:
    """Half of them to the layouts, half to a thread that reads a bus."""
    rounds = range(seeds.start, seeds.start + -(-len(seeds) // FRAMES))
    for first in rounds[::BATCH]:
        batch = range(first, min(first + BATCH, rounds.stop))
        yield in_a_process(lambda tally, batch=batch: _rounds(batch, tally), f"rounds {batch}")  # type: ignore[misc]


def _rounds(batch: range, tally: Tally) -> None:
    reader = Running()
    wait_until(lambda: reader.encoders.health().counters.get("bus.sessions", 0) > 0)
    for seed in batch:
        if seed % 2:
            _check(lambda seed=seed: check_thread(reader, seed), f"round {seed}", tally)  # type: ignore[misc]
        else:
            name = list(LAYOUTS)[seed // 2 % len(LAYOUTS)]
            _check(lambda seed=seed, name=name: check_frames(name, seed), f"round {seed} of {name}", tally)  # type: ignore[misc]
        tally.tried += FRAMES
    reader.close()


def payloads(seeds: range) -> Iterator[Tally]:
    """Half of them to a rover, half to the tools that listen to one."""
    for first in seeds[::BATCH]:
        batch = range(first, min(first + BATCH, seeds.stop))
        work = _to_rover if (first // BATCH) % 2 else _to_tools
        yield in_a_process(lambda tally, batch=batch, work=work: work(batch, tally), f"payloads {batch}")  # type: ignore[misc]


def _to_rover(batch: range, tally: Tally) -> None:
    port, file = free_port(), Path(mkdtemp()) / "zenoh.json5"
    file.write_text(HERE)
    with publishing(settings_on(port, commands=True, config_file=str(file))) as publisher:
        assert opened(publisher)
        put_ticks(publisher, range(12), 0.0)
        with zenoh.open(tool_config(f"tcp/127.0.0.1:{port}")) as session:
            for seed in batch:
                _ask(session, Random(seed))
                tally.tried += 1
                if seed % 20 == 19:
                    put_ticks(publisher, range(2), 0.0)
                    publisher.drain_events()
                    _check(lambda: _is_well(session, publisher), f"up to payload {seed}", tally)


def _ask(session: zenoh.Session, rng: Random) -> None:
    key = f"infant/{rng.choice(('r1', '*'))}/{rng.choice((*ANSWERED, *COMMANDED))}"
    payload = rng.choice((b"", b"seen", mutated_text(rng, b'{"reason": "seen"}', [HERE.encode()]), rng.randbytes(3000)))
    with suppress(zenoh.ZError):
        if rng.random() < 0.3:
            session.put(key, payload, encoding=zenoh.Encoding(rng.choice(("text/plain", "zenoh/bytes", "x" * 200))))
        else:
            selector = key + rng.choice(("", "?a=b", "?_time=[now(-1h)..]", "?" + "x;" * 50))
            session.get(
                selector, handler=zenoh.handlers.RingChannel(1), payload=payload, attachment=payload, timeout=0.2
            )


def _is_well(session: zenoh.Session, publisher: ZenohPublisher) -> None:
    """It answers, its thread lives, and nothing was raised in it."""

    def answer() -> bool:
        return any(reply.ok for reply in session.get("infant/r1/status", timeout=1.0))

    assert until(answer, 60.0)
    assert publisher._thread.is_alive()
    assert publisher._failures.trouble == ""


def _to_tools(batch: range, tally: Tally) -> None:
    said = _said_by_a_rover()
    for seed in batch:
        _check(lambda seed=seed: _hear(said, Random(seed)), f"payload {seed}", tally)  # type: ignore[misc]
        tally.tried += 1


def _said_by_a_rover() -> Payloads:
    """A payload of each name, as a rover says or answers it."""
    port, said = free_port(), Payloads()
    with publishing(settings_on(port)) as publisher:
        assert opened(publisher)
        with zenoh.open(tool_config(f"tcp/127.0.0.1:{port}")) as session:
            subscriber = session.declare_subscriber("infant/r1/*", zenoh.handlers.FifoChannel(1000))

            def has_all() -> bool:
                put_ticks(publisher, range(12), 0.0)
                while (sample := subscriber.try_recv()) is not None:
                    said[str(sample.key_expr).rsplit("/", 1)[1]] = sample.payload.to_bytes()
                for name in ("map", "path", "tf_static"):
                    for reply in session.get(f"infant/r1/{name}", timeout=1.0):
                        if reply.ok is not None:
                            said[name] = reply.ok.payload.to_bytes()
                return said.keys() >= {"pose", "odom", "scan_full", "status", "event", "landmarks", "map", "path"}

            assert until(has_all, 60.0), said.keys()
    return said


def _hear(said: Payloads, rng: Random) -> None:
    """One message changed, among whole ones, to every tool."""
    state, ticks, grid = RoverState("r1"), LiveTicks("r1"), LiveGrid(SlamSettings(), 0.1)
    odd = rng.choice(sorted(said))
    changed = mutated_bytes(rng, said[odd]) if rng.random() < 0.5 else mutated_text(rng, said[odd], list(said.values()))
    for name, whole in said.items():
        data = changed if name == odd else whole
        if name in (*SHOWN, "path"):
            state.take(Message(name, data))
        if name in (*DRAWN, "map"):
            ticks.take(Message(name, data))
        if name in ("pose", "scan_full"):
            grid.take(name.removesuffix("_full"), data)
        for topic in TOPICS:
            if topic.key == name:
                with suppress(ValueError):
                    with_prefix(topic.type_name, data, Frames("rover"))
    json.dumps(state.beat(True), allow_nan=False)
    grid.grid.grid_map()
    answer_of(zenoh.ZBytes(changed))
    for judge in (lambda: believed("infant/r1/status", changed), lambda: path_of(changed)):
        with suppress(ValueError):
            judge()


def _check(check: Callable[[], object], what: str, tally: Tally) -> None:
    """Whatever is raised is a thread that would have ended."""
    began_s = time.process_time()
    try:
        check()
    except BaseException as error:  # noqa: BLE001 pytest's own outcome too
        where = traceback.extract_tb(error.__traceback__)[-1]
        tally.hurt["thread"].append(f"{what}: {type(error).__name__}: {error} ({where.filename}:{where.lineno})"[:600])
    used_s = time.process_time() - began_s
    tally.longest_s = max(tally.longest_s, used_s)
    if used_s > LONGEST_S:
        tally.hurt["hang"].append(f"{what}: {used_s:.0f} s")
