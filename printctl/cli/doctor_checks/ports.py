"""Checks of `printctl doctor`: serial ports and their permissions."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from printctl.cli.doctor_checks.finding import Finding
from printctl.machine.link.ports import PortInfo

MayOpen = Callable[[str], bool]


def may_open(device: str) -> bool:
    """Whether this user may read and write the device; Windows says so only on opening it."""
    return sys.platform == "win32" or os.access(device, os.R_OK | os.W_OK)


def check_ports(ports: Sequence[PortInfo], may: MayOpen = may_open) -> dict[str, str]:
    """Each port with its USB id, and whether it may be opened."""
    return {
        port.device: ", ".join(
            [
                port.usb_id or "no USB id",
                "readable and writable" if may(port.device) else "no permission",
            ]
        )
        for port in ports
    }


def permission_findings(
    ports: Sequence[PortInfo], group_of: Callable[[str], str], may: MayOpen = may_open
) -> list[Finding]:
    """What to do about each port that may not be opened.

    Parameters
    ----------
    ports : sequence of PortInfo
    group_of : function
        Name of the group that a device belongs to.
    may : function
    """
    return [Finding(_remedy(port, group_of(port.device))) for port in ports if not may(port.device)]


def group_of(device: str) -> str:
    """Name of the device's group; the usual one where that can't be found out."""
    try:
        return Path(device).group()
    except (KeyError, NotImplementedError, OSError):
        return "dialout"


def udev_rule(usb_id: str) -> str:
    """A rule that lets whoever sits at the machine open a device of this USB id."""
    vendor, product = usb_id.split(":")
    return (
        f'SUBSYSTEM=="tty", ATTRS{{idVendor}}=="{vendor}", ATTRS{{idProduct}}=="{product}", '
        'TAG+="uaccess", ENV{ID_MM_DEVICE_IGNORE}="1"'
    )


def _remedy(port: PortInfo, group: str) -> str:
    text = f"you may not open {port.device}"
    if not sys.platform.startswith("linux"):
        return f"{text}; see to its rights"
    joined = f"`sudo usermod -aG {group} $USER`, then log out and in again"
    if group == "root" or not port.usb_id:
        joined = "`sudo usermod -aG dialout $USER` (on Arch uucp), then log out and in again"
    rule = ""
    if port.usb_id:
        rule = (
            "; or write this line into /etc/udev/rules.d/70-printctl.rules, plug the printer in "
            f"anew, and nothing else takes the port for a modem: {udev_rule(port.usb_id)}"
        )
    return f"{text}: {joined}{rule}"
