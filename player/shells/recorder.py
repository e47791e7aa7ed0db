"""Records the path of a camera, and replays it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from player.camera.camera import Camera
from player.camera.path import CameraPath, write_path
from player.shells.free_name import free_name


class Recorder:
    """Writes recorded paths into a directory. What `record`, `replay` and `step` return is what to tell the user."""

    def __init__(self, output: Path, path: CameraPath, *, replay: bool) -> None:
        """path: what is replayed until something was recorded; replay: begin with it."""
        self.recorded: CameraPath | None = path if len(path) > 1 else None
        self._output = output
        self._poses: list[tuple[float, np.ndarray, np.ndarray]] | None = None
        self._replaying: float | None = 0.0 if replay else None

    @property
    def replaying(self) -> bool:
        """The recorded path steers the camera."""
        return self._replaying is not None

    def record(self) -> str:
        """Begins to record, or ends it and saves the path. Raises PathError where it cannot be written."""
        if self._poses is None:
            self._poses = []
            return "recording; R: stop"
        poses, self._poses = self._poses, None
        if len(poses) < 2:
            return "nothing was recorded"
        times, positions, orientations = (np.array(column) for column in zip(*poses, strict=True))
        self.recorded = CameraPath(times - times[0], positions, orientations)
        file = free_name(self._output, "vlod_path_{:04d}.json")
        write_path(file, self.recorded)
        return f"saved {file}; T: replay it"

    def replay(self) -> str:
        """Begins or ends the replay of the recorded path."""
        if self._replaying is not None:
            self._replaying = None
            return ""
        if self.recorded is None:
            return "nothing to replay: record a path with R"
        self._replaying = 0.0
        return "replaying; T: stop"

    def stop_replay(self) -> None:
        """Somebody steers again."""
        self._replaying = None

    def lead(self, camera: Camera, seconds: float) -> str:
        """Brings the camera to where the replayed path is after so much more time."""
        if self._replaying is None or self.recorded is None:
            return ""
        self._replaying += seconds
        camera.look_at(*self.recorded.at(float(self.recorded.times[0]) + self._replaying))
        if self._replaying < self.recorded.duration:
            return ""
        self._replaying = None
        return "replayed; T: again"

    def watch(self, camera: Camera, clock: float) -> None:
        """Takes down where the camera is, if a path is being recorded; clock: in seconds, from any time on."""
        if self._poses is not None and (not self._poses or clock > self._poses[-1][0]):
            self._poses.append((clock, camera.position.copy(), camera.orientation))
