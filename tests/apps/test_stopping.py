import os
import signal
import threading

import pytest

from re3.apps.stopping import StopSignals


def send(number):
    os.kill(os.getpid(), number)


@pytest.mark.parametrize(
    ("number", "name", "exit_code"),
    [
        (signal.SIGINT, "Ctrl-C", 130),
        (signal.SIGTERM, "SIGTERM", 143),
        (signal.SIGHUP, "the closing of the terminal", 129),
    ],
)
def test_a_signal_asks_to_stop(number, name, exit_code):
    before = signal.getsignal(number)
    with StopSignals() as stop:
        assert not stop()
        send(number)
        assert stop()
        assert (stop.name, stop.exit_code) == (name, exit_code)
    assert signal.getsignal(number) is before


def test_sighup_is_left_alone_where_it_is_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with StopSignals() as stop:
            send(signal.SIGHUP)
            assert not stop()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_second_ctrl_c_interrupts_at_once():
    with StopSignals():
        send(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            send(signal.SIGINT)


def test_files_are_completed_in_peace():
    with StopSignals() as stop:
        send(signal.SIGINT)
        stop.finishing = True
        send(signal.SIGINT)
        send(signal.SIGINT)
        assert stop()


def test_it_does_nothing_outside_the_main_thread():
    seen = []

    def work():
        with StopSignals() as stop:
            seen.append(stop())

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [False]
