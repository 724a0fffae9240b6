"""Commands are obeyed when the tick that holds them has been written: so the record shows what caused what."""

from runtime.commands import Command, command_of
from runtime.record.folder import RunFolder
from runtime.record.writing.map_file import MapFile
from runtime.record.writing.storage import Storage
from runtime.tick import CompletedTick


class CommandObeyer:
    """Does what the events of a recorded tick ask for. stopped: nothing may be recorded any more."""

    def __init__(self, folder: RunFolder, storage: Storage) -> None:
        self._storage = storage
        self._map_file = MapFile(folder)
        self.stopped = False

    @property
    def trouble(self) -> str:
        """What could not be done."""
        return self._map_file.trouble

    def obey(self, completed: CompletedTick) -> None:
        """Mark, save, stop, in the order in which they were asked for."""
        self._map_file.note(completed.estimate)
        for event in completed.tick.events:
            match command_of(event):
                case Command.MARK:
                    self._storage.mark(event.reason)
                case Command.SAVE:
                    self._storage.end_segment()
                    self._map_file.save()
                case Command.STOP:
                    self.stopped = True
