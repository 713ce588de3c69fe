"""What fixes do within steps: forces on single beads in the order of the deck, friction, thermostats, and their values ``f_id``."""

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from ...base.errors import RunError
from ...kernels.wall_potentials import WALLS
from ..state.records import Fix
from ..values.resolver import Resolver, evaluate_beads

#: Changes forces (N, 3) on the members of a fix, all in the deck's units, and returns its values: the scalar and then the vector.
Force = Callable[[Fix, Resolver, np.ndarray, np.ndarray], "list[float] | None"]


def target(fix: Fix, moment: Resolver) -> float:
    """Thermal energy that a fix sets at this moment of a run."""
    start, stop = fix.parameters["kT"]
    return ramped(start, stop, moment)


def ramped(start: float, stop: float, moment: Resolver) -> float:
    """What goes from start to stop during a run, at this moment of it."""
    window = moment.window
    if window is None or window.end == window.begin:
        return start
    return start + (stop - start) * (moment.step - window.begin) / (window.end - window.begin)


def _inside(fix: Fix, moment: Resolver, members: np.ndarray) -> np.ndarray:
    """Members in the region of a fix, if it has one."""
    region = fix.parameters.get("region")
    return members if region is None else members & moment.region(region).contains(moment.folded[0])


def formula_values(word: str, moment: Resolver, chosen: np.ndarray) -> np.ndarray | float:
    """Value of a component: a number, or one for each of the chosen beads."""
    try:
        return float(word)
    except ValueError:
        return evaluate_beads(word, moment, len(chosen))[chosen]


#: Force of a unit charge in a unit field where it is not 1, by the deck's units.
_CHARGE_FORCE = {"real": 23.060549}


def _add(fix: Fix, moment: Resolver, members: np.ndarray, forces: np.ndarray) -> list[float] | None:
    """Of addforce, gravity, and efield, which multiplies by the charges."""
    if moment.step % fix.parameters.get("every", 1):
        return [0.0] * 4
    chosen, factor = _inside(fix, moment, members), np.float64(1.0)
    if fix.style == "efield":
        factor = moment.state.atoms.charges[chosen] * _CHARGE_FORCE.get(moment.units.name, 1.0)
    before, added = forces[chosen].sum(axis=0), np.zeros((int(chosen.sum()), 3))
    for k, word in enumerate(fix.parameters["force"]):
        if word != "0":
            added[:, k] = factor * formula_values(word, moment, chosen)
    forces[chosen] += added
    if fix.style == "gravity":
        return None
    energy = fix.parameters.get("energy")
    work = -np.sum(added * moment.unwrapped[chosen]) if energy is None else np.sum(formula_values(energy, moment, chosen))
    return [float(work), *(added.sum(axis=0) if fix.style == "efield" else before)]


def _set(fix: Fix, moment: Resolver, members: np.ndarray, forces: np.ndarray) -> list[float]:
    """Of setforce, and of aveforce, which adds the mean force."""
    chosen = _inside(fix, moment, members)
    before = forces[chosen].sum(axis=0)
    mean = before / max(int(chosen.sum()), 1) if fix.style == "aveforce" else np.zeros(3)
    for k, word in enumerate(fix.parameters["force"]):
        if word != "NULL":
            forces[chosen, k] = mean[k] + formula_values(word, moment, chosen)
    return [0.0, *before]


def _spring(fix: Fix, moment: Resolver, members: np.ndarray, forces: np.ndarray) -> list[float]:
    """Between the centre of mass of the group and a point, or that of another group at a distance."""
    given, masses, x = fix.parameters, moment.state.bead_masses(), moment.unwrapped
    groups = [members] if given["other"] is None else [members, moment.state.group(given["other"])]
    centres = [moment.state.mass_average(x, mask) for mask in groups]
    place = np.array([np.nan if place is None else place for place in given["place"]])
    way = np.nan_to_num(place - centres[0] if len(groups) == 1 else centres[1] - centres[0] - place)
    length = max(float(np.linalg.norm(way)), 1e-10)
    longer = length - given["length"]
    pull = given["k"] * longer / length * way
    for mask, force in zip(groups, (pull, -pull), strict=False):
        forces[mask] += (masses[mask] / masses[mask].sum())[:, None] * force
    return [0.5 * given["k"] * longer**2, *pull, float(np.copysign(np.linalg.norm(pull), longer))]


def starts(fix: Fix, moment: Resolver, members: np.ndarray) -> np.ndarray:
    """Unwrapped places (n, 3) that beads had when a fix was defined.  DeckError if there are new ones."""
    ids, wanted = fix.parameters["ids"], moment.state.atoms.ids[members]
    rows = np.searchsorted(ids, wanted)
    if np.any(np.append(ids, -1)[rows] != wanted):
        raise fix.error("its group has beads that were made later; define it again")
    return fix.parameters["start"][rows]


