"""Names that programs and forces share: phases, context parameters and force groups."""

from enum import IntEnum


class Phase(IntEnum):
    """What the pair force computes next; the program sets the phase in the context parameter ``dpd_phase``.

    *Kept* positions are those of the last STORE, FINGERPRINT or CONSERVE, *seen* ones are the present ones.  Velocities in the pair terms
    are (seen - kept)/tau, with tau in the context parameter ``dpd_tau``.  Phases from 100 on have a number below 100 added.
    """

    IDLE = 0  # outside a step: conservative force and energy if the kernel computes them, else nothing
    STORE = 1  # store the positions; nothing else
    FINGERPRINT = 2  # store the positions; the energy is their fingerprint
    CONSERVE = 3  # store the positions; conservative force
    FORCE_SEEN = 4  # all forces of the kernel, at the seen positions
    FORCE_KEPT = 5  # dissipative and random force at the kept positions
    SWEEP_SEEN = 100  # (+ pair update) impulses/dt of a sweep at the seen positions
    SWEEP_KEPT = 200  # (+ pair update) impulses/dt of a sweep at the kept positions
    READ = 300  # (+ block) read three values per bead, per-bead fields, from seen - kept
    CHANGE = 400  # (+ block) changes of these values by the last evaluation: rates, or after a sweep increments
    EXCHANGE = 500  # (+ block) on the device: swap velocities with what is kept (0: accelerations, 1: velocities seen; others: KEPT)
    RUN = 600  # (+ 1: nothing is kept from the last one; + 2: foreign forces may differ) a whole step in one update, on the device


