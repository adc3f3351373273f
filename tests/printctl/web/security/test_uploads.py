"""File uploads: size-limited, checked, confined to their folder."""

import io
import threading
from pathlib import Path

import pytest

from printctl.web.errors import BadRequestError, ConflictError
from printctl.web.security.file_types import kind_of
from printctl.web.security.uploads import (
    TooLargeUploadError,
    UploadLimits,
    save_upload,
)

LIMITS = UploadLimits(1000, frozenset({"text"}), (".gcode",))


def test_a_file_is_there_whole_under_its_name(tmp_path: Path) -> None:
    place = save_upload(io.BytesIO(b"G1 X1\n"), tmp_path / "jobs", "a.gcode", LIMITS)
    assert place.read_bytes() == b"G1 X1\n"
    assert [p.name for p in place.parent.iterdir()] == ["a.gcode"]


@pytest.mark.parametrize(
    "name",
    ["../a.gcode", "/etc/a.gcode", "a/b.gcode", "..\\a.gcode", ".a.gcode", "a\n.gcode", "C:a.gcode",
     "<script>.gcode", "a..gcode", "", "x" * 70 + ".gcode"],
)  # fmt: skip
def test_a_name_that_could_lead_elsewhere_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(BadRequestError, match="can't be used"):
        save_upload(io.BytesIO(b"G1\n"), tmp_path / "jobs", name, LIMITS)
    assert not list(tmp_path.rglob("*.gcode"))


def test_what_is_too_large_leaves_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(TooLargeUploadError, match=r"larger than 0\.001 MB") as told:
        save_upload((b"G1 X1\n" for _ in range(1000)), tmp_path, "a.gcode", LIMITS)
    assert told.value.status == 413
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("content", [b"\x89PNG\r\n\x1a\n123", b"MZ\x90\x00\x03", b"", b"a\x00b"])
def test_another_content_than_the_name_says_is_refused(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(BadRequestError):
        save_upload(io.BytesIO(content), tmp_path, "a.gcode", LIMITS)
    assert not list(tmp_path.iterdir())


def test_another_suffix_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadRequestError, match="must end with"):
        save_upload(io.BytesIO(b"G1\n"), tmp_path, "a.sh", LIMITS)


def test_a_file_that_is_there_stays_unless_it_may_be_replaced(tmp_path: Path) -> None:
    save_upload(io.BytesIO(b"first\n"), tmp_path, "a.gcode", LIMITS)
    with pytest.raises(ConflictError):
        save_upload(io.BytesIO(b"second\n"), tmp_path, "a.gcode", LIMITS)
    assert (tmp_path / "a.gcode").read_bytes() == b"first\n"
    save_upload(io.BytesIO(b"second\n"), tmp_path, "a.gcode", UploadLimits(100, replace=True))
    assert (tmp_path / "a.gcode").read_bytes() == b"second\n"


def test_of_two_at_once_one_is_refused(tmp_path: Path) -> None:
    first_began, second_done = threading.Event(), threading.Event()

    def slow() -> "list[bytes]":
        first_began.set()
        second_done.wait(10)
        return [b"first\n"]

    def first() -> None:
        with pytest.raises(ConflictError):
            save_upload((p for _ in (1,) for p in slow()), tmp_path, "a.gcode", LIMITS)

    thread = threading.Thread(target=first)
    thread.start()
    first_began.wait(10)
    save_upload(io.BytesIO(b"second\n"), tmp_path, "a.gcode", LIMITS)
    second_done.set()
    thread.join(10)
    assert (tmp_path / "a.gcode").read_bytes() == b"second\n"


def test_text_with_a_character_cut_at_the_end_of_the_head_is_text() -> None:
    assert kind_of(("x" * 511 + "µ").encode()[:512]) == "text"
    assert kind_of(b"\xff\xfe\x00") == "other"
