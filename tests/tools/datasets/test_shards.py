"""Shards of rendered scenes: stored values, resuming, loading."""

from pathlib import Path

import numpy as np
import pytest

from blur2view.errors import Blur2ViewError
from tools.datasets.shards import (
    Scenes,
    decode_linear,
    encode_linear,
    load_shards,
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
    with pytest.raises(Blur2ViewError, match="python -m tools.datasets.shards"):
        load_shards(tmp_path)
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
