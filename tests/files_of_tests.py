"""Files that tests begin with."""

from pathlib import Path


def put(path: Path, text: str) -> Path:
    """A file with this text."""
    path.write_text(text, encoding="utf-8")
    return path
