"""`printctl history`: list, filter and export past prints; rebuild the list from journals."""

from __future__ import annotations

import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from printctl.cli.history_options import (
    LimitOption,
    ProfileOption,
    ReverseFlag,
    SearchOption,
    SinceOption,
    SortOption,
    StateOption,
    UntilOption,
    WhoOption,
    query_of,
)
from printctl.cli.history_records import bundle, key, repeat, show, verify
from printctl.cli.options import JsonFlag, messages, print_json, print_lines
from printctl.errors import UsageError
from printctl.history.table import csv_lines, local_time
from printctl.machine.link.find_link import alive
from printctl.machine.link.history import PrintHistory
from printctl.machine.link.history_entry import INTERRUPTED, PrintEntry
from printctl.machine.link.history_query import HistoryQuery, SortBy
from printctl.machine.link.record import JOURNAL

history = typer.Typer(
    help="Past prints: list and search, show one, file its record, print it again.",
    invoke_without_command=True,
    rich_markup_mode="markdown",
)
history.command("show")(show)
history.command("bundle")(bundle)
history.command("verify")(verify)
history.command("key")(key)
history.command("repeat")(repeat)


@history.callback()
def overview(
    context: typer.Context,
    search: SearchOption = "",
    as_csv: Annotated[bool, typer.Option("--csv", help="Every column as CSV.")] = False,
    as_json: JsonFlag = False,
) -> None:
    """List past prints, the latest first; `list --help` has more ways to narrow."""
    if context.invoked_subcommand is None:
        _show(query_of(search), as_csv, as_json)


@history.command("list")
def list_prints(
    search: SearchOption = "",
    state: StateOption = None,
    profile: ProfileOption = "",
    who: WhoOption = "",
    since: SinceOption = "",
    until: UntilOption = "",
    sort: SortOption = SortBy.STARTED,
    reverse: ReverseFlag = False,
    limit: LimitOption = None,
    as_csv: Annotated[bool, typer.Option("--csv", help="Every column as CSV.")] = False,
    as_json: JsonFlag = False,
) -> None:
    """List past prints that fit.

    Example: `printctl history list --state killed --state failed --since 2026-11-01`
    """
    _show(
        query_of(search, state, profile, who, since, until, sort, reverse, limit), as_csv, as_json
    )


@history.command("csv")
def as_table(
    search: SearchOption = "",
    state: StateOption = None,
    profile: ProfileOption = "",
    who: WhoOption = "",
    since: SinceOption = "",
    until: UntilOption = "",
) -> None:
    """Write every column as CSV to stdout, safe to open in a spreadsheet.

    Example: `printctl history csv --since 2026-11-01 > november.csv`
    """
    _show(query_of(search, state, profile, who, since, until), as_csv=True, as_json=False)


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


def _show(query: HistoryQuery, as_csv: bool, as_json: bool) -> None:
    matches = PrintHistory().find(query)
    entries = [_running(entry) for entry in matches.entries]
    if as_json:
        print_json({"prints": [_plain(entry) for entry in entries], "total": matches.total})
    elif as_csv:
        sys.stdout.writelines(csv_lines(entries))
    else:
        for entry in entries:
            print_lines(*_lines(entry))
        if not entries:
            narrowed = query != HistoryQuery()
            messages().print("no print is known" + (" that fits" if narrowed else ""))


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
    when = local_time(entry.started)
    head = f"{when}  {entry.state:<16} {entry.file}  {known}  {entry.profile}  {entry.by}"
    message = [f"    {entry.message}"] if entry.message and entry.state != "done" else []
    return [f"{head}  [{entry.id}]", *message, *(f"    ! {alarm.text}" for alarm in entry.alarms)]
