// Arguments of kernels that belong together, for kernels and host alike: of each its type and name in kernels, and its
// value where the host launches one (Storage.h, Fields.h).
#ifndef DPD_ARGUMENTS_H_
#define DPD_ARGUMENTS_H_
#define TAKE(type, name, value) type name
#define PASS(type, name, value) name
#define GIVE(type, name, value) value
#define READS(type) GLOBAL const type* RESTRICT
#define WRITES(type) GLOBAL type* RESTRICT

// Flags: why nothing goes on (a sum of the constants below), room that would be needed, the bound of the eigenvalues
// of M^-1 G, in units of 2^-20 of the rate that the host passes, since it was reset and ever, the bead that runs away,
// the numbers of the launches that have set STOP, and that have found other positions than those kept
enum { STOP, MOST_IN_CELL, MOST_IN_ROW, BOUND, MOST_BOUND, WHO, WHEN, MOVED, FLAGS };
// COLD: a temperature that is not > 0, NO_HEAT: a negative coefficient of heat conduction
enum { CELLS_FULL = 1, ROWS_FULL = 2, FEW_PASSES = 4, RUNAWAY = 8, COLD = 16, NO_HEAT = 32, FEW_ROUNDS = 64 };

// The box: edges, their inverses, the components below the diagonal (b.x, c.x, c.y), edges of cells, their numbers, and
// places in each.  Without a box it is the period of the cells: beads of other periods seem near, until looked at.
#define BOX_OF(X) \
    X(mixed4, edges, edges), \
    X(mixed4, inverse, inverse), \
    X(mixed4, tilt, tilt), \
    X(mixed4, width, width), \
    X(int, nx, grid[0]), \
    X(int, ny, grid[1]), \
    X(int, nz, grid[2]), \
    X(int, room, cellRoom)
#define BOX BOX_OF(TAKE)
#define BOX_ BOX_OF(PASS)

// Cells: how many beads are in each, and `room` places for them: where a bead is in the box and its index, in mixed
// precision what single precision has left of that; and the velocity that friction sees, with number and type of the
// bead in one word.  The order in `walk`, of which a block has a `share`.
#define CELLS_OF(X) \
    X(READS(int), count, count[cells]), \
    X(READS(real4), beads, beads[side]), \
    X(READS(real4), rests, rests[side]), \
    X(READS(real4), motion, motion[felt]), \
    X(READS(int), walk, walk), \
    X(int, walked, walked), \
    X(int, share, share)
#define CELLS CELLS_OF(TAKE)
#define CELLS_ CELLS_OF(PASS)

// Cells to be filled, those that are emptied meanwhile, and which beads run away (dpdPut)
#define FILL_OF(X) \
    X(WRITES(int), countNew, count[next()]), \
    X(WRITES(real4), beadsNew, beads[1-side]), \
    X(WRITES(real4), restsNew, rests[1-side]), \
    X(WRITES(real4), motionNew, motion[1-felt]), \
    X(WRITES(int), dirty, count[spare()]), \
    X(int, cells, walked), \
    X(mixed, fastest2, Mixed{fastest*fastest}), \
    X(mixed, hottest, Mixed{100*now.kT})
#define FILL FILL_OF(TAKE)
#define FILL_ FILL_OF(PASS)

// Who beads are
#define KINDS_OF(X) \
    X(READS(int), atomIndex, device.index()), \
    X(READS(int), types, types), \
    X(READS(real4), wallVelocity, wallVelocity)
#define KINDS KINDS_OF(TAKE)

