"""What went wrong on a CAN bus, in one sentence with the command that mends it."""

import errno
import re
from importlib import metadata

import can

from drivers.settings.can import BusSettings

NO_CAN_IN_KERNEL = (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT)
ABSENT = (errno.ENODEV, errno.ENXIO, errno.ENOENT)
VENDOR = "install the vendor's driver for this system, or use an adapter that the kernel supports (socketcan)"
MISSING_ARGUMENTS = re.compile(r"missing \d+ required .*arguments?: (.*)")
FORBIDDEN = (errno.EPERM, errno.EACCES)


def error_number(error: BaseException) -> int | None:
    """errno out of OSError or python-can's error_code, looking through the chain of causes."""
    seen: BaseException | None = error
    while seen is not None:
        for number in (getattr(seen, "error_code", None), getattr(seen, "errno", None)):
            if isinstance(number, int):
                return number
        seen = seen.__cause__
    return None


def advice(bus: BusSettings, error: BaseException) -> str:
    """One sentence: which bus, what failed, what to type."""
    number = error_number(error)
    where = f"CAN bus {bus.interface} {bus.channel}"
    if bus.interface not in can.VALID_INTERFACES:
        known = ", ".join(sorted(can.VALID_INTERFACES))
        return f"{where}: python-can has no such interface; set interface in [encoders.bus] to one of {known}"
    if isinstance(error, ImportError | can.CanInterfaceNotImplementedError):
        return f"{where}: python-can has no {bus.interface} here ({error}); {_install_advice(bus.interface)}"
    if isinstance(error, NameError) or "library not found" in str(error):
        return f"{where}: the vendor's library is missing ({error}); {VENDOR}"
    lacking = MISSING_ARGUMENTS.search(str(error)) if isinstance(error, TypeError) else None
    if lacking is not None:
        return f"{where}: this interface needs {lacking[1]}; set them in [encoders.bus.options]"
    if number in NO_CAN_IN_KERNEL:
        return f"{where}: this kernel has no CAN; load it with: sudo modprobe can-raw"
    if number in ABSENT:
        return f"{where}: there is no such interface; {_create_advice(bus)}"
    if number in FORBIDDEN:
        return f"{where}: no permission; {_permission_advice(bus)}"
    if number == errno.ENETDOWN:
        kind = "" if bus.channel.startswith(("vcan", "slcan")) else f" type can bitrate {bus.bitrate}"
        return f"{where}: the interface is down; sudo ip link set {bus.channel} up{kind}"
    if number == errno.EBUSY:
        return f"{where}: another program holds it; find it with: sudo fuser -v {bus.channel}"
    return f"{where}: {error}; check [encoders.bus]: interface, channel, options"


def bitrate_advice(bus: BusSettings) -> str:
    """For a bus on which there are errors and not one good frame."""
    if bus.interface == "socketcan":
        again = f"up type can bitrate {bus.bitrate}"
        change = f"sudo ip link set {bus.channel} down && sudo ip link set {bus.channel} {again}"
    else:
        change = "set bitrate in [encoders.bus] to that of the nodes"
    return (
        f"CAN bus {bus.interface} {bus.channel}: only errors and no valid frame: wrong bit rate (expected "
        f"{bus.bitrate} bit/s), or no other node acknowledges; {change}"
    )


def bus_off_advice(bus: BusSettings) -> str:
    """For a controller that has switched itself off."""
    restart = f"sudo ip link set {bus.channel} type can restart-ms 100" if bus.interface == "socketcan" else "replug it"
    where = f"CAN bus {bus.interface} {bus.channel}"
    return f"{where}: bus-off after too many errors; if it does not restart by itself: {restart}"


def up_command(bus: BusSettings) -> str:
    """What brings a SocketCAN interface up until the next boot."""
    return f"sudo ip link set {bus.channel} up type can bitrate {bus.bitrate} restart-ms 100"


def _install_advice(interface: str) -> str:
    """What brings an interface: an extra of python-can where there is one."""
    extras = metadata.metadata("python-can").get_all("Provides-Extra") or []
    if interface.replace("_", "-") in (extra.replace("_", "-") for extra in extras):
        return f"pip install 'python-can[{interface}]'"
    return VENDOR


def _create_advice(bus: BusSettings) -> str:
    if bus.interface != "socketcan":
        return f"plug in the adapter, or set channel in [encoders.bus]; devices: ls {_folder(bus.channel)}"
    if bus.channel.startswith("vcan"):
        return f"create it with: sudo ip link add {bus.channel} type vcan && sudo ip link set {bus.channel} up"
    return f"plug in the adapter and type: {up_command(bus)}"


def _permission_advice(bus: BusSettings) -> str:
    if bus.channel.startswith("/dev/"):
        return "join the group of the device with: sudo usermod -aG dialout $USER, then log in again"
    return "allow AF_CAN to the service (RestrictAddressFamilies=AF_CAN), or try: sudo setcap cap_net_raw+ep on python"


def _folder(channel: str) -> str:
    return channel.rpartition("/")[0] or "/dev"
