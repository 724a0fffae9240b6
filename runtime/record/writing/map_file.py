"""map.json: the landmarks as they were when someone said save."""

from runtime.errors import StorageError
from runtime.messages.map_json import landmark_json
from runtime.record.folder import RunFolder
from slam.estimate import Estimate, LandmarkMap


class MapFile:
    """Knows the newest landmarks and writes them when asked. trouble: why they are not on disk, "" if they are."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self._newest: tuple[int, LandmarkMap] | None = None
        self.trouble = ""

    def note(self, estimate: Estimate) -> None:
        """Landmarks come with every tenth estimate or so."""
        if estimate.landmarks is not None:
            self._newest = (estimate.stamp_ns, estimate.landmarks)

    def save(self) -> None:
        """Replace the file; nothing where no landmark is known yet."""
        if self._newest is None:
            return
        stamp_ns, landmarks = self._newest
        try:
            self._folder.write(self._folder.map_path, landmark_json(landmarks, stamp_ns).decode() + "\n")
            self.trouble = ""
        except StorageError as error:
            self.trouble = str(error)
