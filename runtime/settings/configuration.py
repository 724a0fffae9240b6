"""Configuration: TOML read once into frozen models; anything wrong names the key, the value and the remedy."""

import difflib
import hashlib
import json
import tomllib
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import tomli_w
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from drivers.settings.encoders import EncoderSettings
from drivers.settings.laser import LaserSettings
from drivers.settings.layouts import Cia406Layout, DbcLayout
from drivers.settings.simulation import SimulationSettings
from drivers.settings.vehicle import VehicleSettings
from runtime.bounded_read import read_bounded
from runtime.errors import ConfigurationError
from runtime.expected_value import expected_value
from runtime.printable import printable
from runtime.settings.data_set import DataSetSettings
from runtime.settings.loop import LoopSettings
from runtime.settings.map import MapSettings
from runtime.settings.not_keys import HANDED_ON, NOT_KEYS, SHARED, excluded
from runtime.settings.publish import PublishSettings
from runtime.settings.record import RecordSettings
from runtime.settings.retired import refusals, translated
from runtime.settings.review import ReviewSettings
from runtime.settings.trees import IN_FILE, ON_LINE, unusable
from runtime.source_tree import CONFIG, shipped_configuration, shipped_names
from slam.settings.front_end import GIVEN_NOISE
from slam.settings.odometry import WIDE_NOISE
from slam.settings.slam import SlamSettings

Tree = dict[str, Any]

LARGEST_BYTES = 64 << 10  # of a file; all keys with all comments take 20 kB
DEEPEST = 16  # tables in tables
MOST_DOTS = 300  # in a line: the library takes the square of a key's parts in steps, minutes for 30 000
MOST_PROBLEMS = 20  # sentences about one file
LONGEST_PROBLEM, LONGEST_VALUE = 1000, 200  # characters


class Configuration(BaseModel):
    """All settings of a run. A recorded data set has only [slam]; a live rover has [laser] and [encoders] too."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    rover: str = Field(
        "infant",
        pattern=r"^[A-Za-z0-9_-]{1,32}$",
        description="Name of the rover in every published key; a live rover without one uses the name of its computer. "
        "Give each rover of a fleet its own",
    )
    seed: int = Field(
        1, ge=0, le=2**32 - 1, description="Seed of the filter. Any number will do; change it to see how much is chance"
    )
    vehicle: VehicleSettings = VehicleSettings()
    slam: SlamSettings = SlamSettings()
    laser: LaserSettings | None = None
    encoders: EncoderSettings | None = None
    loop: LoopSettings = LoopSettings()
    record: RecordSettings = RecordSettings()
    publish: PublishSettings = PublishSettings()
    review: ReviewSettings = ReviewSettings()
    map: MapSettings = MapSettings()
    simulation: SimulationSettings | None = None
    data_set: DataSetSettings | None = None

    @model_validator(mode="after")
    def _hand_the_vehicle_on(self) -> Self:
        """Give filter and driver the geometry, each in its own form; neither has keys for it."""
        vehicle = self.vehicle
        geometry = {name: getattr(vehicle, name) for name in SHARED}
        geometry |= {"model": vehicle.motion_model, "jump_speed_mps": vehicle.jump_speed_mps}
        odometry, front_end = self.slam.odometry, self.slam.front_end
        geometry |= unsaid(odometry, WIDE_NOISE.get(vehicle.motion_model, {}))
        sensor = unsaid(front_end, GIVEN_NOISE if front_end.kind == "given" else {})
        changed = {
            "odometry": odometry.model_copy(update=geometry),
            "front_end": front_end.model_copy(update=sensor),
        }
        object.__setattr__(self, "slam", self.slam.model_copy(update=changed))
        if self.encoders is not None:
            object.__setattr__(self, "encoders", self.encoders.model_copy(update={"vehicle": vehicle}))
        return self

    @property
    def text(self) -> str:
        """The configuration in force as canonical TOML; load_configuration_text gives it back."""
        return tomli_w.dumps(self.model_dump(mode="json", exclude_none=True, exclude=excluded()))

    @property
    def sha256(self) -> str:
        """Hash of the canonical text, hexadecimal."""
        return hashlib.sha256(self.text.encode()).hexdigest()


def unsaid(table: BaseModel, wide: Mapping[str, float]) -> dict[str, float]:
    """Of the wide values those whose keys the table was not given."""
    return {key: value for key, value in wide.items() if key not in table.model_fields_set}


def models_in(annotation: Any) -> list[type[BaseModel]]:
    """The models that a field may hold: none for a value, several for a choice."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in typing.get_args(annotation) for model in models_in(inner)]


