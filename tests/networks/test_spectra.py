"""The fixed part in NumPy: rounding; its cepstra are compared with torch's in tests/tools/training."""

import numpy as np

from blur2view.networks.spectra import as_float16


def test_rounding_is_that_of_float16() -> None:
    """Of numbers of all sizes below 1, of float16's least steps and of halves between its numbers."""
    rng = np.random.default_rng(0)
    any_size = rng.uniform(-1, 1, 20_000) * 10 ** rng.uniform(-9, -0.1, 20_000)
    halves = np.arange(0.5, 4096) * 2.0**-24
    for values in (any_size, halves, 2.0**10 * halves, np.zeros(1)):
        np.testing.assert_array_equal(as_float16(values), values.astype(np.float16))
