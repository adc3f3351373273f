"""Test parameters: the first few in CI, the rest by `make test-slow`."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

import pytest


def first_of(values: Iterable[Any], keep: int = 1) -> list[Any]:
    """The same values, all but the first ``keep`` marked slow."""
    return [
        value if k < keep else pytest.param(value, marks=pytest.mark.slow)
        for k, value in enumerate(values)
    ]


def first_rows(rows: Iterable[tuple[Any, ...]], keep: int = 1) -> list[Any]:
    """Return rows of several parameters, all but the first ``keep`` marked slow."""
    return [
        row if k < keep else pytest.param(*row, marks=pytest.mark.slow)
        for k, row in enumerate(rows)
    ]


def examples(most: int) -> int:
    """How many examples hypothesis tries: a tenth of the most but ten, all by `make test-slow`."""
    return most if "PRINTCTL_NIGHTLY" in os.environ else max(most // 10, min(most, 10))