def load_configuration(path: Path | str, overrides: Mapping[str, str] | None = None) -> Configuration:
    """Read a TOML file and apply overrides such as {"slam.particles": "200"}.

    path: a file, or the bare name of a shipped configuration, such as `mock`.

    Raises ConfigurationError (exit code 3) with one sentence per problem.
    """
    path = shipped_configuration(Path(path))
    try:
        text = read_bounded(path, LARGEST_BYTES).decode("utf-8-sig")  # editors of Windows begin a file with a mark
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"{path}: byte {error.start} is not UTF-8; save the file as UTF-8 text") from error
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise ConfigurationError(f"{path}: cannot be read ({why}); {_remedy(path)}") from error
    return _with_files(load_configuration_text(text, overrides, source=str(path), recorded=False), path.parent)


def _remedy(path: Path) -> str:
    """What to give where a file cannot be read; a bare name may have been meant as a shipped one."""
    names = f", or one of {', '.join(shipped_names())}" if not path.suffix and not path.exists() else ""
    return f"give the path of a TOML file{names}"


def load_configuration_text(
    text: str, overrides: Mapping[str, str] | None = None, source: str = "configuration", recorded: bool = True
) -> Configuration:
    """The same for text. Out of a recorded run's header keys of the past are taken as well; in a file they are wrong,
    and in overrides always.
    """
    tree = _parsed(text, source)
    set_: Tree = {}
    for key, value in (overrides or {}).items():
        _set(set_, key, value)
    if problems := [*refusals(set_), *([] if recorded else refusals(tree))]:
        raise _refused(source, problems)
    tree = translated(tree)[0] if recorded else tree
    for key, value in (overrides or {}).items():
        _set(tree, key, value)
    if problems := [f"{key}: unknown key; the geometry is set in [vehicle]" for key in _handed_on(tree)]:
        raise _refused(source, problems)
    try:
        # JSON mode: strict about types, yet lists fill tuples and words fill enumerations
        configuration = Configuration.model_validate_json(json.dumps(tree, default=_as_date), strict=True)
    except ValidationError as error:
        problems = [_sentence(problem, overrides or {}) for problem in error.errors()]
        raise _refused(source, problems) from error
    if (not recorded or overrides) and (problems := _of_another_sensor(configuration, overrides or {})):
        raise _refused(source, problems)
    return configuration


def _as_date(value: object) -> dict[str, str]:
    """A date or a time of TOML as what no key takes: written without quotes, it would else pass for text."""
    return {"date": str(value)}


def _of_another_sensor(configuration: Configuration, overrides: Mapping[str, str]) -> list[str]:
    """Settings for a sensor that names its landmarks, which a laser does not: each step would fail or match nothing."""
    slam = configuration.slam
    if configuration.laser is None:
        return []
    return [
        f"{key} = {value!r}: expected {expected} with the table [laser], because a laser does not name its landmarks; "
        f"change it {_place(key, overrides)}"
        for key, value, wrong, expected in (
            ("slam.front_end.kind", slam.front_end.kind, "given", "'robust' or 'paper'"),
            ("slam.association.strategy", slam.association.strategy, "known", "'sequential' or 'simultaneous'"),
        )
        if value == wrong
    ]


def _with_files(configuration: Configuration, folder: Path) -> Configuration:
    """With the file of the wheels' layout where it is found: as it stands, beside the configuration, or delivered."""
    encoders = configuration.encoders
    layout = encoders.layout if encoders is not None else None
    if encoders is None or not isinstance(layout, DbcLayout | Cia406Layout) or layout.file is None:
        return configuration
    for place in (folder / layout.file, CONFIG / layout.file):
        if place.is_file():
            layout = layout.model_copy(update={"file": str(place.resolve())})
            return configuration.model_copy(update={"encoders": encoders.model_copy(update={"layout": layout})})
    return configuration


def _refused(source: str, problems: list[str]) -> ConfigurationError:
    more = [f"and {len(problems) - MOST_PROBLEMS} more of this kind"] if len(problems) > MOST_PROBLEMS else []
    shown = [printable(f"{source}: {problem}", LONGEST_PROBLEM) for problem in problems[:MOST_PROBLEMS] + more]
    return ConfigurationError("\n".join(shown))


