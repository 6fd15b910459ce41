"""From a blurred video to a scene: COLMAP maps the sharpest frames, and the others are recovered.

The steps are the functions that the commands call: frames are chosen, mapped by COLMAP (`mapping`), recovered
(`colmap.recovery`), written with and without the views of exposures (`colmap.models`), masked (`masks`), and
written for a trainer (`colmap.transforms`). Each is noted when it is done (`scene`). Measured by
``python -m tools.evaluation.reconstructed``.
"""

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path, PurePath
from statistics import median
from typing import Any

from blur2view import __version__
from blur2view.colmap import transforms
from blur2view.colmap.contrast import write_stretched
from blur2view.colmap.frame_sequence import FrameSequence
from blur2view.colmap.models import read_ids, read_model, refuse_other_model, registered_images, write_model
from blur2view.colmap.recovery import finished_recovery
from blur2view.colmap.recovery_run import Notes, recover_all
from blur2view.errors import DatabaseError, ImageError, OutputError
from blur2view.files import (
    add_checked_line,
    check_file,
    checked_line,
    checked_lines,
    locked,
    quick_digest,
    signed,
    unwritable,
    writable_folder,
    write_beside,
    write_file,
)
from blur2view.images.image import read_picture
from blur2view.images.inputs import Source
from blur2view.movers.mask import MaskFormat
from blur2view.networks.model_file import usable_cores
from blur2view.networks.smear_network import SmearNetwork, SmearReader
from blur2view.pipeline import estimate
from blur2view.reconstruction import mapping
from blur2view.reconstruction.frames import Frame, chosen, colmap_content, list_frames, looked_at, stored_size
from blur2view.reconstruction.masks import MASKS, write_masks
from blur2view.reconstruction.options import MIN_FRAMES, ReconstructionOptions
from blur2view.reconstruction.read_once import KeptSmears
from blur2view.reconstruction.scene import Scene
from blur2view.reconstruction.timeline import timeline
from blur2view.reconstruction.turning import turnings
from blur2view.results.blur_timeline import Seen

IMAGES, SPARSE, EXPOSURES, DATABASE = "images", "sparse/0", "exposures", "database.db"
TRANSFORMS, REPORT, WORK, SMEARS = "transforms.json", "report.html", "work", "smears"
MAX_MAPPED_PX = 12.0  # of a smear: COLMAP registers longer ones worse than `recover_frames` does
MIN_SHARP = 0.4  # share of the chosen frames that is sharper; else all are mapped
MIN_REGISTERED = 0.5  # share of the mapped frames; with fewer they are read anew by `blurred_options`
Show = Callable[[int, int], None]
Step = Callable[[str], AbstractContextManager[Show]]


