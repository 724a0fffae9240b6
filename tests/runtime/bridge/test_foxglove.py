"""A client that speaks Foxglove's protocol sees the rover, also one that comes late; faults are one sentence."""

import asyncio
import contextlib
import io
import json
import re
import socket
import struct
import threading
from typing import Any

import pytest

from runtime.bridge.foxglove import MOST_CLIENTS, FoxgloveOptions, FoxgloveServer, bridge_foxglove
from runtime.bridge.topics import TOPICS
from runtime.errors import SensorError
from runtime.messages.definitions import deserialize
from runtime.service.memory import resident_mb
from tests.support.zenoh.wire import free_port, opened, publishing, put_ticks, settings_on, until

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed; make test installs it")
from tornado.httpclient import HTTPRequest
from tornado.websocket import websocket_connect

WAIT_S = 60.0
NOT_AT_ONCE = ("particles", "path", "grid", "health")  # once a second or less, or when something changes
MESSAGE = 1  # opcode; then the subscription, the stamp and the message


async def heard(port: int, wanted: set[str]) -> dict[str, Any]:
    """One message of each wanted topic, decoded, as a viewer that has just connected gets it."""
    request = HTTPRequest(f"ws://127.0.0.1:{port}/")
    connection = await websocket_connect(request, subprotocols=["foxglove.sdk.v1"], max_message_size=1 << 28)
    channels: dict[int, tuple[str, str]] = {}
    found: dict[str, Any] = {}
    while wanted - found.keys():
        said = await asyncio.wait_for(connection.read_message(), WAIT_S)
        assert said is not None, f"closed after {sorted(found)}"
        if isinstance(said, str):
            told = json.loads(said)
            fresh = [each for each in told.get("channels", ()) if each["topic"] in wanted]
            assert all((each["encoding"], each["schemaEncoding"]) == ("cdr", "ros2msg") for each in fresh)
            channels |= {each["id"]: (each["topic"], each["schemaName"]) for each in fresh}
            asked = [{"id": each["id"], "channelId": each["id"]} for each in fresh]
            await connection.write_message(json.dumps({"op": "subscribe", "subscriptions": asked}))
        elif said[0] == MESSAGE:
            topic, type_name = channels[struct.unpack_from("<I", said, 1)[0]]
            found[topic] = deserialize(type_name, said[13:])
    connection.close()
    return found


def test_a_viewer_that_comes_late_gets_every_topic_and_what_is_said_once() -> None:
    port, stop, said = free_port(), threading.Event(), io.StringIO()
    options = FoxgloveOptions(connect=f"tcp/127.0.0.1:{port}", rover="r1", port=0)
    with publishing(settings_on(port)) as publisher:
        assert opened(publisher)
        driving = threading.Event()

        def drive() -> None:
            seq = 0
            while not driving.is_set():
                put_ticks(publisher, range(seq, seq + 5), 0.1)
                seq += 5

        def serve() -> None:
            while not stop.is_set():
                with contextlib.suppress(SensorError):  # on a busy machine the rover takes its time to answer
                    bridge_foxglove(options, stop, said)

        wheels = threading.Thread(target=drive)
        wheels.start()
        bridge = threading.Thread(target=serve)
        bridge.start()
        try:
            assert until(lambda: "is served" in said.getvalue(), WAIT_S)
            served = int(re.findall(r":(\d+)\n", said.getvalue())[0])
            wanted = {topic.name for topic in TOPICS if topic.key not in NOT_AT_ONCE}
            first = asyncio.run(heard(served, wanted))
            again = asyncio.run(heard(served, {"/tf_static", "/pose"}))
        finally:
            driving.set()
            wheels.join()
            stop.set()
            bridge.join()
    assert first["/pose"].header.frame_id == "map"
    assert again["/tf_static"] == first["/tf_static"]
    assert {each.child_frame_id for each in first["/tf_static"].transforms} == {"laser"}


def test_a_port_in_use_and_an_address_not_ours_are_one_sentence() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(SensorError, match="cannot be served: Address already in use; give others with --host and"):
            FoxgloveServer("r1", "127.0.0.1", taken.getsockname()[1])
    with pytest.raises(SensorError, match="cannot be served"):
        FoxgloveServer("r1", "203.0.113.7", 0)
    with pytest.raises(SensorError, match="does not answer"):
        bridge_foxglove(
            FoxgloveOptions(connect=f"tcp/127.0.0.1:{free_port()}", rover="r1"), threading.Event(), io.StringIO()
        )


def deaf(port: int) -> socket.socket:
    """A client that subscribes to everything, known or not, and reads nothing from then on."""
    client = socket.create_connection(("127.0.0.1", port))
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    client.sendall(
        b"GET / HTTP/1.1\r\nHost: x\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
    )
    client.settimeout(WAIT_S)
    said = b""
    while not (found := re.search(rb'"id":(\d+)', said)):
        said += client.recv(4096)
    asked = [{"id": number, "channelId": number} for number in (int(found[1]), 1 << 20)]
    words = json.dumps({"op": "subscribe", "subscriptions": asked}).encode()
    client.sendall(struct.pack(">BBH4x", 0x81, 0x80 | 126, len(words)) + words)  # masked by zeros
    return client


def test_clients_that_do_not_read_cost_little_memory_no_words_and_do_not_keep_it_from_ending(
    capfd: pytest.CaptureFixture[str],
) -> None:
    server = FoxgloveServer("r1", "127.0.0.1", 0)
    writer = server.writer(TOPICS[0])
    with contextlib.ExitStack() as clients:
        for _ in range(8):
            clients.enter_context(contextlib.closing(deaf(server.port)))
        pause, before_mb = threading.Event(), resident_mb()
        for _ in range(400):
            writer.write(bytes(100_000))
            pause.wait(0.005)
        assert resident_mb() - before_mb < 100.0  # 8 times 32 messages; all of them are 320 MB
        closing = threading.Thread(target=server.close, daemon=True)
        closing.start()
        closing.join(WAIT_S)
        assert not closing.is_alive()
    assert "unknown channel" not in "".join(capfd.readouterr())


def heard_by(client: socket.socket) -> bytes:
    """Whatever has come until nothing more does."""
    client.settimeout(0.5)
    said = b""
    with contextlib.suppress(TimeoutError):
        while block := client.recv(1 << 16):
            said += block
    return said


def test_of_any_number_of_clients_the_last_twenty_get_messages_and_the_others_when_those_have_gone() -> None:
    """A hundred that did not read cost 130 MB."""
    server = FoxgloveServer("r1", "127.0.0.1", 0)
    writer = server.writer(TOPICS[0])
    with contextlib.ExitStack() as clients:
        clients.callback(server.close)
        came = [clients.enter_context(contextlib.closing(deaf(server.port))) for _ in range(MOST_CLIENTS + 3)]
        assert until(lambda: len(server.clients._topics) == len(came), WAIT_S)
        assert len(server.clients.of(TOPICS[0].name)) == MOST_CLIENTS
        writer.write(b"first message" * 4)
        assert [b"first message" in heard_by(client) for client in came[:4]] == [False, False, False, True]
        for client in came[4:]:
            client.close()
        assert until(lambda: len(server.clients.of(TOPICS[0].name)) == 4, WAIT_S)
        writer.write(b"second message" * 4)
        assert all(b"second message" in heard_by(client) for client in came[:4])
