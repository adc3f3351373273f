"""Record bundles: reproducible bytes, every change detected."""

from __future__ import annotations

import hashlib
import io
import json
import os
import stat
import subprocess
import zipfile
from dataclasses import replace
from pathlib import Path
from zlib import crc32

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from printctl.history.bundle import cover_page, write_bundle
from printctl.history.plain_zip import PlainZipWriter, read_members, safe_name
from printctl.history.repeat import entry_of_bundle, make_job, plan_repeat
from printctl.history.signing import BundleError, read_manifest
from printctl.history.table import safe_cell
from printctl.history.verify import Signature, verify_bundle, verify_stream
from printctl.machine.records.folders import film_file
from printctl.machine.records.journal import decode, encode
from printctl.machine.records.lab_key import PRIVATE, KeyTrouble, RecordsError, lab_key
from printctl.machine.records.sealing import check_journal_file
from printctl.pipeline.past.evidence import evidence, keep_earlier
from printctl.pipeline.past.past_print import Alarm, entry_of
from printctl.run_folder.manifest import digest_file
from printctl.version import version
from tests.printctl.history.records.prints import GCODE, printed, with_run
from tests.slower import examples


def filed(tmp_path: Path, signed: bool = True) -> bytes:
    out = tmp_path / "out.zip"
    write_bundle(out, printed(tmp_path / "run"), lab_key() if signed else None)
    return out.read_bytes()


def verified(data: bytes, trusted: bool = True):
    return verify_stream(io.BytesIO(data), [lab_key().public] if trusted else [])


def rewritten(data: bytes, change) -> bytes:
    """The bundle with its files changed by `change` and laid out as printctl lays them out."""
    with zipfile.ZipFile(io.BytesIO(data)) as opened:
        files = {name: opened.read(name) for name in opened.namelist()}
    change(files)
    stream = io.BytesIO()
    writer = PlainZipWriter(stream)
    for name, content in files.items():
        writer.add(name, iter([content]))
    writer.close()
    return stream.getvalue()


def test_bundle_holds_what_there_is_and_any_unzip_program_opens_it(tmp_path):
    with_run_at = tmp_path / "run"
    entry = printed(with_run_at)
    with_run(with_run_at)
    said = {"cells": "hiPSC", "photos": [{"name": "after <b>print.jpg"}]}
    (with_run_at / "print" / "record.json").write_text(json.dumps(said))
    (with_run_at / "print" / "photos").mkdir()
    (with_run_at / "print" / "photos" / "after <b>print.jpg").write_bytes(b"jpeg")
    (with_run_at / "print" / "photos" / "of_the_print_before.jpg").write_bytes(b"jpeg")
    film = film_file(with_run_at / "print", entry.started)
    film.parent.mkdir()
    film.write_bytes(b"webp")
    film.with_name("20200101-000000.webp").write_bytes(b"of an earlier print")
    (with_run_at / "print" / "link.json").write_text('{"token": "secret"}')
    manifest = write_bundle(tmp_path / "out.zip", entry, lab_key())
    with zipfile.ZipFile(tmp_path / "out.zip") as opened:
        assert opened.testzip() is None
        names = set(opened.namelist())
        assert opened.read("job.gcode") == GCODE
        assert json.loads(opened.read("profiles/printer.json"))["firmware"] == "marlin"
        assert b"secret" not in b"".join(map(opened.read, names))
    assert {"journal.log", "recipe.json", "report/report.html", "record.json"} <= names
    assert {"preflight/dry_run.json", "profiles/ink.json", "photos/photo_0001.jpg"} <= names
    assert [name for name in names if "photos" in name] == ["photos/photo_0001.jpg"]
    assert [name for name in names if "timelapse" in name] == [f"timelapse/{film.name}"]
    assert manifest.verdict == "pass"
    assert verify_bundle(tmp_path / "out.zip", [lab_key().public]).good


def test_same_content_gives_the_same_bytes(tmp_path):
    entry = printed(tmp_path / "run")
    for name in ("one.zip", "two.zip"):
        write_bundle(tmp_path / name, entry, lab_key())
        os.utime(tmp_path / "run" / "part.gcode", (1, 1))
    assert (tmp_path / "one.zip").read_bytes() == (tmp_path / "two.zip").read_bytes()


