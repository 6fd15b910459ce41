"""From a blurred video to a scene: COLMAP maps the sharpest frames, and the others are recovered.

The steps are the functions that the commands call: frames are chosen (`frames`), their blur is read
(`read_once`), COLMAP maps the sharp ones (`mapping`), the others are recovered (`recovering`), all are masked
(`masks`) and written for a trainer (`trainer`). Each step is noted when it is done (`scene`). Measured by
``python -m tools.evaluation.reconstructed``.
"""

import hashlib
import os
import shutil
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from blur2view import __version__
from blur2view.colmap import transforms
from blur2view.errors import DatabaseError, OutputError
from blur2view.files import quick_digest
from blur2view.images.inputs import Source
from blur2view.networks.model_file import usable_cores
from blur2view.networks.smear_network import SmearNetwork, SmearReader
from blur2view.output import locked, unwritable, writable_folder, write_file
from blur2view.reconstruction.frames import (
    Frame,
    chosen,
    colmap_content,
    list_frames,
    looked_at,
    refuse_few,
    sharp_enough,
    stood_still,
    stored_size,
)
from blur2view.reconstruction.mapping import STOOD_STILL, map_frames
from blur2view.reconstruction.masks import MASKS, Masks, write_masks
from blur2view.reconstruction.options import ReconstructionOptions
from blur2view.reconstruction.outcome import Reconstruction, shown_frames
from blur2view.reconstruction.read_once import AllWindows, KeptSmears, LooksAtShort, blur_of_frames
from blur2view.reconstruction.recovering import recover_missing
from blur2view.reconstruction.scene import (
    DATABASE,
    EXPOSURES,
    IMAGES,
    REPORT,
    SPARSE,
    TRANSFORMS,
    WORK,
    Scene,
    Step,
)
from blur2view.reconstruction.static_points import StaticPoints
from blur2view.reconstruction.timeline import timeline
from blur2view.reconstruction.trainer import write_transforms
from blur2view.results.blur_timeline import Seen

SMEARS = "smears"  # below `WORK`


