"""`infant setup`: look, listen, ask for the rest, and write a configuration that has been checked."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from drivers.canbus.frame import CanFrame
from drivers.measurements import DriverError
from drivers.settings.can import BusSettings
from drivers.settings.layouts import DbcLayout
from runtime.atomic_write import atomic_write
from runtime.errors import SensorError, StorageError, UsageError
from runtime.settings.configuration import load_configuration_text
from runtime.setup.discover.can_traffic import IdTraffic, traffic_of
from runtime.setup.discover.counts_heard import counts_heard, counts_line
from runtime.setup.discover.dbc_match import layouts_in
from runtime.setup.discover.listen import LaserFound, bus_named, can_interfaces, find_laser, hear, laser_urls
from runtime.setup.discover.questions import BUS, DBC, LASER, Ask, laser_url, rover_name, until_found
from runtime.setup.discover.wheel_layouts import LayoutFound, layouts_that_fit
from runtime.setup.discover.written import Geometry, configuration_text

LISTEN_S = 3.0
Say = Callable[[str], None]
Hear = Callable[[BusSettings, float], list[CanFrame]]
FindLaser = Callable[[Sequence[str]], LaserFound | None]


@dataclass(frozen=True, slots=True)
class Known:
    """What the person says beforehand; None: to be found. bus: can0, or INTERFACE:CHANNEL[:PORT]. dbc: at hand.

    ask: puts a question to the person and returns the answer; None: nobody is there.
    """

    laser_url: str | None = None
    bus: str | None = None
    dbc: Path | None = None
    ask: Ask | None = None


@dataclass(frozen=True, slots=True)
class SetupResult:
    """What was found and written; text: the file."""

    path: Path
    laser: LaserFound
    bus: BusSettings
    traffic: list[IdTraffic]
    fitting: list[LayoutFound]
    text: str

    def as_json(self) -> dict[str, Any]:
        """As --json prints it."""
        return {
            "config": str(self.path),
            "laser": self.laser.as_json(),
            "bus": self.bus.model_dump(exclude_defaults=True) | {"interface": self.bus.interface},
            "heard": [each.as_json() for each in self.traffic],
            "layouts": [asdict(each) | {"layout": each.layout.model_dump()} for each in self.fitting],
            "text": self.text,
        }


def set_up(
    path: Path,
    name: str | None,
    known: Known,
    geometry: Callable[[], Geometry],
    say: Say,
    search: tuple[FindLaser, Hear] = (find_laser, hear),
) -> SetupResult:
    """Find laser, bus and layout, then write `path`.

    geometry: asked for only when the rest is found. search: how to find a laser and how to listen.
    Raises StorageError where the file is there or cannot be written, SensorError where a sensor is not found,
    UsageError where an answer cannot be used.
    """
    if path.exists():
        raise StorageError(f"{path} exists; a configuration is never overwritten; give another name with --out")
    if name is not None:
        rover_name(name)
    dbc = None if known.dbc is None else str(known.dbc)
    _in_dbc(dbc, [])
    find, listen = search
    laser = until_found(lambda url: _laser(url, find, say), known.laser_url, LASER, known.ask, say)
    say(f"laser     {laser.line()}")
    bus, frames = until_found(lambda bus: _busiest(bus, listen, say), known.bus, BUS, known.ask, say)
    traffic = traffic_of(frames)
    for each in traffic:
        say(f"heard     {each.line()}")
    fitting = until_found(lambda file: _fitting(file, bus, traffic), dbc, DBC, known.ask, say)
    for fit in fitting:
        say(f"wheels    {fit.name}, recognised by {fit.why}")
    if (counts := counts_heard(fitting[0].layout, frames)) is not None:
        say(counts_line(counts))
    text = configuration_text(name, laser, bus, beside(fitting[0], path), geometry())
    load_configuration_text(text, source=str(path), recorded=False)
    try:
        atomic_write(path, text)
    except OSError as error:
        raise StorageError(f"{path} cannot be written ({error.strerror}); give another name with --out") from error
    return SetupResult(path, laser, bus, traffic, fitting, text)


def beside(found: LayoutFound, path: Path) -> LayoutFound:
    """With a DBC in the folder of the configuration named relative to it, so that `infant install` takes it along."""
    layout, folder = found.layout, path.resolve().parent
    if not isinstance(layout, DbcLayout) or layout.file is None or not Path(layout.file).is_relative_to(folder):
        return found
    return replace(found, layout=layout.model_copy(update={"file": str(Path(layout.file).relative_to(folder))}))


def next_lines(path: Path) -> list[str]:
    """What to do with the file."""
    return [
        f"written   {path}",
        f"next      infant check --config {path} --live",
        f"then      infant run --config {path} --duration 90, while you drive two loops to the left, two to "
        "the right and 5 m straight; start and end at rest",
        f"          infant calibrate RUN --config {path} --write {path}",
    ]


def _laser(url: str | None, find: FindLaser, say: Say) -> LaserFound:
    """The laser that answers. Raises SensorError, UsageError."""
    urls = laser_urls() if url is None else [laser_url(url)]
    say(f"asking    for a laser at {', '.join(urls)}")
    laser = find(urls)
    if laser is None:
        raise SensorError(f"no laser answered at {', '.join(urls)}; check its power and cable, or give --laser URL")
    return laser


def _in_dbc(file: str | None, traffic: list[IdTraffic]) -> list[LayoutFound]:
    """Layouts of the DBC whose messages are heard. Raises UsageError where it is none."""
    try:
        return [] if file is None else layouts_in(Path(file), traffic)
    except DriverError as error:
        raise UsageError(f"--dbc {error}") from error


def _fitting(file: str | None, bus: BusSettings, traffic: list[IdTraffic]) -> list[LayoutFound]:
    """All layouts that fit, those of the DBC first. Raises SensorError, UsageError."""
    fitting = [*_in_dbc(file, traffic), *layouts_that_fit(traffic)]
    if not fitting:
        heard = ", ".join(each.name for each in traffic)
        raise SensorError(
            f"ids {heard} are heard on {bus.channel}, but no known layout fits them; give the DBC of their "
            "maker with --dbc FILE, or name its signals in [encoders.layout]"
        )
    return fitting


def _busiest(name: str | None, listen: Hear, say: Say) -> tuple[BusSettings, list[CanFrame]]:
    """The bus on which the most is heard, and that. Raises SensorError, UsageError."""
    names = can_interfaces() if name is None else [name]
    if not names:
        raise SensorError(
            "this machine has no CAN interface; plug in the adapter, or give --can, for example --can can0"
        )
    heard: list[tuple[BusSettings, list[CanFrame]]] = []
    troubles = []
    for each in names:
        try:
            bus = bus_named(each)
        except ValueError as error:
            raise UsageError(f"--can {each}: expected can0 or INTERFACE:CHANNEL[:PORT]") from error
        say(f"listening on {each} for {LISTEN_S:g} s; push the rover forward a little meanwhile")
        try:
            heard.append((bus, listen(bus, LISTEN_S)))
        except DriverError as error:
            troubles.append(str(error))
    busiest = max(heard, key=lambda each: sum(found.frames for found in traffic_of(each[1])), default=None)
    if busiest is None or not traffic_of(busiest[1]):
        why = "; ".join(troubles) or "check power, bit rate and termination of the bus"
        raise SensorError(f"nothing was heard on {', '.join(names)} in {LISTEN_S:g} s: {why}")
    return busiest
