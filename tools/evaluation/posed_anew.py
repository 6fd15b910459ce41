"""What ``blur2view recover --max-smear`` gains for blurred frames that COLMAP registered itself.

``python -m tools.evaluation.posed_anew SEQUENCE WORK --out tools/results/posed_anew.md`` reads the frames of
a sequence that has a ``model``. A model of COLMAP that is there is gone on with.
"""

from pathlib import Path

import pycolmap

from blur2view.cli.terminal import complain
from blur2view.colmap.models import find_model
from blur2view.colmap.recovery import recover_frames
from blur2view.networks.smear_network import SmearNetwork
from blur2view.reconstruction.options import ReconstructionOptions
from tools.command import Existing, Target, publish, run, table
from tools.evaluation.placed import poses_of
from tools.evaluation.reconstructed import by_colmap, cpu_s, of_sequence, row

WIDER = [1, 2, 3]  # frames averaged before and after
MAX_SMEAR_PX = 12.0
LEAD = f"""\
Of a sequence whose every frame has a pose runs of 5 of every 15 frames are the mean of 2 *wider* + 1
consecutive ones in linear light. *COLMAP* gets every frame and the camera, and matches exhaustively with
default options. *Anew* is its model after `blur2view recover --max-smear {MAX_SMEAR_PX:g}`: frames with
longer smears, and those that see little and do not fit, get a new pose from the others, and frames that
COLMAP refused are recovered. Errors are those of [reconstructed.md](reconstructed.md): after a similarity
that aligns all frames with the true ones, rotations in degrees and positions in steps, median / 90 % over
frames with a pose, and over those of the runs."""
HEAD = "wider | way | frames with a pose | degrees | steps | runs: frames | degrees | steps | CPU s"


def main(sequence: Existing, work: Path, *, wider: list[int] = WIDER, out: Target | None = None) -> None:
    """Measure a sequence, its runs averaged over so many frames before and after."""
    network, rows = SmearNetwork(), []
    for count in wider:
        frames, colmap = work / f"wider_{count}" / "frames", work / f"wider_{count}" / "colmap"
        true, camera = of_sequence(sequence, frames, count)
        if not (colmap / "models").exists():
            by_colmap(colmap, frames, list(true), ReconstructionOptions(camera=camera))
        model = find_model(colmap / "models", complain)
        begun = cpu_s()
        found = recover_frames(model, frames, list(true), max_smear_px=MAX_SMEAR_PX, network=network)
        seconds = f"{cpu_s() - begun:.0f}"
        rows.append(row((str(count),), "COLMAP", poses_of(pycolmap.Reconstruction(model)), true, "-"))
        rows.append(row((str(count),), "anew", poses_of(found.model), true, seconds))
        publish(out, "# Blurred frames that COLMAP registered, posed anew", LEAD, table(HEAD, rows))


if __name__ == "__main__":
    run(main)
