"""Complete searches: stored, resumed, best candidate as a recipe."""

from __future__ import annotations

import csv
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import yaml
from distributed import LocalCluster
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from printctl.errors import PrintctlError, RecipeError
from printctl.pipeline.context import RunContext
from printctl.pipeline.running.run_stages import run_stages
from printctl.pipeline.stages import measures
from printctl.pipeline.stages.design import tissue, vasculature
from printctl.pipeline.stages.perfusion import flow
from printctl.progress import StageBars
from printctl.recipe import load_recipe
from printctl.run_folder.manifest import Manifest
from printctl.search import SearchResult, evaluate, load_search, run_search
from printctl.search.candidates import Candidate, draw_candidates, drawn
from printctl.search.evaluate import WorkerError
from printctl.search.model import SearchFile
from printctl.search.quantities import QUANTITIES
from printctl.search.rank import RankedCandidate, pareto_fronts, ranked
from printctl.search.results import write_results
from printctl.search.workers import Workers
from tests.printctl.cli.shell import Shell

BASE: dict[str, Any] = {
    "schema": 1,
    "name": "base",
    "tissue": {"shape": "block", "size_mm": [6, 5, 4]},
    "vasculature": {"grow": "tree", "terminals": 3, "smallest_diameter_mm": 0.3},
    "toolpath": {"method": "embedded"},
    "printer": {"ink": "gelatin_sacrificial", "bath": "cell_matrix"},
}
SEARCH: dict[str, Any] = {
    "schema": 1,
    "name": "small",
    "recipe": "base.yaml",
    "vary": {"seed": [1, 2], "vasculature.terminals": [3, 5]},
    "objectives": {"distance_p95_mm": "minimise", "volume_mm3": "minimise"},
    "samples": 1000,
}
HERE = Workers(0)
WRITTEN = ("ranked.csv", "pareto.png", "search.html", "best.yaml")


def write(folder: Path, search: dict[str, Any], base: dict[str, Any] = BASE) -> Path:
    """Recipe and search file in ``folder``; the latter's path."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "base.yaml").write_text(yaml.safe_dump(base), encoding="utf-8")
    path = folder / "search.yaml"
    path.write_text(yaml.safe_dump(search, sort_keys=False), encoding="utf-8")
    return path


def run(path: Path, out: Path, workers: Workers = HERE, limit: int | None = None) -> SearchResult:
    """Search, and write all there is for people."""
    console = Console(file=io.StringIO())
    found = run_search(load_search(path), path.parent, out, console, workers, limit)
    write_results(found, out)
    return found


def left_behind(out: Path) -> dict[str, bytes]:
    """What a search wrote for people, as bytes."""
    return {name: (out / name).read_bytes() for name in WRITTEN}


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the small search, and in ``out`` all that came of it."""
    folder = tmp_path_factory.mktemp("done")
    found = run(write(folder, SEARCH), folder / "out")
    assert (found.made, found.kept, found.left) == (4, 0, 0)
    return folder


@pytest.fixture
def folder(done: Path, tmp_path: Path) -> Path:
    """The same, for one test alone."""
    shutil.copytree(done, tmp_path, dirs_exist_ok=True)
    return tmp_path


def rows(out: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((out / "ranked.csv").read_text(encoding="utf-8").splitlines()))


def test_a_search_ranks_all_and_leaves_table_plot_page_and_recipe(done: Path) -> None:
    out = done / "out"
    table = rows(out)
    assert [row["rank"] for row in table] == list("1234")
    scores = [float(row["score"]) for row in table]
    assert scores == sorted(scores)
    assert {row["state"] for row in table} == {"good"}
    assert [float(row["vasculature.terminals"]) for row in table] == [
        float(row["terminals"]) for row in table
    ]
    best = yaml.safe_load((out / "best.yaml").read_text(encoding="utf-8"))
    assert str(best["seed"]) == table[0]["seed"]
    assert (out / "pareto.png").read_bytes().startswith(b"\x89PNG")
    page = (out / "search.html").read_text(encoding="utf-8")
    assert page.count('<th scope="row"') == 4


