"""Function calls in a second process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from printctl.second_process import SecondProcess


def where() -> int:
    """The process that works."""
    return os.getpid()


def test_a_call_is_made_in_another_process_and_raises_what_it_raises():
    with SecondProcess() as second:
        there, missing = second.call(__name__, "where"), second.call("json", "loads", "{")
        again = second.call(__name__, "where")
        assert there.result() == again.result() != os.getpid()
        with pytest.raises(ValueError, match="Expecting property name"):
            missing.result()


@pytest.mark.skipif(os.name == "nt", reason="no signals")
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_it_ends_with_the_first_and_lets_go_of_the_output(how: signal.Signals) -> None:
    code = (
        "import os\n"
        "from printctl.second_process import SecondProcess\n"
        "with SecondProcess() as second:\n"
        "    print(second.call('os', 'getpid').result(), flush=True)\n"
        "    second.call('time', 'sleep', 600).result()\n"
    )
    first = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    assert first.stdout is not None
    assert int(first.stdout.readline()) != first.pid
    first.send_signal(how)
    first.communicate(timeout=60)  # until no process holds the pipe
    assert first.returncode == -how
