"""``python -m openmm_dpd``: the command line."""

import sys

from .cli import main

sys.exit(main())
