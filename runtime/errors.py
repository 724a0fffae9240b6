"""The errors that end a command: each carries one sentence for the person and the exit code for the caller.

    InfantError                  70  a defect: nothing that a user did
    +-- Interrupted             130  stopped before there was something to keep
    +-- UsageError                2  words of the command line that do not fit together
    +-- ConfigurationError        3  a key, a value or a data set that cannot be used as it is
    |   +-- DataSetError          3  a recording to import lacks what the estimator needs
    +-- PreflightError            4  a check said FAIL
    +-- SensorError               5  a sensor, or the simulated rover, does not come up
    +-- StorageError              6  a disk or a folder refuses
        +-- RunExistsError        6  the folder holds something already; nothing is overwritten
        +-- NotARunError          6  the folder or file is no run, or holds nothing that could be read
        +-- NotAMapError          6  the file is no saved map, is damaged, or holds too little to find a pose in

A sensor that falls silent while driving is none of these: it is a state and an event.
"""


class InfantError(Exception):
    """Base: the message is one sentence that names what, what was expected, and what to do."""

    exit_code: int = 70


class Interrupted(InfantError):  # noqa: N818 as with KeyboardInterrupt, it is no error of anybody
    """For example Ctrl-C before the first tick of a run."""

    exit_code = 130


class UsageError(InfantError):
    """For example --verify together with another configuration."""

    exit_code = 2


class ConfigurationError(InfantError):
    """For example a misspelt key."""

    exit_code = 3


class DataSetError(ConfigurationError):
    """For example a data set without odometry."""


class PreflightError(InfantError):
    """For example no space left for an hour of recording."""

    exit_code = 4


class SensorError(InfantError):
    """For example a simulated rover that does not start."""

    exit_code = 5


class StorageError(InfantError):
    """For example a folder that cannot be written."""

    exit_code = 6


class RunExistsError(StorageError):
    """For example --out naming last week's run."""


class NotARunError(StorageError):
    """For example an empty run.mcap."""


class NotAMapError(StorageError):
    """For example a map that was cut off while it was copied."""
