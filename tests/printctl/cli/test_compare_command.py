"""`printctl compare`, on folders as `run` and `register` leave them."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pypdf import PdfReader

from design.network_files.csv_format import read_network_csv, write_network_csv
from design.solids import write_stl
from printctl.errors import UsageError
from printctl.history import comparing
from printctl.machine.records.journal import encode
from printctl.machine.records.record import JOURNAL
from printctl.pipeline.judging.register_inputs import read_design
from printctl.run_folder.artefacts import JOURNAL_FOLDER, LUMEN, NETWORK, SOLID
from printctl.run_folder.manifest import Manifest
from report import print_page
from tests.printctl.cli.shell import Shell
from tests.printctl.history.records.prints import GCODE, printed, with_run
from tests.printctl.web.shell.browsers import CHROMIUM
from tests.registration.measuring.geometry.shapes import construct, network

DRAWN_FOR = ("test_a_run_and", "test_a_pdf_on", "test_a_gauge_study")
"""Tests that look at drawings."""
DESIGN = "a" * 64
DESIGNED_UM = (400.0, 500.0, 600.0)


@pytest.fixture
def compare(shell: Shell) -> Shell:
    return shell.of("compare")


@pytest.fixture(autouse=True)
def _not_drawn(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if not request.node.name.startswith(DRAWN_FOR):
        monkeypatch.setattr(comparing, "comparison_figures", lambda _: {})


def registration(errors_um: tuple[float, ...], design: str = DESIGN) -> dict[str, Any]:
    """A registration's numbers, with those errors of the three diameters."""
    vessels = [
        {"vessel": v, "kind": "channel", "designed_um": d, "measured_um": d + e,
         "error_percent": 100 * e / d, "length_mm": 5.0, "open": True, "along_mm": [1.0, 2.0, 3.0],
         "diameter_um": [d + e] * 3, "unseen_mm": [], "unmeasured_mm": [], "noise_um": [0.1] * 3,
         "interval_95_um": [0.2] * 3, "designed_along_um": [d] * 3,
         "place_mm": [[1.0, v, 0.0], [2.0, v, 0.0], [3.0, v, 0.0]]}
        for v, (d, e) in enumerate(zip(DESIGNED_UM, errors_um, strict=True))
    ]  # fmt: skip
    return {
        "rigid": {"rms_um": 30.0}, "scaled": {"rms_um": 12.0}, "scale": [0.99, 0.99, 1.0],
        "offset_um": -5.0, "interval_95": {"scale": [0.001, 0.001, None], "offset_um": 1.0},
        "ambiguity": {"margin": 9.0, "flag": False}, "vessels": vessels, "defects": [],
        "design": {"network_sha256": design},
    }  # fmt: skip


def run_folder(name: str, errors_um: tuple[float, ...], **more: Any) -> Path:
    """What `run` leaves: the registration alone, the verdict in report.json."""
    folder = Path(name)
    folder.mkdir()
    (folder / "registration.json").write_text(json.dumps(registration(errors_um, **more)))
    verdict = {"passed": True, "reasons": ["All 3 vessels are open"]}
    (folder / "report.json").write_text(json.dumps({"verdict": verdict}))
    return folder


def registered_folder(name: str, errors_um: tuple[float, ...], printed: Any = None) -> Path:
    """What `register` leaves: all in registration.json."""
    folder = Path(name)
    folder.mkdir()
    whole = {
        "verdict": {"passed": False, "reasons": ["Largest diameter error"]},
        "printed": printed,
        "registration": registration(errors_um),
    }
    (folder / "registration.json").write_text(json.dumps(whole))
    return folder


def journal(folder: Path, started: float) -> None:
    (folder / JOURNAL_FOLDER).mkdir(parents=True, exist_ok=True)
    job = {"t": "job", "started": started, "pid": 7, "host": "bench", "sha256": "b" * 64,
           "path": "/part.gcode", "name": "part.gcode", "lines": 3}  # fmt: skip
    (folder / JOURNAL_FOLDER / JOURNAL).write_bytes(encode(job))


