"""Printer that answers everything after an error with another error: the print ends."""

from __future__ import annotations

import pytest

from printctl.machine.link.states import LinkState
from tests.printctl.machine.link.fake_families import FakeDuet, FakeKlipper
from tests.printctl.machine.link.test_families import JOB, streamer_of

SAID = {"klipper": "!! Lost communication with MCU", "reprapfirmware": "Error: Driver 3 failed"}


def refusing(base, words: str):
    class Refusing(base):
        """It takes twenty lines of the job."""

        failed = False

        def take(self, line: bytes) -> str:
            self.failed |= JOB[20] in line
            return f"{words}\nok\n" if self.failed else super().take(line)

    return Refusing()


BASES = {"klipper": FakeKlipper, "reprapfirmware": FakeDuet}


@pytest.mark.parametrize("firmware", BASES)
def test_the_error_ends_the_print_by_its_own_words(firmware, tmp_path):
    status = streamer_of(firmware, refusing(BASES[firmware], SAID[firmware]), tmp_path).run()
    assert (status.state, status.position_known) == (LinkState.FAILED, False)
    assert SAID[firmware] in status.message
    assert status.message.index(SAID[firmware]) < status.message.index("no usable answer")
