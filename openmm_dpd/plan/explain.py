"""A plan in words."""

import numpy as np

from ..base.errors import either, in_length, in_number, in_units, require, thermal, unit_name
from ..kernels.fields import ENERGY, TEMPERATURE
from ..model.electrostatics import NO_ELECTROSTATICS
from ..model.flow import Wall
from ..model.pairs import describe
from ..model.segments import segment_parts
from ..model.shapes import SolidWall
from .kinds import bonded_kind
from .pair_spec import longest
from .plan import Plan
from .solids import solid_text


def explain_plan(plan: Plan) -> str:
    """A plan in words, half a page: what will be built, and why."""
    require(plan, Plan, "expected a Plan, such as built.plan")
    scene, options, box = plan.scene, plan.options, "none"
    if scene.box is not None:
        edges = [in_number(edge, "length") for edge in (*np.diag(scene.box), *scene.box[(1, 2, 2), (0, 0, 1)])]
        box = f"{' x '.join(edges[:3])} {unit_name('length')}".rstrip()
        box += f", tilt {' '.join(edges[3:])}" if np.any(np.tril(scene.box, -1)) else ""
    frozen = int(scene.immobile.sum()) if plan.host is None else 0
    lines = [
        *_particle_lines(plan),
        f"box: {box}",
        f"scheme: {options.scheme} ({options.scheme.what}), dt = {in_units(options.dt, 'time')}"
        + (f", lambda = {options.lam:g}" if options.scheme.predicts else ""),
        _temperature_text(plan),
        f"seed of the noise: {options.seed}",
        "pair terms:",
    ]
    described: dict[str, list[str]] = {}
    for table in (*plan.layers, *plan.overlays):
        for (a, b), value in table.items():
            text = describe(value)  # in a System made elsewhere the default cutoff is no unit of length
            text += f" within {in_length(value.cutoff)}" if plan.host is not None and value.cutoff and "cutoff" not in text else ""
            described.setdefault(text, []).append(f"{a} - {b}")
    lines += [f"  {', '.join(pairs)}: {text}" for text, pairs in described.items()]
    lines += _execution_lines(plan)
    if plan.spec.fields is not None:
        lines.append(_field_text(plan))
    if len(scene.bond_pairs):
        lines.append(f"{_bond_text(plan)}; {len(plan.exceptions)} bonded neighbours with a factor other than 1")
    lines += [f"{len(group.beads)} {bonded_kind(type(group)).name}" for group in scene.bonded[len(scene.bonds) :]]
    lines += [str(each) for each in scene.reactions]
    if scene.segments is not None:
        lines.append(_segment_text(plan))
    if scene.electrostatics is not None:
        lines += _charge_lines(plan)
    elif scene.charges is not None and scene.charges.any():
        lines.append(NO_ELECTROSTATICS.format(np.count_nonzero(scene.charges)))
    lines += [f"body force on single beads: {term}" for term in scene.body_forces]
    if scene.interacting is not None:
        counts = "/".join(str(int(count)) for count in (~scene.interacting).sum(axis=0))
        lines.append(f"beads on which only body forces act, along x/y/z: {counts}")
    if scene.shear is not None:
        lines.append(f"Lees-Edwards shear along x, growing with y: {scene.shear}")
    if scene.bodies:
        lines.append(f"{len(scene.bodies)} rigid bodies of {sum(len(body.beads) for body in scene.bodies)} beads")
    for axis, gap in scene.gaps.items():
        lines.append(f"{gap.kind} walls: {'xyz'[axis]} from {in_length(gap.low)} to {in_length(gap.high)}")
        lines += [f"  {_wall_text(wall)}" for wall in gap.sides.values() if wall.driven]
    lines += [solid_text(wall, plan.driven, number) for number, wall in enumerate(scene.walls) if isinstance(wall, SolidWall)]
    if frozen:
        lines.append(f"{frozen} beads do not move (mass 0)")
    return "\n".join(lines)


def _wall_text(wall: Wall) -> str:
    parts = [f"the one with the beads {wall.side}:"]
    if wall.velocity is not None:
        swings = "" if wall.period is None else f" times cos(2 pi t/{in_units(wall.period, 'time')})"
        parts.append(f"velocity ({', '.join(f'{u:g}' for u in wall.velocity)}){swings}")
    if wall.behind is not None:
        parts.append(f"behind it a continuum of {wall.behind} with the density {wall.density:g}")
    return " ".join(parts)


def _particle_lines(plan: Plan) -> list[str]:
    scene, lines = plan.scene, []
    if plan.host is not None:
        lines = [f"{plan.n_atoms} particles of a System made elsewhere, {int(plan.host.left_out.sum())} of them without friction"]
    types = [scene.type_names[k] for k in np.unique(scene.type_ids[plan.n_atoms :])]
    if types:
        named = ", ".join(f"{name} (mass {scene.masses[name]:g})" for name in types)
        lines.append(f"{scene.n_beads - plan.n_atoms} beads of {len(types)} type(s): {named}")
    return lines


def _bond_text(plan: Plan) -> str:
    counts: dict[str, int] = {}
    for bonds in plan.scene.bonds:
        name = bonded_kind(type(bonds)).name
        counts[name] = counts.get(name, 0) + len(bonds.pairs)
    return ", ".join(f"{count} {name}" for name, count in counts.items())