@pytest.mark.parametrize("signed", [True, False])
@settings(max_examples=examples(150), suppress_health_check=list(HealthCheck), deadline=None)
@given(place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_flipped_bit_is_found_wherever_it_is(tmp_path_factory, signed, place, bit):
    data = bytearray(_once(tmp_path_factory, signed))
    data[int(place * len(data))] ^= 1 << bit
    found = verified(bytes(data))
    assert not found.whole
    assert found.changed


_KEPT: dict[bool, bytes] = {}


def _once(tmp_path_factory, signed: bool) -> bytes:
    if signed not in _KEPT:
        _KEPT[signed] = filed(tmp_path_factory.mktemp("filed"), signed)
    return _KEPT[signed]


def test_every_byte_of_the_zips_own_structure_counts(tmp_path):
    data = filed(tmp_path)
    contents = set()
    for member in read_members(io.BytesIO(data)):
        contents.update(range(member.data_start, member.data_start + member.size))
    for place in set(range(len(data))) - contents:
        flipped = bytearray(data)
        flipped[place] ^= 0x01
        assert not verified(bytes(flipped)).whole, place


def test_manifest_changed_with_its_file_is_betrayed_by_the_signature(tmp_path):
    def change(files):
        manifest = json.loads(files["manifest.json"])
        manifest["print"]["state"] = "stopped"
        files["manifest.json"] = read_manifest(json.dumps(manifest).encode()).to_bytes()

    found = verified(rewritten(filed(tmp_path), change))
    assert found.signature is Signature.WRONG
    assert not found.whole


def test_signature_taken_away_leaves_no_signed_bundle(tmp_path):
    found = verified(rewritten(filed(tmp_path), lambda files: files.pop("manifest.sig")))
    assert not found.good
    assert not found.whole


def test_signature_of_another_key_is_told_and_not_trusted(tmp_path):
    data, other = filed(tmp_path), lab_key(tmp_path / "other")
    found = verify_stream(io.BytesIO(data), [other.public])
    assert (found.whole, found.signature, found.good) == (True, Signature.UNKNOWN, False)
    assert found.fingerprint == lab_key().public.fingerprint
    assert "ISN'T KNOWN HERE" in " ".join(found.lines())


def test_openssl_agrees_with_the_signature(tmp_path):
    (tmp_path / "out").mkdir()
    with zipfile.ZipFile(io.BytesIO(filed(tmp_path))) as opened:
        for name in ("manifest.json", "manifest.sig", "public_key.pem"):
            (tmp_path / "out" / name).write_bytes(opened.read(name))
    command = "openssl pkeyutl -verify -pubin -inkey public_key.pem -rawin -in manifest.json"
    try:
        result = subprocess.run(
            [*command.split(), "-sigfile", "manifest.sig"],
            cwd=tmp_path / "out",
            capture_output=True,
            check=False,
        )
    except FileNotFoundError:
        pytest.skip("no openssl here")
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize(
    "name",
    [
        "../x",
        "/etc/passwd",
        "a/../b",
        "C:\\x",
        "a\\b",
        "",
        "a//b",
        "a/",
        "x.",
        "a\0b",
        "ü",
        ".ssh/a",
    ],
)
def test_name_that_leaves_its_folder_is_neither_written_nor_read(name):
    assert not safe_name(name)
    with pytest.raises(BundleError):
        PlainZipWriter(io.BytesIO()).add(name, iter([b""]))
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as made, pytest.MonkeyPatch.context() as patch:
        patch.setattr(zipfile.os, "sep", "/")
        made.writestr(zipfile.ZipInfo(name or "x", (1980, 1, 1, 0, 0, 0)), b"x")
    assert not verify_stream(stream, ()).whole


def test_a_name_stands_in_a_bundle_once():
    writer = PlainZipWriter(io.BytesIO())
    writer.add("a.txt", iter([b"1"]))
    with pytest.raises(BundleError, match=r"a\.txt"):
        writer.add("a.txt", iter([b"2"]))
    writer.add("b.txt", iter([b"2"]))
    assert [member.name for member in writer.members] == ["a.txt", "b.txt"]


def test_compressed_bomb_is_refused_without_unpacking_it():
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as made:
        made.writestr("manifest.json", b"0" * 50_000_000)
    found = verify_stream(stream, ())
    assert "compressed" in found.changed[0]


@pytest.mark.parametrize(
    "data",
    [b"", b"PK\x05\x06" + bytes(18), b"not a zip", b"PK\x03\x04" + b"\xff" * 60, b"[" * 100_000],
)
def test_what_is_no_bundle_is_told_without_a_traceback(data):
    assert not verify_stream(io.BytesIO(data), ()).whole


@pytest.mark.parametrize("old_journal", [False, True])
def test_folder_that_was_moved_is_bundled_whole(tmp_path, old_journal):
    entry = printed(tmp_path / "run", relative="" if old_journal else "../part.gcode")
    with_run(tmp_path / "run")
    before = write_bundle(tmp_path / "out.zip", entry, lab_key())
    (tmp_path / "run").rename(tmp_path / "moved")
    moved = entry_of(tmp_path / "moved" / "print" / "journal.log")
    after = write_bundle(tmp_path / "moved.zip", moved, lab_key())
    assert [one.path for one in after.files] == [one.path for one in before.files]
    assert after.missing == ()
    assert verify_bundle(tmp_path / "moved.zip", [lab_key().public]).good


def test_manifest_has_the_hashes_of_scan_profiles_and_inputs_and_the_build(tmp_path):
    entry = printed(tmp_path / "run")
    with_run(tmp_path / "run")
    (tmp_path / "run" / "scan.tif").write_bytes(b"a scan")
    (tmp_path / "run" / "manifest.json").write_text(_with_scan(tmp_path / "run"))
    manifest = write_bundle(tmp_path / "out.zip", entry, lab_key())
    assert manifest.hashes["part.gcode"] == entry.sha256
    assert manifest.hashes["run/scan.tif"] == hashlib.sha256(b"a scan").hexdigest()
    assert manifest.hashes["recipe/tissue.stl"] == "1" * 64
    assert {"profiles/printer", "profiles/ink"} <= set(manifest.hashes)
    assert manifest.versions["printed by"] == version()
    assert "run.json" in [one.path for one in manifest.files]
    (tmp_path / "run" / "scan.tif").write_bytes(b"another")
    changed = write_bundle(tmp_path / "out.zip", entry, lab_key()).missing
    assert changed == ("scan.tif was changed since its run: it is as it is now",)


def _with_scan(run: Path) -> str:
    told = json.loads((run / "manifest.json").read_text())
    digest = hashlib.sha256((run / "scan.tif").read_bytes()).hexdigest()
    told["stages"]["scan"] = {**told["stages"]["toolpath"], "outputs": {"scan.tif": digest}}
    told["facts"]["inputs"] = {"tissue.stl": "1" * 64}
    return json.dumps(told)


def _with_report(run: Path, print_id: str) -> None:
    told = json.loads((run / "manifest.json").read_text())
    files = {name: digest_file(run / name) for name in ("report.json", "report.html")}
    told["report"] = {"print": print_id, "files": files}
    (run / "manifest.json").write_text(json.dumps(told))


def test_a_report_that_was_edited_is_named(tmp_path):
    entry = printed(tmp_path / "run")
    with_run(tmp_path / "run")
    _with_report(tmp_path / "run", entry.id)
    assert write_bundle(tmp_path / "out.zip", entry, lab_key()).missing == ()
    report = tmp_path / "run" / "report.json"
    report.write_text(report.read_text().replace("true", "false"))
    changed = write_bundle(tmp_path / "out.zip", entry, lab_key()).missing
    assert changed == ("report.json was changed since its run: it is as it is now",)


def test_the_report_of_another_print_of_the_same_file_isnt_packed(tmp_path):
    entry, other = printed(tmp_path / "run"), printed(tmp_path / "other")
    with_run(tmp_path / "run")
    _with_report(tmp_path / "run", other.id)
    found = write_bundle(tmp_path / "out.zip", entry, lab_key())
    assert found.missing == ("the report in the run's folder is of another print",)
    assert "report.json" not in [one.path for one in found.files]


DEEP = b'{"x":' + 100_000 * b"[" + 100_000 * b"]" + b"}"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda data: data.replace(b"\n", b"\r\n"), "change of line ends"),
        (lambda data: data.decode().encode("utf-16"), "change of line ends"),
        (lambda data: data + b"%08x %b\n" % (crc32(DEEP), DEEP), "not signed: 1 line follows"),
    ],
)
def test_a_journal_that_an_editor_or_a_stranger_wrote_is_no_fault_of_ours(tmp_path, change, words):
    entry = printed(tmp_path / "run")
    entry.journal.write_bytes(change(entry.journal.read_bytes()))
    assert words in check_journal_file(entry.journal, [lab_key().public]).words


