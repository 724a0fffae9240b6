"""Commands over zenoh, on either side: the rover that answers them and the tool that asks.

A command is a query on infant/<rover>/command/<mark|save|stop|initial_pose> whose payload is the reason, of the last
one the pose (runtime.commands.parse_prior). They are off unless
publish.commands says so, and then the rover wants a zenoh configuration with access rules (see session.py).
"""

import json
from collections.abc import Callable
from dataclasses import dataclass

import zenoh

from runtime.commands import Command, CommandQueue
from runtime.errors import SensorError
from runtime.printable import printable
from runtime.publish.access import LARGEST_MESSAGE
from runtime.publish.session import short_reason, tool_session

JSON = zenoh.Encoding("application/json")
ASK_S = 3.0


def command_key(rover: str, command: Command) -> str:
    """Key of a command: one level deeper than what anyone may ask, so that no rule for the one covers the other."""
    return f"infant/{rover}/command/{command}"


def declare_commands(session: zenoh.Session, rover: str, commands: CommandQueue) -> None:
    """Answer the commands of this rover on a session."""
    for command in Command:
        key = command_key(rover, command)
        # indirect=True would start Python threads that hang or abort a process that ends without closing the session
        session.declare_queryable(key, zenoh.handlers.Callback(_reply(key, command, commands), indirect=False))


@dataclass(frozen=True, slots=True)
class Answer:
    """What the rover said to a command: reason is why it refused, "" where it accepted."""

    accepted: bool
    reason: str


def send_command(
    endpoint: str, rover: str, command: Command, reason: str, config_file: str | None = None, timeout_s: float = ASK_S
) -> Answer:
    """Ask one rover through an endpoint.

    config_file: zenoh configuration with the certificate by which the access rules know who asks.
    Raises SensorError when nobody answers, ConfigurationError when that file cannot be used.
    """
    key = command_key(rover, command)
    try:
        with tool_session(endpoint, config_file) as session:
            for reply in session.get(key, payload=reason.encode(), timeout=timeout_s):
                said = reply.ok or reply.err
                if said is not None and (answer := answer_of(said.payload)) is not None:
                    return answer
    except zenoh.ZError as error:
        raise SensorError(f"{endpoint}: no connection ({short_reason(error)}); give --connect and --zenoh") from error
    raise SensorError(no_answer(f"{rover} at {endpoint}", key))


def no_answer(rover: str, key: str) -> str:
    """What is said where nobody answers a command."""
    return f"{rover} does not answer {key}; is it running, is publish.commands on, and does an access rule allow it?"


def answer_of(payload: zenoh.ZBytes) -> Answer | None:
    """None for what zenoh itself says, for example that the time is over, and for what no rover says."""
    if len(payload) > LARGEST_MESSAGE:
        return None
    try:
        said = json.loads(payload.to_bytes())
        return Answer(said["accepted"] is True, printable(str(said["reason"])))
    except (ValueError, KeyError, TypeError, RecursionError):
        return None


def _reply(key: str, command: Command, commands: CommandQueue) -> Callable[[zenoh.Query], None]:
    def reply(query: zenoh.Query) -> None:
        with query:
            if str(query.key_expr) != key:
                return  # a question with wildcards, such as infant/**, is no command
            payload = query.payload
            if payload is not None and len(payload) > LARGEST_MESSAGE:
                return
            refusal = commands.accept(command, payload.to_bytes() if payload is not None else b"")
            answer = json.dumps({"command": command.value, "accepted": not refusal, "reason": refusal})
            if refusal:
                query.reply_err(answer, encoding=JSON)
            else:
                query.reply(key, answer, encoding=JSON)

    return reply
