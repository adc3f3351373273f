"""Search file errors and their messages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from printctl.errors import PrintctlError, RecipeError, UsageError
from printctl.search import load_search
from printctl.search.candidates import draw_candidates
from printctl.search.workers import Workers
from tests.printctl.search.small import BASE, SEARCH, run, write

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


def test_without_dask_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(UsageError, match=r"pip install 'printctl\[search\]', or give --workers 0"):
        run(write(tmp_path, SEARCH), tmp_path / "out", Workers(1))
