# SPDX-License-Identifier: BSD-3-Clause
# Promise(python/periodic-task-python): A periodic task in Python lies on a grid, whatever it took before, and what
#   passes meanwhile is counted; a timer's exception is told; what answers on a link and is no plant is told.
import contextlib
import signal
import socket
import threading
import time

import pytest

import libapc as apc


def test_a_periodic_task_does_not_drift():
    ticks = []
    for tick in apc.every(0.002):
        ticks.append(tick)
        time.sleep(0.001)
        if len(ticks) == 50:
            break
    start = ticks[0].scheduled - 2_000_000 * ticks[0].k
    assert all(t.scheduled == start + 2_000_000 * t.k for t in ticks)
    assert all(t.started >= t.scheduled and t.late >= 0 for t in ticks)
    assert [t.k for t in ticks] == sorted({t.k for t in ticks})
    assert ticks[-1].k == 49 + sum(t.missed for t in ticks)


def test_what_passes_meanwhile_is_counted_once():
    ticks = apc.every(0.001)
    next(ticks)
    time.sleep(0.05)
    assert next(ticks).missed >= 49


def test_a_loop_is_interrupted():
    def nothing(*_):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGUSR1, nothing)
    main = threading.main_thread().ident
    ticks = apc.every(3600)
    next(ticks)
    kill = threading.Timer(0.05, lambda: signal.pthread_kill(main, signal.SIGUSR1))
    kill.start()
    with pytest.raises(KeyboardInterrupt):
        next(ticks)
    kill.join()
    signal.signal(signal.SIGUSR1, before)


def test_a_timer_has_a_thread_of_its_own():
    called, enough = [], threading.Event()

    def call(what, how):
        called.append((what, how, threading.current_thread()))
        if len(called) == 5:
            enough.set()

    timer = apc.Timer(0.001, call, ("a",), {"how": "b"})
    timer.start()
    assert enough.wait(60)
    timer.cancel()
    timer.join(60)
    assert called[0][:2] == ("a", "b") and called[0][2] is not threading.current_thread()
    n = len(called)
    assert not timer._thread.is_alive() and len(called) == n


def test_what_a_timer_raises_is_told():
    timer = apc.Timer(0.001, lambda: 1 / 0)
    timer.start()
    with pytest.raises(ZeroDivisionError):
        timer.join(60)


def test_periods_have_limits():
    for period in (0, -1, float("nan"), 1e-9, 1e12):
        with pytest.raises(ValueError):
            apc.every(period)
        with pytest.raises(ValueError):
            apc.Timer(period, print)


def serve(listener, answer):
    connection, _ = listener.accept()
    with contextlib.suppress(OSError), connection, connection.makefile("rb") as lines:
        for line in lines:
            connection.sendall(answer(line))


@pytest.fixture
def plant():
    """plant(answer) listens, and answers each line by answer(line). Returns its URI."""
    listener = socket.create_server(("127.0.0.1", 0))

    def at(answer):
        threading.Thread(target=serve, args=(listener, answer), daemon=True).start()
        return f"tcp:127.0.0.1:{listener.getsockname()[1]}"

    yield at
    listener.close()


def test_a_plant_is_commanded(plant):
    def answer(line):
        head, *samples = line.decode().split(";")
        value = float(samples[0].split(",")[2]) if "command" in head else 0.25
        return f"apc1 values {head.split()[2]} 2;2026-01-31T12:00:00.5Z,Good,{value};"\
               f"2026-01-31T12:00:00.500000Z,Bad,-1;\n".replace(".5Z", ".500000Z").encode()

    with apc.Link(plant(answer), timeout=30) as link:
        y = link.command([1.5])
        assert y[0].value == 1.5 and y[0].status.good and y[1].status.bad and y[0].datetime.microsecond == 500000
        assert link.query()[0].value == 0.25
        for wrong in ([float("nan")], ["x"], [[1.0]]):
            with pytest.raises(ValueError):
                link.command(wrong)
    with pytest.raises(apc.StateError):
        link.query()


def test_what_is_no_plant_is_told(plant):
    with apc.Link(plant(lambda line: b"HTTP/1.1 400 Bad Request\n"), timeout=30) as link:
        with pytest.raises(apc.Error, match="no plant"):
            link.query()


def test_nobody_there():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with apc.Link(f"tcp:127.0.0.1:{port}", timeout=0.2) as link, pytest.raises(apc.Error):
        link.query()
    with pytest.raises(ValueError):
        apc.Link("udp:here:1")


def test_a_frame_as_it_is(plant):
    with apc.Link(plant(lambda line: line.upper()), timeout=30) as link:
        assert link.exchange(b"any line\n") == b"ANY LINE\n"
