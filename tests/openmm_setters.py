"""Changes of OpenMM's forces between two steps, of every class some, and all methods of System, Context and integrators; and what they do.

A block begins with a class and how a force of it is made for :data:`N` particles (``f``); then comes a line for a setter: its name, what
it does, its arguments, and further statements where it means nothing alone.  Lines of a block are walked one after the other.  With
OpenMM's own integrators, and so with those of the package, a change

- ``update``: acts after ``updateParametersInContext``;
- ``anew``: acts after ``context.reinitialize(preserveState=True)``;
- ``never``: acts in no Context that keeps its state (names, defaults of parameters), or only together with another one;
- ``refused``: is refused by OpenMM where the Context is made anew.
"""

import inspect
import re
from collections.abc import Iterator
from typing import NamedTuple

import openmm

N, KELVIN = 8, 120.27236  # Particles of the scene, and the temperature at which kT is 1.

GENERIC = {"setForceGroup", "setName", "updateParametersInContext"}  # Methods of all forces, which have blocks of their own.

#: Forces that are walked by nobody here: they act as any force of OpenMM's does, and need more than a few particles.
LIKE_ALL = {f"Amoeba{name}Force" for name in ("GeneralizedKirkwood", "Multipole", "TorsionTorsion", "Vdw", "WcaDispersion")}
LIKE_ALL |= {"ATMForce", "CMAPTorsionForce", "ConstantPotentialForce", "GayBerneForce", "HippoNonbondedForce", "LCPOForce"}
LIKE_ALL |= {"OrientationRestraintForce"}

REFUSED = {  # Forces that are refused beside a DPD thermostat, and a word of the reason.
    "AndersenThermostat": "AndersenThermostat",
    "CMMotionRemover": "CMMotionRemover",
    "DrudeForce": "DrudeForce",
    "RPMDMonteCarloBarostat": "RPMDIntegrator",
}

BAROSTATS = {  # Barostats, at a pressure in bar and with a frequency, for the temperature of kT = 1.
    "MonteCarloBarostat": lambda bar, n: openmm.MonteCarloBarostat(bar, KELVIN, n),
    "MonteCarloAnisotropicBarostat": lambda bar, n: openmm.MonteCarloAnisotropicBarostat([bar] * 3, KELVIN, True, True, True, n),
    "MonteCarloMembraneBarostat": lambda bar, n: openmm.MonteCarloMembraneBarostat(bar, 0.0, KELVIN, 0, 0, n),
    "MonteCarloFlexibleBarostat": lambda bar, n: openmm.MonteCarloFlexibleBarostat(bar, KELVIN, n),
}

