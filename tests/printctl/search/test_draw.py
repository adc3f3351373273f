"""Drawn search candidates."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from printctl.errors import RecipeError
from printctl.search.candidates import drawn
from printctl.search.model import SearchFile
from tests.printctl.search.small import SEARCH


def search(vary: dict[str, Any], **more: Any) -> SearchFile:
    return SearchFile.model_validate(SEARCH | {"vary": vary} | more)


def column(rows: list[dict[str, Any]], key: str) -> list[Any]:
    return [row[key] for row in rows]


def test_a_grid_takes_every_value_with_every_other_the_last_key_fastest() -> None:
    rows = drawn(search({"seed": [1, 2], "print_scale": {"from": 1, "to": 2, "steps": 3}}))
    assert [tuple(row.values()) for row in rows] == [
        (1, 1.0), (1, 1.5), (1, 2.0), (2, 1.0), (2, 1.5), (2, 2.0),
    ]  # fmt: skip


def test_steps_of_whole_numbers_and_of_powers() -> None:
    rows = drawn(search({"seed": {"from": 1, "to": 100, "steps": 3, "log": True, "whole": True}}))
    assert column(rows, "seed") == [1, 10, 100]
    assert all(isinstance(value, int) for value in column(rows, "seed"))


def test_a_latin_hypercube_draws_once_from_each_nth_of_every_range() -> None:
    vary = {"a": {"from": 0, "to": 10}, "b": {"from": 1, "to": 1000, "log": True}}
    rows = drawn(search(vary, draw="latin_hypercube", count=20))
    parts = np.array(column(rows, "a")) / 10, np.log10(column(rows, "b")) / 3
    for share in parts:
        assert sorted((share * 20).astype(int).tolist()) == list(range(20))


def test_sobol_points_halve_every_range_evenly_and_any_count_may_be_asked_for() -> None:
    vary = {"a": {"from": 0, "to": 1}, "b": {"from": 0, "to": 1}}
    rows = drawn(search(vary, draw="sobol", count=16))
    cells = {(int(4 * row["a"]), int(4 * row["b"])) for row in rows}
    assert len(cells) == 16  # a (0, 4, 2)-net in base 2 has one point in each
    assert len(drawn(search(vary, draw="sobol", count=11))) == 11


@pytest.mark.parametrize("draw", ["random", "sobol", "latin_hypercube"])
def test_the_same_seed_draws_the_same_and_another_another(draw: str) -> None:
    vary = {"a": {"from": 0, "to": 1}, "b": ["x", "y", "z"]}

    def rows(seed: int) -> list[dict[str, Any]]:
        return drawn(search(vary, draw=draw, count=8, seed=seed))

    assert rows(1) == rows(1)
    assert rows(1) != rows(2)
    assert set(column(rows(1), "b")) <= {"x", "y", "z"}


def test_whole_numbers_come_all_as_often_the_ends_too() -> None:
    rows = drawn(search(
        {"n": {"from": 1, "to": 4, "whole": True}, "a": {"from": 0, "to": 1}},
        draw="latin_hypercube", count=400,
    ))  # fmt: skip
    assert np.bincount(column(rows, "n")).tolist() == [0, 100, 100, 100, 100]


def test_what_is_drawn_twice_counts_once() -> None:
    assert len(drawn(search({"seed": [1, 2]}, draw="random", count=50))) == 2


def test_a_grid_of_too_many_is_refused() -> None:
    axis = {"from": 0, "to": 1, "steps": 1000}
    with pytest.raises(RecipeError, match=r"1,000,000 candidates, 100,000 at most; vary less"):
        drawn(search({"a": axis, "b": axis}))
