"""What the command line says of failures."""

import errno

from printctl.cli.failures import disk_message


def test_full_disk_is_named_with_the_remedy() -> None:
    text = disk_message(OSError(errno.ENOSPC, "No space left on device", "/runs/a/scan.tif"))
    assert "disk is full" in text
    assert "/runs/a/scan.tif" in text
    assert "free some space" in text