def test_a_run_and_a_registration_are_compared(compare: Shell) -> None:
    run_folder("a", (-8.0, -10.0, -12.0))
    registered_folder("b", (-12.0, -14.0, -16.0))
    found = compare.json("a", "b", "--out", "c")
    assert found == json.loads(Path("c/compare.json").read_text())
    assert found["verdict"]["passed"] is False
    assert found["verdict"]["reasons"][0].startswith("1 of 2 prints pass; failed: b")
    rows = list(csv.DictReader(Path("c/compare.csv").read_text().splitlines()))
    # Means of −8 and −12, and so on; two values differ by √2 times their standard deviation.
    means = [float(row["mean_error_um"]) for row in rows]
    assert means == pytest.approx([-10.0, -12.0, -14.0])
    assert [float(row["observed_sd_um"]) for row in rows] == pytest.approx([4 / 2**0.5] * 3)
    page = Path("c/compare.html").read_text()
    assert page.count("<svg") == 4
    assert "1 of 2 prints pass" in page


def test_a_journal_tells_the_print_and_its_time(compare: Shell) -> None:
    for name, started in (("a", 3000.0), ("b", 3000.0), ("c", 1000.0)):
        journal(run_folder(name, (1.0, float(ord(name)), 2.0)), started)
    found = compare.json("a", "b", "c", "--out", "o")
    assert any("Taken for scans of one print: a, b." in note for note in found["notes"])
    assert [p["label"] for p in found["prints"]] == ["c", "a"]
    assert [p["started"] for p in found["prints"]] == [1000.0, 3000.0]


def test_limits_given_judge_all_anew(compare: Shell) -> None:
    run_folder("a", (-8.0, -10.0, -12.0))
    run_folder("b", (-8.5, -10.0, -60.0))
    for percent, passes in (("5", 1), ("12", 2), ("1", 0)):
        code, out, _ = compare("a", "b", "--out", "o", "--diameter-tolerance-percent", percent)
        assert code == 0
        assert f"{passes} of 2 prints pass" in out
        assert f"diameters within ±{percent} %" in out


def wrong_folders() -> None:
    run_folder("a", (1.0, 2.0, 3.0))
    run_folder("b", (1.0, 2.0, 4.0))
    run_folder("other", (1.0, 2.0, 3.0), design="c" * 64)
    Path("empty").mkdir()
    for name, text in (
        ("broken", '{"vessels": ['),
        ("list", "[1, 2]"),
        ("nothing", "{}"),
        ("binary", "\x00\x01"),
    ):
        Path(name).mkdir()
        (Path(name) / "registration.json").write_text(text)
    old = registration((1.0, 2.0, 3.0))
    del old["design"]
    half = registration((1.0, 2.0, 3.0))
    del half["vessels"][1]["measured_um"]
    unposed = registration((1.0, 2.0, 3.0))
    del unposed["ambiguity"]
    undefined = registration((1.0, 2.0, 3.0)) | {"defects": [{}]}
    made = (("old", old), ("half", half), ("unposed", unposed), ("undefined", undefined))
    for name, numbers in made:
        Path(name).mkdir()
        (Path(name) / "registration.json").write_text(json.dumps(numbers))


CASES: tuple[tuple[int, str, tuple[str, ...]], ...] = (
    (1, "a", ("two registrations or more",)),
    (1, "a other", ("2 different designs", "aaaaaaaaaaaa: a", "cccccccccccc: other")),
    (2, "a a", ("a is named twice",)),
    (2, "a ./a", ("named twice",)),
    (2, "a gone", ("gone isn't a folder",)),
    (2, "a empty", ("empty has no registration.json",)),
    (2, "a broken", ("can't be read", "register the scan again")),
    (2, "a binary", ("can't be read", "register the scan again")),
    (2, "a list", ("holds no registration",)),
    (2, "a nothing", ("holds no registration",)),
    (2, "a old", ("doesn't say which design",)),
    (1, "a half", ("half: its registration is broken", "measured_um")),
    (2, "a unposed --tolerance-um 100", ("unposed", "can't be judged anew", "ambiguity")),
    (1, "a undefined", ("undefined: its registration is broken",)),
    (2, "a b --tolerance-um 0", ("--tolerance-um",)),
    (2, "", ("RUN...",)),
)