_TABLE = """
CustomExternalForce('k*s*x^2'); f.addGlobalParameter('k', 1); f.addPerParticleParameter('s'); [f.addParticle(i, [0.5]) for i in range(N)]
  setParticleParameters         update   1, 1, [0.8]
  addParticle                   anew     3, [2.0]
  setEnergyFunction             anew     'k*s*(x^2+y^2)'
  addPerParticleParameter       anew     't'; [f.setParticleParameters(i, i % N, [0.5, 0.2]) for i in range(N + 1)]; f.setEnergyFunction('s*t*k*x')
  setGlobalParameterDefaultValue never   0, 3.0

CustomBondForce('k*s*r'); f.addGlobalParameter('k', 1); f.addPerBondParameter('s'); f.addBond(0, 1, [2.0])
  setBondParameters             update   0, 0, 1, [1.5]
  addBond                       anew     2, 3, [2.0]

CustomAngleForce('k*s*theta'); f.addGlobalParameter('k', 1); f.addPerAngleParameter('s'); f.addAngle(0, 1, 2, [2.0])
  setAngleParameters            update   0, 0, 1, 2, [1.5]
  addAngle                      anew     3, 4, 6, [2.0]

CustomTorsionForce('k*s*theta'); f.addGlobalParameter('k', 1); f.addPerTorsionParameter('s'); f.addTorsion(0, 1, 3, 7, [2.0])
  setTorsionParameters          update   0, 0, 1, 3, 7, [1.5]
  addTorsion                    anew     2, 3, 1, 5, [2.0]

CustomCompoundBondForce(2, 'k*s*distance(p1,p2)'); f.addGlobalParameter('k', 1); f.addPerBondParameter('s'); f.addBond([0, 1], [2.0])
  setBondParameters             update   0, [0, 1], [1.5]
  addBond                       anew     [2, 3], [2.0]

CustomCentroidBondForce(2, 'k*s*distance(g1,g2)'); [f.addGroup([2 * i, 2 * i + 1], [1, 1]) for i in range(4)]; f.addGlobalParameter('k', 1); \
f.addPerBondParameter('s'); f.addBond([0, 1], [2.0])
  setBondParameters             update   0, [0, 1], [1.5]
  addBond                       anew     [2, 3], [2.0]

CustomNonbondedForce('k*s1*s2*r'); f.addGlobalParameter('k', 0.1); f.addPerParticleParameter('s'); [f.addParticle([1.0]) for i in range(N)]; \
f.setNonbondedMethod(1); f.setCutoffDistance(1.9); f.addExclusion(0, 1)
  setParticleParameters         update   0, [1.5]
  setEnergyFunction             anew     'k*s1*s2*r^2'
  setCutoffDistance             anew     1.5
  setSwitchingDistance          never    1.1
  addEnergyParameterDerivative  refused  'more'

NonbondedForce(); [f.addParticle(0.2, 1.0, 0.5) for i in range(N)]; f.setNonbondedMethod(2); f.setCutoffDistance(1.6); f.addException(0, 1, 0, 1, 0); \
f.addGlobalParameter('k', 1); f.addParticleParameterOffset('k', 0, 0.1, 0, 0); f.addExceptionParameterOffset('k', 0, 0.1, 0, 0)
  setParticleParameters         update   1, 0.3, 1.0, 0.5
  setExceptionParameters        update   0, 0, 1, 0.02, 1, 0
  setParticleParameterOffset    anew     0, 'k', 0, 0.2, 0, 0
  setCutoffDistance             anew     1.4
  setNonbondedMethod            anew     4
  addParticle                   refused  0, 1, 0

CustomGBForce(); f.addGlobalParameter('k', 0.1); f.addPerParticleParameter('s'); [f.addParticle([1.0]) for i in range(N)]; f.setNonbondedMethod(1); \
f.setCutoffDistance(1.9); f.addComputedValue('c', 's1*s2*r', 1); f.addEnergyTerm('k*c1*c2*r', 1); f.addExclusion(0, 1)
  setParticleParameters         update   0, [1.5]
  setEnergyTermParameters       anew     0, 'k*c1*c2*r^2', 1
  addParticle                   refused  [1.0, 1.0]

CustomHbondForce('k*s*t*distance(a1,d1)'); f.addGlobalParameter('k', 1); f.addPerDonorParameter('s'); f.addPerAcceptorParameter('t'); \
[f.addDonor(i, -1, -1, [1.0]) for i in range(3)]; [f.addAcceptor(i, -1, -1, [0.5]) for i in (4, 5, 6)]; f.addExclusion(0, 0)
  setDonorParameters            update   0, 0, -1, -1, [2.0]
  addDonor                      anew     3, -1, -1, [1.0]

CustomManyParticleForce(3, 'k*s1*s2*s3*distance(p1,p2)*distance(p2,p3)'); f.addGlobalParameter('k', 0.1); f.addPerParticleParameter('s'); \
[f.addParticle([1.0], i % 2) for i in range(N)]
  setParticleParameters         update   0, [1.5], 0
  setEnergyFunction             anew     'k*s1*s2*s3*distance(p1,p2)*distance(p1,p3)^2'
  addParticle                   refused  [1.0, 1.0], 0

CustomCVForce('k*d^2'); inner = openmm.CustomBondForce('r'); inner.addBond(0, 1); f.addCollectiveVariable('d', inner); f.addGlobalParameter('k', 1)
  setEnergyFunction             anew     'k*d^3'
  addCollectiveVariable         anew     'e', openmm.RGForce(); f.setEnergyFunction('k*d*e')

CustomVolumeForce('k*v'); f.addGlobalParameter('k', 1)
  setEnergyFunction             never    'k*v^2'

HarmonicBondForce(); f.addBond(0, 1, 1.0, 5.0)
  setBondParameters             update   0, 0, 1, 0.9, 6.0
  addBond                       anew     2, 3, 1.0, 5.0

HarmonicAngleForce(); f.addAngle(0, 1, 2, 1.0, 5.0)
  setAngleParameters            update   0, 0, 1, 2, 0.9, 6.0
  addAngle                      anew     2, 3, 5, 1.0, 5.0

PeriodicTorsionForce(); f.addTorsion(0, 1, 3, 7, 1, 0.3, 5.0)
  setTorsionParameters          update   0, 0, 1, 3, 7, 1, 0.5, 6.0
  addTorsion                    anew     2, 3, 1, 5, 2, 0.3, 5.0

RBTorsionForce(); f.addTorsion(0, 1, 3, 7, 1, 2, 3, 4, 5, 6)
  setTorsionParameters          update   0, 0, 1, 3, 7, 2, 3, 4, 5, 6, 7
  addTorsion                    anew     2, 3, 1, 5, 1, 2, 3, 4, 5, 6

GBSAOBCForce(); [f.addParticle(0.3, 0.2, 0.8) for i in range(N)]; f.setNonbondedMethod(1); f.setCutoffDistance(1.9)
  setParticleParameters         update   0, 0.5, 0.2, 0.8
  setCutoffDistance             anew     1.5
  addParticle                   refused  0, 1, 1

RGForce(); f.setParticles([0, 1, 2])
  setParticles                  anew     [0, 1, 2, 3]

RMSDForce([openmm.Vec3(i % 3, i % 2, i / 4) for i in range(N)])
  setParticles                  update   [0, 1, 2, 3, 5]
  setReferencePositions         update   [openmm.Vec3(i % 4, i % 2, i / 5) for i in range(N)]

PythonForce(PUSH)
  setParticles                  anew     [0, 1, 2]
  setUsesPeriodicBoundaryConditions never True
"""


