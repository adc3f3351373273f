"""Ranking of search candidates, against a slow oracle."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printctl.search.candidates import Candidate
from printctl.search.model import SearchFile
from printctl.search.quantities import QUANTITIES
from printctl.search.rank import RankedCandidate, pareto_fronts, ranked
from tests.printctl.search.small import SEARCH


class Named:
    """Stands for a candidate: nothing of it but its number and key is looked at."""

    def __init__(self, number: int) -> None:
        self.number, self.key = number, str(number)


def order(
    objectives: dict[str, Any], *results: dict[str, float | None] | str
) -> list[RankedCandidate]:
    """Rank; a result is what was measured, or why it was refused."""
    search = SearchFile.model_validate(SEARCH | {"objectives": objectives})
    rows: list[tuple[Candidate, dict[str, Any]]] = []
    for number, result in enumerate(results, 1):
        told: dict[str, Any] = (
            {"refused": result}
            if isinstance(result, str)
            else {"numbers": dict.fromkeys(QUANTITIES, 1.0) | result}
        )
        rows.append((cast(Candidate, Named(number)), told))
    return ranked(search, rows)


def numbers(rows: list[RankedCandidate]) -> list[int]:
    return [row.candidate.number for row in rows]


def naive_fronts(losses: list[tuple[int, ...]]) -> list[int]:
    """A row's front is one more than the last of those that beat it."""

    def beats(a: tuple[int, ...], b: tuple[int, ...]) -> bool:
        return a != b and all(x <= y for x, y in zip(a, b, strict=True))

    def front(row: tuple[int, ...]) -> int:
        return 1 + max((front(other) for other in losses if beats(other, row)), default=0)

    return [front(row) for row in losses]


@given(st.lists(st.tuples(*[st.integers(0, 4)] * 3), max_size=14))
def test_fronts_are_those_of_the_slow_oracle(losses: list[tuple[int, ...]]) -> None:
    rows = np.array(losses, dtype=np.float64).reshape(-1, 3)
    assert pareto_fronts(rows).tolist() == naive_fronts(losses)


def test_the_score_is_the_weighted_share_between_best_and_worst() -> None:
    rows = order(
        {"volume_mm3": {"goal": "minimise", "weight": 3}, "terminals": "maximise"},
        {"volume_mm3": 10.0, "terminals": 5.0},
        {"volume_mm3": 20.0, "terminals": 9.0},
        {"volume_mm3": 12.5, "terminals": 7.0},
    )
    assert numbers(rows) == [1, 3, 2]
    assert [row.score for row in rows] == pytest.approx(
        [(3 * 0 + 1) / 4, (3 * 0.25 + 0.5) / 4, (3 * 1 + 0) / 4]
    )
    assert [row.front for row in rows] == [1, 1, 1]
    assert [row.rank for row in rows] == [1, 2, 3]


def test_limits_come_before_scores_and_what_can_t_be_judged_last() -> None:
    rows = order(
        {"volume_mm3": "minimise", "pressure_drop_mmhg": {"at_most": 10, "at_least": 1}},
        "no room for a trunk",
        {"volume_mm3": None},
        {"volume_mm3": 1.0, "pressure_drop_mmhg": 30.0},
        {"volume_mm3": 1.0, "pressure_drop_mmhg": 0.5},
        {"volume_mm3": 9.0, "pressure_drop_mmhg": 10.0},
        {"volume_mm3": 8.0, "pressure_drop_mmhg": 1.0},
    )
    assert numbers(rows) == [6, 5, 4, 3, 2, 1]
    assert [row.state for row in rows] == [
        "good", "good", "beyond limits", "beyond limits", "undefined", "refused",
    ]  # fmt: skip
    assert rows[3].said == "pressure_drop_mmhg 30"
    assert rows[4].said == "volume_mm3 has no meaning here"
    assert rows[5].said == "no room for a trunk"
    assert rows[3].score is rows[3].front is None