@pytest.mark.parametrize(("code", "command", "said"), CASES, ids=[c[1] or "none" for c in CASES])
def test_wrong_input_ends_in_one_message(
    compare: Shell, code: int, command: str, said: tuple[str, ...]
) -> None:
    wrong_folders()
    compare.refuses(said, *command.split(), "--out", "o", code=code)
    assert not Path("o").exists()


@pytest.mark.browser
@pytest.mark.skipif(CHROMIUM is None, reason="chromium isn't installed")
def test_a_pdf_on_request(compare: Shell) -> None:
    run_folder("a", (-8.0, -10.0, -12.0))
    registered_folder("b", (-12.0, -14.0, -16.0))
    code, out, _ = compare("a", "b", "--out", "c", "--pdf")
    assert code == 0
    assert out.endswith("c/compare.html\nc/compare.pdf\n")
    text = PdfReader("c/compare.pdf").pages[0].extract_text()
    assert "1 of 2 prints pass; failed: b" in text


def test_a_pdf_without_a_browser_is_refused_before_the_work(
    compare: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(print_page, "find_browser", lambda: None)
    compare.refuses("Chromium, Chrome or Edge", "a", "b", "--out", "d", "--pdf")
    assert not Path("d").exists()


def study_folders(count: int = 12, budget_um: float = 3.0) -> list[str]:
    """Three parts, two operators, two repeats: parts differ by 20 µm, repeats scatter by 3."""
    random = np.random.default_rng(6)
    parts = 20 * random.normal(size=(3, 3))
    names = [f"s{k}" for k in range(count)]
    for k, name in enumerate(names):
        errors = parts[k % 3] + 2 * (k // 6) + 3 * random.normal(size=3)
        folder = registered_folder(name, tuple(errors))
        whole = json.loads((folder / "registration.json").read_text())
        for row in whole["registration"]["vessels"]:
            row["offset_um"] = 5 + float(random.normal())
            row["lower_um"], row["upper_um"] = [row["designed_um"] - 50], [row["designed_um"] + 50]
            row["budget"] = [
                {"term": "speckle", "type": "A", "standard": budget_um},
                {"term": "walls", "type": "B", "standard": 17.0},
            ]
        whole["registration"]["record"] = {"operator": "AB"[k // 6], "part": f"P{k % 3}"}
        (folder / "registration.json").write_text(json.dumps(whole))
    return names


def test_a_gauge_study_is_read_from_the_records(compare: Shell) -> None:
    names = study_folders()
    study = compare.json(*names, "--repeatability", "--out", "c")["gauge"]
    assert (study["operators"], study["parts"]) == (["A", "B"], ["P0", "P1", "P2"])
    assert study["repeats"] == [[2, 2, 2], [2, 2, 2]]
    pooled = study["quantities"][0]
    assert pooled["name"] == "diameters"
    repeated = pooled["sources"]["EV"]
    assert repeated["sd"]["low"] < 3.0 < repeated["sd"]["high"]
    assert repeated["of_tolerance"]["value"] == pytest.approx(6 * repeated["sd"]["value"])
    assert [q["name"] for q in study["quantities"][1:3]] == ["offsets", "radial_offset"]
    whole = study["claims"][0]
    assert (whole["name"], whole["verdict"]) == ("all vessels", "agrees")
    assert any("the budget claims 3 µm, repeats scatter by" in s for s in study["sentences"])
    rows = list(csv.DictReader(Path("c/gauge.csv").read_text().splitlines()))
    assert {row["source"] for row in rows} == {"EV", "AV", "INT", "GRR", "PV", "TV"}
    page = Path("c/compare.html").read_text(encoding="utf-8")
    assert "Gauge study: repeatability and reproducibility" in page
    assert 'id="gauge"' in page
    assert "Budget against repeats" in page


def test_a_budget_that_claims_too_little_is_named(compare: Shell) -> None:
    names = study_folders(budget_um=0.5)
    claims = compare.json(*names, "--repeatability", "--out", "c")["gauge"]["claims"]
    assert {c["verdict"] for c in claims if not c["name"].startswith("vessel")} == {"too small"}


def test_a_study_that_isnt_crossed_is_refused_by_name(compare: Shell) -> None:
    names = study_folders()
    parts = "1,2,3,1,2,3,1,2,2,1,2,2"
    words = (*names, "--parts", parts, "--out", "c")
    compare.refuses("B has no scan of part 3", *words, "--repeatability", code=1)
    compare.refuses("add --repeatability", *words)


# --- `printctl history`: list, show, csv, bundle, verify, key, repeat
@pytest.fixture
def run(shell: Shell, tmp_path: Path) -> Shell:
    shell.monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))
    return shell.of("history")


@pytest.fixture
def entry(run, tmp_path):
    return printed(tmp_path / "run", who="=ada")


def test_list_narrows_and_refuses_what_there_is_not(run, entry, tmp_path):
    printed(tmp_path / "two", "liver.gcode", started=1.5e9, end="killed")
    code, out, _ = run("list", "--state", "killed", "--since", "2017-01-01")
    assert code == 0
    assert "liver.gcode" in out
    assert "part.gcode" not in out
    prints = run.json("list", "--until", "2002-01-01")["prints"]
    assert [one["file"] for one in prints] == ["part.gcode"]
    run.refuses("--state 'fine'", "list", "--state", "fine")
    run.refuses("2026-11-21", "list", "--since", "yesterday")


def test_csv_is_safe_to_open_by_both_ways(run, entry):
    for words in (("--csv",), ("csv",), ("list", "--csv")):
        code, out, _ = run(*words)
        assert code == 0
        assert "'=ada" in out


def test_show_tells_what_happened_and_what_there_is(run, entry, tmp_path):
    with_run(tmp_path / "run")
    code, out, _ = run("show", entry.id[:12])
    assert code == 0
    assert "verdict  pass" in out
    assert "alarm      the printer says 'cold'" in out
    assert run.json("show", entry.id)["verdict"]["passed"] is True
    assert run("show", "nobody")[0] == 1


def test_bundle_is_made_verified_and_found_out_when_changed(run, entry, tmp_path):
    assert run("bundle", entry.id, "--out", "a.zip")[0] == 0
    code, out, _ = run("verify", "a.zip")
    assert code == 0
    assert "WHOLE" in out
    assert "trusted key" in out
    assert run("key", "--out", "lab.pem")[0] == 0
    assert run("verify", "a.zip", "--key", "lab.pem")[0] == 0
    data = bytearray(Path("a.zip").read_bytes())
    data[data.index(b"a comment")] ^= 1
    Path("a.zip").write_bytes(data)
    code, out, _ = run("verify", "a.zip")
    assert code == 1
    assert "job.gcode: changed" in out


def test_verify_of_what_is_no_bundle_or_is_not_there_is_one_message(run, tmp_path):
    (tmp_path / "no.zip").write_bytes(b"no")
    code, out, _ = run("verify", "no.zip", "--json")
    assert (code, json.loads(out)["whole"]) == (1, False)
    run.refuses("check the path", "verify", "absent.zip", code=1)


def test_repeat_makes_a_job_or_only_looks(run, entry, tmp_path):
    code, out, _ = run("repeat", entry.id, "--check")
    assert code == 0
    assert "nothing known differs" in out
    assert not (tmp_path / "jobs").exists()
    code, out, _ = run("repeat", entry.id)
    assert (tmp_path / "jobs" / "part_again_1.gcode").read_bytes() == GCODE
    assert "nothing was started" in out


def test_repeat_of_a_bundle_that_another_machine_made(run, entry, tmp_path, monkeypatch):
    assert run("bundle", entry.id, "--out", "a.zip")[0] == 0
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "elsewhere"))
    (tmp_path / "run" / "part.gcode").unlink()
    assert Path(run.json("repeat", "--bundle", "a.zip")["job"]).read_bytes() == GCODE
    assert run("repeat")[0] == 2


