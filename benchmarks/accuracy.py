"""Accuracy of every scheme against the time step: kinetic and configurational temperature and potential energy per bead.

The standard fluid: rho = 3, A = 25, kT = 1, cutoff 1, at gamma = 4.5 and 40.5.  Prints one table per gamma; every entry carries its
standard error from block averages.  Potential energy per bead tends to 4.543(2) as dt -> 0.  The atlas (benchmarks/atlas.py) has more
quantities, more fluids and the peers.

    python benchmarks/accuracy.py                 # about 12 minutes on one core
    python benchmarks/accuracy.py --time 30       # a quick look
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from atlas_parts import drivers  # noqa: E402
from atlas_parts.fluids import methods  # noqa: E402

#: Fluid of the atlas and step sizes, by friction.
STEPS = {4.5: ("weak", (0.02, 0.05, 0.08, 0.10)), 40.5: ("strong", (0.01, 0.03, 0.06))}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--beads", type=int, default=1500)
    parser.add_argument("--time", type=float, default=200.0, help="simulated time of each entry")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--gamma", type=float, nargs="*", choices=STEPS, default=list(STEPS))
    parser.add_argument("--json", help="write all numbers to this file")
    options = parser.parse_args()
    report = []
    with tempfile.TemporaryDirectory() as folder:
        for gamma in options.gamma:
            fluid, steps = STEPS[gamma]
            print(f"\ngamma = {gamma:g}, {options.beads} beads: kinetic kT, configurational kT, U/N, with standard errors")
            for method in (m for m in methods(fluid) if m.kind == "ours"):
                for dt in steps:
                    job = {
                        "fluid": fluid, "method": method.name, "dt": dt, "time": options.time, "discard": 0.1 * options.time, "beads": options.beads,
                        "seed": options.seed, "kT": 1.0, "equilibrate": 20.0,
                    }  # fmt: skip
                    result = drivers.run(job, Path(folder))
                    found = None if "failed" in result else {name: result[name] for name in ("T_kin", "T_conf", "U")}
                    report.append({"gamma": gamma, "scheme": method.scheme, "lambda": method.lam, "dt": dt, "result": found})
                    text = result.get("failed") or "  ".join(f"{key} {mean:.4f}({sem or 0:.4f})" for key, (mean, sem) in found.items())
                    print(f"{method.name:16s} dt {dt:<5g} {text}", flush=True)
    if options.json:
        Path(options.json).write_text(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