def _segment_text(plan: Plan) -> str:
    segments = plan.scene.segments
    assert segments is not None
    points = "midpoints" if segments.distance == "mid" else "nearest points"
    many = f"{len(plan.scene.segment_pairs)} bonds{' at the start' * bool(segment_parts(plan.scene)[1])}"
    return (
        f"segmental repulsion between the {points} of {many}: A = {in_number(segments.A, 'force')}, "
        f"cutoff {in_length(segments.cutoff)}, compiled"
    )


def _charge_lines(plan: Plan) -> list[str]:
    charges, q, ewald = plan.scene.electrostatics, plan.scene.charges, plan.scene.ewald
    assert charges is not None and q is not None
    ions = int(np.count_nonzero(q))
    text = f"{ions} charged beads, total charge {q.sum():g} e: {charges.describe()}"
    text += either(f", Coulomb constant {charges.coulomb(plan.scene.initial_kT):.6g} kJ/mol nm/e^2", "")
    if ewald is None:
        return [text + "; no box: every pair, no cutoff"]
    if ewald.alpha == 0.0:
        return [f"{text}; pairs to {in_length(ewald.cutoff, 4)}, no lattice sum"]
    grid = "a direct sum over waves" if "charges" in plan.execution.held else "PME on a grid of " + " x ".join(map(str, ewald.grid))
    lines = [text, f"  real space to {in_length(ewald.cutoff, 4)}, {grid}, alpha = {in_units(ewald.alpha, 'inverse_length', 4)}"]
    error = charges.tail(ewald.cutoff)
    if error > 2 * charges.tolerance:
        lines.append(
            f"  beyond that charges are point charges; the smeared force differs there by a part of {error:.1g} still "
            f"({charges.tolerance:g} from {in_length(charges.reach(charges.tolerance), 3)} on)"
        )
    return lines


def _field_text(plan: Plan) -> str:
    fields = plan.spec.fields
    assert fields is not None
    text = f"{fields.n_values} value(s) per bead in {fields.n_blocks} per-DOF variable(s): {plan.options.field_names}"
    if fields.kind == ENERGY:
        eos = plan.scene.internal.by_type(plan.scene.type_names)  # type: ignore[union-attr]
        text += "; equation of state " + ", ".join(f"{name}: {state}" for name, state in zip(plan.scene.type_names, eos, strict=True))
    if fields.kind == TEMPERATURE and plan.scene.compat == "lammps":
        text += "; heat as LAMMPS computes it (compat), which does not conserve energy"
    text += "".join(f"; {caution}" for kind in plan.kinds if kind.caution and (caution := kind.caution(plan.scene)))
    pushing = sum(source.pushes for source in fields.sources)
    text += f"; {len(fields.sources) - pushing} source(s)" if len(fields.sources) > pushing else ""
    return text + (f"; {pushing} force(s) that follow it" if pushing else "")


def _temperature_text(plan: Plan) -> str:
    ramp = plan.options.ramp
    if ramp is None:
        return thermal(plan.options.kT)
    ends = f"{in_number(ramp.kT_start, 'thermal_energy')} to {in_units(ramp.kT_end, 'thermal_energy')}"
    return f"{either('kT', 'temperature')} from {ends} between steps {ramp.first_step} and {ramp.last_step}"


def _execution_lines(plan: Plan) -> list[str]:
    """Lines that say who computes what, and why."""
    execution, options = plan.execution, plan.options
    unlisted = "" if plan.listed(longest(plan.layers)) else ", over all pairs (a list could miss some: the box is small and tilted)"
    conservative = {
        "kernel": "in the pair kernel",
        "openmm": "CustomNonbondedForce with " + ("constants" if len(plan.scene.masses) == 1 else "tables of type pairs") + unlisted,
        "none": "none",
    }
    lines = [f"conservative DPD force: {conservative[execution.conservative]} ({execution.why['conservative']})"]
    if not options.kernel:
        lines.append("no friction, no noise: no pair kernel, no PythonForce")
    elif options.scheme.native:
        lines.append("friction and noise: OpenMM's DPDIntegrator")
    elif options.thermostat:
        transverse = any(np.any(getattr(term, "gamma_perp", 0) > 0) for term in plan.spec.terms)
        behind = "" if execution.on_device else " behind a PythonForce"
        lines.append(f"friction and noise: {plan.engine.what}{behind}" + (", with transverse terms" if transverse else ""))
    often = "each step" if options.slow_every == 1 else f"every {options.slow_every} steps"
    loop = f"many at once in compiled loops; other forces of OpenMM kick before and after {often}, a barostat acts behind them"
    beside = "charges and forces of others kick before and after each" if execution.slow else "all forces of the System kick at every B"
    device = f"whole ones on the device; {beside}"
    steps = {"loop": loop, "program": "one by one, by the program", "openmm": "one by one", "device": device}
    lines.append(f"steps: {steps[execution.steps]} ({execution.why['steps']})")
    if options.guided:
        lines.append(f"within each step, in Python: {options.guided}")
    parts: dict[tuple[bool, str], list[str]] = {}
    for part, why in execution.why.items():
        if part not in ("engine", "steps", "conservative", "precision"):
            parts.setdefault((part in execution.held, why), []).append(part)
    for (held, why), names in parts.items():
        lines.append(f"{', '.join(names)}: {'in' if held else 'outside of'} the pair kernel ({why})")
    if options.kernel and not options.scheme.native:
        lines.append(f"engine of the pair kernel: {execution.engine} ({execution.why['engine']})")
    lines.append(f"positions and velocities: {execution.precision} precision ({execution.why['precision']})")
    return lines
