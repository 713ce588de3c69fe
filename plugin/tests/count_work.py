"""What kernels ask of a GPU, without one: one line of JSON with instructions and sectors per bead of a diffused fluid.

python count_work.py SCHEME ...

Instructions are those of LLVM that Oclgrind (`oclgrind --inst-counts`) executes in all threads, in a step whose forces are known: so the number is
larger than that of a GPU's own instructions, and compares kernels with each other.  Sectors are 32 bytes of the positions in cells that a block
looks at, in the order in which blocks take beads, and in the order of their numbers.
"""

import json
import os
import re
import shutil
import subprocess
import sys

import numpy as np
import openmm

import openmm_dpd as dpd
from openmm_dpd.simulation import device_check

EDGE = 6.1  # a box of 6 x 6 x 6 cells
LANES, BLOCK = 4, 256


def diffused(edge: float, density: float = 3.0) -> np.ndarray:
    """Positions of a fluid at rest, whose numbers say nothing of places."""
    n = int(density * edge**3)
    side = int(np.ceil(n ** (1 / 3)))
    rng = np.random.default_rng(1)
    x = np.stack(np.meshgrid(*[np.arange(side)] * 3), -1).reshape(-1, 3)[rng.permutation(side**3)[:n]] + rng.normal(0, 0.3, (n, 3))
    return x * (edge / side) % edge


def run(scheme: str) -> None:
    """One step in the simulator, after one that finds out how much room there has to be."""
    device_check.MOST = 0
    x = diffused(EDGE)
    scene = dpd.Scene({"W": 1}, ["W"] * len(x), x, {("W", "W"): dpd.DPD(A=25, gamma=4.5)}, kT=1, box=[EDGE] * 3)
    built = dpd.build(scene, dt=0.01, scheme=scheme, platform="OpenCL", seed=1, engine="device")
    simulation = built.simulation(properties={"Precision": "single"})
    openmm.CustomIntegrator.step(built.integrator, 2)
    simulation.context.getState(velocities=True)


def instructions(scheme: str) -> float:
    """Of one step, for each bead."""
    command = [shutil.which("oclgrind") or "oclgrind", "--num-threads", "1", "--inst-counts", sys.executable, __file__, "--run", scheme]
    environment = os.environ | {"OPENMM_DPD_DEVICE_LANES": str(LANES)}
    text = subprocess.run(command, env=environment, capture_output=True, text=True, check=True, timeout=300).stdout
    kernels = re.findall(r"Instructions executed for kernel '(dpd\w+)':\n((?: +\d+ - .*\n)+)", text)
    counts = [(name, sum(map(int, re.findall(r"^ +(\d+) - ", body, re.M)))) for name, body in kernels]
    last = max(k for k, (name, _) in enumerate(counts) if name == ("dpdKick" if scheme == "mvv" else "dpdFinish"))
    first = max(k for k, (name, _) in enumerate(counts[:last]) if name == ("dpdMove" if scheme == "mvv" else "dpdKick"))
    return sum(count for _, count in counts[first : last + 1]) / len(diffused(EDGE))


def sectors(edge: float = 20.5, width: int = 2) -> dict[str, float]:
    """Two places of a cell are a sector.  A block takes cells in columns of two by two (Storage.h), or as many beads in the order of their numbers."""
    x = diffused(edge)
    n = int(edge / 1.0001)
    cell = (x / edge * n).astype(int)
    number = (cell[:, 2] * n + cell[:, 1]) * n + cell[:, 0]
    needed = (np.bincount(number, minlength=n**3) + 1) // 2
    columns = [(z, y) for z in range(0, n, width) for y in range(0, n, width)]
    walk = [
        ((z + k // 2) * n + y + k % 2) * n + a for z, y in columns for a in range(n) for k in range(4) if z + k // 2 < n and y + k % 2 < n
    ]
    share = int(0.9 * BLOCK / LANES * n**3 / len(x))
    around = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), -1).reshape(-1, 3)

    def touched(cells: np.ndarray) -> int:
        places = np.stack([cells % n, cells // n % n, cells // n**2], -1)[:, None] + around
        places %= n
        return int(needed[np.unique((places[..., 2] * n + places[..., 1]) * n + places[..., 0])].sum())

    by_cells = sum(touched(np.array(walk[k : k + share])) for k in range(0, n**3, share)) / len(x)
    size = BLOCK // LANES
    by_number = sum(touched(number[k : k + size]) for k in range(0, len(x), size)) / len(x)
    return {"sectors": by_cells, "sectors by number": by_number}


if sys.argv[1:2] == ["--run"]:
    run(sys.argv[2])
else:
    print(json.dumps({scheme: instructions(scheme) for scheme in sys.argv[1:]} | sectors()))
