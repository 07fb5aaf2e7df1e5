"""The thread in which a node or a master does all its network traffic: one asyncio event loop."""

from __future__ import annotations

import asyncio
import concurrent.futures
import logging
import sys
import threading
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, TypeVar

from baxter_kin.display import OneLine
from baxter_kin.fields import NotCopied, evolve, frozen
from sim.errors import RosError

CLOSING_S = 2.0
"""Time that the thread is given to close all connections."""

TOGETHER_S = 0.005
"""Maximum time that a thread waits until its calls are made."""

SWITCH_S = 0.0005
"""Time after which a thread that computes makes way for others, such as an event loop's."""

REPEAT_S = 10.0
"""Time before the same error of asyncio is logged again."""

_LOG = logging.getLogger(__name__)

T = TypeVar("T")


@frozen(error=RosError, eq=True)
class Counts:
    """How often something happened on the network since a node or master started.

    Attributes:
        malformed: peers that were disconnected because of what they sent, or did not send in time.
        refused: connections refused for a reason that the peer was given, such as another md5 sum.
        dropped: messages that were replaced by newer ones before a slow subscriber took them.
        reconnects: connections to publishers that were restored after they broke.
        registrations: how often everything was registered again at a master that had forgotten it.
        faults: errors in callbacks and handlers; each is in the log.
    """

    malformed: int = 0
    refused: int = 0
    dropped: int = 0
    reconnects: int = 0
    registrations: int = 0
    faults: int = 0


