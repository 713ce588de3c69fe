"""Random scenes of every kind, with operations between steps: device and host go the same way.

Where steps have friction as a force the two are the same to rounding; where pair updates have it, device and host take pairs in another
order, and friction is nearly 0 here.  Where forces of others act, friction that is computed anew sees velocities before or after their kick:
nothing that asks for it is done beside them.  With new seeds:

    python plugin/tests/test_random.py 500 --first 20000
    python plugin/tests/test_random.py 50 --first 20000 --platform OpenCL
"""

import argparse
import io
import logging
import sys
import traceback
from collections import Counter
from pathlib import Path

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[2] / "tests")]

import numpy as np
import openmm
import pytest
from conftest import available
from devices import REFERENCE, Device
from kinds import TABULATED

import openmm_dpd as dpd
from openmm_dpd.base.names import IMPULSES
from openmm_dpd.measure import Observer
from openmm_dpd.model.sources import Block, Source, Sphere
from openmm_dpd.simulation.field_file import has_fields
from openmm_dpd.simulation.fields import read_fields, write_fields

NAMES = "ABC"
PUSHES = ("isothermal", "many", "lucy", "mixed tables")
PLACES = np.linspace(0.01, 1.1, 40)
CARRIED = ("heat", "lammps", "species", "energies")


