"""What a run of a deck says: on the screen, and all of it in a file."""

from collections.abc import Callable
from pathlib import Path

from ...file_ledger import ledger_in_use
from ...files import BlockFile

#: Name of the file.
NAME = "log.txt"


class RunLog:
    """Takes lines: rows of thermo output, remarks, what ``print`` prints.

    Parameters
    ----------
    show : callable
        Takes them as well.
    folder : Path, optional
        Where ``log.txt`` is written, unbuffered; nowhere by default.
    append : bool
        Go on with the file that is there.

    Raises
    ------
    OutputError
        If the file cannot be written, here and from calls.
    """

    def __init__(self, show: Callable[[str], None], folder: Path | None, append: bool = False):
        self.show = show
        self._file = None if folder is None else BlockFile(folder / NAME, "the log", append)

    def __call__(self, text: str) -> None:
        """Add a line; nothing of what was said already, before a run that is resumed."""
        ledger = ledger_in_use()
        if ledger is not None and ledger.replaying:
            return
        if self._file is not None:
            self._file.write(text + "\n")
        self.show(text)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