def _parsed(text: str, source: str) -> Tree:
    if len(text) > LARGEST_BYTES:
        raise _refused(source, [f"it has {len(text)} characters, a configuration has at most {LARGEST_BYTES}"])
    if (dots := max(line.count(".") for line in text.split("\n"))) > MOST_DOTS:
        raise _refused(source, [f"not valid TOML: a line with {dots} dots; a key has few parts"])
    try:
        tree = tomllib.loads(text)
    except RecursionError:
        raise _refused(source, [f"not valid TOML: tables in tables more than {DEEPEST} times"]) from None
    except ValueError as error:  # of numbers and dates too, which the library does not take for its own
        raise _refused(source, [f"not valid TOML: {error}"]) from error
    if problem := unusable(tree, DEEPEST, IN_FILE):
        raise _refused(source, [problem])
    return tree


def _handed_on(tree: Tree) -> list[str]:
    """Keys in the tree that are none: fields that are filled from [vehicle]."""
    found = []
    for path, names in HANDED_ON.items():
        table: Any = tree
        for name in path.split("."):
            table = table.get(name) if isinstance(table, dict) else None
        found += [f"{path}.{name}" for name in sorted(names) if isinstance(table, dict) and name in table]
    return found


def _set(tree: Tree, key: str, text: str) -> None:
    """Put one override into the tree; the text is a TOML value, or a bare word taken as a string."""
    if len(text) > LARGEST_BYTES or key.count(".") > DEEPEST:
        raise ConfigurationError(f"{printable(key, 100)}: a value of {len(text)} characters; give a shorter one")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        value = text
    if problem := unusable({key: value}, DEEPEST, ON_LINE):
        raise ConfigurationError(printable(problem))
    *tables, last = key.split(".")
    for table in tables:
        tree = tree.setdefault(table, {})
        if not isinstance(tree, dict):
            raise ConfigurationError(f"{key} = {text}: {table} is a value, not a table; name a key of a table")
    tree[last] = value


def _place(key: str, overrides: Mapping[str, str]) -> str:
    """Where a key was given, or a part of a table."""
    typed = (f"{name}." for name in overrides)
    return ON_LINE if any(f"{key}.".startswith(name) or name.startswith(f"{key}.") for name in typed) else IN_FILE


def _sentence(problem: Any, overrides: Mapping[str, str]) -> str:
    """Key, value, what was expected and, for a misspelt key, what was probably meant; a value is changed where it is
    given.
    """
    location = tuple(part for part in problem["loc"] if isinstance(part, str | int))
    key = ".".join(str(part) for part in location)
    change = f"change it {_place(key, overrides)}"
    match problem["type"]:
        case "extra_forbidden":
            known = _fields_at(location[:-1])
            close = difflib.get_close_matches(str(location[-1]), known, n=1)
            hint = f"did you mean {close[0]}?" if close else f"known keys here: {', '.join(sorted(known))}"
            return f"{key} = {_shown(problem)}: unknown key; {hint}"
        case "union_tag_invalid":
            key, tags = f"{key}.{_discriminator(problem)}", problem["ctx"]["expected_tags"]
            return f"{key} = {problem['ctx']['tag']!r}: expected one of {tags}; {change}"
        case "union_tag_not_found":
            return f"{key}.{_discriminator(problem)}: missing; it says what this table describes"
        case "missing":
            return f"{key}: missing; add it to the configuration"
        case _:
            return f"{key} = {_shown(problem)}: expected {expected_value(problem)}; {change}"


def _shown(problem: Any) -> str:
    return printable(repr(problem["input"]), LONGEST_VALUE)


def _discriminator(problem: Any) -> str:
    """The key that tells the tables of a union apart."""
    return str(problem["ctx"]["discriminator"]).strip("'")


def _fields_at(location: tuple[str | int, ...]) -> list[str]:
    """Names of the keys that the model at this place has; walks through optional models and unions."""
    candidates: list[Any] = [Configuration]
    for part in location:
        following: list[Any] = []
        for model in candidates:
            if part in model.model_fields:
                following += models_in(model.model_fields[str(part)].annotation)
        candidates = following or candidates  # a union's tag is part of the location but not a field
    hidden = NOT_KEYS.get(".".join(str(part) for part in location), frozenset())
    return sorted({name for model in candidates for name in model.model_fields} - hidden)
