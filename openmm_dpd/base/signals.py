"""SIGINT and SIGTERM (from a batch system, for example): steps are completed or not done, and a run ends without losing results.

Python runs a handler before any next line, also in functions that OpenMM calls.  OpenMM turns an exception raised there into an error
without a text, or an internal one of Python.  So a signal that comes within a step is noted, and acts between two steps.
"""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

try:  # the functions of signal without its enumerations, which import ten times as slowly
    import _signal as handlers  # type: ignore[import-not-found]
except ImportError:
    handlers = signal


class Signals(threading.local):
    """Turns a signal into a KeyboardInterrupt: at once, or within :meth:`later` at a :meth:`check`; ``seen`` are the signals received.
    Signals go to the main thread; other threads never see one."""

    def __init__(self) -> None:
        self.seen: list[int] = []
        self._patient = False

    @contextmanager
    def caught(self) -> Iterator[None]:
        """Handle signals within the block (in the main thread only)."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {number: handlers.signal(number, self.take) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                handlers.signal(number, handler)

    def take(self, number: int, frame: object) -> None:
        """Handler of a signal: note it, and raise KeyboardInterrupt unless it has to wait."""
        self.seen.append(number)
        if len(self.seen) > 1:  # a second signal does not wait; a third goes to Python
            handlers.signal(number, signal.default_int_handler)
        if not self._patient or len(self.seen) > 1:
            raise KeyboardInterrupt

    @contextmanager
    def later(self) -> Iterator[None]:
        """A block in which the first signal waits for :meth:`check`."""
        before, self._patient = self._patient, True
        try:
            yield
        finally:
            self._patient = before

    def end(self) -> None:
        """Ignore a first signal from now on, as all work is done."""
        self._patient = True

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal was received."""
        if self.seen:
            raise KeyboardInterrupt

    @property
    def name(self) -> str:
        """Name of the first signal received; ``SIGINT`` if it was not caught here."""
        return signal.Signals(self.status - 128).name

    @property
    def status(self) -> int:
        """Exit status for the first signal received."""
        return 128 + (self.seen[0] if self.seen else int(signal.SIGINT))


#: Ctrl-C during steps of a script.
CTRL_C = Signals()


@contextmanager
def unbroken() -> Iterator[None]:
    """A block in which Ctrl-C waits for ``CTRL_C.check()``, and always leaves it as a KeyboardInterrupt, even if OpenMM turned it into
    another error.  Only Python's own handler is replaced, not those of decks and others."""
    ours = handlers.getsignal(signal.SIGINT) in (signal.default_int_handler, CTRL_C.take)
    if not ours or threading.current_thread() is not threading.main_thread():
        yield
        return
    try:
        handlers.signal(signal.SIGINT, CTRL_C.take)
        with CTRL_C.later():  # of this thread, since another one may fork a process
            yield
    finally:
        handlers.signal(signal.SIGINT, signal.default_int_handler)
        seen, CTRL_C.seen = CTRL_C.seen, []
        if seen:
            raise KeyboardInterrupt from None