def test_a_journal_without_an_end_is_refused(tmp_path):
    (tmp_path / "journal.log").symlink_to("/dev/zero")
    with pytest.raises(RecordsError, match="isn't a regular file"):
        check_journal_file(tmp_path / "journal.log", [])


def test_evidence_stays_when_another_build_runs_in_the_folder(tmp_path):
    run = tmp_path / "run"
    entry = printed(run)
    with_run(run)
    told = json.loads((run / "manifest.json").read_text())["facts"]
    facts = {"versions": None, "inputs": {}, **told}
    assert keep_earlier(run, {**facts, "inputs": {"scan.tif": "2" * 64}}) is None  # a new scan
    kept = keep_earlier(run, {**facts, "versions": {"printctl": "0.2.0"}})
    assert kept.parent == run / "earlier"
    before = write_bundle(tmp_path / "before.zip", entry, lab_key())
    for name in ("part.gcode", "report.html", "report.json", "dry_run.json"):
        (run / name).write_text("another design's")
    (run / "manifest.json").write_text('{"schema": 1, "facts": {}, "stages": {}}')
    assert keep_earlier(run, facts) is None  # what is there now was never printed
    after = write_bundle(tmp_path / "after.zip", entry, lab_key())
    assert after.files == before.files
    assert after.verdict == "pass"