def test_it_goes_on_where_it_was_and_ends_as_if_never_stopped(done: Path, folder: Path) -> None:
    path, out = folder / "search.yaml", folder / "out"
    lost, torn, *kept = sorted((out / "candidates").iterdir())
    before = [(file, file.stat().st_ino) for file in kept]
    lost.unlink()
    torn.write_text(torn.read_text(encoding="utf-8")[:40], encoding="utf-8")
    first = run(path, out, limit=1)
    assert (first.made, first.kept, first.left) == (1, 2, 1)
    again = run(path, out)
    assert (again.made, again.kept, again.left) == (1, 3, 0)
    assert [(file, file.stat().st_ino) for file in kept] == before
    assert left_behind(out) == left_behind(done / "out")


def test_other_goals_rank_what_is_known_anew(folder: Path) -> None:
    out = folder / "out"
    other = {"objectives": {"terminals": "maximise", "volume_mm3": {"at_most": 0.001}}}
    found = run(write(folder, SEARCH | other), out)
    assert (found.made, found.kept) == (0, 4)
    assert found.best is None
    assert not (out / "best.yaml").exists()


def test_a_candidate_that_can_t_grow_is_recorded_with_its_message(tmp_path: Path) -> None:
    vary = {"vasculature.smallest_diameter_mm": [0.3, 3.5]}
    path, out = write(tmp_path, SEARCH | {"vary": vary}), tmp_path / "out"
    assert run(path, out).made == 2
    last = rows(out)[-1]
    assert (last["state"], last["vasculature.smallest_diameter_mm"]) == ("refused", "3.5")
    assert len(last["said"]) > 20
    assert run(path, out).kept == 2


