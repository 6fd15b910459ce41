"""The command ``blur2view segment``: which pixels of a photograph move by themselves."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from blur2view.cli.batch import plan_files, run_each
from blur2view.cli.options import add_estimator_options, read_run
from blur2view.cli.outputs import MaskFiles, write_mask
from blur2view.cli.summary import mask_summary
from blur2view.documents import estimate_file, mask_document
from blur2view.networks.smear_network import SmearNetwork
from blur2view.pipeline import Run
from blur2view.segmentation.mask import SegmentOptions, segment
from blur2view.segmentation.network import MotionNetwork


def add_segment(commands: Any) -> None:
    """Describe ``blur2view segment``."""
    about = "tell what moves by itself from what the camera's motion explains"
    parser = commands.add_parser("segment", help=about, description=about)
    add = parser.add_argument
    add("images", nargs="+", type=Path, metavar="IMG", help="photographs: JPEG, PNG, TIFF, ...")
    add(
        "-o",
        "--output",
        type=Path,
        metavar="DIR",
        help="write DIR/<stem>.mask.png (0 static, 1 moving, 2 unobservable), .moving.png (probability), "
        ".motion.png and .motion.json",
    )
    add("--objects", action="store_true", help="fit an F or a homography to each moving part, too")
    add("--overwrite", action="store_true", help="replace results of an earlier call")
    add("--json", action="store_true", help="print one JSON document instead of the summary")
    add_estimator_options(parser)
    parser.set_defaults(run=lambda options: run_segment(options, parser.error))


def run_segment(options: argparse.Namespace, usage_error: Callable[[str], object]) -> int:
    """Segment every photograph; a failing one costs a line on stderr, not the others."""
    run = read_run(options, usage_error)
    wanted = SegmentOptions(objects=options.objects, estimator=run.options)
    plan = plan_files(options, MaskFiles)
    networks = SmearNetwork(options.model), MotionNetwork()
    return run_each(
        options, plan, "masks", lambda image, files: _segment_one(image, files, networks, run, wanted)
    )


def _segment_one(
    path: Path,
    files: MaskFiles | None,
    networks: tuple[SmearNetwork, MotionNetwork],
    run: Run,
    options: SegmentOptions,
) -> tuple[dict[str, Any], str]:
    """Read, estimate, segment and write one photograph; return its JSON document and its summary."""
    one = estimate_file(path, networks[0], run)
    start = time.perf_counter()
    mask = segment(one.found, one.image, options, np.random.default_rng(run.seed), networks[1])
    facts = mask_document(one, mask, time.perf_counter() - start)
    if files:
        write_mask(files, facts, one, mask)
    return facts, mask_summary(facts, mask, files)