def test_bundle_of_a_changed_journal_says_from_which_line(tmp_path):
    entry = printed(tmp_path / "run")
    text = entry.journal.read_text().splitlines(keepends=True)
    record = decode(text[3].encode(), chained=True) | {"text": "all was well"}
    entry.journal.write_text("".join([*text[:3], encode(record).decode(), *text[4:]]))
    write_bundle(tmp_path / "out.zip", entry, lab_key())
    found = verify_bundle(tmp_path / "out.zip", [lab_key().public])
    assert (found.whole, found.signature, found.good) == (True, Signature.TRUSTED, False)
    assert found.lines()[-1] == (
        "JOURNAL: the journal was changed after line 3: line 5 doesn't follow"
    )


def test_journal_of_another_print_in_its_place_makes_no_bundle(tmp_path):
    entry, other = printed(tmp_path / "run"), printed(tmp_path / "other", started=2e9)
    entry.journal.write_bytes(other.journal.read_bytes())
    with pytest.raises(BundleError, match=f"isn't of print {entry.id} any more, but of {other.id}"):
        write_bundle(tmp_path / "out.zip", entry, lab_key())


def test_changed_gcode_is_missing_and_not_filed_as_the_prints(tmp_path):
    entry = printed(tmp_path / "run")
    (tmp_path / "run" / "part.gcode").write_bytes(b"G28\n")
    manifest = write_bundle(tmp_path / "out.zip", entry, lab_key())
    assert "job.gcode" not in [file.path for file in manifest.files]
    assert "was changed since the print" in manifest.missing[0]


def test_lost_journal_makes_no_bundle_and_leaves_no_file(tmp_path):
    entry = printed(tmp_path / "run")
    entry.journal.unlink()
    with pytest.raises(BundleError, match="journal"):
        write_bundle(tmp_path / "out.zip", entry, None)
    assert not list(tmp_path.glob("*.zip"))


@pytest.mark.skipif(os.name != "posix", reason="modes of files are POSIX's")
def test_labs_key_is_made_once_and_for_its_owner_alone(data):
    first = lab_key()
    assert stat.S_IMODE((data / PRIVATE).stat().st_mode) == 0o600
    assert lab_key().public == first.public
    (data / PRIVATE).chmod(0o644)
    with pytest.raises(KeyTrouble, match="chmod 600"):
        lab_key()


# --- cover page of a record bundle
HOSTILE = "<b>&<script>\x00\x1b[31m\n" + "x" * 5000


def test_cover_has_verdict_hash_and_operator(tmp_path):
    entry = printed(tmp_path / "run")
    with_run(tmp_path / "run")
    page = cover_page(evidence(entry))
    assert page == cover_page(evidence(entry))
    for words in ("<li>pass</li>", "ada at lab", entry.sha256):
        assert words in page


