"""The scripts of the how-to pages, with a force of the user's in every System: it acts there as well.

Every page is run twice, as it is and with a constant force on all mobile particles, in a group that nothing else uses, added to every
System before its Context is made.  What the momentum of each Context gains while it steps must differ by the impulse of that force.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import openmm
import pytest
from cases import raises
from openmm import unit
from test_docs import script_of

import openmm_dpd as dpd

ROOT = Path(__file__).resolve().parents[2]
PUSH, GROUP, NAME = 0.01, 7, "push of the test"

ELSEWHERE = {  # Pages, and the Contexts in them (by their number among those that step), from which momentum goes elsewhere.
    "changes": {0: "a trap takes up momentum"},
    "dense_start": {1: "OpenMM's Langevin integrator takes momentum up"},
    "build_scene": {2: "immobile beads take up momentum", 3: "a trap takes up momentum"},
    "flow": {0: "the body force of reverse Poiseuille flow depends on where beads are"}
    | dict.fromkeys((1, 2, 4), "walls take up momentum"),
    "heat_species": {1: "walls take up momentum", 3: "walls take up momentum, and buoyancy gives it"},
    "partition": dict.fromkeys(range(15), "the beads by which copies of a molecule are held take up momentum"),
}
#: Pages whose Systems refuse it, and the reason.
REFUSED = {"shear": "beside Lees-Edwards shear no force of OpenMM's own"}


@dataclass
class Gain:
    """What a Context gained while it stepped."""

    momentum: float = 0.0
    expected: float = 0.0
    size: float = 0.0


PAGES = [page for page in sorted((ROOT / "docs" / "howto").glob("*.md")) if script_of(page)]


def run_page(page: Path, monkeypatch, push: bool) -> list[Gain]:
    """Run a page and return what each Context that stepped has gained, in their order."""
    gains: list[Gain] = []
    plain_context, plain_minimize = openmm.Context, openmm.LocalEnergyMinimizer.minimize

    class Pushed(plain_context):
        """A Context whose System has the force, and whose integrator keeps account."""

        def __init__(self, system, integrator, *rest):
            mobile = [k for k in range(system.getNumParticles()) if system.getParticleMass(k)._value > 0]
            if push and all(force.getName() != NAME for force in system.getForces()):
                force = openmm.CustomExternalForce("-push*x")
                force.addGlobalParameter("push", PUSH)
                for k in mobile:
                    force.addParticle(k)
                force.setForceGroup(GROUP)
                force.setName(NAME)
                system.addForce(force)
            super().__init__(system, integrator, *rest)
            masses = np.array([system.getParticleMass(k)._value for k in mobile])
            gain = Gain()
            inner = integrator.step

            def step(n):
                if gain not in gains:
                    gains.append(gain)
                before, time = momentum(), now()
                inner(n)
                gain.momentum += momentum() - before
                passed = now() - time
                gain.expected += len(mobile) * PUSH * passed
                # what rounding may add: every impulse and every velocity is rounded once in every step
                forces = np.linalg.norm(self.getState(forces=True).getForces(asNumpy=True)._value, axis=1).sum()
                gain.size += passed * forces + n * np.abs(masses[:, None] * velocities()).sum()

            def velocities():
                return self.getState(velocities=True).getVelocities(asNumpy=True)._value[mobile]

            def momentum():
                return float(masses @ velocities()[:, 0])

            def now():
                return self.getTime().value_in_unit(unit.picosecond)

            integrator.step = step

    def minimize(context, *args, **named):
        """The potential of a constant force has no minimum."""
        here = push and "push" in context.getParameters()
        if here:
            context.setParameter("push", 0.0)
        plain_minimize(context, *args, **named)
        if here:
            context.setParameter("push", PUSH)

    monkeypatch.setattr(openmm, "Context", Pushed)
    monkeypatch.setattr(openmm.LocalEnergyMinimizer, "minimize", staticmethod(minimize))
    try:
        exec(compile(script_of(page), str(page), "exec"), {"__name__": "page"})
    finally:
        dpd.set_threads(None)
    return gains


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=[page.stem for page in PAGES])
def test_a_force_acts_in_the_scripts_of_a_page(page, tmp_path, monkeypatch):
    """Momentum of every Context that steps, beside the same page without the force."""
    found = []
    for push in (False, True):
        folder = tmp_path / str(push)
        folder.mkdir()
        (folder / "examples").symlink_to(ROOT / "examples")
        with monkeypatch.context() as patch:
            patch.chdir(folder)
            if push and page.stem in REFUSED:
                raises(dpd.PlanError, REFUSED[page.stem], run_page, page, patch, push)
                return
            found.append(run_page(page, patch, push))
    plain, pushed = found
    assert len(plain) == len(pushed)
    elsewhere = ELSEWHERE.get(page.stem, {})
    assert set(elsewhere) <= set(range(len(plain))), "a reason for a Context that is not there"
    wrong = {}
    for number, (without, gain) in enumerate(zip(plain, pushed, strict=True)):
        rounding = 2.0**-24 * (gain.size + without.size)  # OpenMM's own forces and constraints are single precision on the CPU platform
        assert 5 * rounding < gain.expected, "rounding would hide the force"
        difference = gain.momentum - without.momentum
        if number not in elsewhere and abs(difference - gain.expected) > rounding:
            wrong[number] = f"momentum {difference:.6g} where {gain.expected:.6g} was to be added (rounding: {rounding:.1g})"
    assert not wrong


def test_every_page_that_is_named_exists():
    assert set(ELSEWHERE) | set(REFUSED) <= {page.stem for page in PAGES}
