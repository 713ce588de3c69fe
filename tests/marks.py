"""Parameters that tests of many files have."""

import pytest
from scenes import BOXES

BOX = pytest.mark.parametrize("box", BOXES.values(), ids=BOXES.keys())

_NAMED = {name: {"scheme": name} for name in ("shardlow", "middle", "aboba", "bababo")}
SCHEMES = {"mvv": {"scheme": "mvv"}, "mvv-0.65": {"scheme": "mvv", "lam": 0.65}, **_NAMED}
SCHEME = pytest.mark.parametrize("choices", SCHEMES.values(), ids=SCHEMES.keys())
