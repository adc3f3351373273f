"""Every module can be imported where Python has only what Windows gives it.

A stand-in, not Windows: it shows what is used while modules are imported, and that alone.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from printctl.machine.process.socket_server import listen, open_address
from printctl.processes.alive import KILL, is_alive, send_signal
from sim.devices.serving.port import open_port
from sim.devices.serving.serve import ServeError

ROOT = Path(__file__).parents[2]
PACKAGES = ("kernels", "firmware_profiles", "design", "sim", "registration", "printctl")

STAND_IN = r"""
import importlib, importlib.abc, os, pkgutil, select, signal, socket, sys, time
from importlib import import_module

PACKAGES = "kernels firmware_profiles design sim registration printctl".split()
MODULES = "fcntl grp nis posix pty pwd readline resource spwd syslog termios tty".split()
# Of `os` in Python 3.11: what its documentation marks "Availability: Unix".
OS = '''chown chroot confstr ctermid eventfd fchdir fchmod fchown fdatasync fork forkpty fpathconf
fstatvfs getegid geteuid getgid getgroups getloadavg getpgid getpgrp getpriority getresuid getsid
getuid getxattr initgroups killpg lchown lockf major makedev memfd_create minor mkfifo mknod nice
openpty pathconf pidfd_open pipe2 posix_fallocate posix_spawn pread pwrite readv register_at_fork
sched_getaffinity sched_setaffinity sched_yield sendfile set_blocking get_blocking setegid seteuid
setgid setpgid setpriority setregid setsid setuid splice statvfs sync sysconf tcgetpgrp tcsetpgrp
ttyname uname wait wait3 wait4 waitid writev WNOHANG O_CLOEXEC O_DIRECTORY O_NOCTTY O_NOFOLLOW
O_NONBLOCK O_SYNC RTLD_NOW PRIO_PROCESS'''.split()
LACKS = {
    os: OS,
    select: "poll epoll kqueue devpoll".split(),
    signal: '''SIGKILL SIGHUP SIGUSR1 SIGUSR2 SIGALRM SIGCHLD SIGCONT SIGPIPE SIGQUIT SIGSTOP
SIGTSTP alarm pause setitimer pthread_kill pthread_sigmask sigwait siginterrupt'''.split(),
    socket: "AF_UNIX SO_REUSEPORT MSG_DONTWAIT MSG_NOSIGNAL SCM_RIGHTS sethostname".split(),
    time: "clock_gettime clock_settime CLOCK_MONOTONIC CLOCK_BOOTTIME tzset".split(),
}


def ours(name):
    return name.partition(".")[0] in PACKAGES


def walk():
    for package in PACKAGES:
        yield package
        path = import_module(package).__path__
        yield from (found.name for found in pkgutil.walk_packages(path, package + "."))


class NotOnWindows(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name in MODULES:
            raise ModuleNotFoundError(f"{name} is POSIX's alone", name=name)


def fails(name):
    try:
        import_module(name)
    except BaseException as exc:
        return repr(exc)


# Those of others are imported as they are here; it is ours that are tried. Some are for a Python
# that has more packages: where they fail here, it must be for the same reason.
names = [*walk(), *sys.argv[1:]]
here = {name: fails(name) for name in names if ours(name)}
for name in [*filter(ours, sys.modules), *MODULES]:
    sys.modules.pop(name, None)
for module, absent in LACKS.items():
    for name in absent:
        if hasattr(module, name):
            delattr(module, name)
sys.platform = "win32"
sys.meta_path.insert(0, NotOnWindows())
for name in names:
    why = fails(name)
    if why != here.get(name):
        print(name, why)
print(len(names), "tried")
"""


def run_stand_in(*more: str, **environment: str) -> list[str]:
    """Lines that the child writes: modules that fail with the reason, then how many were tried."""
    command = [sys.executable, "-W", "ignore", "-c", STAND_IN, *more]
    done = subprocess.run(
        command, capture_output=True, text=True, check=True, env={**os.environ, **environment}
    )
    return done.stdout.splitlines()


def test_every_module_can_be_imported_with_what_windows_has(tmp_path):
    (tmp_path / "bad_fcntl.py").write_text("import fcntl\n")
    (tmp_path / "bad_signal.py").write_text("import signal\nsignal.SIGKILL\n")
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    *failed, tried = run_stand_in("bad_fcntl", "bad_signal", PYTHONPATH=path)
    assert [line.split()[0] for line in failed] == ["bad_fcntl", "bad_signal"], failed
    files = [one for package in PACKAGES for one in (ROOT / package).rglob("*.py")]
    assert tried == f"{len(files) + 2} tried"


def test_where_there_are_no_pseudo_terminals_the_simulated_printer_says_what_to_do(monkeypatch):
    monkeypatch.delattr(os, "openpty")
    with pytest.raises(ServeError, match="no pseudo-terminals; use --tcp 0"):
        open_port(None, None)
    port = open_port(None, 0)
    assert port.address.startswith("socket://127.0.0.1:")
    port.close()


def test_where_there_are_no_unix_sockets_clients_come_by_tcp_and_show_a_token(
    monkeypatch, tmp_path
):
    monkeypatch.delattr(socket, "AF_UNIX")
    listener, address, token = listen(tmp_path)
    with listener:
        client = open_address(address)
        assert client is not None
        client.close()
    assert address.startswith("tcp:127.0.0.1:")
    assert token
    assert open_address("unix:/tmp/of_another_machine.sock") is None


def test_a_process_is_seen_to_live_until_it_is_ended():
    assert is_alive(os.getpid())
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        assert is_alive(process.pid)
        send_signal(process.pid, KILL)
        process.wait()
    assert not is_alive(process.pid)