PHASE, TAU, DT, KT, COUNTER, SEED = "dpd_phase", "dpd_tau", "dpd_dt", "dpd_kT", "dpd_counter", "dpd_seed"
#: Choices of the script that made the integrator, so that a state identifies it: scheme (a number), thermal energy and seed.
BY_SCHEME, BY_KT, BY_SEED, BY_FORCES = "dpd_by_scheme", "dpd_by_kT", "dpd_by_seed", "dpd_by_forces"
#: Number that identifies the variables of the integrator that wrote a state: a checkpoint has values without names.
BY_VARIABLES = "dpd_by_variables"
#: Number that identifies what beads carry, in Contexts where they do: its variables have the same names for all kinds.
BY_FIELDS = "dpd_by_fields"
#: 0 until the first step of a Context; reinitialize() without preserving the state resets it.
BEGUN = "dpd_begun"
#: Number that identifies the foreign forces of the last step, 0 without any: what a scheme has kept is not valid for others.
BESIDE = "dpd_beside"
#: Name of a barostat whose pressure was given in the units of a scene.
CONVERTED = "DPD barostat"
#: How the Context parameters of this package begin; all others are of forces of others.
OWN = "dpd_"
#: Context parameters the pair force defines.
PARAMETERS = (PHASE, TAU, DT, KT, COUNTER, SEED, BY_SCHEME, BY_KT, BY_SEED, BY_FORCES, BY_VARIABLES, BESIDE, BEGUN)
#: Global variables of an integrator: the temperature in kelvin, for OpenMM's samplers; and this and dpd_kT when they last agreed.
TEMPERATURE, SEEN_TEMPERATURE, SEEN_KT = "temperature", "seen_temperature", "seen_kT"
#: Global variable of an integrator that follows a temperature ramp: steps done.
RAMP_STEP = "ramp_step"
#: Global variables that every integrator with a pair force has, used or not, so that states can move to platforms where the scheme has
#: another program.
PORTABLE = ("ahead", "unused", "fingerprint", "valid_for", "stamp")
#: Per-DOF variable of an integrator: 1 where only body forces act, 0 elsewhere.
ALONE = "alone"
#: Global variable of an integrator: number of steps already done, in which only barostats still have to act.
AHEAD = "ahead"
#: Prefix of global variables of an integrator with what a guide of its steps keeps, and then how many bonds reactions have changed.
GUIDE = "guide"
#: Global variable of an integrator whose slow forces do not kick in every step: steps since their last kick.
SLOW_STEP = "slow_step"
#: Global variable of an integrator: fingerprint of the per-DOF variables left by a loop of steps, 0 if something else wrote them.
STAMP = "stamp"
#: Context parameters with internal energies: number of volume moves tried, their length (in ln V), and recently accepted ones.
VOLUME_MOVES, VOLUME_STEP, VOLUME_ACCEPTED = "dpd_volume_moves", "dpd_volume_step", "dpd_volume_accepted"
#: Names of the per-DOF variables of internal energies, temperatures or concentrations, with three values per bead each; and of their rates,
#: if a scheme keeps them.
FIELD, RATE = "field", "rate"
#: Numbers of the first blocks of both in the phase EXCHANGE.
KEPT = {FIELD: 10, RATE: 50}
#: There, the number of the first component of a wall, whose energy is the momentum that it has taken up since this was asked last, and
#: the number by which all are added to the context parameters IMPULSES, outside of a step.
TAKEN, ALL_TAKEN = 80, 98
#: Prefix of per-DOF variables with the table of bonds that form and break, see :mod:`openmm_dpd.kernels.reactions`.
BONDS = "bonds"
#: Context parameter where forces depend on bonds or temperatures, which OpenMM does not hand to them: the number of what they are now
#: (:class:`openmm_dpd.plan.forces.thread_state.Shown`), 0 if nobody has said it.
SHOWN = "dpd_shown"
#: Context parameter with temperatures or concentrations: 1 where beads that do not move have others than at the start, which programs skip.
WRITTEN = "dpd_written"
#: Prefix of per-DOF variables with the velocities and fields that the last call of step left; and global variables that mark the first and
#: last step of a call (by default every step is both).
LEFT, FIRST, LAST = "left_", "first", "last"
#: Context parameters with moving walls or a continuum behind walls: the impulse on each wall since the Context was made, by the number of
#: its axis, side (0: the beads are above) and component.
IMPULSES = {
    (axis, side, k): f"dpd_wall_{'xyz'[axis]}_{('above', 'below')[side]}_{'xyz'[k]}"
    for axis in range(3)
    for side in range(2)
    for k in range(3)
}
#: Context parameters with walls that have a shape: impulse and angular impulse (force, torque) on each, by its number, and how many there
#: may be.
SOLID, MOST_SOLIDS = "dpd_solid_{}_{}_{}", 8
#: Parameters that change within a step and are not part of the state.
VOLATILE = frozenset((PHASE, TAU, BY_SCHEME, BY_KT, BY_SEED, BY_VARIABLES, BY_FIELDS, BEGUN, VOLUME_MOVES, VOLUME_STEP, VOLUME_ACCEPTED))
VOLATILE |= frozenset((BY_FORCES, *IMPULSES.values()))
VOLATILE |= {SOLID.format(k, kind, axis) for k in range(MOST_SOLIDS) for kind in ("force", "torque") for axis in "xyz"}

#: Context parameter with a Lees-Edwards shear: its duration, to which the box vectors belong.
SHEARED = "dpd_sheared"

# Force groups.  The low ones are left to users and OpenMM.

#: Name of the force of the pair terms.
PAIR_FORCE = "DPD pair terms"
#: Part of the plugin's message when a device had too little memory for cells or rows, and has enlarged it.
ROOM = "there is more room now"
#: Default force group of the pair terms, outside the integration groups unless the kernel computes the conservative force.
PAIR_GROUP = 31
#: Groups of pair potentials, one for each cutoff, and then of the densities of many-body terms, from the first down to the last.
POTENTIAL_GROUP, LAST_POTENTIAL_GROUP = 15, 4
#: Group of bonds and angles.
BONDED_GROUP = 3
#: Group of forces on single beads, and the context parameter that scales them (0 switches them off).
EXTERNAL_GROUP = 20
BODY_FORCE = "dpd_body_force"
#: Group of a force without energy that defines bonds for barostats, which move molecules, if the kernel computes the bonds.
MOLECULE_GROUP = 21
#: Group of the segmental repulsion.
SEGMENT_GROUP = 16
#: Groups of smeared charges: the short-range part and the lattice sum.
COULOMB_GROUP, LATTICE_GROUP = 17, 18
