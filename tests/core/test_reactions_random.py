"""Random scenes with bonds that form and break, and angles with them, beside trials written out in numpy; interrupted here and there."""

import copy
import io

import numpy as np
import openmm
import oracle
import pytest
from chains_of_beads import segment_energy
from openmm import unit

import openmm_dpd as dpd
from openmm_dpd.runtime import set_threads

SCHEMES = ("middle", "mvv", "B/2 A/2 O A/2 B/2")


class Random:
    """A scene drawn by a seed, its reactions, and what the oracle knows of its bonds."""

    def __init__(self, seed):
        rng = self.rng = np.random.default_rng(seed)
        self.n, self.edge, self.A = 2 * int(rng.integers(40, 70)), rng.uniform(3.4, 3.8), rng.choice([0.0, 25.0])
        names = [*"ABC"][: rng.integers(1, 4)]
        self.types = np.array(names)[rng.integers(len(names), size=self.n)]
        bend, torn = rng.random() < 0.5, rng.random() < 0.7
        self.angle = dpd.HarmonicAngles([[0, 1, 2]], k=3.0, theta0=2.0) if bend else None
        order = rng.permutation(self.n)
        self.static = np.sort(order[: 2 * rng.integers(1, 12)].reshape(-1, 2), axis=1)
        first = np.sort(order[30 : 30 + 2 * rng.integers(0, 9)].reshape(-1, 2), axis=1) if not (bend and torn) else np.zeros((0, 2), int)
        counted, number = rng.integers(self.n, size=5 * rng.integers(2)), rng.integers(1, 3)
        self.sorts = [
            dpd.ReactiveBonds(dpd.HarmonicBonds, {"k": 20.0 * (k + 1), "r0": 0.4}, [first, ()][k], [counted, ()][k]) for k in range(number)
        ]
        self.turns, self.bent_away = rng.random() < 0.6, 0
        self.reactions = [self.formation(names, self.sorts[k % len(self.sorts)]) for k in range(rng.integers(len(self.sorts), 4))]
        for bonds in self.sorts if torn else ():
            self.reactions.append(dpd.BondBreaking(bonds, beyond=rng.uniform(0.4, 0.7), spends=rng.random() < 0.3, **self.when()))
        self.bonds = {tuple(pair): 0 for pair in first.tolist()}
        self.start = {*self.bonds, *map(tuple, self.static.tolist())}
        self.counts = np.zeros((len(self.sorts), self.n), int)
        np.add.at(self.counts[0], [*first.ravel(), *counted], 1)
        self.names, force = names, rng.choice([0.5, 1.0], (3, 3))
        self.A *= force + force.T
        charges = {"positions": rng.random((self.n, 3)) * self.edge, "box": [self.edge] * 3, "kT": 1.0, "reactions": self.reactions}
        pairs = {(a, b): dpd.DPD(A=self.A[i, j], gamma=4.5) for i, a in enumerate(names) for j, b in enumerate(names[: i + 1])}
        charges |= {"pairs": pairs, "bonds": [dpd.HarmonicBonds(self.static, 30.0, 0.4)]}
        self.factors = tuple(rng.choice([0.0, 0.5, 1.0], 3).tolist()) if rng.random() < 0.5 else (1.0, 1.0, 1.0)
        charges["bonded_factors"] = self.factors
        listed = [None, self.sorts[-1:], self.static][seed % 3]  # bonds that repel each other, in every other scene
        self.repelling = seed % 4 < 2 and dpd.SegmentalRepulsion(40.0, 0.6, bonds=listed, exclude_adjoining=seed % 4 == 0)
        charges["segments"] = self.repelling or None
        self.scene = dpd.Scene(dict.fromkeys(names, 1.0), self.types.tolist(), **charges)
        self.scheme, self.threads = SCHEMES[seed % 3], 1 + seed % 2

    def when(self):
        return {"every": int(self.rng.integers(1, 6)), "start": int(self.rng.integers(0, 4))}

    def formation(self, names, bonds):
        pair = tuple(self.rng.choice(names, 2).tolist())
        valences = self.rng.integers(1, 4, 2).tolist() if pair[0] != pair[1] else [int(self.rng.integers(1, 4))] * 2
        later = tuple(self.rng.choice([*names, None], 2).tolist()) if self.turns else None
        later = (later[0],) * 2 if later and pair[0] == pair[1] else later
        given = {"angle": self.angle, "becomes": later, "between": (0.8, 2.5) if self.rng.random() < 0.3 else None, **self.when()}
        return dpd.BondFormation(bonds, pair, self.rng.uniform(0.3, 0.7), tuple(valences), **given)

    def built(self):
        return dpd.build(self.scene, dt=0.03, scheme=self.scheme, platform="CPU", seed=3)

    def shells(self):
        """Beads by the number of bonds between them, 4 for more, and 0 for a bead itself."""
        apart = np.full((self.n, self.n), 4)
        near = np.zeros((self.n, self.n), bool)
        for i, j in (*self.bonds, *map(tuple, self.static)):
            near[i, j] = near[j, i] = True
        reached = np.eye(self.n, dtype=bool)
        for bonds in range(4):
            apart[reached & (apart == 4)] = bonds
            reached = reached @ near
        return apart

    def trials(self, step, x):
        """Carry out what is due at a step."""
        d = np.linalg.norm(oracle.minimum_image(x[:, None] - x[None], np.diag([self.edge] * 3)).reshape(self.n, self.n, 3), axis=2)
        before = dict(self.bonds)
        alone = np.isin(self.shells(), [k + 1 for k, factor in enumerate(self.factors) if factor == 0.0])
        for each in self.reactions:
            if step < max(each.start, 1) or (step - each.start) % each.every:
                continue
            sort, score = self.sorts.index(each.bonds), np.full_like(d, np.inf)
            if each.forms:
                one, other = (self.types == name for name in each.types)
                room = [self.counts[sort] < valence for valence in each.valences]
                able = (one & room[0])[:, None] & (other & room[1])[None]
                able = (able | able.T) & (d < each.within) & ~np.eye(self.n, dtype=bool) & ~alone
                for i, j in (*self.bonds, *map(tuple, self.static)):
                    able[i, j] = able[j, i] = False
                for i, j in np.argwhere(np.triu(able)) if each.between else ():
                    angles = self.angles(x, i, j)
                    able[i, j] = able[j, i] = all(each.between[0] <= angle <= each.between[1] for angle in angles)
                    self.bent_away += not able[i, j]
                score[able] = d[able]
            else:
                for i, j in (pair for pair, its in self.bonds.items() if its == sort and pair in before and d[pair] > each.beyond):
                    score[i, j] = score[j, i] = -d[i, j]
            best = score.argmin(axis=1)
            for i, j in ((i, int(j)) for i, j in enumerate(best) if i < j and best[j] == i and np.isfinite(score[i, j])):
                if each.forms:
                    self.bonds[i, j] = sort
                else:
                    del self.bonds[i, j]
                self.counts[sort, [i, j]] += 1 if each.forms else 0 if each.spends else -1
                for bead in (i, j) if each.forms and each.becomes else ():
                    role = each.types.index(self.types[bead])
                    if self.counts[sort, bead] == each.valences[role] and each.becomes[role]:
                        self.types[bead] = each.becomes[role]

    def angles(self, x, i, j):
        """Angles that a bond between two beads would have with all others of theirs."""
        there = [*self.bonds, *map(tuple, self.static)]
        for one, other in ((i, j), (j, i)):
            for near in (a + b - one for a, b in there if one in (a, b)):
                a, b = (oracle.minimum_image(x[end] - x[one], np.diag([self.edge] * 3)).ravel() for end in (other, near))
                yield np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1))

    def energy(self, x):
        box = np.diag([self.edge] * 3)
        i, j = np.triu_indices(self.n, 1)

        def apart(i, j):
            return oracle.minimum_image(x[i] - x[j], box).reshape(-1, 3)

        factors = np.array([0.0, *self.factors, 1.0])[self.shells()[i, j]]
        kinds = np.array([self.names.index(name) for name in self.types])
        total = 0.5 * (self.A[kinds[i], kinds[j]] * factors * np.maximum(1.0 - np.linalg.norm(apart(i, j), axis=1), 0.0) ** 2).sum()
        for (i, j), k in [*((pair, 20.0 * (sort + 1)) for pair, sort in self.bonds.items()), *((pair, 30.0) for pair in self.static)]:
            total += k * (np.linalg.norm(apart([i], [j])) - 0.4) ** 2
        if self.repelling:
            its, segments = self.repelling.bonds, [] if isinstance(self.repelling.bonds, tuple) else self.static.tolist()
            segments += [pair for pair, sort in self.bonds.items() if its is None or (isinstance(its, tuple) and self.sorts[sort] in its)]
            total += segment_energy(x, segments, box, 40.0, 0.6, "mid", not self.repelling.exclude_adjoining) if len(segments) > 1 else 0.0
        there = {*self.bonds, *self.start}
        near = {k: sorted({i + j - k for i, j in there if k in (i, j)}) for k in range(self.n)}
        self.bent = [(i, k, j) for k in near for i in near[k] for j in near[k] if i < j]
        self.bent = [(i, k, j) for i, k, j in self.bent if not {(min(i, k), max(i, k)), (min(j, k), max(j, k))} <= self.start]
        for i, k, j in self.bent if self.angle is not None else ():
            a, b = apart([i, j], [k, k])
            total += 3.0 * (np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b) - 2.0) ** 2
        return total


