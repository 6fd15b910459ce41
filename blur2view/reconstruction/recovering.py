"""The frames of a scene that COLMAP's model lacks or misplaces, recovered and written into its models."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from blur2view.colmap.frame_sequence import FrameSequence
from blur2view.colmap.models import read_ids, refuse_other_model, write_model
from blur2view.colmap.recovery import finished_recovery
from blur2view.colmap.recovery_run import Notes, recover_all
from blur2view.colmap.transforms import keep_photographs
from blur2view.networks.smear_network import SmearReader
from blur2view.reconstruction.scene import DATABASE, EXPOSURES, IMAGES, SPARSE, WORK, Step
from blur2view.reconstruction.turning import turnings


def recover_missing(
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
    write_model(keep_photographs(found.model, known), folder / SPARSE, images, database)
    write_model(found.model, folder / EXPOSURES, images, database)
    notes.remove()
    return {
        "registered": found.registered,
        "recovered": list(found.recovered),
        "refused": dict(found.refused),
        "turned": turned,
    }
