"""`printctl history`: list, filter and export past prints; rebuild the list from journals."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import typer

from design.files import write_bytes
from printctl.cli.declare import command, group, json_command, wants_json
from printctl.cli.options import print_json, print_lines, print_note, print_result
from printctl.errors import UsageError
from printctl.history import table
from printctl.history.bundle import filed, write_bundle
from printctl.history.index import PrintHistory
from printctl.history.query import HistoryQuery, SortBy
from printctl.history.repeat import entry_of_bundle, make_job, plan_repeat
from printctl.history.table import local_time
from printctl.history.timeline import TimeLine, time_line
from printctl.history.verify import verify_bundle
from printctl.machine.records.lab_key import (
    known_lab_key,
    lab_key,
    read_public_file,
    signing_missing,
)
from printctl.machine.records.record import JOURNAL
from printctl.machine.records.sealing import Finding, check_journal_file
from printctl.machine.records.states import ENDED, state_words
from printctl.pipeline.past.evidence import evidence
from printctl.pipeline.past.past_print import PrintEntry, entry_of
from printctl.run_folder.artefacts import JOURNAL_FOLDER
from printctl.settings import arg, opt, settings

STATES = {state_words(state): state.value for state in sorted(ENDED)}
SearchOption = Annotated[str, opt("Words that must all occur: file, hash, profile, alarm ...")]
CsvFlag = Annotated[bool, opt("Every column as CSV.", False, "--csv")]
IdArg = Annotated[
    str,
    arg(
        "The print's id (`printctl history` has it in brackets), or its beginning; or its folder.",
        metavar="ID",
    ),
]


@settings
class Which:
    """Which prints are meant."""

    search: SearchOption = ""
    state: list[str] | None = opt(f"Any of these ends: {', '.join(STATES)}.")
    profile: str = opt("The printer's profile.", "")
    who: str = opt("The operator.", "")
    since: str = opt("First day: 2026-11-01.", "", metavar="DAY")
    until: str = opt("Last day: 2026-11-30.", "", metavar="DAY")

    def query(self) -> HistoryQuery:
        """As the history takes it; raises `UsageError` for a state or a day that there isn't."""
        states = tuple(STATES.get(one.replace("_", " "), one) for one in self.state or ())
        for one in states:
            if one not in STATES.values():
                raise UsageError(f"--state {one!r} isn't one of {', '.join(STATES)}")
        return HistoryQuery(
            words=self.search,
            states=states,
            profile=self.profile,
            who=self.who,
            since=table.day_begins(self.since, "--since"),
            until=table.day_ends(self.until, "--until"),
        )


@settings
class Sorted(Which):
    """The same, in which order and how many."""

    sort: SortBy = opt("Sort by this column, latest or last name first.", SortBy.STARTED)
    reverse: bool = opt("Reverse the order.", False)
    limit: int | None = opt("Maximum number of prints.", min=1)

    def query(self) -> HistoryQuery:
        """See `Which.query`."""
        plain = super().query()
        return replace(plain, sort=self.sort, descending=not self.reverse, limit=self.limit)


@json_command
def show(print_id: IdArg) -> None:
    """Show one print: what, when, what happened, what there is of it.

    Example: `printctl history show 1795267901`
    """
    entry = _entry(print_id)
    record = evidence(entry)
    line = TimeLine((), ())
    with suppress(OSError):
        line = time_line(entry.journal)
    facts = {
        "print": filed(entry).model_dump(mode="json"),
        "journal": str(entry.journal),
        "gcode": record.gcode and str(record.gcode),
        "run": record.run and str(record.run),
        "report": {name: str(path) for name, path in record.report.items()},
        "verdict": record.verdict,
        "note": record.note(),
        "missing": list(record.missing),
        "events": list(map(asdict, line.events)),
    }
    print_result(facts, [
        f"{entry.file}, {state_words(entry.state)}: {entry.message}",
        f"id       {entry.id}",
        f"sha256   {entry.sha256}",
        f"begun    {local_time(entry.started)}, over {local_time(entry.ended) or 'never'}",
        f"lines    {entry.done} of {entry.total}",
        f"operator {entry.by} at {entry.host}",
        f"printer  {entry.profile} at {entry.port}",
        f"verdict  {table.outcome(record.verdict) or 'none'}",
        f"report   {record.report.get('report.html', 'none')}",
        f"journal  {entry.journal}",
        *(f"missing  {text}" for text in record.missing),
        "",
        *(f"{e.after_s:9.1f} s  {e.kind:<10} {e.text}" for e in line.events),
    ])  # fmt: skip