class EventLoop(NotCopied, OneLine):
    """An asyncio event loop in a thread of its own.

    `call`, `run` and `close` are for other threads; the rest is for coroutines of this loop.
    """

    def __init__(self, name: str) -> None:
        """Start the thread.

        Args:
            name: of the thread, for the log.

        Raises:
            RosError: when the system has no file descriptors left.
        """
        self._name = name
        self._counts = Counts()
        self._lock = threading.RLock()  # of _is_closing and _calls; signal handlers may call
        self._is_closing = False
        self._tasks: set[asyncio.Task[None]] = set()
        self._calls: list[Callable[[], object]] = []
        self._silent_until_s: dict[str, float] = {}
        started: concurrent.futures.Future[None] = concurrent.futures.Future()
        self._thread = threading.Thread(target=self._run, args=(started,), name=name, daemon=True)
        self._thread.start()
        try:
            started.result()
        except OSError as cause:
            raise RosError(f"cannot start the {name}: {cause}") from cause

    @property
    def is_current(self) -> bool:
        """Whether the caller runs in this loop."""
        return threading.get_ident() == self._thread.ident

    @property
    def counts(self) -> Counts:
        """What was counted so far."""
        return self._counts

    def count(self, name: str) -> None:
        """Count one more of a field of `Counts`."""
        increased: dict[str, int] = {name: getattr(self._counts, name) + 1}
        self._counts = evolve(self._counts, **increased)

    def call(self, function: Callable[..., object], *args: object) -> None:
        """Call a function soon; nothing happens when the loop is closed.

        Calls in quick succession wake the loop once.
        """
        with self._lock:
            if not self._is_closing:
                self._calls.append(partial(function, *args))
                if len(self._calls) == 1:
                    self._loop.call_soon_threadsafe(self._make_calls)

    @contextmanager
    def together(self) -> Iterator[None]:
        """Make all calls of the block right after each other, and wait until they are made.

        The interpreter lets one thread run at a time, so a caller that went on computing would get
        between two messages as the first one is sent. It waits for `TOGETHER_S` at most.
        """
        made = threading.Event()
        with self._lock:
            yield
            is_called = bool(self._calls) and not self.is_current
            if is_called:
                self.call(made.set)
        if is_called:
            made.wait(TOGETHER_S)

    def run(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine in the loop, and wait for its result.

        Raises:
            RosError: when the loop is closed, or the caller runs in it.
        """
        with self._lock:
            if self._is_closing or self.is_current:
                coroutine.close()
                raise RosError(
                    "a callback cannot wait for an answer: call it in another thread"
                    if self.is_current
                    else f"the {self._name} is closed"
                )
            future = asyncio.run_coroutine_threadsafe(coroutine, self._loop)
        try:
            return future.result()
        except concurrent.futures.CancelledError:
            raise RosError(f"the {self._name} was closed meanwhile") from None
        except BaseException:
            future.cancel()  # of no effect, unless the caller was interrupted
            raise

    def spawn(self, coroutine: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        """Run a coroutine in the background; its errors are counted and logged."""
        task = asyncio.create_task(coroutine)
        self._tasks.add(task)
        task.add_done_callback(self._finish)
        return task

    def close(self) -> None:
        """Cancel what is running and end the thread; closing twice is harmless."""
        with self._lock:
            if not self._is_closing:
                self._is_closing = True
                self._loop.call_soon_threadsafe(self._stopping.set)
        if not self.is_current:
            self._thread.join(CLOSING_S)

    def _run(self, started: concurrent.futures.Future[None]) -> None:
        main = self._main(started)
        try:
            asyncio.run(main)
        except OSError as error:
            main.close()
            started.set_exception(error)

    async def _main(self, started: concurrent.futures.Future[None]) -> None:
        self._loop = asyncio.get_running_loop()
        self._loop.set_exception_handler(self._report)
        self._stopping = asyncio.Event()
        started.set_result(None)
        await self._stopping.wait()

    def _make_calls(self) -> None:
        with self._lock:
            calls, self._calls = self._calls, []
        for call in calls:
            self._make_call(call)

    def _make_call(self, call: Callable[[], object]) -> None:
        try:
            call()
        except Exception as error:  # the calls that follow must not be lost
            message = f"{self._name}: a call failed"
            self._loop.call_exception_handler({"message": message, "exception": error})

    def _report(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Count an error of asyncio itself, and log it unless it was logged just before.

        Without file descriptors, asyncio reports a hundred times a second that it cannot accept a
        connection.
        """
        self.count("faults")
        message = context["message"]
        if loop.time() >= self._silent_until_s.get(message, 0.0):
            self._silent_until_s[message] = loop.time() + REPEAT_S
            loop.default_exception_handler(context)

    def _finish(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            self.count("faults")
            _LOG.error("%s: %s", self._name, error, exc_info=error)

    def _facts(self) -> tuple[str, ...]:
        return self._name, "running" if self._thread.is_alive() else "ended"


@contextmanager
def quick_switches() -> Iterator[None]:
    """Inside the block, threads that compute make way for others after `SWITCH_S`.

    Python's default is 5 ms, half a tick, each time that an event loop has waited for a peer.
    """
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(min(SWITCH_S, before_s))
    try:
        yield
    finally:
        sys.setswitchinterval(before_s)


async def in_thread(function: Callable[..., T], *args: object) -> T:
    """Run a function that may block in a daemon thread, and await its result.

    Unlike threads of an executor, the thread does not keep the interpreter from ending. Where no
    thread can be started, as at the end of the interpreter, the function blocks the loop instead.

    Raises:
        RuntimeError: when the function raises what a coroutine cannot, such as SystemExit.
    """
    name = getattr(function, "__name__", repr(function))
    loop = asyncio.get_running_loop()
    future: asyncio.Future[T] = loop.create_future()

    def deliver(method: Callable[[Any], None], value: object) -> None:
        if not future.done():
            method(value)

    def work() -> None:
        try:
            method, value = future.set_result, function(*args)
        except BaseException as error:
            if isinstance(error, StopIteration) or not isinstance(error, Exception):
                error = RuntimeError(f"{name} raised {error!r}")
            method, value = future.set_exception, error  # type: ignore[assignment]
        with suppress(RuntimeError):  # the loop is closed
            loop.call_soon_threadsafe(deliver, method, value)

    try:
        threading.Thread(target=work, name=name, daemon=True).start()
    except RuntimeError:
        return function(*args)
    return await future
