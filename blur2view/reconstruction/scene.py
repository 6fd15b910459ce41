"""The folder of a scene, and which steps of its making are done: a call that was ended goes on."""

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from blur2view import __version__
from blur2view.colmap.recovery_run import Show
from blur2view.errors import OutputError
from blur2view.output import signed, write_file

STATE = "reconstruction.json"
IMAGES, SPARSE, EXPOSURES, DATABASE = "images", "sparse/0", "exposures", "database.db"
TRANSFORMS, REPORT, WORK = "transforms.json", "report.html", "work"
Step = Callable[[str], AbstractContextManager[Show]]


class Scene:
    """A scene's folder. A step is done when its result is noted, after all of its files are whole.

    ``call`` is the digest of the video and the options. OutputError if the folder holds something else, or a
    scene of another call.
    """

    def __init__(self, folder: Path, call: str) -> None:
        self.folder, self.steps = folder, dict[str, dict[str, Any]]()
        self.call = call
        if folder.exists() and not folder.is_dir():
            raise OutputError(f"{folder}: is not a folder; name another with -o")
        state = folder / STATE
        if not state.is_file():
            if folder.exists() and (other := min(os.listdir(folder), default="")):
                raise OutputError(f"{folder}: holds {other} and is not a scene; name a new folder with -o")
            self.write()
            return
        try:
            known = json.loads(state.read_bytes())
            self.steps, same = known["steps"], known["call"] == call
            if known["sha256"] != self._digest():
                raise ValueError("has changed")
        except (OSError, ValueError, TypeError, LookupError, RecursionError):
            raise OutputError(f"{state}: is damaged; remove the folder, or name a new one with -o") from None
        if not same:
            raise OutputError(
                f"{folder}: has the scene of another video, or of other options; name a new folder with -o"
            )

    def step(self, name: str, files: Sequence[str], work: Callable[[], Any]) -> Any:
        """Return the noted result of a step whose ``files`` are there, else that of ``work``.

        What is done anew makes all steps after it begin anew.
        """
        if name in self.steps and all((self.folder / file).exists() for file in files):
            return self.steps[name]["result"]
        names = list(self.steps)
        for later in names[names.index(name) :] if name in names else ():
            del self.steps[later]
        result = json.loads(json.dumps(work()))  # as it is when it is read again
        self.steps[name] = {"result": result}
        self.write()
        return result

    def result(self, name: str, otherwise: Any) -> Any:
        """Return the noted result of a step, or what is given if it is not done."""
        return self.steps[name]["result"] if name in self.steps else otherwise

    def write(self) -> None:
        """Note the steps that are done."""
        content = signed({"call": self.call, "steps": self.steps}, __version__)
        content["sha256"] = self._digest()
        write_file(self.folder / STATE, (json.dumps(content) + "\n").encode())

    def _digest(self) -> str:
        """Return the SHA-256 of the steps that are done, by which damage is known."""
        return hashlib.sha256(json.dumps(self.steps).encode()).hexdigest()