@dataclass(frozen=True, kw_only=True)
class Reconstruction:
    """A scene that was made, by names of frames in order."""

    folder: Path
    looked_at: tuple[str, ...]  # frames of the video
    chosen: tuple[str, ...]  # that are sharpest
    mapped: tuple[str, ...]  # that COLMAP got
    registered: tuple[str, ...]  # by COLMAP
    recovered: tuple[str, ...]  # by their blur
    refused: Mapping[str, str]  # the reason
    other_models: tuple[int, ...]  # frames in each further model of COLMAP that the largest one lacks
    smear_px: Mapping[str, float | None]  # of frames that were delivered; None where it is unknown

    def median_smear_px(self, names: Sequence[str]) -> float | None:
        """Return the median smear of frames; None if none is known."""
        known = [smear for name in names if (smear := self.smear_px.get(name)) is not None]
        return median(known) if known else None


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
    video
        A video, or a folder of the frames of one.
    folder
        Where the scene goes: ``images``, ``sparse/0`` (COLMAP's model of these), ``exposures`` (the same
        with the poses NAME#open and NAME#close of recovered frames), ``database.db``, ``masks`` (where
        anything moves by itself), ``transforms.json`` and ``sparse_pc.ply``, ``report.html``. New, empty, or
        of an earlier call.
    options
        Which frames, camera and mapper.
    network
        Reads smears; by default a new `SmearNetwork`.
    jobs
        Processes that recover frames, by default one per core; any number gives the same scene. COLMAP runs
        in a process, too, so that a script calls this under ``if __name__ == "__main__":``.
    step
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
            f"{folder}: is the folder of the frames, or lies in it; name another folder with -o"
        )
    listed = dict(list_frames(video))
    if options.camera:  # which is checked before anything is written
        options.for_colmap(stored_size(next(iter(listed.values()))))
    writable_folder(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from None
    with locked(folder, alone=True):
        return _made(video, listed, folder, options, network, jobs, step)


def _made(
    video: Path,
    listed: Mapping[str, Source],
    folder: Path,
    options: ReconstructionOptions,
    network: SmearReader | None,
    jobs: int | None,
    step: Step,
) -> Reconstruction:
    """Return the scene of the ``listed`` frames, in a folder that no other call changes meanwhile."""
    with step("reading the video"):
        network = network or SmearNetwork()
        scene = Scene(folder, _digest(listed, options, network))
    work, images = folder / WORK, folder / IMAGES
    network = KeptSmears(network, work / SMEARS)

    def choose() -> dict[str, Any]:
        with step("looking at frames") as show:
            frames = list(looked_at(list(listed.items()), show))
        if len(frames) < MIN_FRAMES:
            raise ImageError(f"{video}: has {len(frames)} frames, but a scene needs at least {MIN_FRAMES}")
        best = [frame.name for frame in chosen(frames, options.frames)]
        return {"frames": frames, "chosen": best}

    first = scene.step("choose", [], choose)
    frames = [Frame(*values) for values in first["frames"]]
    best: list[str] = first["chosen"]
    kept = [frame.name for frame in frames] if options.all_frames else best

    def write_images() -> int:
        with step("writing frames") as show:
            for done, name in enumerate(kept):
                show(done, len(kept))
                if not (images / name).is_file():  # one that is there is whole
                    write_file(images / name, colmap_content(listed[name]))
        return len(kept)

    scene.step("images", [f"{IMAGES}/{name}" for name in kept], write_images)
    seen = scene.step("look", [], partial(_look, images, kept, work / "look.jsonl", network, step))
    smears: dict[str, float | None] = {name: values[1] for name, values in seen.items()}
    sharp = [name for name in best if (smears[name] or 0.0) <= MAX_MAPPED_PX]
    mapped = sharp if len(sharp) >= max(MIN_FRAMES, MIN_SHARP * len(best)) else best
    way = sum(frame.moved for frame in frames)
    named = f"{work.name}/model/images.bin"
    counts = scene.step("map", [named, DATABASE], partial(_map, folder, mapped, options, way, step))
    recovering = partial(_recover, folder, kept, network, jobs or usable_cores(), step)
    found = scene.step("recover", [f"{SPARSE}/images.bin", f"{EXPOSURES}/images.bin"], recovering)
    result = Reconstruction(
        folder=folder,
        looked_at=tuple(frame.name for frame in frames),
        chosen=tuple(best),
        mapped=tuple(mapped),
        registered=tuple(found["registered"]),
        recovered=tuple(found["recovered"]),
        refused=found["refused"],
        other_models=tuple(counts["others"]),
        smear_px=smears,
    )

    def mask() -> list[str]:
        posed, beside = {*result.registered, *result.recovered}, options.dialect == transforms.INSTANT_NGP
        with step("finding what moves by itself") as show:
            return write_masks(
                folder,
                IMAGES,
                [name for name in kept if name in posed],
                work / MASKS,
                network,
                consecutive=options.all_frames,
                beside=beside,
                show=show,
            )

    masks: list[str] = scene.step("masks", scene.result("masks", []), mask) if options.masks else []
    trainer = [TRANSFORMS, transforms.PLY] if options.dialect == transforms.NERFSTUDIO else [TRANSFORMS]
    scene.step("transforms", trainer, partial(_write_transforms, folder, options, masks))

    def write_report() -> str:
        with step("writing the report"):
            kinds = {name: values[0] for name, values in seen.items()}
            shown = _seen(frames, kinds, result, found.get("turned", {}))
            page = timeline(shown, folder / EXPOSURES, images, video.name, __version__)
            write_file(folder / REPORT, page)
        return REPORT

    scene.step("report", [REPORT], write_report)
    for rest in ("models", "placed", "stretched", MASKS, SMEARS):
        shutil.rmtree(work / rest, ignore_errors=True)
    for path in work.glob("matches_*"):
        path.unlink()
    return result


def _digest(listed: Mapping[str, Source], options: ReconstructionOptions, network: SmearReader) -> str:
    """Return the SHA-256 of the frames' content, the options and the network."""
    files = list(dict.fromkeys(source.path for source in listed.values()))
    files += [network.path] if isinstance(network, SmearNetwork) else []
    every = __version__, [quick_digest(file) for file in files], list(listed), options, network.model_id
    return hashlib.sha256(repr(every).encode()).hexdigest()


def _look(
    images: Path, names: Sequence[str], notes: Path, network: SmearReader, step: Step
) -> dict[str, tuple[str, float | None]]:
    """Return what blurred each frame, and the length of its smear; ``notes`` keep what is done."""
    lines = checked_lines(notes)
    found: dict[str, tuple[str, float | None]] = {
        name: (kind, smear) for name, kind, smear in map(json.loads, lines)
    }
    write_file(notes, "".join(map(checked_line, lines)).encode())
    with step("reading blur") as show:
        for done, name in enumerate(names):
            show(done, len(names))
            if name in found:
                continue
            picture = read_picture(images / name, as_stored=True)
            seen = estimate(picture.pixels, network=network, geometry=False)
            blur = seen.blur
            smear_px = blur.smear_px if blur.kind.of_camera else 0.0
            found[name] = str(blur.kind), None if smear_px is None else float(smear_px)
            add_checked_line(notes, json.dumps([name, *found[name]]))
    return found


def _map(
    folder: Path, names: Sequence[str], options: ReconstructionOptions, way: float, step: Step
) -> dict[str, Any]:
    """Write COLMAP's database and its largest model; DatabaseError if it makes none."""
    work, images, models = folder / WORK, folder / IMAGES, list[Any]()
    camera = options.for_colmap(read_picture(images / names[0], as_stored=True).size)
    for blurred, again in product((False, True), (False, True)):
        if again and options.mapper == "global":
            continue
        database, there = work / f"matches_{blurred:d}.db", work / "models"
        if not again:
            with step("finding and matching features" + (" of blurred frames" if blurred else "")):
                readable = _stretched(images, work / "stretched", names) if blurred else images
                mapping.match(database, readable, names, camera=camera, blurred=blurred)
        else:  # on a copy, because the mapper may change it, and a killed call begins with the first one
            database = mapping.copied(database, work / f"matches_{blurred:d}_again.db")
        with step("mapping" + (" again" if again else "")):
            shutil.rmtree(there, ignore_errors=True)
            known = bool(options.camera)
            found = mapping.mapped(
                database, images, there, mapper=options.mapper, camera_known=known, again=again
            )
        if found and (not models or found[0].num_reg_images() > models[0].num_reg_images()):
            models = found
            shutil.copyfile(database, work / "best.db")
        if models and models[0].num_reg_images() >= MIN_REGISTERED * len(names):
            break
    if not models:
        why = mapping.why_no_model(work / "matches_0.db", way)
        raise DatabaseError(f"{folder}: COLMAP made no model of {len(names)} frames: {why}")
    write_model(models[0], work / "model", images, folder / DATABASE)
    (work / "best.db").replace(folder / DATABASE)
    largest, *others = (set(registered_images(model)) for model in models)
    return {"others": [len(other - largest) for other in others if other - largest]}


def _stretched(images: Path, copies: Path, names: Sequence[str]) -> Path:
    """Return where COLMAP finds features: in copies if the contrast of any frame is stretched there."""
    shutil.rmtree(copies, ignore_errors=True)
    return copies if write_stretched(images, copies, names) else images


def _recover(
    folder: Path, names: Sequence[str], network: SmearReader, jobs: int, step: Step
) -> dict[str, Any]:
    """Write the model with what is recovered, with and without views."""
    for name in (SPARSE, EXPOSURES):  # of which one may be lost, and the other refined since
        refuse_other_model(folder / name, folder / WORK / "model")
    with step("recovering frames") as show:
        sequence = FrameSequence(folder / WORK / "model", folder / IMAGES, names, network)
        if misplaced := [sequence.model.find_image_with_name(name) for name in sequence.misplaced()]:
            for image in misplaced:
                sequence.model.deregister_frame(image.frame_id)
            write_model(sequence.model, folder / WORK / "placed", folder / IMAGES, folder / DATABASE)
            sequence = FrameSequence(folder / WORK / "placed", folder / IMAGES, names, network)
        notes = Notes(folder / WORK / "recovering.jsonl", sequence)
        recover_all(sequence, jobs=jobs, notes=notes, show=show)
        found = finished_recovery(sequence, read_ids(folder / DATABASE), views=True)
        turned = turnings(sequence, [*found.registered, *found.recovered])
    known = {*found.registered, *found.recovered}
    images, database = folder / IMAGES, folder / DATABASE
    write_model(transforms.keep_photographs(found.model, known), folder / SPARSE, images, database)
    write_model(found.model, folder / EXPOSURES, images, database)
    notes.remove()
    return {
        "registered": found.registered,
        "recovered": list(found.recovered),
        "refused": dict(found.refused),
        "turned": turned,
    }


def _write_transforms(folder: Path, options: ReconstructionOptions, masks: Sequence[str]) -> int:
    """Write the scene for a trainer, with its masks if it has any; return how many frames it has."""
    model = read_model(folder / EXPOSURES)
    posed = {image.name: image for image in model.images.values() if image.has_pose}
    try:
        exposed = transforms.exposed_images(model, folder / EXPOSURES)
    except DatabaseError:  # no frame is blurred
        exposed = [transforms.Exposed(posed[name], (), None) for name in sorted(posed)]
    content = transforms.transforms_content(
        model,
        folder / EXPOSURES,
        exposed,
        dialect=options.dialect,
        images=IMAGES,
        exposure_s=options.exposure_s,
    )
    if masks and options.dialect == transforms.NERFSTUDIO:
        for frame, exposure in zip(content["frames"], exposed, strict=True):
            frame["mask_path"] = f"{MASKS}/{MaskFormat.COLMAP.path(PurePath(exposure.image.name))}"
    files = {folder / transforms.PLY: transforms.point_cloud(model)} if transforms.PLY_KEY in content else {}
    files[folder / TRANSFORMS] = (
        json.dumps(signed(content, __version__), indent=2, allow_nan=False) + "\n"
    ).encode()
    for file in files:
        check_file(file)
    write_beside(files, noted=True)
    return len(exposed)


def _seen(
    frames: Sequence[Frame],
    kinds: Mapping[str, str],
    result: Reconstruction,
    turned: Mapping[str, tuple[float, float]],
) -> list[Seen]:
    """Return what the report shows of each frame."""
    fates = dict.fromkeys(result.registered, "registered") | dict.fromkeys(result.recovered, "recovered")
    fates |= dict.fromkeys(result.refused, "refused")
    best = set(result.chosen)
    return [
        Seen(
            name=frame.name,
            number=frame.number,
            kind=kinds.get(frame.name, ""),
            smear_px=result.smear_px.get(frame.name),
            chosen=frame.name in best,
            fate=fates.get(frame.name, "left out"),
            reason=result.refused.get(frame.name, ""),
            turned=turned.get(frame.name),
        )
        for frame in frames
    ]