def reconstruct(
    video: str | os.PathLike[str],
    folder: str | os.PathLike[str],
    options: ReconstructionOptions | None = None,
    *,
    network: SmearReader | None = None,
    jobs: int | None = None,
    step: Step = lambda text: nullcontext(lambda done, count: None),
) -> Reconstruction:
    """Make a scene of a blurred video: a folder that trainers of radiance fields and COLMAP read.

    The same call goes on where one was ended, by Ctrl-C or killed.

    Parameters
    ----------
    video : path
        A video, or a folder of the frames of one.
    folder : path
        Where the scene goes: ``images``, ``sparse/0`` (COLMAP's model of these), ``exposures`` (the same
        with the poses NAME#open and NAME#close of recovered frames), ``database.db``, ``masks`` (where
        anything moves by itself), ``transforms.json`` and ``sparse_pc.ply``, ``report.html``. New, empty, or
        of an earlier call.
    options : ReconstructionOptions, optional
        Which frames, camera and mapper.
    network : SmearReader, optional
        Reads smears; by default a new `SmearNetwork`.
    jobs : int, optional
        Processes that recover frames, by default one per core; any number gives the same scene. COLMAP runs
        in a process, too, so that a script calls this under ``if __name__ == "__main__":``.
    step : callable, optional
        Is entered for each step with its name; gives what gets how many parts are done, of how many.

    Returns
    -------
    Reconstruction
        What became of every frame, by name.

    Raises
    ------
    DatabaseError
        If COLMAP makes no model; the message says why.
    OutputError
        If the folder cannot be used, or another call makes a scene there.
    ImageError
        If the video cannot be read.
    CameraError
        If the camera is for frames of another shape.

    Examples
    --------
    A scene of a video, of minutes of work, and how many of its frames have a pose::

        if __name__ == "__main__":
            scene = blur2view.reconstruct("clip.mp4", "scene")
            print(len(scene.registered), len(scene.recovered), dict(scene.refused))
    """
    options, video, folder = options or ReconstructionOptions(), Path(video), Path(folder)
    if Path(os.path.realpath(folder)).is_relative_to(os.path.realpath(video)):
        raise OutputError(
            f"{folder}: is the video, or lies in the folder of its frames; name another folder with -o"
        )
    listed = dict(list_frames(video))
    refuse_few(video, len(listed))
    if options.camera:  # which is checked before anything is written
        options.for_colmap(stored_size(next(iter(listed.values()))))
    writable_folder(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from None
    with locked(folder, alone=True):
        with step("reading the video"):
            network = network or SmearNetwork()
            scene = Scene(folder, _digest(listed, options, network))
        kept_smears = KeptSmears(network, folder / WORK / SMEARS)
        making = _Making(
            video=video,
            listed=listed,
            scene=scene,
            options=options,
            network=kept_smears,
            jobs=jobs or usable_cores(),
            step=step,
        )
        return making.made()


@dataclass(frozen=True, kw_only=True, eq=False)
class _Making:
    """The steps of a scene, in a folder that no other call changes meanwhile."""

    video: Path
    listed: Mapping[str, Source]  # frames by name
    scene: Scene
    options: ReconstructionOptions
    network: SmearReader
    jobs: int
    step: Step

    @property
    def folder(self) -> Path:
        """The scene's folder."""
        return self.scene.folder

    @property
    def work(self) -> Path:
        """The folder of what is not done."""
        return self.folder / WORK

    def made(self) -> Reconstruction:
        """Return the scene after all steps that are not done yet."""
        scene, options = self.scene, self.options
        first = scene.step("choose", [], self._choose)
        frames = [Frame(*values) for values in first["frames"]]
        best: list[str] = first["chosen"]
        kept = [frame.name for frame in frames] if options.all_frames else best
        scene.step("images", [f"{IMAGES}/{name}" for name in kept], partial(self._write_images, kept))
        scene.step("standing", [], partial(self._refuse_standing, frames, best))
        reading = partial(
            blur_of_frames, self.folder / IMAGES, kept, self.work / "look.jsonl", self.network, self.step
        )
        seen = scene.step("look", [], reading)
        smears: dict[str, float | None] = {name: values[1] for name, values in seen.items()}
        way = sum(frame.moved for frame in frames)
        mapping = partial(map_frames, self.folder, sharp_enough(best, smears), options, way, self.step)
        counts = scene.step("map", [f"{WORK}/model/images.bin", DATABASE], mapping)
        reader = LooksAtShort(self.network)
        recovering = partial(recover_missing, self.folder, kept, reader, self.jobs, self.step)
        found = scene.step("recover", [f"{SPARSE}/images.bin", f"{EXPOSURES}/images.bin"], recovering)
        result = Reconstruction(
            folder=self.folder,
            looked_at=tuple(frame.name for frame in frames),
            chosen=tuple(best),
            mapped=tuple(counts["mapped"]),
            registered=tuple(found["registered"]),
            recovered=tuple(found["recovered"]),
            refused=found["refused"],
            other_models=tuple(counts["others"]),
            moving=None,
            smear_px=smears,
        )
        result = replace(result, moving=self._masked(result, kept))
        writing = partial(write_transforms, self.folder, options, masked=bool(result.moving))
        trainer = [TRANSFORMS, transforms.PLY] if options.dialect == transforms.NERFSTUDIO else [TRANSFORMS]
        scene.step("transforms", trainer, writing)
        kinds = {name: values[0] for name, values in seen.items()}
        shown = partial(shown_frames, frames, kinds, result, found.get("turned", {}))
        moving = None if result.moving is None else len(result.moving)
        scene.step("report", [REPORT], lambda: self._write_report(shown(), moving))
        self._tidy()
        return result

    def _choose(self) -> dict[str, Any]:
        """Return all frames, and which of them are chosen."""
        with self.step("looking at frames") as show:
            frames = list(looked_at(list(self.listed.items()), show))
        refuse_few(self.video, len(frames))  # of those that a video announces, some may not be there
        return {"frames": frames, "chosen": [frame.name for frame in chosen(frames, self.options.frames)]}

    def _write_images(self, names: list[str]) -> int:
        """Write the frames that are not there; return how many there are."""
        with self.step("writing frames") as show:
            for done, name in enumerate(names):
                show(done, len(names))
                path = self.folder / IMAGES / name
                if not path.is_file():  # one that is there is whole
                    write_file(path, colmap_content(self.listed[name]))
        return len(names)

    def _refuse_standing(self, frames: list[Frame], names: list[str]) -> None:
        """Raise DatabaseError if the camera stood still, of which COLMAP makes no model."""
        with self.step("looking whether the camera moves"):
            some = [frame for frame in frames if frame.name in set(names)]
            some.sort(key=lambda frame: -frame.energy)
            if stood_still([self.folder / IMAGES / frame.name for frame in some]):
                raise DatabaseError(f"{self.folder}: COLMAP can make no model: {STOOD_STILL}")

    def _masked(self, result: Reconstruction, names: list[str]) -> tuple[str, ...] | None:
        """Return the frames in which anything moves by itself, after writing masks; None if nobody asked."""
        if not self.options.masks:
            return None
        posed = {*result.registered, *result.recovered}

        def mask() -> Masks:
            with self.step("finding what moves by itself") as show:
                return write_masks(
                    self.folder,
                    IMAGES,
                    [name for name in names if name in posed],
                    self.work / MASKS,
                    AllWindows(self.network),
                    points=StaticPoints(self.folder / SPARSE, result.recovered),
                    consecutive=self.options.all_frames,
                    beside=self.options.dialect == transforms.INSTANT_NGP,
                    show=show,
                )

        done = Masks(*self.scene.result("moving", Masks([], [])))
        return tuple(Masks(*self.scene.step("moving", done.files, mask)).moving)

    def _write_report(self, frames: list[Seen], moving: int | None) -> str:
        """Write the report, and return its name."""
        with self.step("writing the report"):
            page = timeline(
                frames,
                self.folder / EXPOSURES,
                self.folder / IMAGES,
                self.video.name,
                __version__,
                moving=moving,
            )
            write_file(self.folder / REPORT, page)
        return REPORT

    def _tidy(self) -> None:
        """Remove what only calls that were ended need."""
        for rest in ("models", "placed", "stretched", MASKS, SMEARS):
            shutil.rmtree(self.work / rest, ignore_errors=True)
        for path in self.work.glob("matches_*"):
            path.unlink()


def _digest(listed: Mapping[str, Source], options: ReconstructionOptions, network: SmearReader) -> str:
    """Return the SHA-256 of the frames' content, the options and the network."""
    files = list(dict.fromkeys(source.path for source in listed.values()))
    files += [network.path] if isinstance(network, SmearNetwork) else []
    every = __version__, [quick_digest(file) for file in files], list(listed), options, network.model_id
    return hashlib.sha256(repr(every).encode()).hexdigest()
