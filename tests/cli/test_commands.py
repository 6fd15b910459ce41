"""``blur2view estimate``: what it prints and writes."""

import json
from pathlib import Path

import numpy as np

from blur2view.geometry.epipolar import serrmin
from blur2view.images.image import read_image
from blur2view.smears.grid import smear_ends
from blur2view.smears.matches import SelectOptions
from blur2view.two_view.estimate import EstimatorOptions
from tests.support.calls import Call, table
from tests.support.colour_code import HEIGHT, WIDTH, forward_motion
from tests.support.many_photographs import contents


def test_files_hold_the_estimate_whose_F_fits_the_true_smears(
    run: Call, moving: Path, tmp_path: Path
) -> None:
    out = tmp_path / "deep" / "out"
    assert run(moving, "-o", out) == 0
    assert sorted(contents(out)) == ["moving.json", "moving.png", "moving.smear.npz"]

    document = json.loads((out / "moving.json").read_text())
    assert document["config"] == "PLANAR" and document["reason"]
    F = np.array(document["F"])
    assert F.shape == (3, 3) and np.isclose(np.linalg.norm(F), 1)
    assert 0 < document["num_inliers"] <= document["num_matches"]
    assert (document["width"], document["height"]) == (WIDTH, HEIGHT)
    assert document["model_ids"] == ["colour-code"] and document["seed"] == 0
    assert (document["beta"], document["max_error_px"]) == (SelectOptions.beta, EstimatorOptions.max_error_px)

    with np.load(out / "moving.smear.npz") as arrays:
        assert arrays["smear_grid"].shape == (-(-HEIGHT // 32), WIDTH // 32, 4)
        assert arrays["smear_grid"].dtype == np.float16
        assert arrays["stride"] == 32 and arrays["shape"].tolist() == [HEIGHT, WIDTH]
        assert arrays["ends"].shape == (document["num_matches"], 2, 2)
        assert arrays["inlier_mask"].sum() == document["num_inliers"]
        assert (
            arrays["second_end_is_open"].shape
            == arrays["match_sigma_px"].shape
            == arrays["inlier_mask"].shape
        )

    assert read_image(out / "moving.png").shape[1] == 640
    y, x = np.mgrid[2:HEIGHT:7, 2:WIDTH:7]
    points, displacement = np.c_[x.ravel(), y.ravel()], forward_motion()[2::7, 2::7].reshape(-1, 2)
    length = np.hypot(*displacement.T)
    rho = np.sqrt(serrmin(F, smear_ends(points, displacement)))[length > 4] / length[length > 4]
    assert np.median(rho) < 0.01


def test_verbose_summary_has_the_reason_and_no_control_character_is_printed(
    run: Call, moving: Path, tmp_path: Path
) -> None:
    odd = moving.rename(tmp_path / "two\nlines\x1b[31m.png")
    done = run(odd, "-v", "--csv", tmp_path / "t.csv")
    assert done == 0 and "two\\nlines\\x1b[31m.png: Camera" in done.out
    (row,) = table(tmp_path / "t.csv")
    assert row["reason"] in done.out and row["reason"] not in run(odd).out


def test_json_is_one_document_that_equals_the_file(
    run: Call, moving: Path, still: Path, tmp_path: Path
) -> None:
    done = run(moving, still, "--json", "-o", tmp_path / "out")
    assert done == 0 and done.document["failures"] == []
    for document in done.document["estimates"]:
        file = tmp_path / "out" / f"{Path(document['name']).stem}.json"
        assert json.loads(file.read_text()) == document