# --- `printctl register --datums` and `--tolerance`: wrong values reported before any scan is read
@pytest.mark.parametrize(
    ("option", "text", "said"),
    [
        ("--datums", "", "--datums is empty"),
        ("--datums", " , ", "--datums is empty"),
        ("--datums", "face up", "'face up' isn't known"),
        ("--datums", "face -z, face -z", "is given twice"),
        ("--datums", "face -z, axis 7", "the design has vessels 0 to 2"),
        ("--datums", "face -z, outlet 9", "no such mouth in the design"),
        (
            "--tolerance",
            "vessels: [{vessels: [9], open: false}]",
            "vessel 9 isn't in the network (it",
        ),
        (
            "--tolerance",
            "vessels: [{kinds: [vein], open: false}]",
            "no vessel of the network is of kind 'vein'",
        ),
    ],
)
def test_what_the_design_hasnt_is_wrong_use_and_no_scan_is_read(
    shell: Shell, option: str, text: str, said: str
) -> None:
    write_stl(Path("part.stl"), construct())
    write_network_csv(Path("network.csv"), network())
    # A file that is no scan: reading it would be refused in other words.
    Path("scan.tif").write_bytes(b"no scan")
    if option == "--tolerance":
        Path("tolerances.yaml").write_text(text)
        text = "tolerances.yaml"
    words = ("scan.tif", "--model", "part.stl", "--out", "out", option, text)
    shell.refuses(said, "register", *words)