@json_command
def bundle(
    print_id: IdArg,
    out: Path | None = opt("The zip; print_ID.zip by default."),
    unsigned: bool = opt("Export without a signature.", False),
) -> None:
    """Pack a print's journal, G-code, recipe, profiles and report into one signed zip.

    Exit code 1 when the journal was changed; the bundle is written, and says so.

    Example: `printctl history bundle 1795267901 --out heart_3.zip`
    """
    missing = signing_missing()
    if missing and not unsigned:
        raise UsageError(f"{missing}; or pack it --unsigned")
    entry = _entry(print_id)
    path = out or Path(f"print_{entry.id}.zip")
    manifest = write_bundle(path, entry, None if unsigned else lab_key())
    signed = f"signed by key {manifest.signed_by}" if manifest.signed_by else "unsigned"
    lines = [f"{path}: {len(manifest.files)} files, {signed}"]
    lines += [f"  journal: {manifest.journal.words}"] if manifest.journal else []
    lines += [f"  not in it: {text}" for text in manifest.missing or ("nothing is missing",)]
    changed = manifest.journal is not None and manifest.journal.finding is Finding.CHANGED
    facts = {"bundle": str(path), "manifest": manifest.model_dump(mode="json")}
    print_result(facts, lines, not changed)


@json_command
def verify(
    file: Path = arg("The bundle; or a run or print folder, or a journal in one."),
    keys: list[Path] | None = opt(
        "A public key (PEM) that you know to be the lab's; this machine's own by default.",
        None,
        "--key",
    ),
) -> None:
    """Tell whether a bundle is as it was filed, or a journal as it was signed, and who signed it.

    Exit code 0: whole, and signed by a trusted key, with the journal at the print's end; 1:
    anything else. Nothing is unpacked.

    Example: `printctl history verify heart_3.zip --key lab.pem`
    """
    own = known_lab_key() if not keys else None
    trusted = [read_public_file(path) for path in keys or ()] + ([own] if own else [])
    if file.is_dir() or file.suffix == ".log":
        journal = _journal(file)
        check = check_journal_file(journal, trusted)
        past, lines = entry_of(journal), [f"JOURNAL: {check.words}"]
        lines += (
            [f"  {past.file}, {state_words(past.state)}, {local_time(past.started)}"]
            if past
            else []
        )
        told = {"journal": str(journal), **asdict(check)}
        print_result(told, lines, check.finding is Finding.SIGNED)
        return
    result = verify_bundle(file, trusted)
    entry = result.manifest.print if result.manifest else None
    facts = {
        "whole": result.whole,
        "signature": result.signature.value,
        "fingerprint": result.fingerprint,
        "changed": list(result.changed),
        "journal": result.journal and result.journal.words,
        "print": entry.model_dump(mode="json") if entry else None,
    }
    lines = [*result.lines()]
    if result.whole and entry:
        lines.append(
            f"  {entry.file}, {state_words(entry.state)}, {local_time(entry.started)}, {entry.who}"
        )
    print_result(facts, lines, result.good)


@command
def key(out: Path | None = opt("Write the public key here (PEM).")) -> None:
    """Show the lab's key, made at the first call; give the public one to whoever verifies.

    Example: `printctl history key --out lab.pem`
    """
    public = lab_key().public
    if out is not None:
        write_bytes(out, public.pem())
    shown = str(out) if out else public.pem().decode().strip()
    print_lines(f"fingerprint {public.fingerprint}", shown)


