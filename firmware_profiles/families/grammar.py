"""Record type of a firmware family's G-code syntax: known commands, their letters, E rule."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Final, Literal, get_args

TEXT: Final = "text"
"""Of a code whose rest is a text or a file's name."""
ERule = Literal["with_axes", "alone", "either"]
E_RULES: Final[tuple[ERule, ...]] = get_args(ERule)


class Meaning(Enum):
    """What a command with a name does, as far as a job's checks go."""

    PLACES = auto()
    """Tells where the tip stands (``X=``, ``Y=``, ``Z=``), as G92 does."""
    SHIFTS = auto()
    """Shifts every place that is named after it."""
    CHOOSES = auto()
    """Chooses a head (``EXTRUDER=``), as T does."""
    HEATS = auto()
    """Sets the target (``TARGET=``) of a heater (``HEATER=``), °C."""
    AWAITS = auto()
    """Waits until a heater (``SENSOR=``) is at least ``MINIMUM=``, at most ``MAXIMUM=``, °C."""
    OTHER = auto()
    """Moves nothing, and heats nothing."""


@dataclass(frozen=True, kw_only=True)
class Grammar:
    """What a family makes of a line.

    Attributes
    ----------
    codes : frozenset of str
        Commands that it knows by letter and number; T with any number is known to all.
    head_codes : frozenset of str
        Those that it knows beyond them where it was built for several heads.
    names : mapping of str to Meaning
        Commands with names that it knows. A name means the same in every family.
    words : mapping of str to str
        Letters that a code knows, separated by blanks: one needs a number; with ``?`` it may stand
        alone. `TEXT` where the rest is a text. A code that isn't here takes any word.
    whole : frozenset of str
        Codes whose numbers it cuts to whole ones.
    named : bool
        Whether it reads commands with a name and ``KEY=value``.
    lower_case : bool
        Whether it takes commands in small letters.
    quoted_words : bool
        Whether a letter may be followed by a text in quotes.
    crc16 : bool
        Whether a checksum of five digits is a CRC-16; else every checksum is an XOR.
    powers_of_ten : bool
        Whether it reads 1E-5 as a number.
    rest_codes : frozenset of str or None
        Codes whose text, without quotes, takes the rest of the line, where a line may hold several
        commands; None where it never does.
    expressions : bool
        Whether it works out what stands in braces, and reads on behind them.
    parentheses : bool
        Whether a text in parentheses is taken for a comment, which isn't sent.
    e_rule : str
        What makes E relative. ``with_axes``: the last of G90, G91, M82 and M83. ``alone``: M82 and
        M83, whatever G90 and G91 said. ``either``: G91 as well as M83, until each is taken back.
    """

    codes: frozenset[str]
    head_codes: frozenset[str] = frozenset()
    names: Mapping[str, Meaning] = field(default_factory=dict)
    words: Mapping[str, str] = field(default_factory=dict)
    whole: frozenset[str] = frozenset()
    named: bool = False
    lower_case: bool = True
    quoted_words: bool = False
    crc16: bool = False
    powers_of_ten: bool = False
    rest_codes: frozenset[str] | None = None
    expressions: bool = False
    parentheses: bool = True
    e_rule: ERule = "with_axes"


def codes(letter: str, *numbers: int | range) -> frozenset[str]:
    """Name commands: ``codes("G", 0, to(17, 21))``."""
    named: list[int] = []
    for number in numbers:
        named += [number] if isinstance(number, int) else number
    return frozenset(f"{letter}{number}" for number in named)


def number_range(first: int, last: int) -> range:
    """Return the numbers from ``first`` to ``last``, both included."""
    return range(first, last + 1)


# See `firmware_profiles.families.grammar.Grammar.words` for how they are written.
MOVE: Final = "X Y Z E F"
ARC: Final = "X Y Z E F I J R"
# M2-style ends, files and texts: the rest of the line isn't words.
TEXT_CODES: Final = frozenset(
    {"M0", "M1", "M16", "M23", "M28", "M30", "M32", "M36", "M75", "M98", "M117", "M118", "M928"}
)
TEXTS: Final = dict.fromkeys(TEXT_CODES, TEXT)
COMMON: Final[dict[str, str]] = {
    **TEXTS,
    "G0": MOVE,
    "G1": MOVE,
    "G2": ARC,
    "G3": ARC,
    "G4": "P S",
    "G17": "",
    "G20": "",
    "G21": "",
    "G28": "X? Y? Z?",
    "G90": "",
    "G91": "",
    "G92": "X Y Z E",
    "M17": "X? Y? Z? E?",
    "M18": "S X? Y? Z? E?",
    "M82": "",
    "M83": "",
    "M84": "S X? Y? Z? E?",
    "M85": "S",
    "M92": "X Y Z E T",
    "M104": "S T",
    "M105": "T",
    "M106": "P S",
    "M107": "P",
    "M108": "",
    "M109": "S R T",
    "M110": "N",
    "M112": "",
    "M114": "D? E? R?",
    "M115": "",
    "M119": "",
    "M140": "S",
    "M141": "S",
    "M190": "S R",
    "M201": "X Y Z E T",
    "M203": "X Y Z E T",
    "M204": "S P R T",
    "M220": "S",
    "M221": "S T",
    "M302": "S P?",
    "M400": "",
    "M410": "",
    "M999": "S",
}
