"""The event loop of a node, and the threads around it."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from functools import partial
from itertools import pairwise

import pytest

from sim.errors import RosError
from sim.ros1.transport.event_loop import EventLoop, in_thread
from tests.sim.ros1.processes import until


@pytest.fixture
def loop() -> Iterator[EventLoop]:
    loop = EventLoop("test")
    yield loop
    loop.close()


def test_calls_of_any_thread_run_in_one(loop: EventLoop) -> None:
    found: list[tuple[int, bool]] = []

    def call(number: int) -> None:
        loop.call(lambda: found.append((number, loop.is_current)))

    threads = [threading.Thread(target=call, args=(number,)) for number in range(20)]
    for thread in threads:
        thread.start()
    until(lambda: len(found) == 20)
    assert sorted(found) == [(number, True) for number in range(20)]
    assert not loop.is_current


def test_calls_are_made_in_order_and_a_failed_one_loses_no_other(
    loop: EventLoop, caplog: pytest.LogCaptureFixture
) -> None:
    found: list[int] = []
    for number in range(100):
        loop.call(found.append, number)
        if number == 50:
            loop.call(fail, ZeroDivisionError("of a call"))
    assert loop.run(asyncio.sleep(0.0, "later")) == "later"
    assert found == list(range(100))
    assert loop.counts.faults == 1
    assert "of a call" in caplog.text


def test_no_call_of_another_thread_comes_between_those_made_together(loop: EventLoop) -> None:
    found: list[str] = []
    ended = threading.Event()

    def disturb() -> None:
        while not ended.wait(0.0):
            loop.call(found.append, "other")

    thread = threading.Thread(target=disturb)
    thread.start()
    for _ in range(50):
        with loop.together():
            loop.call(found.append, "left")
            ended.wait(1e-4)
            loop.call(found.append, "right")
    ended.set()
    thread.join()
    loop.run(asyncio.sleep(0.0))
    assert found.count("left") == 50
    assert all(after == "right" for each, after in pairwise(found) if each == "left")


def test_nothing_is_waited_for_where_nothing_was_called_or_the_loop_is_closed(
    loop: EventLoop,
) -> None:
    with loop.together():
        pass
    loop.close()
    with loop.together():
        loop.call(fail, ZeroDivisionError("of a call that is not made"))
    assert loop.counts.faults == 0


def test_results_and_errors_of_a_coroutine_reach_the_caller(loop: EventLoop) -> None:
    async def divide(a: float, b: float) -> float:
        await asyncio.sleep(0.0)
        return a / b

    assert loop.run(divide(6.0, 3.0)) == 2.0
    with pytest.raises(ZeroDivisionError):
        loop.run(divide(1.0, 0.0))


def test_a_failed_background_task_is_counted_and_logged(
    loop: EventLoop, caplog: pytest.LogCaptureFixture
) -> None:
    async def fail() -> None:
        raise ZeroDivisionError("of a task")

    loop.call(lambda: loop.spawn(fail()))
    until(lambda: "of a task" in caplog.text)
    assert loop.counts.faults == 1
    assert loop.run(asyncio.sleep(0.0, "alive")) == "alive"


def test_a_caller_that_waits_for_a_closed_loop_gets_an_error(loop: EventLoop) -> None:
    reasons: list[str] = []

    def wait() -> None:
        try:
            loop.run(asyncio.sleep(1000.0))
        except RosError as error:
            reasons.append(str(error))

    thread = threading.Thread(target=wait)
    thread.start()
    until(lambda: loop.run(_number_of_tasks()) > 2)
    loop.close()
    thread.join(20.0)
    assert reasons == ["the test was closed meanwhile"]
    with pytest.raises(RosError, match="the test is closed"):
        loop.run(asyncio.sleep(0.0))
    loop.call(lambda: reasons.append("called"))
    loop.close()
    assert reasons == ["the test was closed meanwhile"]
    assert repr(loop) == "EventLoop(test, ended)"


async def _number_of_tasks() -> int:
    return len(asyncio.all_tasks())


def test_its_own_thread_cannot_wait_and_may_close(loop: EventLoop) -> None:
    reasons: list[str] = []

    def call() -> None:
        try:
            loop.run(asyncio.sleep(0.0))
        except RosError as error:
            reasons.append(str(error))
        loop.close()

    loop.call(call)
    until(lambda: "ended" in repr(loop))
    assert reasons == ["a callback cannot wait for an answer: call it in another thread"]


def test_a_thread_that_blocks_holds_up_neither_the_loop_nor_its_end(loop: EventLoop) -> None:
    released = threading.Event()

    async def block() -> None:
        await in_thread(released.wait, 20.0)

    loop.call(lambda: loop.spawn(block()))
    assert loop.run(asyncio.sleep(0.0, 7)) == 7
    loop.close()
    assert repr(loop) == "EventLoop(test, ended)"
    released.set()


def fail(error: BaseException) -> None:
    raise error


def test_results_and_errors_of_a_thread_are_awaited(
    loop: EventLoop, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert loop.run(in_thread(divmod, 7, 3)) == (2, 1)
    with pytest.raises(ZeroDivisionError):
        loop.run(in_thread(divmod, 7, 0))
    for error in (SystemExit(3), StopIteration(), KeyboardInterrupt()):
        with pytest.raises(RuntimeError, match=f"raised {type(error).__name__}"):
            loop.run(in_thread(partial(fail, error)))

    def refuse(_: threading.Thread) -> None:
        raise RuntimeError("can't create new thread at interpreter shutdown")

    monkeypatch.setattr(threading.Thread, "start", refuse)
    assert loop.run(in_thread(divmod, 7, 3)) == (2, 1)


def test_a_loop_that_cannot_start_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> asyncio.AbstractEventLoop:
        raise OSError(24, "Too many open files")

    monkeypatch.setattr(asyncio, "new_event_loop", fail)
    monkeypatch.setattr(asyncio.events, "new_event_loop", fail)
    with pytest.raises(RosError, match=r"cannot start the test: .*Too many open files"):
        EventLoop("test")


def test_an_error_of_asyncio_is_counted_and_logged_once(
    loop: EventLoop, caplog: pytest.LogCaptureFixture
) -> None:
    async def report() -> None:
        for _ in range(100):
            running = asyncio.get_running_loop()
            running.call_exception_handler({"message": "socket.accept() out of system resource"})

    loop.run(report())
    assert loop.counts.faults == 100
    assert len(caplog.messages) == 1