// What the pair terms depend on beside positions and velocities
#define TERMS_OF(X) \
    KINDS_OF(X), \
    X(READS(real4), params, params), \
    X(READS(real4), more, more), \
    X(READS(real4), cubics, cubics), \
    X(READS(int), exceptionStart, exceptionStart), \
    X(READS(int), exceptionBead, exceptionBead), \
    X(READS(real), exceptionFactor, exceptionFactor), \
    X(READS(real4), many, many), \
    X(READS(real), weights, massOf), \
    X(READS(real), densities, densities), \
    X(READS(real4), carrying, fields.carrying), \
    X(READS(mixed4), carried, fields.shown), \
    X(mm_long, key, (long long) noiseKey(now.seed, now.counter, now.kT, part)), \
    X(mm_long, begun, (long long) callKey({now.seed, now.counter})), \
    X(mm_long, bits, (long long) bitsOf(now.kT)+part), \
    X(real, noise, Real{dt > 0 ? std::sqrt(2*(fluid.carries == HEAT ? 1 : now.kT)/dt) : 0}), \
    X(real, perRoot2kT, Real{now.kT > 0 ? 1/std::sqrt(2*now.kT) : 0}), \
    X(real, slide, Real{flow.w})
#define TERMS TERMS_OF(TAKE)
#define TERMS_ TERMS_OF(PASS)

// What drifts depend on: walls, whose rows are lower ones, upper ones, where the period begins, its length, 1 along
// axes with bounce-back; then velocities of the lower and the upper wall of each axis, which `swings` multiply; what is
// behind walls; and the momentum that walls have taken up.  `flow` of a shear: what velocities change by before and
// after a drift, per height, and its rate then.
#define DRIFT_OF(X) \
    X(mixed, drift, Mixed{drift}), \
    X(READS(mixed4), walls, walls), \
    X(READS(real4), behind, behind), \
    X(real, behindReach, Real{fluid.behindReach}), \
    X(WRITES(mm_ulong), impulses, impulses), \
    X(mixed4, swingsLow, swings[0]), \
    X(mixed4, swingsHigh, swings[1]), \
    X(mixed4, flow, flow)
#define DRIFT DRIFT_OF(TAKE)
#define DRIFT_ DRIFT_OF(PASS)

// Forces of others, now and kept; partial: along some axes only the `external` force acts on a bead.
#define OTHERS_OF(X) \
    X(READS(mm_long), others, device.force()), \
    X(WRITES(mm_long), kept, beside), \
    X(READS(int), alone, alone), \
    X(READS(mm_long), external, external), \
    X(int, partial, (int) apart)
#define OTHERS OTHERS_OF(TAKE)

// Rows of partners (dpdRows), how they are solved (dpdPass), and the arrays of that
#define ROWS_OF(X, access) \
    X(access(int), rowCount, rowCount), \
    X(access(real4), rows, rows), \
    X(access(real), rowsAcross, rowsAcross)
#define SOLVES_OF(X) \
    X(READS(real), limits, limits), \
    X(READS(real4), weights, weights), \
    X(real, factor, Real{factor}), \
    X(mixed, halfdt, Mixed{0.5*h})
#define SOLVES SOLVES_OF(TAKE)

// Rows of pairs (dpdPairs); around: what all neighbours of a bead exchange with it, per time
#define PAIRS_OF(X, access) \
    X(access(int), rowCount, rowCount), \
    X(access(real4), rows, rows), \
    X(access(real), distances, distances), \
    X(access(mixed4), around, around), \
    X(READS(real), capacities, capacities)

// Sources of what beads carry, and on which they act
#define SOURCES_OF(X) \
    X(READS(mixed4), sources, sources), \
    X(int, numSources, (int) fluid.sources.size()/12), \
    X(READS(int), takes, takes)
#define SOURCES SOURCES_OF(TAKE)
#define SOURCES_ SOURCES_OF(PASS)

// Of all kernels the first: what has stopped them, and the number of the launch
#define HALTS WRITES(int) flags, int launch
// Positions, those that a kernel writes, and copies of them
#define PLACE READS(real4) pos, READS(real4) corr
#define PLACE_NEW WRITES(real4) posNew, WRITES(real4) corrNew
#define PLACE_COPY WRITES(real4) posCopy, WRITES(real4) corrCopy
#endif