def test_cover_takes_hostile_text(tmp_path):
    alarms = tuple(Alarm(1e9, HOSTILE) for _ in range(50))
    entry = replace(printed(tmp_path / "run"), file=HOSTILE, message=HOSTILE, alarms=alarms)
    page = cover_page(evidence(entry))
    assert "<script>" not in page
    assert "&lt;script&gt;" in page


# --- repeat of a print: identical G-code or none; differences reported
def test_profiles_that_differ_today_are_told_key_by_key(tmp_path):
    entry = printed(tmp_path / "run")
    with_run(tmp_path / "run")
    told = {one.what: (one.then, one.now) for one in plan_repeat(entry).differences}
    assert told["ink's profile collagen_fresh, name"][0] == "another"
    assert not any("printer's profile" in what for what in told)


def test_changed_gcode_is_refused_and_its_bundle_brings_it_back(tmp_path):
    entry = printed(tmp_path / "run")
    bundle = tmp_path / "out.zip"
    write_bundle(bundle, entry, lab_key())
    (tmp_path / "run" / "part.gcode").write_bytes(b"G28\n")
    with pytest.raises(RecordsError, match=r"changed since the print.*--bundle"):
        plan_repeat(entry)
    made = make_job(plan_repeat(entry, bundle), tmp_path / "jobs")
    assert made.read_bytes() == GCODE
    assert entry_of_bundle(bundle).id == entry.id


def test_damaged_or_foreign_bundle_is_refused(tmp_path):
    entry, bundle = printed(tmp_path / "run"), tmp_path / "out.zip"
    write_bundle(bundle, entry, lab_key())
    (tmp_path / "run" / "part.gcode").unlink()
    with pytest.raises(RecordsError, match="another G-code"):
        plan_repeat(replace(entry, sha256="0" * 64), bundle)
    data = bytearray(bundle.read_bytes())
    data[len(data) // 2] ^= 1
    bundle.write_bytes(data)
    with pytest.raises(RecordsError, match="isn't whole"):
        plan_repeat(entry, bundle)
    with pytest.raises(RecordsError, match="isn't whole"):
        entry_of_bundle(bundle)


def test_file_that_changes_between_check_and_copy_makes_no_job(tmp_path):
    plan = plan_repeat(printed(tmp_path / "run"))
    plan.gcode.write_bytes(b"G28\n")
    with pytest.raises(RecordsError, match="nothing was made"):
        make_job(plan, tmp_path / "jobs")
    assert not list((tmp_path / "jobs").glob("*"))


# --- history as CSV, and a print's timeline
CALCULATED = "=+-@"


@pytest.mark.parametrize(
    "text",
    [
        "=cmd|' /C calc'!A0",
        "+1",
        "-1",
        "@SUM(A1)",
        "\t=1",
        "\r=1",
        "\n=1",
        "  =1",
        "\ufeff=1",
        "＝1",
    ],
)
def test_cell_that_a_spreadsheet_would_calculate_begins_with_an_apostrophe(text):
    assert safe_cell(text) == f"'{text}"


@given(st.text())
def test_no_text_begins_as_a_formula_and_none_is_lost(text):
    cell = safe_cell(text)
    assert not cell.lstrip(" \ufeff\u00a0").startswith(tuple(CALCULATED))
    assert cell.removeprefix("'") == text.replace("\0", "").removeprefix("'")


@settings(max_examples=examples(40), suppress_health_check=list(HealthCheck), deadline=None)
@given(end=st.floats(0, 1, exclude_max=True), more=st.binary(max_size=20))
def test_cut_or_lengthened_bundle_is_found(tmp_path_factory, end, more):
    data = _once(tmp_path_factory, True)
    assert not verified(data[: int(end * len(data))]).whole
    assert verified(data + more).whole == (not more)


@pytest.mark.parametrize("manifest", [b"[" * 200_000, b"{}", b"\xff", b'{"files": 3}', b"null"])
def test_hostile_manifest_is_told(tmp_path, manifest):
    data = rewritten(filed(tmp_path), lambda files: files.update({"manifest.json": manifest}))
    assert "manifest.json" in verified(data).changed[0]
