"""The triangle of a tall matrix: all that least squares takes from it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fracid.qr import BLOCK, triangle


@given(st.lists(st.integers(1, 40), min_size=1, max_size=6), st.integers(1, 8), st.integers(0, 2**32 - 1))
def test_it_has_the_products_of_all_rows_however_they_are_cut(sizes, columns, seed):
    parts = [np.random.default_rng((seed, n)).standard_normal((n, columns)) for n in sizes]
    R, rows = triangle(parts), np.concatenate(parts)
    assert R.shape == (columns, columns)
    assert np.array_equal(R, np.triu(R))
    assert np.all(np.diag(R) >= 0)
    assert np.allclose(R.T @ R, rows.T @ rows, rtol=0, atol=1e-12 * np.sum(rows**2))


def test_one_block_or_many_are_the_same_to_rounding():
    rows = np.random.default_rng(1).standard_normal((3 * BLOCK + 7, 4))
    whole = np.linalg.qr(rows, mode="r")
    assert triangle([rows]) == pytest.approx(np.sign(np.diag(whole))[:, None] * whole, rel=1e-12, abs=1e-10)


@pytest.mark.parametrize("ratio", [1e-4, 1e-7, 1e-10])
def test_it_keeps_directions_that_the_normal_equations_lose(ratio):
    # columns that differ by a part of 1e-10: in J'J that part, squared, is below the rounding of 1
    base, other = np.random.default_rng(2).standard_normal((2, 100_000))
    rows = np.column_stack([base, base + ratio * other])
    smallest = np.linalg.svd(triangle([rows]), compute_uv=False)[-1]
    assert smallest == pytest.approx(np.linalg.svd(rows, compute_uv=False)[-1], rel=1e-5)
    assert smallest == pytest.approx(ratio * np.sqrt(1e5 / 2), rel=0.02)
