"""Runs that no recorder writes: every checksum in them is right."""

import hashlib
import json
import struct
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import zstandard

from runtime.messages.tick import Record
from runtime.record.header import RunHeader
from runtime.record.mcap_file import RecordFile, RunWriter
from runtime.record.mcap_prefix import CHANNEL, CHUNK, CHUNK_HEAD, MESSAGE, MESSAGE_HEAD, RECORD_HEAD

HEADER = RunHeader("seed = 1\n", "live", boot_id="b", created_utc="2026-01-01T00:00:00Z")


def text(value: str) -> bytes:
    data = value.encode()
    return struct.pack("<I", len(data)) + data


def record(opcode: int, body: bytes) -> bytes:
    return RECORD_HEAD.pack(opcode, len(body)) + body


def chunk(records: bytes, level: int = 3) -> bytes:
    """A chunk as MCAP has it, with the checksum that it has to have."""
    head = CHUNK_HEAD.pack(0, 0, len(records), zlib.crc32(records))
    packed = zstandard.ZstdCompressor(level=level).compress(records)
    return record(CHUNK, head + text("zstd") + struct.pack("<Q", len(packed)) + packed)


def channel(number: int, topic: str) -> bytes:
    return record(CHANNEL, struct.pack("<HH", number, 0) + text(topic) + text("cdr") + struct.pack("<I", 0))


def message(number: int, data: bytes) -> bytes:
    return record(MESSAGE, MESSAGE_HEAD.pack(number, 0, 0, 0) + data)


def with_segment(number: str) -> dict[str, dict[str, str]]:
    return {**HEADER.metadata, "segment": {"number": number}}


def run_with(folder: Path, after_head: bytes, metadata: dict[str, dict[str, str]] | None = None) -> Path:
    """A run whose head is in order and is followed by these bytes."""
    folder.mkdir(parents=True)
    file = RecordFile(folder / "run.mcap", metadata or HEADER.metadata)
    file.write()
    file.close()
    with (folder / "run.mcap").open("ab") as stream:
        stream.write(after_head)
    return folder


def run_of(folder: Path, ticks: Iterable[list[Record]]) -> Path:
    """A closed run of these records, whatever they hold."""
    folder.mkdir(parents=True)
    writer = RunWriter(folder / "run.mcap", HEADER.metadata)
    for records in ticks:
        writer.add(records)
    writer.close()
    return folder


def write_manifest(folder: Path, *lines: dict[str, Any]) -> Path:
    """manifest.jsonl with a chain of hashes that is right."""
    chain, content = "", ""
    for facts in lines:
        packed = json.dumps(facts, sort_keys=True, separators=(",", ":"))
        chain = hashlib.sha256(f"{chain}{packed}".encode()).hexdigest()
        content += json.dumps({**facts, "chain": chain}, sort_keys=True) + "\n"
    path = folder / "manifest.jsonl"
    path.write_text(content)
    return path
