"""Commands that speak to a running rover: command, page, bridge."""

import sys
from enum import StrEnum
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.live import stopping
from runtime.cli.output import answer, say, say_json
from runtime.cli.progress import LONGEST_S, AsJson

Rover = Annotated[str | None, typer.Option("--rover", help="name of the rover; default: the only one that answers")]
Connect = Annotated[
    str | None,
    typer.Option(
        "--connect", metavar="ENDPOINT|HOST", help="endpoint or host of the rover or a router; default: this machine"
    ),
]
ZenohFile = Annotated[
    Path | None, typer.Option("--zenoh", help="zenoh configuration with the certificate for the router of a fleet")
]
Duration = Annotated[
    float | None, typer.Option("--duration", min=1.0, max=LONGEST_S, help="seconds; default: until Ctrl-C")
]

Resolution = Annotated[float, typer.Option(min=0.02, max=10.0, help="cell size of /map, m")]
Grid = Annotated[bool, typer.Option("--map/--no-map", help="whether to make /map from poses and scans")]


def ros2(
    rover: Rover = None,
    connect: Connect = None,
    zenoh_file: ZenohFile = None,
    domain: Annotated[
        int, typer.Option("--domain", envvar="ROS_DOMAIN_ID", help="domain of the nodes that are to see the rover")
    ] = 0,
    interface: Annotated[str, typer.Option("--interface", help="network interface, for example wlan0")] = "lo",
    namespace: Annotated[
        str | None, typer.Option("--namespace", help="prefix of the topics; default: the rover's name; '' for none")
    ] = None,
    frame_prefix: Annotated[
        str | None, typer.Option("--frame-prefix", help="prefix of the frames; default: the rover's name; '' for none")
    ] = None,
    resolution: Resolution = 0.1,
    grid: Grid = True,
    duration: Duration = None,
    as_json: AsJson = False,
) -> None:
    """Show a running rover to ROS 2 nodes over DDS, from a separate process; this machine needs no ROS."""
    from runtime.bridge.ros2 import BridgeOptions, bridge_ros2

    file = None if zenoh_file is None else str(zenoh_file)
    cell_m = resolution if grid else None
    options = BridgeOptions(connect, rover, file, domain, interface, namespace, frame_prefix, cell_m)
    result = bridge_ros2(options, stopping(duration), sys.stderr)
    answer(result, (f"{topic:<24} {count}" for topic, count in result["sent"].items()), as_json)


def foxglove(
    rover: Rover = None,
    connect: Connect = None,
    zenoh_file: ZenohFile = None,
    host: Annotated[str, typer.Option("--host", help="address at which to serve")] = "127.0.0.1",
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="TCP port; 0 takes any free one")] = 8765,
    resolution: Resolution = 0.1,
    grid: Grid = True,
    duration: Duration = None,
    as_json: AsJson = False,
) -> None:
    """Show a running rover to Foxglove and Lichtblick over WebSocket, read-only, from a separate process."""
    from runtime.bridge.foxglove import FoxgloveOptions, bridge_foxglove

    file = None if zenoh_file is None else str(zenoh_file)
    options = FoxgloveOptions(connect, rover, file, host, port, resolution if grid else None)
    result = bridge_foxglove(options, stopping(duration), sys.stderr)
    answer(result, (f"{topic:<24} {count}" for topic, count in result["sent"].items()), as_json)


def rclpy(
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="file to write; default: standard output")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write the bridge as one Python file for a machine with ROS 2; it needs rclpy and eclipse-zenoh, but not
    Infant.
    """
    from runtime.atomic_write import atomic_write
    from runtime.errors import RunExistsError, StorageError

    text = files("runtime.bridge").joinpath("rclpy_node.py").read_text(encoding="utf-8")
    if out is None:
        if as_json:
            say_json({"text": text})
        else:
            typer.echo(text, nl=False)
        return
    if out.exists() or out.is_symlink():
        raise RunExistsError(f"{out} exists and nothing is overwritten; give another name")
    try:
        atomic_write(out, text, 0o755)
    except OSError as error:
        raise StorageError(f"{out} cannot be written ({error.strerror}); give another name") from error
    answer({"file": str(out)}, (f"written   {out}: python3 {out} --rover NAME --connect ENDPOINT",), as_json)


class CommandWord(StrEnum):
    """Words of the command line; the same as runtime.commands.Command, which is imported only when it is needed."""

    mark = "mark"
    save = "save"
    stop = "stop"
    initial_pose = "initial_pose"


def command(
    asked: Annotated[
        CommandWord,
        typer.Argument(
            metavar="WORD",
            help="mark this moment, save what is recorded, stop recording, or say where the rover is",
        ),
    ],
    reason: Annotated[
        str,
        typer.Argument(
            metavar="REASON", help="what you saw (required for mark); for initial_pose: X,Y,YAW[,SIGMA_M,SIGMA_RAD]"
        ),
    ] = "",
    rover: Rover = None,
    connect: Connect = None,
    zenoh_file: Annotated[
        Path | None, typer.Option("--zenoh", help="zenoh configuration with the certificate for the router of a fleet")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Command a rover over zenoh: mark a moment, save or stop recording, or say where it is.

    Needs publish.commands on the rover.
    """
    from runtime.commands import Command
    from runtime.errors import UsageError
    from runtime.publish.commands import send_command
    from runtime.publish.find_rover import FoundRover, endpoint_of, find_rover

    file = None if zenoh_file is None else str(zenoh_file)
    if rover is not None and connect is not None:  # who may command it need not be allowed to ask for its state
        found = FoundRover(rover, endpoint_of(connect))
    else:
        found = find_rover(connect, rover, file)
    rover, answer = found.name, send_command(found.endpoint, found.name, Command(asked.value), reason, file)
    error = None if answer.accepted else UsageError(f"{rover} refused {asked.value}: {answer.reason}")
    if as_json:
        said = {"rover": rover, "command": asked.value, "accepted": answer.accepted, "reason": answer.reason}
        say_json(said, error)
    elif answer.accepted:
        say(f"{rover} accepted {asked.value}; the event is in its log")
    if error is not None:
        raise error


def page(
    rover: Rover = None,
    connect: Connect = None,
    zenoh_file: ZenohFile = None,
    host: Annotated[
        str, typer.Option("--host", help="address of this machine at which to serve the page")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="port; 0 takes any free one")] = 8448,
    runs: Annotated[Path, typer.Option("--runs", metavar="DIR", help="folder whose runs are listed")] = Path("runs"),
    commands: Annotated[
        bool,
        typer.Option(
            "--commands", help="add buttons for mark and stop; on the loopback only, and only what the rover allows"
        ),
    ] = False,
    duration: Duration = None,
    as_json: AsJson = False,
) -> None:
    """Serve a web page that shows a running rover: state, map, sensors, events and runs."""
    from runtime.page.serve import ServeOptions, serve_page

    file = None if zenoh_file is None else str(zenoh_file)
    options = ServeOptions(host, port, connect, rover, file, runs, commands)
    result = serve_page(options, stopping(duration), sys.stderr)
    answer(result, (f"served    {result['rover']} at {result['url']}",), as_json)


COMMANDS = (command, page)
BRIDGE_COMMANDS = (ros2, rclpy, foxglove)
BRIDGE_HELP = "Show a running rover to ROS 2, Foxglove or Lichtblick."
