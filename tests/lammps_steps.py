"""Steps of beads with temperatures, species or densities in a live LAMMPS, and the noise that it draws."""

from collections import namedtuple
from collections.abc import Sequence

import lammps_peer
import numpy as np

_PEER_BOX = 12.0


# Positions, velocities, forces (N, 3) and per-bead values by name after a run; all sorted by id.
LammpsState = namedtuple("LammpsState", "x v f values pe press")


def lammps_normals(seed: int, count: int) -> list[float]:
    """The first N(0,1) numbers that a CPU pair style of LAMMPS draws on its only process.

    RANMAR (Marsaglia, Zaman and Tsang 1990) with the two seeds ``divmod(seed - 1, 30082)``, one uniform
    number thrown away, then the polar method, which gives two normals per accepted point.
    """
    ij, kl = divmod(seed - 1, 30082)
    i, j, k, m = ij // 177 % 177 + 2, ij % 177 + 2, kl // 169 % 178 + 1, kl % 169
    table = []
    for _ in range(97):
        bits = 0
        for _ in range(24):
            i, j, k = j, k, i * j % 179 * k % 179
            m = (53 * m + 1) % 169
            bits = 2 * bits + (m * k % 64 >= 32)
        table.append(bits)  # 24-bit integers: the generator is exact in them
    state = {"c": 362436, "at": 0}

    def uniform() -> float:
        at = state["at"]
        lagged = (table[(96 - at) % 97] - table[(32 - at) % 97]) % 2**24
        table[(96 - at) % 97] = lagged
        state["at"] = (at + 1) % 97
        state["c"] -= 7654321
        state["c"] += 16777213 if state["c"] < 0 else 0
        return (lagged - state["c"]) % 2**24 / 2**24

    uniform()
    normals: list[float] = []
    while len(normals) < count:
        a, b = 2.0 * uniform() - 1.0, 2.0 * uniform() - 1.0
        square = a * a + b * b
        if 0.0 < square < 1.0:
            scale = np.sqrt(-2.0 * np.log(square) / square)
            normals += [float(b * scale), float(a * scale)]
    return normals[:count]


def peer_box() -> np.ndarray:
    """The periodic box (3, 3) of `run`; beads that stay inside keep their coordinates."""
    return np.diag([_PEER_BOX] * 3)


def run(
    atom_style: str, x, v, types, type_masses, commands: Sequence[str], steps: int, measure: dict[str, str] | None = None
) -> LammpsState:
    """Put beads into a fresh LAMMPS (lj units), obey ``commands``, run, and read them back.

    Parameters
    ----------
    x, v, types
        (N, 3) positions inside `peer_box`, velocities, types from 0; ids are 1..N.
    measure
        name -> per-atom compute, e.g. ``{"T": "edpd/temp/atom"}``, or ``"atom:rho"`` for a stored array.
    """
    x, n = np.asarray(x, dtype=float), len(x)
    with lammps_peer.instance() as lmp:
        box = f"region box block {('0 ' + str(_PEER_BOX) + ' ') * 3}"
        head = ["units lj", f"atom_style {atom_style}", "atom_modify map yes sort 0 0.0", "comm_modify vel yes", box]
        masses = [f"mass {k} {float(m)!r}" for k, m in enumerate(type_masses, start=1)]
        lmp.commands_list([*head, f"create_box {len(type_masses)} box", *masses])
        ids = list(range(1, n + 1))
        created = lmp.create_atoms(n, ids, [int(t) + 1 for t in types], x.ravel().tolist(), np.asarray(v, dtype=float).ravel().tolist())
        if created != n:
            raise ValueError(f"LAMMPS took {created} of {n} beads")
        measure = measure or {}
        lmp.commands_list(list(commands))
        lmp.commands_list([f"compute {name} all {style}" for name, style in measure.items() if not style.startswith("atom:")])
        lmp.commands_list(["thermo_style custom step pe press", "thermo_modify norm no", f"run {steps} post no"])
        order = np.argsort(lmp.numpy.extract_atom("id")[:n])
        values = {}
        for name, style in measure.items():
            if style.startswith("atom:"):
                array = lmp.numpy.extract_atom(style.removeprefix("atom:"))
            else:
                columns = style.startswith("dpd/atom")
                array = lmp.numpy.extract_compute(name, 1, 2 if columns else 1)
            values[name] = np.array(array)[:n][order]
        x, v, f = (np.array(lmp.gather_atoms(name, 1, 3), dtype=float).reshape(n, 3) for name in "xvf")
        return LammpsState(x, v, f, values, float(lmp.get_thermo("pe")), float(lmp.get_thermo("press")))


def pair_noise(seed: int, evaluations: int, per_pair: int) -> np.ndarray:
    """Noise (evaluations, per_pair) of the only pair of two beads, from `lammps_normals`."""
    return np.array(lammps_normals(seed, evaluations * per_pair)).reshape(evaluations, per_pair)


def two_bead_noise(number: float, symmetric: bool) -> np.ndarray:
    """The (2, 2) noise matrix of two beads, ``number`` being that of (0, 1)."""
    return np.array([[0.0, number], [number if symmetric else -number, 0.0]])
