"""SIGINT and SIGTERM (from a batch system, for example): a run ends without losing results."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


class Signals:
    """Makes a KeyboardInterrupt of a signal: at once, or within :meth:`later` where the run says.

    Attributes
    ----------
    seen : list of int
        Signals that have come.
    """

    def __init__(self) -> None:
        self.seen: list[int] = []
        self._patient = False

    @contextmanager
    def caught(self) -> Iterator[None]:
        """Take the signals over (they go to the main thread; nothing happens in others)."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {number: signal.signal(number, self._take) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _take(self, number: int, frame: object) -> None:
        self.seen.append(number)
        # whoever asks twice does not want to wait
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
        """Exit status that tells of it."""
        return 128 + (self.seen[0] if self.seen else int(signal.SIGINT))
