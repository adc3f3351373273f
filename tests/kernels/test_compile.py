"""Compiler flags of the kernels."""

import numpy as np

from kernels import jit


@jit
def _ratio(a: float, b: float) -> float:
    return a / b


def test_nan_and_infinity_keep_their_meaning() -> None:
    assert np.isinf(_ratio(1.0, 0.0))
    assert np.isnan(_ratio(0.0, 0.0))
    assert np.isnan(_ratio(np.nan, 1.0))


@jit
def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.dot(a, b)


def test_matrix_products_work() -> None:
    assert (_product(2 * np.eye(2), np.ones((2, 2))) == 2).all()