class Line(NamedTuple):
    """A setter, what it does, and the statements that call it."""

    method: str
    does: str
    code: str


class Block(NamedTuple):
    """A class of forces, how one is made, and its setters."""

    name: str
    code: str
    lines: tuple[Line, ...]


def _read(text: str) -> Iterator[Block]:
    for block in text.replace("\\\n", "").strip().split("\n\n"):
        head, *rows = block.splitlines()
        lines = []
        for row in rows:
            method, does, call = row.split(None, 2)
            arguments, _, further = call.partition("; ")
            lines.append(Line(method, does, f"f.{method}({arguments}); {further or 'pass'}"))
        yield Block(head.partition("(")[0], f"f = openmm.{head}", tuple(lines))


FORCES = {block.name: block for block in _read(_TABLE)}


def setters(cls: type) -> set[str]:
    """Methods of a class that change something."""
    words = r"(set[A-Z]|add|remove|update|load|reinitialize|apply|computeVirtual)"
    return {name for name in dir(cls) if re.match(words, name) and inspect.isroutine(getattr(cls, name))}


def force_classes() -> set[str]:
    """Names of all classes of forces there are."""
    forces = {cls for cls in vars(openmm).values() if isinstance(cls, type) and issubclass(cls, openmm.Force)}
    return {cls.__name__ for cls in forces if cls not in (openmm.Force,)}


def _ways(rows: dict[str, str]) -> dict[str, tuple[str, str]]:
    """What each method does in whole steps and in programs, where the two differ with ``|`` between them."""
    found = {}
    for does, methods in rows.items():
        whole, _, program = does.partition("|") if "|" in does else (does, "", does)
        found |= {method: (whole, program) for method in methods.split()}
    return found


#: What the methods of System, Context and the integrators do, in whole steps and in programs.  ``acts``: in the next step; ``anew``: after
#: reinitialize; ``nothing``: as with OpenMM's own; ``refused: ...`` and ``anew refused: ...``: an error with these words instead.
_DOES: dict[str, dict[str, str]] = {
    "System": {
        "anew": "addForce removeForce",
        "|anew": "removeConstraint setConstraintParameters",
        "nothing": "setDefaultPeriodicBoxVectors",
        "refused: 9 particles": "addParticle",
        "anew refused: had none when": "addConstraint",
        "anew refused: mass of particle 1": "setParticleMass",
        "anew refused: virtual site": "setVirtualSite",
    },
    "Context": {
        "acts": "loadCheckpoint reinitialize setParameter setPeriodicBoxVectors setPositions setState setStepCount setTime setVelocities "
        "setVelocitiesToTemperature",
        "|acts": "applyConstraints applyVelocityConstraints computeVirtualSites",
    },
    "PairIntegrator": {
        "refused: bound to a context": "addComputeGlobal addComputePerDof addComputeSum addConstrainPositions addConstrainVelocities "
        "addGlobalVariable addPerDofVariable addUpdateContextState",
        "nothing": "addTabulatedFunction",
        "|acts": "setConstraintTolerance",
        "acts": "setGlobalVariable setGlobalVariableByName setPerDofVariable setPerDofVariableByName setRandomNumberSeed setStepSize "
        "setTemperature",
        "acts|refused: setIntegrationForceGroups": "setIntegrationForceGroups",
        "anew": "setKineticEnergyExpression",
    },
    "Force": {"anew refused: is in force group 31": "setForceGroup", "nothing": "setName"},
    "MonteCarloBarostat": {
        "nothing": "setDefaultPressure setDefaultTemperature",
        "acts": "setFrequency",
        "anew": "setRandomNumberSeed setScaleMoleculesAsRigid",
    },
    "MonteCarloMembraneBarostat": {"nothing": "setDefaultSurfaceTension", "acts": "setXYMode setZMode"},
}
METHODS = {owner: _ways(rows) for owner, rows in _DOES.items()}