def test_what_breaks_is_told_not_recorded_and_tried_again(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, out = folder / "search.yaml", folder / "out"
    vary = {"vary": {"seed": [1, 2, 3], "vasculature.terminals": [3, 5]}}
    write(folder, SEARCH | vary)
    make = vasculature.make_network

    def breaking(context: RunContext) -> Any:
        if context.recipe.seed == 3:
            raise MemoryError("none left")
        return make(context)

    with monkeypatch.context() as broken:
        broken.setattr(vasculature, "make_network", breaking)
        found = run(path, out)
    assert found.broken == {5: "MemoryError: none left", 6: "MemoryError: none left"}
    assert (found.made, found.kept, found.left) == (0, 4, 2)
    again = run(path, out)
    assert (again.made, again.kept, again.broken) == (2, 4, {})


def test_the_best_recipe_runs_to_the_very_numbers_of_the_search(tmp_path: Path) -> None:
    """Through the stages of `printctl run`, from another folder than the user's files are in."""
    (tmp_path / "given").mkdir()
    points = "x_mm,y_mm,z_mm\n1.5,1.2,1.4\n4.3,1.4,2.9\n4.8,3.5,1.8\n"
    (tmp_path / "given" / "ends.csv").write_text(points, encoding="utf-8")
    grown = {"grow": "tree", "terminal_points": "ends.csv", "smallest_diameter_mm": 0.3}
    base = BASE | {"vasculature": grown, "print_scale": 1.3}
    base["flow"] = {"shear_band_dyn_cm2": [0.5, 4.0], "viscosity_mpa_s": 1.0}
    vary = {"seed": [2], "vasculature.murray_exponent": [2.71]}
    search = SEARCH | {"vary": vary, "samples": 200_000}
    out = tmp_path / "elsewhere" / "out"
    found = run(write(tmp_path / "given", search, base), out)
    assert found.best is not None
    recipe, folder = load_recipe(out / "best.yaml"), tmp_path / "run"
    folder.mkdir()
    bars = StageBars(Console(file=io.StringIO()))
    context = RunContext(recipe, out, folder, Manifest(folder), bars)
    stages = (tissue.STAGE, vasculature.STAGE, flow.STAGE, measures.STAGE)
    run_stages(context, stages, bars)
    told = json.loads((folder / "measures.json").read_text(encoding="utf-8"))
    driven = context.manifest.stages["flow"].summary
    numbers = found.best.numbers
    assert numbers["distance_p95_mm"] == told["supply"]["distance_p95_mm"]
    assert numbers["volume_mm3"] == told["volume_mm3"]
    assert numbers["supply_over_demand_p5"] == told["territories"]["p5"]
    inside = 100 * driven["shear_band"]["area_inside"]
    assert numbers["wall_shear_outside_percent"] == pytest.approx(100 - inside, abs=1e-9)
    assert 0 < inside < 100
    for key in ("pressure_drop_mmhg", "wall_shear_max_pa", "dissipated_uw"):
        assert numbers[key] == driven[key]


def test_a_worker_with_other_files_or_another_printctl_is_not_believed(tmp_path: Path) -> None:
    path = write(tmp_path, SEARCH)
    task = draw_candidates(load_search(path), tmp_path).candidates[0].task
    with pytest.raises(WorkerError, match="another printctl than the search"):
        evaluate(replace(task, code="other"))
    with pytest.raises(WorkerError, match=r"ends.csv isn't there on the worker"):
        evaluate(replace(task, files={"ends.csv": "0" * 64}))
    with pytest.raises(WorkerError, match="a profile that the recipe names is another"):
        evaluate(replace(task, limits_mm=(0.1, 2.0, 0.3)))


def test_the_command_prints_the_table_and_its_exit_code_tells_the_outcome(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shell = Shell(monkeypatch, capsys, "search", str(folder / "search.yaml"))
    there = ("--out", str(folder / "out"), "--workers", "0")
    code, said, _ = shell(*there)
    assert code == 0
    assert "4 of 4 candidates known (4 from before): 4 good" in said
    code, said, _ = shell(*there, "--json")
    assert code == 0
    assert [row["rank"] for row in json.loads(said)["candidates"]] == [1, 2, 3, 4]
    write(folder, SEARCH | {"objectives": {"volume_mm3": {"goal": "minimise", "at_most": 1e-3}}})
    code, said, _ = shell(*there)
    assert code == 1
    assert "4 beyond limits" in said


# --- search workers: several processes, a cluster, and interruption
LONG = SEARCH | {"vary": {"seed": list(range(1, 13))}}
SHORT = SEARCH | {"vary": {"seed": [1, 2]}}
PATIENCE_S = 120


def alone(folder: Path, search: dict[str, Any]) -> dict[str, bytes]:
    """What a search leaves behind when this process alone has done it."""
    folder.mkdir()
    run(write(folder, search), folder / "out")
    return left_behind(folder / "out")


@pytest.mark.slow
def test_killed_it_loses_what_ran_and_goes_on_to_the_same_end(tmp_path: Path) -> None:
    path, out = write(tmp_path, LONG), tmp_path / "out"
    known = out / "candidates"
    command = [sys.executable, "-m", "printctl", "search", str(path), "--out", str(out)]
    search = subprocess.Popen([*command, "--workers", "1"], stderr=subprocess.DEVNULL)
    _wait_until(lambda: known.is_dir() and any(known.glob("[!.]*.json")), search)
    family = _children(search.pid)
    search.send_signal(signal.SIGKILL)
    search.wait()
    _wait_until(lambda: not any(_lives(process) for process in family))
    kept = {file: file.stat().st_ino for file in known.glob("[!.]*.json")}
    found = run(path, out)
    assert family, "it searched without workers"
    assert found.kept == len(kept) >= 1
    assert found.made == 12 - len(kept) > 0
    assert all(file.stat().st_ino == ino for file, ino in kept.items())
    assert left_behind(out) == alone(tmp_path / "alone", LONG)


def test_a_cluster_by_its_address_finds_the_same(tmp_path: Path) -> None:
    # Threads of this process stand for the cluster: what is asked here is the way there.
    quick = {"n_workers": 2, "threads_per_worker": 1, "processes": False, "protocol": "tcp://"}
    with LocalCluster(**quick, host="127.0.0.1", dashboard_address="127.0.0.1:0") as cluster:
        assert cluster.scheduler_address.startswith("tcp://")
        there = Workers(None, cluster.scheduler_address)
        found = run(write(tmp_path, SHORT), tmp_path / "out", there)
    assert (found.made, found.broken) == (2, {})
    assert left_behind(tmp_path / "out") == alone(tmp_path / "alone", SHORT)


def _wait_until(happened: object, process: subprocess.Popen[bytes] | None = None) -> None:
    assert callable(happened)
    end = time.monotonic() + PATIENCE_S
    while not happened():
        assert process is None or process.poll() is None, "the search ended before it was killed"
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


def _children(parent: int) -> list[int]:
    """All processes that descend from one; Linux."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and _parent(int(entry.name)) == parent:
            found += [int(entry.name), *_children(int(entry.name))]
    return found


def _parent(process: int) -> int | None:
    try:
        stat = Path(f"/proc/{process}/stat").read_text(encoding="utf-8")
    except OSError:
        return None
    return int(stat.rpartition(")")[2].split()[1])


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


# --- drawn search candidates
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
