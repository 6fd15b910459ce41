"""The motions of exposures that ``blur2view place`` has put into COLMAP's model, against measured ones.

``python -m tools.evaluation.placed MODEL TRUTH``, with a folder of NAME.npz that hold ``R`` (3, 3) and ``t``
(3,), cam_close_from_cam_open of the photograph NAME, left/a.npz those of left/a.jpg. Rotations are compared
after one scale for all, as the truth may be of a frame interval and not of its exposure. No photographs with
such a truth ship.
"""

from pathlib import Path, PurePosixPath

import numpy as np

from blur2view.arrays import Array
from blur2view.colmap.models import read_model
from blur2view.errors import OutputError
from blur2view.exposure.views import CLOSE, OPEN
from blur2view.geometry.rotation import rotation_vector
from tools.arguments import existing, parser_of
from tools.pages import table

Motions = dict[str, Array]  # by the photograph's name without suffix: rotation vector and translation (2, 3)


def placed_motions(folder: Path) -> Motions:
    """Return the motions from shutter-open to shutter-close of a model's photographs that have both views."""
    images = read_model(folder).images.values()
    poses = {image.name: image.cam_from_world() for image in images if image.has_pose}
    names = [name.removesuffix(OPEN) for name in poses if name.endswith(OPEN)]
    steps = {
        name: poses[name + CLOSE] * poses[name + OPEN].inverse() for name in names if name + CLOSE in poses
    }
    return {
        PurePosixPath(name).with_suffix("").as_posix(): np.stack(
            [rotation_vector(step.rotation.matrix()), step.translation]
        )
        for name, step in steps.items()
    }


def measured_motions(folder: Path) -> Motions:
    """Return the true motions of a folder and the folders in it."""
    motions = {}
    for path in sorted(folder.rglob("*.npz")):
        with np.load(path) as file:
            name = path.relative_to(folder).with_suffix("").as_posix()
            motions[name] = np.stack([rotation_vector(file["R"]), file["t"].ravel()])
    return motions


def page(placed: Motions, measured: Motions) -> str:
    """Return the medians over the photographs that both have, as Markdown."""
    names = sorted(placed.keys() & measured.keys())
    if not names:
        raise OutputError("no photograph with both views has a truth; name the folder of NAME.npz")
    r, t = np.array([placed[name] for name in names]).swapaxes(0, 1)
    r_true, t_true = np.array([measured[name] for name in names]).swapaxes(0, 1)
    scaled = r_true * (r * r_true).sum() / (r_true**2).sum()
    relative = np.linalg.norm(r - scaled, axis=1) / np.linalg.norm(scaled, axis=1)
    cosine = (t * t_true).sum(axis=1) / np.linalg.norm(t, axis=1) / np.linalg.norm(t_true, axis=1)
    direction = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    row = (
        len(names),
        f"{np.median(relative):.3f}",
        f"{np.median(direction):.1f}",
        f"{(direction < 30).mean():.0%}",
    )
    head = "photographs | rotation, relative error | translation's direction, degrees | below 30"
    return "\n".join(table(head, [row]))


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("model", type=existing, help="folder that blur2view place has written")
    parser.add_argument("truth", type=existing, help="folder of NAME.npz")
    arguments = parser.parse_args()
    print(page(placed_motions(arguments.model), measured_motions(arguments.truth)))


if __name__ == "__main__":
    main()
