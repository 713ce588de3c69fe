"""SIGINT and SIGTERM (from a batch system, for example): steps are taken whole or not, and a run ends without losing results.

Python carries a handler out before any next line, in what OpenMM calls too.  Of an exception that is raised there OpenMM makes
an error without a text, or one of Python's own inside.  So a signal that comes in steps is noted, and acts between two of them.
"""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

try:  # the functions of signal without its enumerations, which take ten times as long
    import _signal as handlers  # type: ignore[import-not-found]
except ImportError:
    handlers = signal


class Signals(threading.local):
    """Makes a KeyboardInterrupt of a signal: at once, or within :meth:`later` where the run says; ``seen`` are the signals that have come.
    Signals go to the main thread; in others none is ever seen."""

    def __init__(self) -> None:
        self.seen: list[int] = []
        self._patient = False

    @contextmanager
    def caught(self) -> Iterator[None]:
        """Take the signals over (nothing happens in threads other than the main one)."""
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
        """The handler."""
        self.seen.append(number)
        if len(self.seen) > 1:  # whoever asks twice does not want to wait, and once more even less
            handlers.signal(number, signal.default_int_handler)
        if not self._patient or len(self.seen) > 1:
            raise KeyboardInterrupt

    @contextmanager
    def later(self) -> Iterator[None]:
        """Within, the first signal waits for :meth:`check`."""
        before, self._patient = self._patient, True
        try:
            yield
        finally:
            self._patient = before

    def end(self) -> None:
        """From now on the first signal changes nothing: all is done."""
        self._patient = True

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal has come."""
        if self.seen:
            raise KeyboardInterrupt

    @property
    def name(self) -> str:
        """Name of the first signal that came: ``SIGINT`` where it was not caught here."""
        return signal.Signals(self.status - 128).name

    @property
    def status(self) -> int:
        """Its exit status."""
        return 128 + (self.seen[0] if self.seen else int(signal.SIGINT))


#: Ctrl-C in steps that a script takes.
CTRL_C = Signals()


@contextmanager
def unbroken() -> Iterator[None]:
    """Within, Ctrl-C waits for ``CTRL_C.check()``, and comes out as a KeyboardInterrupt, even where OpenMM has made another error of it.
    Only Python's own handler is replaced: those of decks and of others act as they do."""
    ours = handlers.getsignal(signal.SIGINT) in (signal.default_int_handler, CTRL_C.take)
    if not ours or threading.current_thread() is not threading.main_thread():
        yield
        return
    try:
        handlers.signal(signal.SIGINT, CTRL_C.take)
        with CTRL_C.later():  # of this thread: another one may fork a process
            yield
    finally:
        handlers.signal(signal.SIGINT, signal.default_int_handler)
        seen, CTRL_C.seen = CTRL_C.seen, []
        if seen:
            raise KeyboardInterrupt from None
