"""Verdicts and uses: short, right about what is known, and without contradiction."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from blur2view.records.record import Record
from blur2view.records.verdict import decide_use

F = H = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
MOVED = Record(name="a.jpg", width=641, height=481, blur="camera moved", smear_px=9.0, smear_sigma_px=1.0)
SMEARS = "; smears of 9.0 px"
PARALLAX = {"model": "parallax", "parameters": 10, "log_likelihood": 0.0, "probability": 0.6}


def moved(config: str, parallax: str = "absent", **more: Any) -> Record:
    return replace(MOVED, config=config, parallax=parallax, **more)


def posed(config: str, translation: list[float], sigma: float = 0.005, **more: Any) -> Record:
    pose = {"rotation": np.eye(3).tolist(), "translation": translation}
    rates = {"wx": 0.0, "wy": 0.0837758, "wz": 0.0} | {f"sigma_w{axis}": sigma for axis in "xyz"}
    return moved(config, cam2_from_cam1=pose, pose_covariance={"translation_sigma_deg": 12.0}, **rates | more)


CASES = {
    "Sharp": replace(MOVED, blur="sharp"),
    "Out of focus (radius 4.1 px)": replace(MOVED, blur="out of focus", defocus_px=4.1),
    "The camera stood still; 14 % of the picture moves by itself": replace(
        MOVED, blur="camera at rest", moving_share=0.14
    ),
    "Too dark: cannot tell": replace(MOVED, blur="cannot tell", nothing_seen="too dark"),
    f"Camera moved, and too little of the picture shows how{SMEARS}": moved("DEGENERATE", "undecided"),
    f"Camera turned sideways{SMEARS}": moved("PANORAMIC", H=H, direction_deg=172.0),
    f"Camera rolled{SMEARS}": moved("PANORAMIC", "undecided", F=F, H=H),
    f"Camera rolled or moved{SMEARS}": moved("PANORAMIC", "undecided", F=F, H=H, models=[PARALLAX]),
    f"Camera turned by 4.8 +/- 0.3 degrees and moved, in an unknown direction{SMEARS}": posed(
        "PLANAR", [0.0, 0.0, 0.0], H=H
    ),
    f"Camera moved sideways (+/- 12 degrees){SMEARS}": posed("CALIBRATED", [1.0, 0.0, 0.0], F=F, sigma=0.09),
    f"Camera turned sideways at 2.1 +/- 0.1 rad/s{SMEARS}": posed(
        "PANORAMIC", [0.0, 0, 0], 0.13, wy=2.094, H=H, direction_deg=172.0, exposure_s=0.04
    ),
    f"Camera moved past something flat{SMEARS}": moved("PLANAR", H=H),
    f"Camera moved forward or back (+/- 12 degrees), turned by 4.8 +/- 0.3 degrees{SMEARS}": posed(
        "CALIBRATED", [0.0, 0.0, 1.0], F=F
    ),
    f"Camera moved past near and far things{SMEARS}; out of focus as well (radius 3.0 px)": replace(
        moved("UNCALIBRATED", "proven", F=F), blur="out of focus and moved", defocus_px=3.0
    ),
}


@pytest.mark.parametrize("expected", CASES)
def test_the_sentence_says_what_is_known_and_no_more(expected: str) -> None:
    assert CASES[expected].verdict == expected


USES = {
    "sharp": [
        replace(MOVED, blur="sharp", smear_px=8.9, smear_sigma_px=19.0),  # a sharp kind is never unusable
        replace(MOVED, blur="camera at rest", moving_share=0.1),
        moved("UNDEFINED", smear_px=2.9),
    ],
    "blurred": [moved("UNCALIBRATED", F=F), moved("PANORAMIC", H=H), moved("")],  # "": was not asked for
    "unusable": [moved("DEGENERATE"), moved("UNDEFINED")],
    "out of focus": [
        replace(MOVED, blur="out of focus", defocus_px=1.5),
        replace(MOVED, blur="sharp", defocus_px=2.5),
    ],
    "unclear": [replace(MOVED, blur="cannot tell"), replace(MOVED, smear_px=None)],
    "": [Record(name="a.jpg", error="a.jpg: is no picture")],
}


@pytest.mark.parametrize("use", USES)
def test_use_follows_from_the_kind_of_blur_then_from_its_length(use: str) -> None:
    for one in USES[use]:
        assert decide_use(one) == use
    assert moved("UNCALIBRATED", F=F).with_use(10.0).use == "sharp"  # 9 px are within that limit
