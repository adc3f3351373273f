"""Findings of `printctl doctor`, and its exit code."""

import os
import socket
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from printctl.cli import doctor as places
from printctl.cli.doctor import extras, permission_findings, udev_rule
from printctl.cli.main import app
from printctl.machine.link.ports import PortInfo

USB = PortInfo("/dev/ttyACM0", "Marlin", "2a03:0042", "x")


def doctor(*words: str):
    return CliRunner().invoke(app, ["doctor", *words])


def nobody_may(device: str) -> bool:
    return False


def test_a_machine_that_can_run_the_tests_is_fit():
    done = doctor()
    assert done.exit_code == 0, done.output
    assert "OpenGL               not needed" in done.output
    assert sys.executable in done.output


def test_a_data_folder_that_cannot_be_written_blocks(monkeypatch):
    monkeypatch.setattr("printctl.cli.doctor.is_writable", lambda folder: False)
    done = doctor()
    assert done.exit_code == 1
    assert "BLOCKS: no file can be written in" in done.output
    assert "PRINTCTL_DATA" in done.output


def test_a_full_disk_blocks_and_a_nearly_full_one_is_told():
    (full,) = places.disk_findings("here", Path("/x"), 0.1)
    (low,) = places.disk_findings("here", Path("/x"), 3.0)
    assert full.blocks
    assert not low.blocks
    assert "0.10 GB left" in full.text
    assert places.disk_findings("here", Path("/x"), 300.0) == []


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() == 0, reason="root writes anywhere")
def test_a_folder_without_rights_is_not_writable(tmp_path: Path):
    tmp_path.chmod(0o500)
    assert not places.is_writable(tmp_path)


def test_a_taken_port_is_seen():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        assert not places.is_port_free(port)
    assert places.is_port_free(port)


def test_a_port_that_may_not_be_opened_comes_with_group_and_udev_rule(monkeypatch):
    monkeypatch.setattr("sys.platform", "linux")
    (found,) = permission_findings([USB], lambda device: "dialout", nobody_may)
    assert "sudo usermod -aG dialout $USER" in found.text
    assert 'ATTRS{idVendor}=="2a03", ATTRS{idProduct}=="0042"' in found.text
    assert "ID_MM_DEVICE_IGNORE" in udev_rule(USB.usb_id)
    assert not found.blocks


def test_a_missing_extra_comes_with_its_command(monkeypatch):
    wanted = ["numpy>=2", 'h5py>=3 ; extra == "scans"', "no-such-thing>=1; extra == 'scans'"]
    monkeypatch.setattr("printctl.cli.doctor.metadata.requires", lambda name: wanted)
    assert extras() == {"scans": "missing no-such-thing; pip install 'printctl[scans]'"}


def test_an_extra_that_cannot_be_imported_is_reported(monkeypatch):
    monkeypatch.setattr("printctl.cli.doctor.metadata.requires", lambda name: ["a; extra == 'b'"])
    monkeypatch.setattr("printctl.cli.doctor.metadata.version", lambda name: "1")
    monkeypatch.setattr("printctl.cli.doctor._COMPILED", {"a"})
    assert extras() == {"b": "can't import a; pip install 'printctl[b]' --force-reinstall"}


def test_two_homes_of_our_packages_block(monkeypatch):
    monkeypatch.setattr("printctl.cli.doctor.OURS", ("design", "json"))
    done = doctor()
    assert done.exit_code == 1
    assert "come from 2 places" in done.output


def test_kernels_that_are_not_compiled_are_told(monkeypatch, tmp_path: Path):
    monkeypatch.setattr("printctl.cli.doctor.cache_dir", lambda: tmp_path / "none")
    done = doctor()
    assert done.exit_code == 0
    assert "printctl doctor --warm" in done.output
