"""Recipe settings on print supervision reach the link process."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from rich.console import Console

from firmware_profiles import Ink, Needle, Printer, Syringe, load
from printctl.errors import RecipeError, SafetyError
from printctl.machine.link.care import Care
from printctl.machine.printing import Order, usable_mm
from printctl.pipeline.heads import Filled
from printctl.pipeline.run import toolpath_recipe
from printctl.pipeline.stages import printing
from printctl.recipe import Recipe, parse_recipe

ROOT = Path(__file__).parents[3]
GOOD = yaml.safe_load((ROOT / "examples" / "planar_fresh.yaml").read_text())
PRINTER, SYRINGE = load(Printer, "generic_marlin"), load(Syringe, "hamilton_1ml")


def recipe(care: dict[str, Any] | None, **printer: Any) -> Recipe:
    data = deepcopy(GOOD)
    data["printer"] |= printer if care is None else {"care": care, **printer}
    return parse_recipe(data, "test.yaml")


def ordered(
    care: dict[str, Any] | None, folder: Path, monkeypatch: pytest.MonkeyPatch, reloads: list[int]
) -> Order:
    """The order that the print stage gives for a recipe, without printing it."""
    orders: list[Order] = []
    done = SimpleNamespace(state=SimpleNamespace(value="done"), lines_done=1, proved=True)
    client = SimpleNamespace(status=SimpleNamespace(ended=True))
    monkeypatch.setattr(printing, "find_or_start", lambda order, _: orders.append(order) or client)
    monkeypatch.setattr(printing, "follow", lambda client, report, bars: done)
    context: Any = SimpleNamespace(
        recipe=recipe(care, port="simulated"),
        folder=folder,
        printer=PRINTER,
        syringe=SYRINGE,
        loads=(Filled(SYRINGE, load(Ink, "collagen_fresh"), load(Needle, "fresh_150um")),),
        lift_mm=8.0,
        start_mm=np.array([100.0, 100, 20]),
        bars=None,
        printed=False,
        manifest=SimpleNamespace(
            stages={"dry run": SimpleNamespace(summary={"reload_at": reloads})}
        ),
    )
    monkeypatch.setattr(printing, "executed_facts", lambda context: {})
    printing.work(context, lambda share, text="": None)
    return orders[0]


def test_recipe_that_says_nothing_prints_as_the_command_does_by_default(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order = ordered(None, tmp_path, monkeypatch, [])
    assert order.care == Care(syringe="hamilton_1ml", capacity_mm=usable_mm(SYRINGE, PRINTER))
    assert order.retreat.prime_mm == 0


@pytest.mark.parametrize(
    ("key", "value", "field", "expected"),
    [
        ("checkpoint_every_s", 0, "checkpoint_s", 0.0),
        ("checkpoint_every_s", None, "checkpoint_s", None),
        ("deadman_min", 20, "deadman_s", 1200.0),
        ("silent_limit_s", 300, "silent_limit_s", 300.0),
        ("noise_limit", 60, "noise_limit", 60),
    ],
)
def test_each_choice_is_given_on(
    key: str,
    value: Any,
    field: str,
    expected: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    order = ordered({key: value}, tmp_path, monkeypatch, [])
    assert getattr(order.care, field) == expected
    assert getattr(Care(), field) != expected


def test_dead_man_may_stop_the_print(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    order = ordered({"deadman_min": 5, "deadman_stops": True}, tmp_path, monkeypatch, [])
    assert order.care.deadman_stops
    with pytest.raises(RecipeError, match=r"printer\.care.*deadman_min"):
        recipe({"deadman_stops": True})


def test_ink_pushed_after_a_pause_becomes_plunger_travel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order = ordered({"prime_ul": 2.0}, tmp_path, monkeypatch, [])
    assert order.retreat.prime_mm * np.pi * SYRINGE.inner_mm**2 / 4 == pytest.approx(2.0)


def test_changes_that_the_dry_run_planned_are_given_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order = ordered({"reload": True}, tmp_path, monkeypatch, [120, 240])
    assert order.care.reload_at == (120, 240)


@pytest.mark.slow
def test_part_too_big_for_the_plunger_is_refused_or_printed_with_changes(tmp_path: Path) -> None:
    short = PRINTER.model_dump(mode="json", exclude_unset=True) | {"plunger_travel_mm": 10.0}
    (tmp_path / "short.yaml").write_text(yaml.safe_dump(short))
    profile, console = str(tmp_path / "short.yaml"), Console(quiet=True)
    with pytest.raises(SafetyError, match=r"say printer\.care\.reload: true: the syringe is then"):
        toolpath_recipe(recipe({}, profile=profile), tmp_path, tmp_path / "run", console)
    data = toolpath_recipe(
        recipe({"reload": True}, profile=profile), tmp_path, tmp_path / "run", console
    )
    assert len(data["dry_run"]["reload_at"]) >= 2


@pytest.mark.parametrize(
    ("care", "message"),
    [
        ({"checkpoint_every_s": -1}, r"printer\.care\.checkpoint_every_s.*-1"),
        ({"deadman_min": 2000}, r"printer\.care\.deadman_min.*1440.*2000"),
        ({"prime_ul": -0.1}, r"printer\.care\.prime_ul.*-0\.1"),
        ({"deadman": 3}, r"printer\.care\.deadman.*remove it"),
    ],
)
def test_wrong_choice_names_place_value_and_limit(care: dict[str, Any], message: str) -> None:
    with pytest.raises(RecipeError, match=message):
        recipe(care)
