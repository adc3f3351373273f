"""`printctl history`: who printed what on which printer, when, and how it ended."""

from __future__ import annotations

import csv
import sys
import time
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from printctl.cli.options import JsonFlag, messages, print_json, print_lines
from printctl.errors import UsageError
from printctl.link.history import PrintHistory
from printctl.link.history_entry import INTERRUPTED, PrintEntry
from printctl.link.reach import alive
from printctl.link.record import JOURNAL

history = typer.Typer(
    help="Past prints: list, search, rebuild the list from the journals.",
    invoke_without_command=True,
)


@history.callback()
def show(
    context: typer.Context,
    search: Annotated[
        str,
        typer.Option("--search", help="Words that must all occur: file, hash, profile, alarm ..."),
    ] = "",
    as_csv: Annotated[bool, typer.Option("--csv", help="Every column as CSV.")] = False,
    as_json: JsonFlag = False,
) -> None:
    """List past prints, the latest first."""
    if context.invoked_subcommand is not None:
        return
    entries = [_running(entry) for entry in PrintHistory().entries(search)]
    if as_json:
        print_json({"prints": [_plain(entry) for entry in entries]})
    elif as_csv:
        _write_csv(entries)
    else:
        for entry in entries:
            print_lines(*_lines(entry))
        if not entries:
            messages().print("no print is known" + (" that has these words" if search else ""))


@history.command("rebuild")
def rebuild(
    folders: Annotated[
        list[Path] | None,
        typer.Argument(help="Search these too, with all folders below.", show_default=False),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Make the list again from the journals, which are the truth.

    For a list that is damaged, or run folders that were moved. No journal is changed.
    """
    for folder in folders or ():
        if not folder.is_dir():
            raise UsageError(f"{folder} is no folder; give one that holds prints")
    kept = PrintHistory()
    count = kept.rebuild(folders or ())
    if as_json:
        print_json({"prints": count, "index": str(kept.path)})
        return
    print_lines(f"{count} prints in {kept.path}")


def _when(seconds: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(seconds)) if seconds else ""


def _plain(entry: PrintEntry) -> dict[str, Any]:
    return asdict(entry) | {"journal": str(entry.journal)}


def _running(entry: PrintEntry) -> PrintEntry:
    """Tell a print that is going on from one whose link process died."""
    latest = entry.journal.name == JOURNAL and entry.state == INTERRUPTED
    if latest and entry.journal.exists() and alive(entry.journal.parent):
        return replace(entry, state="running")
    return entry


def _lines(entry: PrintEntry) -> list[str]:
    known = f"{entry.done} of {entry.total} lines"
    head = f"{_when(entry.started)}  {entry.state:<16} {entry.file}  {known}  {entry.profile}"
    told = [f"    {entry.message}"] if entry.message and entry.state != "done" else []
    return [f"{head}  {entry.who}", *told, *(f"    ! {alarm.text}" for alarm in entry.alarms)]


def _write_csv(entries: list[PrintEntry]) -> None:
    names = [field.name for field in fields(PrintEntry)]
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow(names)
    for entry in entries:
        row = _plain(entry) | {"started": _when(entry.started), "ended": _when(entry.ended)}
        row["alarms"] = "; ".join(alarm.text for alarm in entry.alarms)
        writer.writerow([row[name] for name in names])
