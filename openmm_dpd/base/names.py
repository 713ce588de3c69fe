"""Names that programs and forces share: phases, context parameters and force groups."""

from enum import IntEnum


class Phase(IntEnum):
    """What the pair force is asked to do; the program sets it in the context parameter ``dpd_phase``.

    *Kept* are the positions of the last STORE, FINGERPRINT or CONSERVE, *seen* the present ones.  The pair terms use the velocity
    (seen - kept)/tau, with tau in the context parameter ``dpd_tau``.  To phases from 100 on a number below 100 is added.
    """

    IDLE = 0  # outside a step: conservative force and energy if the kernel computes them, else nothing
    STORE = 1  # store the positions; nothing else
    FINGERPRINT = 2  # store the positions; the energy is their fingerprint
    CONSERVE = 3  # store the positions; conservative force
    FORCE_SEEN = 4  # all forces that the kernel computes, at the seen positions
    FORCE_KEPT = 5  # dissipative and random force at the kept positions
    SWEEP_SEEN = 100  # (+ pair update) impulses/dt of a sweep at the seen positions
    SWEEP_KEPT = 200  # (+ pair update) impulses/dt of a sweep at the kept positions
    READ = 300  # (+ block) take three values per bead from seen - kept: per-bead fields
    CHANGE = 400  # (+ block) what the last evaluation did to these values: rates, or after a sweep increments
    EXCHANGE = 500  # (+ block) on the device: velocities and what is kept change places: 0 accelerations, 1 the velocities friction saw
    RUN = 600  # (+ 1: nothing is kept from the last one; + 2: forces of others may differ) a whole step in an update, on the device


PHASE, TAU, DT, KT, COUNTER, SEED = "dpd_phase", "dpd_tau", "dpd_dt", "dpd_kT", "dpd_counter", "dpd_seed"
#: What the script that made the integrator asked for, so that a state says who wrote it: scheme (a number), thermal energy and seed.
BY_SCHEME, BY_KT, BY_SEED = "dpd_by_scheme", "dpd_by_kT", "dpd_by_seed"
#: A number for the variables of the integrator that wrote a state: a checkpoint has their values without their names.
BY_VARIABLES = "dpd_by_variables"
#: 0 until the first step of a Context: reinitialize() without preserving the state makes it a new one.
BEGUN = "dpd_begun"
#: A number for the forces of others that acted in the last step, 0 where there were none: what a scheme kept is not valid for others.
BESIDE = "dpd_beside"
#: Name of a barostat whose pressure was given in the units of a scene.
CONVERTED = "DPD barostat"
#: Context parameters the pair force defines.
PARAMETERS = (PHASE, TAU, DT, KT, COUNTER, SEED, BY_SCHEME, BY_KT, BY_SEED, BY_VARIABLES, BESIDE, BEGUN)
#: Global variable of an integrator that holds the temperature in kelvin, as OpenMM's samplers want it; and what dpd_kT and it were
#: when they last agreed.
TEMPERATURE, SEEN_TEMPERATURE, SEEN_KT = "temperature", "seen_temperature", "seen_kT"
#: Global variable of an integrator that follows a temperature ramp: steps done.
RAMP_STEP = "ramp_step"
#: Global variables that every integrator with a pair force has, used or not, so that states go from one platform to another, where
#: another program may run the same scheme.
PORTABLE = ("ahead", "unused", "fingerprint", "valid_for", "stamp")
#: Per-DOF variable of an integrator: 1 where only body forces act, 0 elsewhere.
ALONE = "alone"
#: Global variable of an integrator: steps that are done already.  Only barostats still act in them.
AHEAD = "ahead"
#: Global variable of an integrator whose slow forces do not kick in every step: steps done since they last did.
SLOW_STEP = "slow_step"
#: Global variable of an integrator: fingerprint of the per-DOF variables that a loop of steps left, 0 where something else wrote them.
STAMP = "stamp"
#: Further ones where beads have internal energies: volume moves tried, their length (in ln V), and how many were accepted of late.
VOLUME_MOVES, VOLUME_STEP, VOLUME_ACCEPTED = "dpd_volume_moves", "dpd_volume_step", "dpd_volume_accepted"
#: Names of the per-DOF variables that hold internal energies, temperatures or concentrations, three values per bead in each; and of those
#: with their changes per time, where a scheme keeps these.
FIELD, RATE = "field", "rate"
#: Beginning of the names of per-DOF variables with what the last call of step left of velocities and fields; and global variables that say
#: whether a step is the first or last one of a call (both are, unless somebody knows).
LEFT, FIRST, LAST = "left_", "first", "last"
#: Further ones where walls move or have something behind them: the impulse that each has taken up since the Context was made, by number
#: of its axis, side (0: the beads are above) and component.
IMPULSES = {
    (axis, side, k): f"dpd_wall_{'xyz'[axis]}_{('above', 'below')[side]}_{'xyz'[k]}"
    for axis in range(3)
    for side in range(2)
    for k in range(3)
}
#: Parameters that change within a step and say nothing about the state.
VOLATILE = frozenset((PHASE, TAU, BY_SCHEME, BY_KT, BY_SEED, BY_VARIABLES, BEGUN, VOLUME_MOVES, VOLUME_STEP, VOLUME_ACCEPTED))
VOLATILE |= frozenset(IMPULSES.values())

#: Further one where there is a Lees-Edwards shear: for how long, which the box vectors belong to.
SHEARED = "dpd_sheared"

# Force groups.  The package leaves the low ones to users and OpenMM.

#: Name of the force of the pair terms.
PAIR_FORCE = "DPD pair terms"
#: Part of what the plugin says where a device had too little room for cells or rows, and has more of it now.
ROOM = "there is more room now"
#: Usual force group of the pair terms, outside the integration groups unless the kernel holds the conservative force.
PAIR_GROUP = 31
#: Groups of pair potentials, one for each cutoff, and then of the densities of many-body terms: the first one downwards to the last.
POTENTIAL_GROUP, LAST_POTENTIAL_GROUP = 15, 4
#: Group of bonds and angles.
BONDED_GROUP = 3
#: Group of forces on single beads, and the context parameter that scales them (0 switches them off).
EXTERNAL_GROUP = 20
BODY_FORCE = "dpd_body_force"
#: Group of a force without an energy that says which beads are bonded, where the kernel holds the bonds: barostats move molecules.
MOLECULE_GROUP = 21
#: Group of the segmental repulsion.
SEGMENT_GROUP = 16
#: Groups of smeared charges: what is short-ranged, and the lattice sum.
COULOMB_GROUP, LATTICE_GROUP = 17, 18
