"""Reader of the recorded transcripts."""

import ast
import re
from dataclasses import dataclass, field
from pathlib import Path

DATA = Path(__file__).parent / "data" / "marlin"

_SENT = re.compile(r">> (b['\"].*)")
_REPLY = re.compile(r"<<\s+([\d.]+) ms (b['\"].*)")
_PING = re.compile(r"(N\d+) -> (\[.*\])")


@dataclass
class Row:
    """What was sent at one moment, and all that came before the next was."""

    title: str
    sent: bytes
    replies: list[tuple[float, bytes]] = field(default_factory=list)

    @property
    def expected(self) -> bytes:
        return b"".join(data for _, data in self.replies)

    @property
    def last_s(self) -> float:
        return self.replies[-1][0] * 1e-3 if self.replies else 0.0


def rows_of(name: str) -> list[Row]:
    """Rows of a transcript; notes of the recorder become rows that send nothing."""
    rows: list[Row] = []
    title = ""
    for text in (DATA / name).read_text(encoding="ascii").splitlines():
        if sent := _SENT.fullmatch(text):
            rows.append(Row(title, ast.literal_eval(sent[1])))
            title = ""
        elif reply := _REPLY.fullmatch(text):
            if title:
                rows.append(Row(title, b""))
                title = ""
            rows[-1].replies.append((float(reply[1]), ast.literal_eval(reply[2])))
        elif ping := _PING.fullmatch(text):
            answers = [(0.0, answer) for answer in ast.literal_eval(ping[2])]
            rows.append(Row(f"{title} {ping[1]}".strip(), b"", answers))
        elif text.startswith("## "):
            title = text[3:]
        elif text.startswith("==="):
            rows.append(Row(text, b""))
    return rows
