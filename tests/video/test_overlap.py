"""Reading ahead and writing behind: order, limits, errors, and that threads end."""

import threading
import time

import pytest

from re3.video.overlap import DEPTH, ReadAhead, WriteBehind


def wait_for(condition):
    until = time.monotonic() + 5
    while not condition():
        assert time.monotonic() < until, "waited in vain"
        time.sleep(0.002)


def helpers():
    return [t for t in threading.enumerate() if t.name in ("read ahead", "write behind")]


@pytest.fixture(autouse=True)
def no_thread_stays():
    yield
    assert not helpers()


def test_items_come_in_order_and_only_so_many_ahead():
    fetched = []

    def items():
        for number in range(20):
            fetched.append(number)
            yield number

    with ReadAhead(items()) as ahead:
        # One more than wait: it is held by the thread.
        wait_for(lambda: len(fetched) == DEPTH + 1)
        time.sleep(0.02)
        assert len(fetched) == DEPTH + 1
        assert list(ahead) == list(range(20))


def test_an_error_of_the_items_comes_after_those_before_it():
    def items():
        yield 1
        raise ZeroDivisionError("broken")

    seen = []
    with pytest.raises(ZeroDivisionError, match="broken"), ReadAhead(items()) as ahead:
        seen.extend(ahead)
    with pytest.raises(ZeroDivisionError, match="broken"), ReadAhead(items()) as ahead:
        for item in ahead:
            seen.append(item)
    assert seen[-1] == 1


def test_leaving_early_ends_the_thread():
    closed = []

    def endless():
        try:
            while True:
                yield 1
        finally:
            closed.append(True)

    items = endless()
    with ReadAhead(items) as ahead:
        assert next(iter(ahead)) == 1
    assert not helpers()
    items.close()  # would raise if the thread were still within
    assert closed == [True]


def test_everything_is_written_in_order_also_after_an_error_of_the_caller():
    written = []

    def slowly(item):
        time.sleep(0.005)
        written.append(item)

    with pytest.raises(KeyboardInterrupt), WriteBehind(slowly) as behind:
        for number in range(10):
            behind.put(number)
        raise KeyboardInterrupt
    assert written == list(range(10))


def test_the_caller_waits_when_writing_falls_behind():
    gate = threading.Event()
    written = []

    def write(item):
        gate.wait(5)
        written.append(item)

    put = []

    def caller():
        with WriteBehind(write) as behind:
            for number in range(3 * DEPTH):
                behind.put(number)
                put.append(number)

    thread = threading.Thread(target=caller)
    thread.start()
    wait_for(lambda: len(put) == DEPTH + 1)
    time.sleep(0.02)
    assert len(put) == DEPTH + 1
    gate.set()
    thread.join(5)
    assert written == list(range(3 * DEPTH))


def test_an_error_of_writing_reaches_the_caller():
    def write(item):
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"), WriteBehind(write) as behind:
        for number in range(100):
            behind.put(number)
            time.sleep(0.001)
    with pytest.raises(OSError, match="disk full"), WriteBehind(write) as behind:
        behind.put(1)
