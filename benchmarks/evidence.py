"""Tamper with journals and bundles without the station's key; count what goes unnoticed.

The tamperer knows the program and may write every file but the key and what lies beside it: lines
are flipped, cut, added, doubled and moved, with checksums and chains computed again; signatures are
removed, replaced by ones of another key, taken from another print; files change with their hashes.
"""

from __future__ import annotations

import io
import json
import os
import random
import time
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from benchmarks.common import Row, limited, row, scratch
from printctl.history.bundle import write_bundle
from printctl.history.plain_zip import PlainZipWriter
from printctl.history.signing import MANIFEST, PUBLIC_KEY, SIGNATURE, BundleError
from printctl.history.verify import verify_bundle, verify_stream
from printctl.machine.records.journal import BEGIN, Journal, decode, encode, link, shown
from printctl.machine.records.lab_key import LabKey, lab_key
from printctl.machine.records.sealing import sign_journal
from printctl.pipeline.past.past_print import PrintEntry, entry_of

COUNT, QUICK_COUNT = 10_000, 1_000
PRINTS = 8
GCODE = b"G21\nG90\nG1 X1 F600\n"


@dataclass(frozen=True)
class Filed:
    """A print as it was: its entry, journal and bundle."""

    entry: PrintEntry
    journal: bytes
    bundle: bytes


def make_print(folder: Path, number: int, rng: random.Random) -> PrintEntry:
    """Write an honest print: some are continued, some after a loss of power tore the last line."""
    folder.mkdir(parents=True)
    (folder.parent / "part.gcode").write_bytes(GCODE)
    path = folder / "journal.log"
    job = {"name": "part.gcode", "path": str(folder.parent / "part.gcode"), "lines": 3}
    job |= {"sha256": sha256(GCODE).hexdigest(), "started": 1e9 + number, "id": f"print-{number}"}
    for attempt in range(1 + number % 3):
        journal = Journal(path, sign=sign_journal)
        journal.add("job", **job, who="ada", host="lab", profile="generic_marlin", port="/dev/x")
        journal.add("action", do="resume" if attempt else "start", who="ada", **{"from": "page"})
        journal.add("state", state="printing", message="printing")
        for k in range(rng.randint(3, 40)):
            journal.add("ack", done=min(k, 3))
            journal.add("control", n=k, command="M105")
        journal.add("alarm", text=f"the bath is {rng.uniform(20, 30):.1f} °C")
        if attempt or number % 2:
            journal.add("end", state="done", message="over", done=3, error="", position_known=True)
        journal.close()
        if not (attempt or number % 2) and number % 3:  # power went away
            os.truncate(path, path.stat().st_size - rng.randint(1, 30))
    if decode(path.read_bytes().splitlines()[-1])["t"] != "seal":  # type: ignore[index]
        journal = Journal(path, sign=sign_journal)
        journal.add("end", state="given_up", message="", done=3, error="", position_known=False)
        journal.close()
    entry = entry_of(path)
    assert entry is not None
    return entry


# --- journals ------------------------------------------------------------------------------------


def records_of(data: bytes) -> list[dict[str, Any]]:
    """Return the records that can be read."""
    return [one for line in data.splitlines() if (one := decode(line)) is not None]


def rehashed(records: list[dict[str, Any]], key: LabKey | None = None) -> bytes:
    """Return lines with checksums and chain computed again; seals signed by ``key``, if any."""
    head, lines = BEGIN, []
    for record in records:
        record = {**record, "chain": shown(head)}
        if record.get("t") == "seal":
            old = {k: v for k, v in record.items() if k not in ("key", "signature")}
            record = {**old, **{k: record[k] for k in ("key", "signature") if k in record}}
            if key is not None:
                record = old | {"key": key.public.raw.hex()}
                text = b"printctl journal %b " % head.hex().encode() + json.dumps(record).encode()
                record["signature"] = key.sign(text).hex()
        lines.append(encode(record))
        head = link(head, lines[-1][:-1])
    return b"".join(lines)


def edited(records: list[dict[str, Any]], rng: random.Random) -> list[dict[str, Any]]:
    """Change, remove, add, double or move a record."""
    records = [dict(one) for one in records]
    at, other = rng.randrange(len(records)), rng.randrange(len(records))
    kind = rng.randrange(5)
    if kind == 0:
        name = rng.choice([k for k in records[at] if k != "t"] or ["t"])
        records[at][name] = rng.choice([0, "x", 1e9, None, True])
    elif kind == 1:
        del records[at]
    elif kind == 2:
        records.insert(at, {"t": "alarm", "at": 1e9, "text": "all was well"})
    elif kind == 3:
        records.insert(at, records[other])
    else:
        records[at], records[other] = records[other], records[at]
    return records


