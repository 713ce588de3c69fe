"""Hashes of short trajectories: every kind of pair term under every scheme, to see that a change of the code moves no bit.

Scenes are those of ``tests/kinds.py``: pair kinds, bonds, walls, charges, overlays.  Each runs twenty steps on the Reference and CPU
platforms, in loops of whole steps and one by one, with the conservative force in the kernel and as OpenMM's, and gives one line: its name and
a hash of positions, velocities, fields and one sample.  Where OpenMM computes forces, and of samples, hashes depend on the machine, so
compare two states of the code on one machine:

    python docs/measure/same_bits.py --write /tmp/before      (some minutes)
    python docs/measure/same_bits.py --compare /tmp/before
"""

from __future__ import annotations

import argparse
import hashlib
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))

from kinds import KINDS, WORDS, everything, made, running, schemes_of  # noqa: E402

import openmm_dpd as dpd  # noqa: E402

STEPS = 20

#: What is hashed of a sample.
MEASURED = (
    *("kinetic", "kinetic_on_step", "potential", "total", "bond", "angle", "other", "momentum", "forces", "gradient2", "laplacian"),
    *("virial_conservative", "virial_dissipative", "virial_random", "internal", "conductive", "theta", "kinetic_pressure"),
)


def cases(platforms: list[str]) -> Iterator[tuple[str, str, str, dict]]:
    """Kind, scheme, platform and choices."""
    for platform in platforms:
        for kind in KINDS:
            for scheme in (*schemes_of(kind, WORDS[:1]), "native"):
                for choices in ({"loop": True}, {"loop": False}, {"conservative": "openmm"}):
                    if scheme != "native" or "conservative" in choices:
                        yield kind, scheme, platform, choices


def bits(kind: str, scheme: str, platform: str, choices: dict) -> str:
    """Hash of a run, or the reason why there is none."""
    try:
        built = made(kind, scheme, platform, **choices)
        simulation = running(built, platform)
        simulation.step(STEPS)
        found = everything(simulation.context, built)
        sample = dpd.Observer(built).sample(simulation.context)
    except dpd.DPDError as error:
        return f"{type(error).__name__}: {error}".replace("\n", " ")
    digest = hashlib.sha256()
    for name in sorted(found):
        digest.update(found[name].tobytes())
    for name in MEASURED:
        value = getattr(sample, name)
        digest.update(b"-" if value is None else np.asarray(value, dtype=float).tobytes())
    return digest.hexdigest()[:16]


def main() -> int:
    """Write or compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    action = parser.add_mutually_exclusive_group(required=True)
    action.add_argument("--write", type=Path, metavar="FILE")
    action.add_argument("--compare", type=Path, metavar="FILE")
    parser.add_argument("--platform", choices=("Reference", "CPU"), help="one of the two only")
    options = parser.parse_args()
    known: dict[str, str] = {}
    if options.compare:
        known = dict(line.split("\t") for line in options.compare.read_text().splitlines())
    lines, other = [], 0
    for kind, scheme, platform, choices in cases([options.platform] if options.platform else ["Reference", "CPU"]):
        name = "; ".join([kind, scheme, platform, *(f"{key}={value}" for key, value in choices.items())])
        found = bits(kind, scheme, platform, choices)
        lines.append(f"{name}\t{found}\n")
        if options.compare and known.get(name) != found:
            other += 1
            print(f"{name}: {known.get(name, 'not there before')} -> {found}")
    if options.write:
        options.write.write_text("".join(lines))
    print(f"{len(lines)} runs" + (f", {other} differ" if options.compare else ""))
    return other > 0


if __name__ == "__main__":
    sys.exit(main())
