"""The history page: list of prints, filter, check of a record's file."""

from __future__ import annotations

import contextlib
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Final
from urllib.parse import urlencode

from fastapi import Request
from nicegui import ui

from printctl.errors import UsageError
from printctl.history.table import day_begins, day_ends, local_time
from printctl.history.verify import BundleCheck
from printctl.machine.link.history_entry import PrintEntry
from printctl.machine.link.history_query import PAGE, HistoryPage, HistoryQuery, SortBy
from printctl.web.api import API
from printctl.web.history.layout import STYLE, card, cell, download, duration, head, state_words
from printctl.web.history.one_print import show_print
from printctl.web.history.service import HistoryService
from printctl.web.shell.frame import frame, run_or_notify, upload

# Print history filter: parse it from a URL query, write it back, convert it to an index query.

_LONGEST = 200


@dataclass(frozen=True)
class PrintFilter:
    """What stands in the form."""

    words: str = ""
    state: str = ""
    profile: str = ""
    who: str = ""
    since: str = ""
    until: str = ""
    sort: str = SortBy.STARTED.value
    descending: bool = True

    @classmethod
    def asked(cls, address: Mapping[str, str]) -> tuple[PrintFilter, int]:
        """Read an address's words, and which page of the list, the first being 0.

        What makes no sense in it is left out.
        """
        names = [field.name for field in fields(cls) if field.name not in ("sort", "descending")]
        given = {name: address[name][:_LONGEST] for name in names if name in address}
        for name, read in (("since", day_begins), ("until", day_ends)):
            try:
                read(given.get(name, ""), name)
            except UsageError:
                given.pop(name)
        with contextlib.suppress(KeyError, ValueError):
            given["sort"] = SortBy(address["sort"]).value
        page = address.get("page", "1")
        at = int(page) - 1 if page.isascii() and page.isdigit() and len(page) < 9 else 0
        return cls(**given, descending=address.get("descending") != "False"), max(at, 0)

    def query(self, page: int) -> HistoryQuery:
        """As it is asked.

        Raises
        ------
        UsageError
            For what is no day.
        """
        return HistoryQuery(
            words=self.words,
            states=(self.state,) if self.state else (),
            profile=self.profile,
            who=self.who,
            since=day_begins(self.since, "from"),
            until=day_ends(self.until, "to"),
            sort=SortBy(self.sort),
            descending=self.descending,
            limit=PAGE,
            offset=PAGE * page,
        )

    def address(self, page: int) -> str:
        """Of the page that shows it."""
        values = self._said() | ({"page": str(page + 1)} if page else {})
        return f"/history?{urlencode(values)}" if values else "/history"

    def csv(self) -> str:
        """Of the same as CSV."""
        return f"{API}/history/csv?{urlencode(self._said())}"

    def _said(self) -> dict[str, str]:
        usual = vars(PrintFilter())
        return {name: str(value) for name, value in vars(self).items() if value != usual[name]}


# Draw the History page's table of prints, with search form, filters, order and page buttons.

COLUMNS: Final = ("Begun", "File", "End", "Lines", "Took", "Profile", "Operator", "Port", "SHA-256")
ORDERS: Final = {
    SortBy.STARTED: "Begun",
    SortBy.ENDED: "Ended",
    SortBy.FILE: "File",
    SortBy.PROFILE: "Profile",
    SortBy.WHO: "Operator",
    SortBy.STATE: "End",
}
_WAIT: Final = "debounce=300"