def flip(data: bytes, rng: random.Random) -> bytes:
    """Change one byte."""
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ rng.randint(1, 255)]) + data[at + 1 :]


def move_lines(data: bytes, rng: random.Random) -> bytes:
    """Delete, double, swap or add whole lines as they are."""
    lines = data.splitlines(keepends=True)
    at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(4)
    if kind == 0:
        del lines[at : at + rng.randint(1, 3)]
    elif kind == 1:
        lines.insert(other, lines[at])
    elif kind == 2:
        lines[at], lines[other] = lines[other], lines[at]
    else:
        lines.insert(at, rng.choice([b"\n", b"torn", encode({"t": "ack", "done": 1})]))
    return b"".join(lines)


def cut_at_seal(data: bytes, rng: random.Random) -> bytes:
    """Take the journal back to an earlier signature, or to just before the last."""
    lines = data.splitlines(keepends=True)
    seals = [k for k, line in enumerate(lines) if (decode(line) or {}).get("t") == "seal"]
    ends = [k + 1 for k in seals[:-1]] + [seals[-1]]
    return b"".join(lines[: rng.choice(ends)])


def journal_tampers(other_key: LabKey) -> dict[str, Callable[[bytes, bytes, random.Random], bytes]]:
    """Return ways to tamper with a journal, given it and another print's."""
    old = ("chain", "signature", "key")
    return {
        "flip a byte": lambda data, other, rng: flip(data, rng),
        "move lines": lambda data, other, rng: move_lines(data, rng),
        "edit, hash again": lambda data, other, rng: rehashed(edited(records_of(data), rng)),
        "edit, sign anew": lambda data, other, rng: rehashed(
            edited(records_of(data), rng), other_key
        ),
        "truncate": lambda data, other, rng: data[: rng.randrange(len(data))],
        "back to a signature": lambda data, other, rng: cut_at_seal(data, rng),
        "append": lambda data, other, rng: rehashed([*records_of(data), {"t": "ack", "done": 3}]),
        "as of an old version": lambda data, other, rng: b"".join(
            encode({k: v for k, v in one.items() if k not in old})
            for one in edited(records_of(data), rng)
            if one.get("t") != "seal"
        ),
        "another print's": lambda data, other, rng: other,
        "another print's seal": lambda data, other, rng: (
            b"".join(data.splitlines(keepends=True)[:-1]) + other.splitlines(keepends=True)[-1]
        ),
    }


# --- bundles -------------------------------------------------------------------------------------


def unpacked(data: bytes) -> dict[str, bytes]:
    """Return a bundle's files by name."""
    with zipfile.ZipFile(io.BytesIO(data)) as opened:
        return {name: opened.read(name) for name in opened.namelist()}


def packed(files: dict[str, bytes]) -> bytes:
    """Return files as printctl packs them."""
    stream = io.BytesIO()
    writer = PlainZipWriter(stream)
    for name, content in files.items():
        writer.add(name, iter([content]))
    writer.close()
    return stream.getvalue()


def with_hashes(files: dict[str, bytes], key: LabKey | None = None, **changes: Any) -> bytes:
    """Return a bundle whose manifest has the files' hashes of now; signed by ``key``, if any."""
    files = dict(files)
    manifest = json.loads(files[MANIFEST]) | changes
    if key is not None:
        files[PUBLIC_KEY] = key.public.pem()
        manifest["signed_by"] = key.public.fingerprint
    manifest["files"] = [
        {**one, "sha256": sha256(files[one["path"]]).hexdigest(), "bytes": len(files[one["path"]])}
        for one in manifest["files"]
        if one["path"] in files
    ]
    files[MANIFEST] = json.dumps(manifest, indent=1, sort_keys=True).encode() + b"\n"
    if key is not None:
        files[SIGNATURE] = key.sign(files[MANIFEST])
    return packed(files)


