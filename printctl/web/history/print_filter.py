"""Print history filter: parse it from a URL query, write it back, convert it to an index query."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from urllib.parse import urlencode

from printctl.errors import UsageError
from printctl.history.table import day_begins, day_ends
from printctl.machine.link.history_query import PAGE, HistoryQuery, SortBy
from printctl.web.api.answers import API

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
