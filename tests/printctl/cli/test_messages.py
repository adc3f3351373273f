"""Command-line error messages."""

import errno

from printctl.system_errors import explain


def test_full_disk_is_named_with_the_remedy() -> None:
    text = explain(OSError(errno.ENOSPC, "No space left on device", "/runs/a/scan.tif")).message
    assert "disk is full" in text
    assert "/runs/a/scan.tif" in text
    assert "free some space" in text
