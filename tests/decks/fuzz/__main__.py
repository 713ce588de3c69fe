"""``python tests/decks/fuzz --seeds 1000:3000 [--area setup] [--keep DIR]``: random decks by hand."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[k]) for k in (1, 2)]

from fuzz.command_line import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main())
