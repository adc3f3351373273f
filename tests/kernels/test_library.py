"""Ctrl-C while numba makes machine code: held back, not lost."""

import signal

import pytest

from kernels.library import interrupt_held_back


def test_an_interrupt_counts_when_the_code_is_there() -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's job ignores it
    done = []
    with pytest.raises(KeyboardInterrupt), interrupt_held_back():
        signal.raise_signal(signal.SIGINT)
        done.append(True)
    signal.signal(signal.SIGINT, before)
    assert done


def test_without_an_interrupt_the_usual_handler_is_back() -> None:
    usual = signal.getsignal(signal.SIGINT)
    with interrupt_held_back():
        assert signal.getsignal(signal.SIGINT) is not usual
    assert signal.getsignal(signal.SIGINT) is usual