class Listing:
    """The list with its form, for one browser.

    Parameters
    ----------
    service : HistoryService
    address : mapping of str to str
        What the page's address asks for; it follows the form, so that a list can be shared.
    """

    def __init__(self, service: HistoryService, address: Mapping[str, str]) -> None:
        self._service, self._filter, self._page = service, *PrintFilter.asked(address)

    async def show(self) -> None:
        """Build it."""
        ui.add_css(STYLE)
        choices = await run_or_notify(self._service.choices)
        if choices is None:
            return
        with ui.element("section").classes("ph-card").props('aria-label="Search"'):
            self._form(choices.profiles, choices.people, choices.states)
        with ui.element("section").classes("ph-card").props('aria-label="Prints"'):
            with ui.element("div").classes("ph-row").style("justify-content:space-between"):
                self._count = ui.label().props("role=status")
                self._csv = download("Export as CSV", self._filter.csv())
            self._table = ui.element("table").classes("ph-table ph-list")
            with ui.element("nav").classes("ph-row").props('aria-label="Pages of the list"'):
                self._back = self._turner("Earlier page", -1)
                self._place = ui.label()
                self._on = self._turner("Next page", 1)
        await self._find()

    def _form(self, profiles: list[str], people: list[str], states: list[str]) -> None:
        print_filter = self._filter
        with ui.element("div").classes("ph-row"):
            words = ui.input(
                "Search: words, hash, alarm",
                value=print_filter.words,
                on_change=self._set_filter("words"),
            )
            words.props(f"{_WAIT} clearable type=search").style("flex:1 1 16em")
            self._select("End", "state", {one: state_words(one) for one in states})
            self._select("Profile", "profile", {one: one for one in profiles})
            self._select("Operator", "who", {one: one for one in people})
            for name, field in (("From day", "since"), ("To day", "until")):
                day = ui.input(
                    name, value=getattr(print_filter, field), on_change=self._set_filter(field)
                )
                day.props("type=date stack-label")
                day.style("flex:0 1 11em")
            self._select("Order", "sort", {k.value: v for k, v in ORDERS.items()}, every=False)
            last = ui.checkbox(
                "last first",
                value=print_filter.descending,
                on_change=self._set_filter("descending"),
            )
            last.style("min-height:44px")

    def _select(self, name: str, field: str, options: dict[str, str], every: bool = True) -> None:
        value = getattr(self._filter, field)
        named = {value: value} if value else {}
        first = {"": "all"} if every else {}
        made = ui.select({**first, **named, **options}, label=name, value=value)
        made.on_value_change(self._set_filter(field))
        made.style("flex:0 1 11em")

    def _turner(self, words: str, by: int) -> ui.button:
        async def turn() -> None:
            self._page = max(0, self._page + by)
            await self._find()

        made = ui.button(words, on_click=turn).props("outline no-caps")
        return made.style("min-height:44px")

    def _set_filter(self, field: str) -> Any:
        async def changed(event: Any) -> None:
            value: Any = event.value if event.value is not None else ""
            changes: dict[str, Any] = {field: value}
            self._filter, self._page = replace(self._filter, **changes), 0
            await self._find()

        return changed

    async def _find(self) -> None:
        try:
            query = self._filter.query(self._page)
        except UsageError:  # a day that is half typed
            return
        prints = await run_or_notify(self._service.find, query)
        if prints is not None and self._page > 0 and not prints.entries:  # an address of old
            self._page = max(0, -(-prints.total // PAGE) - 1)
            await self._find()
        elif prints is not None:
            self._fill(prints)
            ui.navigate.history.replace(self._filter.address(self._page))

    def _fill(self, prints: HistoryPage) -> None:
        many = "print" if prints.total == 1 else "prints"
        self._count.set_text(f"{prints.total} {many}" if prints.total else "No print fits.")
        self._csv.props["href"] = self._filter.csv()
        self._csv.update()
        pages = max(1, -(-prints.total // PAGE))
        self._place.set_text(f"page {self._page + 1} of {pages}")
        self._back.set_enabled(self._page > 0)
        self._on.set_enabled(self._page + 1 < pages)
        self._table.clear()
        with self._table:
            head(COLUMNS)
            with ui.element("tbody"):
                for entry in prints.entries:
                    _row(entry)


def _row(entry: PrintEntry) -> None:
    with ui.element("tr"):
        cell(local_time(entry.started), "Begun", "ph-number")
        with ui.element("td"):
            ui.link(entry.file or "(no name)", f"/history/{entry.id}")
        with ui.element("td"):
            ui.label(state_words(entry.state)).classes("" if entry.state == "done" else "ph-bad")
            if entry.alarms:
                many = len(entry.alarms)
                ui.label(f"{many} alarm{'s' if many > 1 else ''}").classes("ph-quiet")
        cell(f"{entry.done} of {entry.total}", "Lines", "ph-number")
        took = duration(entry.ended - entry.started) if entry.ended else ""
        cell(took, "Took", "ph-number")
        cell(entry.profile, "Profile")
        cell(entry.by, "Operator")
        cell(entry.port, "Port")
        cell(entry.sha256[:12], "SHA-256", "ph-hash")


# Verify card of the History page: check an uploaded bundle's contents and signature.

_MOST_SHOWN: Final = 50


def verify_card(service: HistoryService) -> None:
    """The card with its upload and what it finds."""
    with card("Verify a bundle"):
        ui.label(
            "Is a bundle as it was filed, and who signed it? Without another key, this lab's own "
            "is the one that is trusted."
        )
        key = ui.textarea("Public key to trust (PEM); empty for this lab's own")
        key.props("rows=2 maxlength=2000").style("width:100%")

        async def uploaded(event: Any) -> None:
            path = service.incoming(secrets.token_hex(8))
            try:
                await event.file.save(path)
                check = await run_or_notify(service.verify_file, path, (key.value or "").encode())
            finally:
                path.unlink(missing_ok=True)
            column.clear()
            chosen.reset()
            if check is not None:
                with column:
                    _tell(check, event.file.name)

        chosen = upload("Choose a bundle (zip)", uploaded, ".zip", max_files=1)
        chosen.classes("ph-upload")
        column = ui.element("div").props("role=status")


def _tell(check: BundleCheck, name: str) -> None:
    ui.label(name).classes("ph-name ph-bad")
    for line in check.lines()[: _MOST_SHOWN + 2]:
        ui.label(line).style("white-space:pre-wrap;overflow-wrap:anywhere")
    if check.whole and check.manifest is not None:
        told_print = check.manifest.print
        ui.label(f"{told_print.file}, {told_print.state}, print {told_print.id}")


WAY = "/history"


def register(service: HistoryService) -> None:
    """Define the pages.

    Parameters
    ----------
    service : HistoryService
    """

    @ui.page(WAY)
    async def listing(request: Request) -> None:
        with frame(WAY):
            await Listing(service, request.query_params).show()
            verify_card(service)

    @ui.page(f"{WAY}/{{print_id}}")
    async def one(print_id: str) -> None:
        with frame(WAY):
            ui.link("← All prints", WAY).classes("pc-way")
            shown = await run_or_notify(service.one, print_id)
            if shown is None:
                ui.label("There is no such print in the history.")
                return
            show_print(service, shown)
