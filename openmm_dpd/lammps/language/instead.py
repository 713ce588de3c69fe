"""What a deck can say instead of something that is not supported: by command, or by command and style."""

import json
from importlib.resources import files

_ROWS = json.loads((files("openmm_dpd") / "data" / "deck_words.json").read_text(encoding="utf-8"))

#: What the refusal says behind a colon.
INSTEAD: dict[str, str] = {name: row["write"] for row in _ROWS for name in row["instead of"]}
