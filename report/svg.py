"""Embed figures in the page: sanitised, themed SVG with unique ids; PNG as data."""

from __future__ import annotations

import base64
import re
from typing import Final

from lxml import etree  # type: ignore[import-untyped]
from markupsafe import Markup

from report.errors import ReportError

INK: Final = "#1c2126"
MUTED: Final = "#5f6972"
RULE: Final = "#dcdfe2"
ACCENT: Final = "#1b5e9e"
PAPER: Final = "#fcfcfb"
BAD: Final = "#ad3517"
THEMED: Final = {
    INK: "var(--ink)",
    MUTED: "var(--muted)",
    RULE: "var(--rule)",
    ACCENT: "var(--accent)",
    PAPER: "var(--paper)",
    BAD: "var(--bad)",
}
"""Colours of a drawing that follow the page's light or dark theme."""

_NAMESPACE: Final = "{http://www.w3.org/2000/svg}"
_XLINK: Final = "{http://www.w3.org/1999/xlink}href"
_ALLOWED: Final = frozenset(
    ("svg", "g", "path", "rect", "circle", "ellipse", "line", "polyline", "polygon", "text",
     "tspan", "use", "defs", "style", "title", "desc", "clipPath", "linearGradient",
     "radialGradient", "stop", "image", "marker", "mask", "pattern", "symbol")
)  # fmt: skip
_PNG: Final = b"\x89PNG\r\n\x1a\n"


def inline_figure(picture: bytes, caption: str, prefix: str) -> Markup:
    """An SVG or PNG as HTML that needs no other file.

    Parameters
    ----------
    picture : bytes
        An SVG document or a PNG file.
    caption : str
        Read out in the picture's place; plain text.
    prefix : str
        Set before every id inside an SVG, so that two of a page don't clash.

    Raises
    ------
    ReportError
        When the bytes are neither.
    """
    if picture.startswith(_PNG):
        data = base64.b64encode(picture).decode("ascii")
        return Markup('<img src="data:image/png;base64,{}" alt="{}">').format(data, caption)
    return Markup(inline_svg(picture, caption, prefix))


def inline_svg(picture: bytes, caption: str, prefix: str) -> str:
    """An SVG document as an element of an HTML page.

    Only drawing elements stay; scripts, event handlers and references that leave the document
    are taken out.
    """
    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True)
    try:
        root = etree.fromstring(picture, parser)
    except etree.XMLSyntaxError as exc:
        raise ReportError(f"figure {caption!r} is neither PNG nor SVG ({exc})") from exc
    if root.tag != f"{_NAMESPACE}svg":
        raise ReportError(f"figure {caption!r} is neither PNG nor SVG (root is {root.tag})")
    _clean(root, prefix)
    _fit(root, caption)
    etree.cleanup_namespaces(root)
    text = str(etree.tostring(root, encoding="unicode", with_tail=False))
    return _themed(text.replace("xlink:href", "href"))


def _clean(element: etree._Element, prefix: str) -> None:
    for child in list(element):
        tag = child.tag if isinstance(child.tag, str) else ""
        if tag.removeprefix(_NAMESPACE) not in _ALLOWED:
            element.remove(child)
        else:
            _clean(child, prefix)
    for name, value in list(element.attrib.items()):
        if name.lower().startswith("on") or _leaves(name, value):
            del element.attrib[name]
        else:
            element.set(name, _renamed(name, value, prefix))


def _leaves(name: str, value: str) -> bool:
    if name in (_XLINK, "href"):
        return not value.startswith(("#", "data:image/png;base64,"))
    return bool(re.search(r"url\(\s*['\"]?(?!#)[^)]", value))


def _renamed(name: str, value: str, prefix: str) -> str:
    if name == "id":
        return prefix + value
    if name in (_XLINK, "href") and value.startswith("#"):
        return f"#{prefix}{value[1:]}"
    return re.sub(r"url\(#", f"url(#{prefix}", value)


def _fit(root: etree._Element, caption: str) -> None:
    """Let the page set the size, up to the drawing's own."""
    width = root.attrib.pop("width", "")
    root.attrib.pop("height", None)
    natural = width if re.fullmatch(r"[\d.]+(pt|px)?", width) else "100%"
    root.set("style", f"max-width:{natural}")
    root.set("role", "img")
    root.set("aria-label", caption)


def _themed(text: str) -> str:
    for colour, variable in THEMED.items():
        text = text.replace(colour, variable)
    # Matplotlib measures with its own font; the page sets its own in its place.
    return re.sub(r"'DejaVu Sans'[^;\"]*", "var(--sans)", text)