def tamper_bundle(
    data: bytes, other: bytes, other_key: LabKey, rng: random.Random
) -> tuple[str, bytes]:
    """Return a way to tamper with a bundle, given it and another print's, and what it gives."""
    files, others = unpacked(data), unpacked(other)
    name = rng.choice(sorted({*files} - {MANIFEST, SIGNATURE, PUBLIC_KEY}))
    changed = {**files, name: flip(files[name], rng)}
    forged = edited(records_of(files["journal.log"]), rng)
    swapped = rng.choice([(MANIFEST,), (SIGNATURE,), (MANIFEST, SIGNATURE)])
    unsigned = {k: v for k, v in changed.items() if k != SIGNATURE}
    ways: dict[str, Callable[[], bytes]] = {
        "flip a byte": lambda: flip(data, rng),
        "truncate": lambda: data[: rng.randrange(len(data))],
        "lengthen": lambda: data + rng.randbytes(rng.randint(1, 9)),
        "change a file": lambda: packed(changed),
        "change a file and its hash": lambda: with_hashes(changed),
        "another print's file and its hash": lambda: with_hashes({**files, name: others[name]}),
        "remove a file and its hash": lambda: with_hashes(
            {k: v for k, v in files.items() if k != name}
        ),
        "another journal, all signed anew": lambda: with_hashes(
            {**files, "journal.log": rehashed(forged, other_key)}, other_key
        ),
        "change a file, unsigned": lambda: with_hashes(unsigned, signed_by=""),
        "as of format 1": lambda: with_hashes(changed, format_version=1),
        "another print's manifest": lambda: packed({**files, **{k: others[k] for k in swapped}}),
    }
    way = rng.choice(sorted(ways))
    return way, ways[way]()


# --- what is noticed -----------------------------------------------------------------------------


def unnoticed(count: int, seed: int, folder: Path) -> tuple[Counter[str], Counter[str]]:
    """Tamper ``count`` times; return by kind how often it was tried, and what passed as right.

    A journal is judged by the bundle that its lab makes of it in good faith.
    """
    rng, key, other_key = random.Random(seed), lab_key(), lab_key(folder / "thief")
    filed, out = [], folder / "out.zip"
    for number in range(PRINTS):
        entry = make_print(folder / str(number) / "print", number, rng)
        write_bundle(out, entry, key)
        filed.append(Filed(entry, entry.journal.read_bytes(), out.read_bytes()))
        if not verify_bundle(out, [key.public]).good:
            raise ValueError(f"honest print {number} isn't taken for right")
    ways = journal_tampers(other_key)
    tried: Counter[str] = Counter()
    passed: Counter[str] = Counter()
    while tried.total() < count:
        one, other = rng.sample(filed, 2)
        if tried.total() % 2:
            way, data = tamper_bundle(one.bundle, other.bundle, other_key, rng)
            same, kind = data == one.bundle, f"bundle: {way}"
            good = not same and verify_stream(io.BytesIO(data), [key.public]).good
        else:
            way = rng.choice(sorted(ways))
            data = ways[way](one.journal, other.journal, rng)
            same, kind = data == one.journal, f"journal: {way}"
            good = not same and passes(one, data, key, out)
        if not same:
            tried[kind] += 1
            passed[kind] += good
    return tried, +passed


def passes(one: Filed, data: bytes, key: LabKey, out: Path) -> bool:
    """Whether a print's journal, replaced by ``data``, makes a bundle that is right."""
    one.entry.journal.write_bytes(data)
    try:
        write_bundle(out, one.entry, key)
        return verify_bundle(out, [key.public]).good
    except BundleError:  # it is another print's, or none's
        return False
    finally:
        one.entry.journal.write_bytes(one.journal)


def line_us(folder: Path, lines: int = 20_000) -> float:
    """Return the time of a journal's line that isn't forced to the disk, µs; the best of five."""
    best = float("inf")
    for attempt in range(5):
        journal = Journal(folder / f"{attempt}.log")
        begun = time.perf_counter()
        for k in range(lines):
            journal.add("control", n=k, command="M114")
        best = min(best, time.perf_counter() - begun)
        journal.close()
    return best / lines * 1e6


def rows(quick: bool) -> Iterator[Row]:
    """Yield what went unnoticed, and what a line of a journal costs."""
    with scratch() as folder:
        tried, passed = unnoticed(QUICK_COUNT if quick else COUNT, 1, folder / "prints")
        found = limited("tampers unnoticed", passed.total(), f"of {tried.total()}", 0)
        yield found | {"tried": dict(sorted(tried.items())), "unnoticed": dict(passed)}
        yield row("journal, a line that isn't forced to the disk", round(line_us(folder), 1), "µs")
