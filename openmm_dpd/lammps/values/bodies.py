"""Values of the bodies of ``fix rigid`` and its like: ``compute rigid/local``, ``ke/rigid`` and ``erotate/rigid``."""

from functools import partial

import numpy as np

from ...base.errors import ParameterError
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.moment import DeckMoment
from ..state.records import Compute
from ..state.rigid import RIGID, deck_bodies, given_now
from .compute_spec import ComputeSpec

#: Words of rigid/local for vectors, and the letters of their components.
_VECTORS = {word: tuple(f"{word}{axis}" for axis in "xyz") for word in ("", "v", "f", "i", "tq", "omega", "angmom", "inertia")}
_VECTORS["u"] = ("xu", "yu", "zu")
_WORDS = ("id", "mol", "mass", *(word for words in _VECTORS.values() for word in words))


def _motions(moment: DeckMoment, compute: Compute, forces: bool = False) -> list[dict[str, np.ndarray]]:
    """Vectors of each body (deck units), see :data:`_VECTORS`, the id of LAMMPS's bead of it (``owner``), and its ``mass``."""
    state, found = moment.state, []
    mass, x, v = state.bead_masses() / moment.units.mass, moment.unwrapped, moment.velocities
    f = np.asarray(moment.need("forces")) / moment.units.force if forces else np.zeros_like(x)
    for body in deck_bodies(state):
        if body.fix.name != compute.settings[0]:
            continue
        at, m = x[body.beads], mass[body.beads, None]
        centre, speed = (m * at).sum(axis=0) / m.sum(), (m * v[body.beads]).sum(axis=0) / m.sum()
        r = at - centre
        momentum = np.cross(r, m * (v[body.beads] - speed)).sum(axis=0)
        squares = (m * r).T @ r
        tensor = np.trace(squares) * np.eye(3) - squares
        moments = np.linalg.eigvalsh(tensor)
        moments[moments < 1e-7 * moments[2]] = 0.0  # beads in line
        spin, total = np.linalg.pinv(tensor, rcond=1e-7, hermitian=True) @ momentum, m.sum()
        if body.given is not None:
            beads, total = centre, body.given["mass"]
            centre, tensor = given_now(body.given, at)
            speed, r, momentum, moments = speed + np.cross(spin, centre - beads), at - centre, tensor @ spin, np.linalg.eigvalsh(tensor)
        inside = moment.box.wrap(centre[None])[0][0]
        its = {
            "": inside,
            "u": centre,
            "i": np.rint(np.linalg.solve(moment.box.vectors.T, centre - inside)),
            "inertia": moments,
            "v": speed,
        }
        its |= {"omega": spin, "angmom": momentum, "f": f[body.beads].sum(axis=0), "tq": np.cross(r, f[body.beads]).sum(axis=0)}
        found.append(its | {"mass": total, "owner": body.owner})
    return found


def _local(moment: DeckMoment, compute: Compute) -> np.ndarray:
    """Values (rows, columns) of the bodies whose owners are in the group, in the order of these."""
    atoms, words, rows = moment.state.atoms, compute.settings[1:], []
    bodies = _motions(moment, compute, not {*_VECTORS["f"], *_VECTORS["tq"]}.isdisjoint(words))
    places = atoms.index_of(np.array([its["owner"] for its in bodies], np.int64))
    for place, its in sorted(zip(places.tolist(), bodies, strict=True), key=lambda one: one[0]):
        values = {name: value for word, names in _VECTORS.items() for name, value in zip(names, its[word], strict=True)}
        values |= {"id": its["owner"], "mol": atoms.molecules[place], "mass": its["mass"]}
        rows += [[float(values[word]) for word in words]] if moment.state.group(compute.group)[place] else []
    return np.array(rows).reshape(len(rows), len(words))


def _energy(moment: DeckMoment, compute: Compute) -> float:
    """Energy of translation or rotation of the bodies of a fix."""
    bodies, units = _motions(moment, compute), moment.units
    moving = (its["mass"] * (its["v"] @ its["v"]) if compute.style == "ke/rigid" else its["omega"] @ its["angmom"] for its in bodies)
    return 0.5 * sum(moving) * units.mass * units.velocity**2 / units.energy


def _check(style: str, allowed: tuple[str, ...], state: DeckState, group: str, words: list[str]) -> tuple[str, ...]:
    read.count(
        words, f"compute ID group {style} fix-ID{' value value ...' * (style == 'rigid/local')}", 1 + bool(allowed), None if allowed else 1
    )
    fix = state.fixes.get(words[0])
    if fix is None or fix.style not in RIGID or (allowed and not fix.style.endswith("small")):
        raise ParameterError(f"compute {style}: '{words[0]}' must be a fix rigid{'/small or rigid/nve/small' * bool(allowed)}")
    for word in words[1:]:
        read.choice(word, f"a value of compute {style}", allowed)
    return tuple(words)


#: Computes of bodies.
OF_BODIES: dict[str, ComputeSpec] = {
    **{style: ComputeSpec(partial(_check, style, ()), _energy, extensive=True) for style in ("ke/rigid", "erotate/rigid")},
    "rigid/local": ComputeSpec(
        partial(_check, "rigid/local", _WORDS),
        local=_local,
        columns=lambda compute: len(compute.settings) - 1 if len(compute.settings) > 2 else 0,
    ),
}
