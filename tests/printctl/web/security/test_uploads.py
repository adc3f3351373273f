"""File uploads: size-limited, checked, confined to their folder."""

import asyncio
import io
import stat
import threading
import zipfile
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from printctl.web.errors import BadRequestError, ConflictError
from printctl.web.security.archives import ArchiveLimits, extract_archive
from printctl.web.security.kinds import kind_of
from printctl.web.security.uploads import (
    TooLargeUploadError,
    UploadLimits,
    save_stream,
    save_upload,
)

LIMITS = UploadLimits(1000, frozenset({"text"}), (".gcode",))


def test_a_file_is_there_whole_under_its_name(tmp_path: Path) -> None:
    place = save_upload(io.BytesIO(b"G1 X1\n"), tmp_path / "jobs", "a.gcode", LIMITS)
    assert place.read_bytes() == b"G1 X1\n"
    assert [p.name for p in place.parent.iterdir()] == ["a.gcode"]


def test_a_stream_is_written_as_it_comes(tmp_path: Path) -> None:
    async def pieces() -> AsyncIterator[bytes]:
        yield b"G1 X1\n"
        yield b"G1 X2\n"

    place = asyncio.run(save_stream(pieces(), tmp_path, "a.gcode", LIMITS))
    assert place.read_bytes() == b"G1 X1\nG1 X2\n"


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


def zipped(path: Path, **files: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def test_an_archive_is_unpacked_into_its_folder(tmp_path: Path) -> None:
    archive = zipped(tmp_path / "a.zip", **{"one.txt": b"1", "deep/two.txt": b"2"})
    files = extract_archive(archive, tmp_path / "out")
    assert sorted(p.relative_to(tmp_path / "out").as_posix() for p in files) == [
        "deep/two.txt",
        "one.txt",
    ]
    assert (tmp_path / "out" / "deep" / "two.txt").read_bytes() == b"2"


@pytest.mark.parametrize(
    "name",
    ["../out.txt", "/etc/passwd", "a/../../b", "C:\\x", "a\\b", ".hidden", "a/./.b", "a\x07"],
)
def test_an_archive_that_leads_elsewhere_is_refused(tmp_path: Path, name: str) -> None:
    archive = zipped(tmp_path / "a.zip", **{"good.txt": b"1", name: b"2"})
    with pytest.raises(BadRequestError, match="plain name"):
        extract_archive(archive, tmp_path / "in" / "out")
    assert not list((tmp_path / "in").iterdir())


def test_a_link_in_an_archive_is_refused(tmp_path: Path) -> None:
    entry = zipfile.ZipInfo("link")
    entry.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr(entry, "/etc/passwd")
    with pytest.raises(BadRequestError, match="link"):
        extract_archive(tmp_path / "a.zip", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_bomb_is_refused_before_it_fills_the_disk(tmp_path: Path) -> None:
    archive = zipped(tmp_path / "a.zip", zeros=bytes(30_000_000))
    with pytest.raises(BadRequestError, match="times its size"):
        extract_archive(archive, tmp_path / "out")
    with pytest.raises(BadRequestError, match="more than 1 MB"):
        extract_archive(archive, tmp_path / "out", ArchiveLimits(bytes=1_000_000))
    assert [p.name for p in tmp_path.iterdir()] == ["a.zip"]


def test_an_archive_that_lies_about_its_size_is_refused(tmp_path: Path) -> None:
    archive = zipped(tmp_path / "a.zip", zeros=bytes(3_000_000))
    content = archive.read_bytes().replace((3_000_000).to_bytes(4, "little"), bytes([9, 0, 0, 0]))
    archive.write_bytes(content)
    with pytest.raises(BadRequestError):
        extract_archive(archive, tmp_path / "out", ArchiveLimits(bytes=1_000_000))
    assert not (tmp_path / "out").exists()


def test_too_many_files_are_refused(tmp_path: Path) -> None:
    archive = zipped(tmp_path / "a.zip", **{f"f{n}": b"" for n in range(20)})
    with pytest.raises(BadRequestError, match="20 files"):
        extract_archive(archive, tmp_path / "out", ArchiveLimits(files=10))


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 broken", b"no zip at all"])
def test_a_broken_archive_is_refused_in_words(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.zip").write_bytes(content)
    with pytest.raises(BadRequestError, match="can't be unpacked"):
        extract_archive(tmp_path / "a.zip", tmp_path / "out")


def test_a_file_twice_in_an_archive_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("a.txt", "1")
        with pytest.warns(UserWarning, match="Duplicate"):
            archive.writestr("a.txt", "2")
    with pytest.raises(BadRequestError):
        extract_archive(tmp_path / "a.zip", tmp_path / "out")