class Draw:
    """A scene, how it is stepped, and what happens in between, from one seed."""

    def __init__(self, seed: int, exact: bool = True):
        self.exact, self.rng, self.said = exact, np.random.default_rng([seed, 77]), [f"seed {seed}"]
        self.kind = self.one(*PUSHES, *CARRIED)
        self.predicts = self.kind in CARRIED or self.chance(0.6)
        self.n = int(self.rng.integers(40, 90))
        self.types = self.rng.choice(list(NAMES[: self.rng.integers(1, 4)]), self.n).tolist()
        self.names = sorted(set(self.types))

    def one(self, *choices):
        return choices[self.rng.integers(len(choices))]

    def chance(self, part: float) -> bool:
        return bool(self.rng.random() < part)

    def note(self, what: str) -> str:
        self.said.append(what)
        return what

    def between(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def friction(self) -> float:
        return self.between(0.5, 9.0) if self.predicts else 1e-12

    def pair(self, kind: str):
        if kind == "isothermal":
            strength = {"gamma": self.friction()} if self.chance(0.7) else {"sigma": self.between(0.5, 4.0) if self.predicts else 1e-6}
            across = {"gamma_perp": self.friction(), "exponent_perp": self.one(0.5, 1.0, 1.3)} if self.chance(0.4) else {}
            return dpd.DPD(
                A=self.between(0, 40), cutoff=self.between(0.8, 1.2), exponent=self.one(0.5, 1.0, 1.0, 1.4), **strength, **across
            )
        if kind in ("many", "lucy"):
            kernel = "lucy" if kind == "lucy" else "quadratic"
            return dpd.MDPD(A=-20.0, B=15.0, gamma=self.friction(), cutoff=1.0, cutoff_B=0.8, kernel=kernel)
        if kind == "energies":
            return dpd.EnergyDPD(
                A=self.between(0, 30), sigma=self.between(0.5, 3.0), kappa=self.between(0, 1), cutoff=self.between(0.8, 1.2)
            )
        if kind == "species":
            return dpd.TDPD(
                A=self.between(0, 30), gamma=self.friction(), exponent=self.one(0.6, 1.0, 2.0), cutoff=self.between(0.9, 1.2),
                cutoff_c=self.between(0.8, 1.2), kappa=(1.0, 0.5), epsilon=(0.1, 0.2), exponent_c=(2.0, 1.0),
            )  # fmt: skip
        return dpd.EDPD(
            A=self.between(0, 30), gamma=self.friction(), kappa=self.between(0, 1), cutoff=self.between(0.9, 1.2), cutoff_T=self.between(0.8, 1.2),
            exponent=self.one(0.41, 1.0, 2.0), exponent_T=self.one(1.0, 2.0, 3.0),
        )  # fmt: skip

    def table(self, kind: str) -> dict:
        if kind in ("many", "lucy"):
            return {("*", "*"): self.pair(kind)}
        pairs = {(a, b): self.pair(kind) for k, a in enumerate(self.names) for b in self.names[k:]}
        return pairs | (
            {(self.names[0], self.names[-1]): dpd.NONE} if kind == "isothermal" and len(self.names) > 1 and self.chance(0.1) else {}
        )

    def scene(self) -> dpd.Scene:
        rng, kind = self.rng, self.note(self.kind)
        box = self.note(self.one("ortho", "ortho", "tilted", "none"))
        edges = rng.uniform(2.6, 5.0, 3)
        vectors = {"ortho": np.diag(edges), "tilted": np.diag(edges) + np.tril(rng.uniform(-0.4, 0.4, (3, 3)), -1) * edges}.get(box)
        x = rng.random((self.n, 3)) * edges if vectors is None else (rng.random((self.n, 3)) + rng.integers(-2, 3, (self.n, 3))) @ vectors
        tables = [self.table("isothermal"), self.table(self.one("many", "isothermal"))] if kind == "mixed tables" else self.table(kind)
        more: dict = {"velocities": rng.normal(size=(self.n, 3))}
        masses = dict(zip(NAMES, (1.0, self.between(0.5, 4.0), self.one(1.0, 12.0)), strict=True))
        if kind in ("heat", "lammps"):
            more["internal"] = dpd.BeadTemperatures(rng.uniform(0.6, 1.8, self.n), rng.uniform(20.0, 50.0, self.n))
            more |= {"compat": "lammps"} if kind == "lammps" else {}
        elif kind == "species":
            more["internal"] = dpd.Concentrations(rng.random((self.n, 2)))
        elif kind == "energies":
            eos = {name: TABULATED["AB"[k % 2]] for k, name in enumerate(self.names)}
            more["internal"] = dpd.InternalEnergy(eos, rng.uniform(0.6, 1.8, self.n), conductive=rng.normal(size=self.n))
        if kind in ("heat", "species") and self.chance(0.4):
            self.note("sources")
            corner = {"corner": (-1.0, 0.0, 0.0)} if vectors is not None else {}
            more["sources"] = [
                Source(Block([0.5, -np.inf, -np.inf], [2.0, np.inf, np.inf]), 0.3, **corner),
                Source(Sphere([1.0, 1.0, 1.0], 0.9), 0.2),
            ]
        if self.chance(0.35):
            self.note("bonds")
            chain = np.arange(12).reshape(-1, 2)
            x[chain[:, 1]] = x[chain[:, 0]] + 0.3
            more["bonds"] = [self.one(dpd.HarmonicBonds(chain, 20.0, 0.5), dpd.FENEBonds(chain, 20.0, 2.2, 0.4, 0.5))]
            if self.chance(0.5) and "shear" not in more:
                self.note("angles")
                more["angles"] = [dpd.HarmonicAngles(np.arange(12).reshape(-1, 3), 4.0, 2.4)]
            more["bonded_factors"] = self.one((1.0, 1.0, 1.0), (0.0, 1.0, 1.0), (0.5, 1.0, 1.0))
        if self.chance(0.3):
            self.note("immobile")
            more["mobile"] = np.arange(self.n) > 6
        if self.chance(0.25) and vectors is not None and kind != "energies" and not {"sources", "mobile"} & more.keys():
            self.note("shear")
            more["shear"] = self.one(
                dpd.LeesEdwards(rate=self.between(-2, 2)),
                dpd.LeesEdwards(rate=0.5, end_rate=2.0, ramp_time=0.1),
                dpd.LeesEdwards(amplitude=0.5, frequency=5.0),
            )
            vectors[1, 0] = vectors[2, 0] = vectors[2, 1] = 0.0
        elif self.chance(0.3) and box == "ortho":
            self.note("walls")
            axis = self.rng.integers(3)
            x[:, axis] = rng.uniform(0.3, edges[axis] - 0.3, self.n)
            how = self.one("bounce-back", "specular", "moving", "behind")
            self.note(how)
            lower: dict = {"kind": how} if how in ("bounce-back", "specular") else {"velocity": np.where(np.arange(3) == axis, 0.0, 0.4)}
            upper: dict = {"kind": how} if how in ("bounce-back", "specular") else {}
            if how == "behind":
                lower |= {"behind": self.names[0], "density": 3.0, "period": 0.3}
                upper |= {"behind": self.names[-1], "density": 3.0}
            more["walls"] = [
                dpd.Wall("xyz"[axis], 0.2, "above", **lower),
                dpd.Wall("xyz"[axis], float(edges[axis]) - 0.2, "below", **upper),
            ]
        if self.chance(0.25):
            self.note("body force")
            more["body_forces"] = [dpd.BodyForce(tuple(rng.normal(size=3).tolist()))]
            if self.chance(0.3) and kind in PUSHES:
                self.note("alone")
                more["interacting"] = rng.random((self.n, 3)) > 0.3
        # tables of OpenMM's have seven digits on GPU platforms
        if self.chance(0.15) and self.exact and "shear" not in more and kind in ("isothermal", *CARRIED):
            self.note("overlay")
            rows = {(a, b): dpd.NONE for k, a in enumerate(self.names) for b in self.names[k:]}
            rows[self.names[0], self.names[0]] = dpd.TabulatedPair(PLACES, 3 * (1.1 - PLACES) ** 3, forces=9 * (1.1 - PLACES) ** 2)
            tables = [tables, rows]
        kT: object = 1.0
        if kind in PUSHES and self.chance(0.2):
            self.note("ramp")
            kT = dpd.TemperatureRamp(1.0, 2.0, 0, 20)
        return dpd.Scene(
            masses={name: masses[name] for name in self.names}, types=self.types, positions=x, pairs=tables, kT=kT, box=vectors, **more
        )

    def choices(self) -> dict:
        self.note(
            scheme := "mvv"
            if self.predicts
            else self.one("middle", "aboba", "bababo", "shardlow", "bababs", "B/2 A/2 O A/2 B/2", "O B/2 A B/2")
        )
        lam = self.one(0.5, 0.65) if scheme == "mvv" else 0.5
        return {"dt": self.one(0.005, 0.01), "scheme": scheme, "lam": lam, "seed": int(self.rng.integers(1, 99))}


def operated(draw: Draw, pair) -> None:
    """Do one thing to both."""
    what = draw.one(
        "positions", "velocities", "dt", "kT", "seed", "box", "fields", "reload", "checkpoint", "energy", "reinitialize", "time"
    )
    if "others" in draw.said and what in ("velocities", "reinitialize"):
        return  # friction that is computed anew sees velocities before or after the kick by forces of others
    contexts, built = [each.context for each in pair], pair[0].built
    x, v, box = now(contexts[1])
    scene = built.plan.scene
    draw.note(what)
    if what == "positions":
        x = x + 0.02 * draw.rng.normal(size=x.shape)
        for context in contexts:
            context.setPositions(x)
    elif what == "velocities":
        v = np.where(scene.immobile[:, None], v, draw.rng.normal(size=v.shape))
        for context in contexts:
            context.setVelocities(v)
    elif what == "dt":
        step = draw.between(0.002, 0.012)
        for each in pair:
            each.integrator.setStepSize(step)
    elif what == "kT" and not isinstance(scene.kT, dpd.TemperatureRamp) and draw.kind in PUSHES:
        kT = draw.between(0.5, 2.0)
        for context in contexts:
            context.setParameter("dpd_kT", kT)
    elif what == "seed" and "dpd_seed" in contexts[0].getParameters():
        for context in contexts:
            context.setParameter("dpd_seed", 1234)
    elif what == "box" and box is not None and scene.shear is None and not scene.walls and "sources" not in draw.said:
        for context in contexts:
            context.setPeriodicBoxVectors(*(1.01 * box))
            context.setPositions(1.01 * x)
    elif what == "fields" and has_fields(built):
        found = read_fields(contexts[1], built.plan)
        word = next(iter(found))
        new = found[word] * draw.rng.uniform(0.97, 1.03, found[word].shape)
        new = np.where(scene.immobile.reshape(-1, *[1] * (new.ndim - 1)), found[word], new)
        if word in ("theta", "concentrations"):
            for each in pair:
                write_fields(each.context, each.built.plan, **{word: new})
    elif what in ("reload", "checkpoint"):
        name, file, n = ("State", io.StringIO, 2) if what == "reload" else ("Checkpoint", io.BytesIO, 3)
        for each in pair:
            state = file()
            getattr(each, f"save{name}")(state)
            goes(each, n)
            state.seek(0)
            getattr(each, f"load{name}")(state)
    elif what == "energy":
        compare([np.array(context.getState(energy=True).getPotentialEnergy()._value) for context in contexts], draw, "energy", 1e-4)
    elif what == "reinitialize":
        for context in contexts:
            context.reinitialize(preserveState=True)
    elif what == "time":
        for context in contexts:
            context.setTime(1.5)


def now(context):
    state = context.getState(positions=True, velocities=True)
    box = state.getPeriodicBoxVectors(asNumpy=True)._value
    return state.getPositions(asNumpy=True)._value, state.getVelocities(asNumpy=True)._value, box


def compare(values, draw: Draw, what: str, close=1e-6) -> None:
    ours, theirs = values
    np.testing.assert_allclose(
        ours, theirs, rtol=0, atol=close * max(1.0, np.abs(theirs).max(initial=0.0)), err_msg=f"{what}: {', '.join(draw.said)}"
    )


def goes(simulation, n: int) -> bool:
    """Whether n steps are possible."""
    try:
        simulation.step(n)
        simulation.context.getState(energy=True)  # a device is asked now
    except openmm.OpenMMException as error:
        assert "the step size" in str(error), error
        return False
    return True


def same_way(seed: int, device=REFERENCE) -> str:
    """Whether device and host go the same way ("same"), both fail, or one refuses the scene (why)."""
    draw, builts = Draw(seed, device.exact), []
    try:
        scene, choices = draw.scene(), draw.choices()
    except (dpd.PlanError, dpd.ParameterError) as error:
        return f"no scene: {error}"
    for engine, platform in (("device", device.platform), ("host", "Reference")):
        try:
            builts.append(dpd.build(scene, engine=engine, platform=platform, **choices))
        except (dpd.PlanError, dpd.ParameterError) as error:
            return f"refused: {error}"
    if draw.chance(0.3) and scene.shear is None:
        draw.note("others")
        for built in builts:
            spring = openmm.CustomExternalForce("2*((x-1)^2+0.5*(y-2)^2)")
            for bead in range(0, draw.n, 7):
                spring.addParticle(bead)
            built.system.addForce(spring)
    pair = [builts[0].simulation(properties=device.properties), builts[1].simulation()]
    for each, built in zip(pair, builts, strict=True):
        each.built = built
    for _ in range(4):
        n = int(draw.rng.integers(1, 8))
        draw.note(f"{n} steps")
        if len(failed := [each for each in pair if not goes(each, n)]):
            assert len(failed) == 2, f"one fails: {', '.join(draw.said)}"
            return "both fail"
        for what, values in zip(("positions", "velocities", "box"), zip(*(now(each.context) for each in pair), strict=True), strict=True):
            compare(values, draw, what)
        if has_fields(builts[0]):
            for values in zip(*(read_fields(each.context, each.built.plan).values() for each in pair), strict=True):
                compare(values, draw, "fields")
        known = [each.context.getParameters() for each in pair]
        compare([np.array([of[name] for name in IMPULSES.values() if name in of and name in known[1]]) for of in known], draw, "walls")
        samples = [Observer(each.built).sample(each.context) for each in pair]
        for name in ("potential", "kinetic_pressure", "virial_conservative", "virial_dissipative", "kT"):
            compare([np.array(getattr(sample, name)) for sample in samples], draw, name, 1e-4)  # body forces have an energy of rounding
        for _ in range(int(draw.rng.integers(0, 3))):
            operated(draw, pair)
    return "same"


@pytest.mark.parametrize("first, count", [(0, 5), pytest.param(5, 60, marks=[pytest.mark.slow, pytest.mark.long])])
def test_random_scenes_go_the_same_way(first, count):
    available(REFERENCE)
    found = Counter(same_way(seed) for seed in range(first, first + count))
    assert found["same"] > 0.7 * count, found


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("scenes", type=int)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--platform", default="Reference", help="in double precision: OpenCL, CUDA or HIP")
    asked = parser.parse_args()
    on = REFERENCE if asked.platform == "Reference" else Device(asked.platform, "double")
    logging.disable()
    counted = Counter()
    for seed in range(asked.first, asked.first + asked.scenes):
        try:
            counted[same_way(seed, on)] += 1
        except Exception as error:
            counted["differ"] += 1
            text = str(error) if isinstance(error, AssertionError) else traceback.format_exc()
            print(seed, *(line for line in text.strip().splitlines() if ":" in line), sep="\n  ")
    print(*(f"{count}: {what}" for what, count in counted.most_common()), sep="\n")