def _tether(fix: Fix, moment: Resolver, members: np.ndarray, forces: np.ndarray) -> list[float]:
    given = fix.parameters
    away = np.where(given["axes"], moment.unwrapped[members] - starts(fix, moment, members), 0.0)
    forces[members] -= given["k"] * away
    return [0.5 * given["k"] * float(np.sum(away**2))]


def _drag(fix: Fix, moment: Resolver, members: np.ndarray, forces: np.ndarray) -> None:
    forces[members] -= fix.parameters["gammas"][moment.state.atoms.types[members] - 1, None] * moment.velocities[members]


def _langevin(fix: Fix, moment: Resolver, members: np.ndarray, forces: np.ndarray) -> list[float]:
    """Friction, and noise that is a function of seed, run and step."""
    state, given = moment.state, fix.parameters
    ratios = given["ratios"][state.atoms.types[members] - 1]
    rates = state.bead_masses()[members] / given["damp"] / ratios
    kT = target(fix, moment)
    # uniform numbers with the variance of the noise, for all beads, so that those of a bead do not depend on the group
    drawn = np.random.default_rng([given["seed"], state.runs, moment.step]).random((len(members), 3))[members] - 0.5
    noise = np.sqrt(24.0 * kT * rates / state.timestep)[:, None] * drawn
    if given["zero"] and len(noise):
        noise -= noise.mean(axis=0)
    added = (noise - rates[:, None] * moment.velocities[members] * moment.units.velocity) / moment.units.force
    forces[members] += added
    if given["tally"]:
        given["last"] = added
    return [0.0]


#: Distances from a wall, directions away from it, coefficients and cutoff.
Contact = tuple[np.ndarray, np.ndarray, list[float], float]


def _contacts(fix: Fix, moment: Resolver, beads: np.ndarray) -> Iterator[Contact]:
    """The walls of a fix as beads with these indices see them."""
    given = fix.parameters
    if fix.style == "wall/region":
        region, x = moment.region(given["region"]), moment.folded[0][beads]
        if not region.contains(x).all():
            raise RunError(f"fix {fix.name} ({fix.style}): beads are behind the wall")
        for r, normal in region.distances(x):
            yield r, normal, [float(word) for word in given["coefficients"]], given["cutoff"]
    for face, (place, unit, words, cutoff) in given.get("faces", {}).items():
        k, side = "xyz".index(face[0]), 1.0 if face.endswith("lo") else -1.0
        where, *values = (moment.number(word) if word.startswith("v_") else float(word) for word in (place, *words))
        r = side * (moment.positions[beads, k] - unit * where)
        yield r, np.broadcast_to(side * np.eye(3)[k], (len(r), 3)), values, cutoff


def _wall(fix: Fix, moment: Resolver, members: np.ndarray, forces: np.ndarray) -> list[float]:
    energies, taken, beads, curve = 0.0, list[np.ndarray](), np.flatnonzero(members), WALLS[fix.parameters["potential"]]
    for r, normal, values, cutoff in _contacts(fix, moment, beads):
        near = r < cutoff
        if np.any(r[near] <= 0):
            bead = moment.state.atoms.ids[beads[np.argmin(r)]]
            raise RunError(f"fix {fix.name} ({fix.style}): bead {bead} is on or inside the wall")
        energy, force = curve(r[near], *values, cutoff)
        pushes = force[:, None] * normal[near]
        forces[beads[near]] += pushes
        energies += float(np.sum(energy - curve(np.array([cutoff]), *values, cutoff)[0]))
        taken.append(-pushes.sum(axis=0))
    return [energies, *(np.sum(taken, axis=0) if fix.style == "wall/region" else np.sum(taken, axis=1))]


#: What fixes do to forces, by style.
FORCES: dict[str, Force] = {
    **dict.fromkeys(("addforce", "gravity", "efield"), _add),
    **{"setforce": _set, "aveforce": _set, "spring": _spring, "spring/self": _tether, "viscous": _drag, "langevin": _langevin},
    **{f"wall/{style}": _wall for style in (*WALLS, "region")},
}


def acted_on(moment: Resolver, forces: np.ndarray, styles: Iterable[str] = tuple(FORCES)) -> tuple[np.ndarray, dict[str, list[float]]]:
    """Forces (N, 3) after the fixes of these styles have changed them, and the values of these fixes; in the deck's units."""
    found, values = forces.copy(), {}
    for fix in moment.state.fixes_of(*styles):
        result = FORCES[fix.style](fix, moment, moment.state.group(fix.group), found)
        if result is not None:
            values[fix.name] = result
    if moment.state.dimension == 2:
        found[:, 2] = 0.0
    return found, values