# --- `printctl register --model RUN`: holds a scan against what the run's print leaves to be seen
@pytest.mark.parametrize(
    ("method", "lumens", "whole"),
    [
        ("embedded", None, False),
        ("fresh", None, True),
        (None, None, True),
        ("embedded", False, True),
        ("fresh", True, False),
    ],
)
def test_of_an_embedded_print_the_lumens_are_scanned(
    tmp_path: Path, method: str | None, lumens: bool | None, whole: bool
) -> None:
    part, inside = construct(), construct()
    inside = type(inside)(inside.vertices / 2, inside.faces)
    write_stl(tmp_path / SOLID, part)
    write_stl(tmp_path / LUMEN, inside)
    write_network_csv(tmp_path / NETWORK, network())
    if method is not None:
        Manifest(tmp_path, {"recipe": {"toolpath": {"method": method}}}).save()
    surface = read_design(tmp_path, None, lumens, "mm", None, tmp_path, print).surface
    wanted = part if whole else inside
    assert surface.vertices.max() == pytest.approx(wanted.vertices.max(), abs=1e-3)


def test_lumens_of_an_stl_without_a_network_are_found_and_kept(tmp_path: Path) -> None:
    said: list[str] = []
    model = tmp_path / "models" / "part.stl"
    model.parent.mkdir()
    write_stl(model, construct())
    out = tmp_path / "report"
    design = read_design(model, None, None, "mm", None, out, said.append)
    assert design.vessels.vessel_count == network().vessel_count
    assert sorted(design.vessels.mean_radius()) == pytest.approx(
        sorted(network().mean_radius()), rel=0.03
    )
    assert design.network == out / NETWORK
    assert read_network_csv(out / NETWORK, unit="mm").vessel_count == network().vessel_count
    assert "lumens were found in the model" in said[0]
    with pytest.raises(UsageError, match="no network at"):
        read_design(model, tmp_path / "none.csv", None, "mm", None, out, said.append)