def interrupted(case, how, built, simulation):
    """Go on with something else: a new script and its checkpoint or state, or copies of integrator and System."""
    if how == "copies":
        integrator, old = copy.copy(simulation.integrator), simulation.context
        context = openmm.Context(openmm.XmlSerializer.clone(built.system), integrator, old.getPlatform())
        context.setState(old.getState(positions=True, velocities=True, parameters=True, integratorParameters=True))
        simulation.context, simulation.integrator = context, integrator
        return built, simulation
    kept = simulation.context.createCheckpoint() if how == "checkpoint" else io.StringIO()
    if how == "state":
        simulation.saveState(kept)
    built = case.built()
    simulation = built.simulation()
    simulation.step(int(case.rng.integers(0, 5)))  # over bonds of another state
    simulation.loadCheckpoint(io.BytesIO(kept)) if how == "checkpoint" else simulation.loadState(io.StringIO(kept.getvalue()))
    return built, simulation


def state(simulation):
    found = simulation.context.getState(positions=True, velocities=True, energy=True)
    x, v = found.getPositions(asNumpy=True), found.getVelocities(asNumpy=True)
    return x.value_in_unit(unit.nanometer), v.value_in_unit(unit.nanometer / unit.picosecond), found.getPotentialEnergy()._value


def agrees(seed, steps):
    """Bonds after every step, energies now and then, and the last state beside a run in one piece; returns bonds made, broken, angles."""
    case = Random(seed)
    built = case.built()
    whole = built.simulation()
    whole.step(steps)
    simulation = (built := case.built()).simulation()
    set_threads(case.threads)
    try:
        for step in range(1, steps + 1):
            if case.rng.random() < 0.12:
                built, simulation = interrupted(case, case.rng.choice(["checkpoint", "state", "copies"]), built, simulation)
            simulation.integrator.step(1)
            x, v, energy = state(simulation)
            case.trials(step, x)
            found = {(i, j): sort for i, j, sort in dpd.read_bonds(simulation.context, built.plan).tolist()}
            assert found == case.bonds, step
            assert dpd.read_types(simulation.context, built.plan) == case.types.tolist(), step
            if step % 5 == 0:
                assert energy == pytest.approx(case.energy(x), rel=1e-9), step
                assert dpd.Observer(built).sample(simulation.context).potential == pytest.approx(energy, rel=1e-9), step
    finally:
        set_threads(None)
    wanted = state(whole)
    assert np.array_equal(x, wanted[0])
    assert np.array_equal(v, wanted[1])
    made = dpd.read_reacted(simulation.context, built.plan)[:, :2].sum(axis=0)
    return *made, len(case.bent) if case.angle is not None else 0, case.bent_away


def test_ten_scenes():
    found = np.array([agrees(seed, 10) for seed in range(10)])
    assert (found.sum(axis=0) > (300, 50, 60, 50)).all(), found


@pytest.mark.slow
@pytest.mark.long
def test_a_hundred_scenes():
    assert sum(agrees(seed, 16)[0] for seed in range(10, 100)) > 2500
