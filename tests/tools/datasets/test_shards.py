"""Shards of rendered scenes: stored values, resuming, loading; and the contact sheet."""

import argparse
from pathlib import Path

import cv2
import numpy as np
import pytest

from blur2view.errors import Blur2ViewError
from tools.datasets import contact_sheet
from tools.datasets.shards import (
    Scenes,
    add_scene_arguments,
    decode_linear,
    encode_linear,
    load_shards,
    scene_arguments,
    training_record,
    write_shards,
)
from tools.rendering.render import RenderOptions, render

TINY = RenderOptions(size=(64, 48), mover_share=1.0)


def scenes_of(count: int, level: int) -> Scenes:
    return Scenes(
        linear=np.full((count, 8, 12, 3), level, np.uint16),
        displacement=np.full((count, 2, 3, 2), level, np.float16),
        labels=np.full((count, 2, 3), level, np.uint8),
    )


def test_radiance_is_stored_finely_in_the_dark_and_up_to_four() -> None:
    linear = np.concatenate([np.linspace(0, 0.01, 50), np.linspace(0.01, 4, 500)]).astype(np.float32)
    coded = encode_linear(linear)
    assert coded.dtype == np.uint16
    half_a_step = np.sqrt(4 * linear) / 65535
    assert (np.abs(decode_linear(coded) - linear) <= 1.01 * half_a_step + 1e-6 * linear + 1e-9).all()
    np.testing.assert_allclose(decode_linear(encode_linear(np.array([-1.0, 9.0]))), [0, 4], rtol=1e-6)


def test_record_holds_the_rendering() -> None:
    record, scene = training_record(5, TINY), render(5, TINY)
    np.testing.assert_allclose(record.displacement[0], scene.displacement, rtol=1e-3, atol=1e-4)
    np.testing.assert_array_equal(record.labels[0] & 1, scene.valid)
    np.testing.assert_array_equal(record.labels[0] >> 1, scene.static)
    np.testing.assert_allclose(decode_linear(record.linear[0]), np.minimum(scene.linear, 4), atol=1e-4)


def test_shards_are_joined_in_order_of_their_names(tmp_path: Path) -> None:
    for start, (count, level) in {7: (1, 9), 0: (3, 1), 3: (2, 5)}.items():
        scenes_of(count, level).save(tmp_path / f"train_{start:08d}.npz")
    (tmp_path / "train_00000009.tmp.npz").write_bytes(b"half written")
    merged = load_shards(tmp_path)
    assert len(merged) == 6
    for array in (merged.linear, merged.displacement, merged.labels):
        np.testing.assert_array_equal(array[:, 0, 0].reshape(6, -1)[:, 0], [1, 1, 1, 5, 5, 9])
    joined = Scenes.join([scenes_of(3, 1), scenes_of(2, 5)])
    np.testing.assert_array_equal(joined.linear, merged.linear[:5])
    assert joined.displacement.dtype == np.float16


def test_empty_folder_names_the_command(tmp_path: Path) -> None:
    with pytest.raises(Blur2ViewError, match="python -m tools.datasets.shards"):
        load_shards(tmp_path)


@pytest.mark.slow
def test_stopped_dataset_goes_on_where_it_stopped(tmp_path: Path) -> None:
    scenes_of(2, 3).save(tmp_path / "train_00000000.npz")
    written = list(write_shards(tmp_path, range(0, 4), TINY, jobs=1, shard=2))
    assert [path.name for path in written] == ["train_00000002.npz"]
    merged = np.load(written[0])
    np.testing.assert_array_equal(merged["linear"][1], training_record(3, TINY).linear[0])
    assert not list(tmp_path.glob("*.tmp*"))
    with np.load(tmp_path / "train_00000000.npz") as kept:
        assert kept["linear"].max() == 3


def test_defaults_of_the_command_are_those_of_the_options(tmp_path: Path) -> None:
    parser = argparse.ArgumentParser()
    add_scene_arguments(parser)
    assert scene_arguments(parser.parse_args([])) == (range(12), RenderOptions())
    words = [
        "--scenes",
        "3",
        "--first-seed",
        "5",
        "--split",
        "test",
        "--size",
        "64",
        "48",
        "--photos",
        str(tmp_path),
    ]
    options = RenderOptions(size=(64, 48), split="test", photos=tmp_path)
    assert scene_arguments(parser.parse_args(words)) == (range(5, 8), options)


def test_contact_sheet_has_a_row_a_seed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sheet = contact_sheet.contact_sheet(range(2), TINY)
    assert sheet.shape == (2 * 48, 3 * 64, 3) and sheet.dtype == np.uint8
    words = f"contact_sheet --scenes 1 --size 64 48 --out {tmp_path / 'sheet.png'}".split()
    monkeypatch.setattr("sys.argv", words)
    contact_sheet.main()
    assert cv2.imread(str(tmp_path / "sheet.png")).shape == (48, 192, 3)  # type: ignore[union-attr]


def test_smear_picture_knows_no_sign_and_darkens_short_smears() -> None:
    field = np.array([[[30.0, 10.0], [-30.0, -10.0], [3.0, 1.0], [10.0, -30.0]]])
    picture = contact_sheet.smear_picture(field)
    np.testing.assert_allclose(picture[0, 0].astype(int), picture[0, 1], atol=4)
    assert picture[0, 2].max() < picture[0, 0].max()
    assert np.abs(picture[0, 3].astype(int) - picture[0, 0]).max() > 100