@json_command
def repeat(
    print_id: str = arg("The print; not needed with --bundle.", "", metavar="[ID]"),
    out: Path = opt("Folder for the job; of a page's workspace, its jobs.", Path("jobs"), "--to"),
    bundle: Path | None = opt("Take the G-code from this bundle."),
    check_only: bool = opt("Only report what differs from that print.", False, "--check"),
) -> None:
    """Make a job of the same bytes again, and tell what isn't as it was then; nothing is started.

    Example: `printctl history repeat 1795267901 --to work/jobs`
    """
    if not print_id and bundle is None:
        raise UsageError("give the print's ID, or --bundle FILE.zip")
    entry = PrintHistory().one(print_id) if print_id else entry_of_bundle(bundle or Path())
    plan = plan_repeat(entry, bundle)
    made = None if check_only else make_job(plan, out)
    facts = {
        "job": str(made) if made else None,
        "differences": [asdict(one) for one in plan.differences],
        "unknown": list(plan.unknown),
        "set_up": plan.set_up,
    }
    lines = [f"the G-code is the one that was printed ({plan.entry.sha256})"]
    lines += [f"differs: {one.line()}" for one in plan.differences] or ["nothing known differs"]
    lines += [f"not known: {text}" for text in plan.unknown]
    print_result(facts, [*lines, *([f"job: {made}; nothing was started"] if made else [])])


@json_command
def overview(context: typer.Context, search: SearchOption = "", as_csv: CsvFlag = False) -> None:
    """List past prints, the latest first; `list --help` has more ways to narrow."""
    if context.invoked_subcommand is None:
        _show(Which(search=search).query(), as_csv)


@json_command
def list_prints(which: Sorted, as_csv: CsvFlag = False) -> None:
    """List past prints that fit.

    Example: `printctl history list --state halted --state failed --since 2026-11-01`
    """
    _show(which.query(), as_csv)


@command
def as_table(which: Which) -> None:
    """Write every column as CSV to stdout, safe to open in a spreadsheet.

    Example: `printctl history csv --since 2026-11-01 > november.csv`
    """
    _show(which.query(), as_csv=True)


@json_command
def rebuild(
    folders: list[Path] | None = arg("Search these too, with all folders below.", None),
) -> None:
    """Make the list again from the journals, which are the truth.

    For a list that is damaged, or run folders that were moved. No journal is changed.
    """
    for folder in folders or ():
        if not folder.is_dir():
            raise UsageError(f"{folder} is no folder; give one that holds prints")
    kept = PrintHistory()
    count = kept.rebuild(folders or ())
    print_result({"prints": count, "index": str(kept.path)}, [f"{count} prints in {kept.path}"])


def _journal(path: Path) -> Path:
    """Return the journal that a path is, or the last one of a run or print folder."""
    inner = path / JOURNAL_FOLDER / JOURNAL
    return path if path.is_file() else inner if inner.is_file() else path / JOURNAL


def _entry(print_id: str) -> PrintEntry:
    """Return a print by its id, or the last one of a folder."""
    journal = _journal(Path(print_id))
    entry = entry_of(journal) if print_id and journal.is_file() else None
    return entry or PrintHistory().one(print_id)


def _show(query: HistoryQuery, as_csv: bool) -> None:
    matches = PrintHistory().find(query)
    entries = [table.tell_running(entry) for entry in matches.entries]
    if wants_json():
        plain = [asdict(entry) | {"journal": str(entry.journal)} for entry in entries]
        print_json({"prints": plain, "total": matches.total})
    elif as_csv:
        sys.stdout.writelines(table.csv_lines(entries))
    elif entries:
        print_lines(*(line for entry in entries for line in _lines(entry)))
    else:
        print_note("no print is known" + (" that fits" if query != HistoryQuery() else ""))


def _lines(entry: PrintEntry) -> Iterator[str]:
    yield (
        f"{local_time(entry.started)}  {entry.state:<16} {entry.file}  {entry.done} of "
        f"{entry.total} lines  {entry.profile}  {entry.by}  [{entry.id}]"
    )
    if entry.message and entry.state != "done":
        yield f"    {entry.message}"
    yield from (f"    ! {alarm.text}" for alarm in entry.alarms)


history = group(
    typer.Typer(
        help="Past prints: list and search, show one, file its record, print it again.",
        invoke_without_command=True,
        rich_markup_mode="markdown",
    ),
    *(show, bundle, verify, key, repeat),
    list=list_prints,
    csv=as_table,
    rebuild=rebuild,
)
history.callback()(overview)
