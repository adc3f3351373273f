"""Drawn search candidates."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printctl.errors import PrintctlError, RecipeError
from printctl.search import load_search
from printctl.search.candidates import Candidate, draw_candidates, drawn
from printctl.search.model import SearchFile
from printctl.search.quantities import QUANTITIES
from printctl.search.rank import RankedCandidate, pareto_fronts, ranked
from printctl.search.workers import Workers
from tests.printctl.search.small import BASE, SEARCH, run, write


def search(vary: dict[str, Any], **more: Any) -> SearchFile:
    return SearchFile.model_validate(SEARCH | {"vary": vary} | more)


def column(rows: list[dict[str, Any]], key: str) -> list[Any]:
    return [row[key] for row in rows]


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


# --- ranking of search candidates, against a slow oracle
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


# --- search file errors and their messages
RANGE = {"from": 1, "to": 2}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"draws": "grid"}, r"draws: .*remove it or mend its spelling"),
        ({"draw": "halton"}, r"draw: .*'sobol'.*is 'halton'"),
        ({"count": 5}, "a grid has as many as its values make; leave count out"),
        ({"draw": "sobol"}, "sobol needs to know how many; add count"),
        ({"vary": {"seed": RANGE}}, r"vary\.seed: a grid takes steps"),
        ({"draw": "random", "count": 3, "vary": {"seed": RANGE | {"steps": 3}}}, "a grid's"),
        ({"vary": {"seed": {"from": 2, "to": 1}}}, r"vary\.seed: from 2 isn't below to 1; swap"),
        ({"vary": {"seed": {"from": 1}}}, r"vary\.seed\.to: is missing.*add it"),
        ({"vary": {"seed": 3}}, r"vary\.seed: give a list of values, or a range"),
        ({"vary": {"seed": []}}, r"vary\.seed: .*at least 1"),
        ({"vary": {"seed": {"from": 0, "to": 1, "steps": 3, "log": True}}}, "above 0 only"),
        ({"vary": {"seed": {"from": 0.5, "to": 1, "steps": 3, "whole": True}}}, "whole numbers"),
        ({"vary": {"print_scale": [float("nan")]}}, "isn't finite"),
        ({"vary": {}}, r"vary: .*at least 1"),
        ({"objectives": {"speed": "minimise"}}, "speed isn't measured; choose from flow_spread"),
        ({"objectives": {"volume_mm3": {"at_most": 1}}}, "limits alone; minimise or maximise"),
        ({"objectives": {"volume_mm3": {}}}, r"objectives\.volume_mm3: asks for nothing"),
        ({"objectives": {"volume_mm3": "less"}}, r"objectives\.volume_mm3\.goal: .*is 'less'"),
        ({"objectives": {"volume_mm3": {"at_most": 1, "weight": 2}}}, "weight without a goal"),
        ({"objectives": {"volume_mm3": {"at_most": 1, "at_least": 2}}}, "at_least 2 is above"),
        ({"samples": 3}, "samples: .*100"),
    ],
)  # fmt: skip
def test_a_wrong_file_is_refused_with_key_and_remedy(
    tmp_path: Path, changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(RecipeError, match=words) as told:
        load_search(write(tmp_path, SEARCH | changes))
    assert "search.yaml can't be used" in str(told.value)


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        ({"toolpath.write_speed_mm_s": [1]}, "isn't among what can be varied; a search varies"),
        ({"vasculature": [1]}, "isn't among what can be varied"),
        ({"vasculature.terminal": [1]}, r"vary \(terminal 1\).*\n.*vasculature\.terminal: "),
        ({"vasculature.murray_exponent": [3, 9]}, r"\(murray exponent 9\)(.|\n)*is 9"),
        ({"vasculature.terminals.more": [1]}, "goes into terminals, which holds no keys"),
    ],
)
def test_what_the_recipe_refuses_is_refused_before_anything_is_grown(
    tmp_path: Path, vary: dict[str, Any], words: str
) -> None:
    search = load_search(write(tmp_path, SEARCH | {"vary": vary}))
    with pytest.raises(RecipeError, match=words):
        draw_candidates(search, tmp_path)


def test_a_recipe_of_a_plate_and_one_that_isn_t_there_are_refused(tmp_path: Path) -> None:
    plate = BASE | {"plate": {"profile": "corning_24"}}
    path = write(tmp_path, SEARCH, plate)
    with pytest.raises(RecipeError, match="prints on a plate"):
        run(path, tmp_path / "out")
    (tmp_path / "base.yaml").unlink()
    with pytest.raises(RecipeError, match=r"recipe .*base.yaml doesn't exist; check the path"):
        run(path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_scheduler_that_doesn_t_answer_is_told(tmp_path: Path) -> None:
    path = write(tmp_path, SEARCH)
    with pytest.raises(
        PrintctlError, match=r"no Dask scheduler .* within 0.003 min \(--wait-min\)"
    ):
        run(path, tmp_path / "out", Workers(None, "tcp://127.0.0.1:9", 0.003))
