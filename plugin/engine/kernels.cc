// Pair terms of DPD and whole steps on cells of our own: one source for OpenCL, CUDA, HIP and C++.
//
// Sums over partners are sums of fixed-point numbers, pair by pair, so that neither the order of beads in a cell nor that of threads changes a
// bit, and that momentum is conserved to the last one.
//
// On a CPU a thread does all for its bead.  On a GPU LANES threads of a block share one: each looks for partners in other cells, what they find is
// listed in the memory of the block (else nearly all threads of a warp would wait while one draws noise), each takes its part of the list, and
// what they sum up comes together in lane 0.
//
// Where anything is wrong (a cell or row is full, a bead runs away) a kernel sets flags[STOP], and all kernels after it do nothing: the host
// finds out when it looks.  Launches have numbers, so that all of the one that found it still counts what room would be needed.

#define STOP 0        // why nothing goes on: a sum of the next five
#define CELLS_FULL 1
#define ROWS_FULL 2
#define FEW_PASSES 4
#define RUNAWAY 8
#define COLD 16       // a temperature that is not > 0
#define NO_HEAT 32    // a negative coefficient of heat conduction
#define FEW_ROUNDS 64
#define MOST_IN_CELL 1
#define MOST_IN_ROW 2
#define BOUND 3       // of the eigenvalues of M^-1 G, in units of 2^-20 of the rate that the host passes
#define MOST_BOUND 4
#define TOO_LARGE 2000000000 // for such a bound
#define WHO 5         // index of a bead that runs away
#define WHEN 6        // the number of the launch that has set STOP
#define MOVED 7       // of the launch that has found other positions than those kept
#define STOPPED (flags[STOP] != 0 && flags[WHEN] != 0 && flags[WHEN] != launch)
#define HALT(why) { flags[WHEN] = launch; ATOMIC_OR(&flags[STOP], why); }

#ifndef BOUNDS // what a compiler has to be told of the size of blocks
#define BOUNDS
#endif
#if LANES == 1
#define SHARED(sums)
#define EACH_BEAD for (int i = GLOBAL_ID; i < NUM_ATOMS; i += GLOBAL_SIZE) { \
    const bool there = true; \
    const int lane = 0; \
    int entries = 0;
#define TOGETHER(sums, n)
#define ENTRY (entries++)
#define ENTRIES entries
#else
#define BEADS (BLOCK/LANES) // that a block has at a time
#define LISTED 40           // partners of a bead at a time
#define SHARED(sums) \
    LOCAL mm_long shared[(sums)*BLOCK]; \
    LOCAL int found[BEADS], entered[BEADS], list[LISTED*BEADS], unfinished[1];
#define EACH_BEAD for (int first = GROUP_ID*BEADS; first < NUM_ATOMS; first += NUM_GROUPS*BEADS) { \
    const int lane = LOCAL_ID/BEADS, mine = LOCAL_ID%BEADS, i = min(first+mine, NUM_ATOMS-1); \
    const bool there = first+mine < NUM_ATOMS; \
    if (lane == 0) \
        found[mine] = entered[mine] = unfinished[0] = 0; \
    SYNC_THREADS
#define TOGETHER(sums, n) dpdTogether(sums, n, shared);
#define ENTRY ATOMIC_ADD(&entered[mine], 1)
#define ENTRIES entered[mine]

DEVICE void dpdTogether(mm_long* sums, int n, LOCAL_ARG mm_long* shared) {
    for (int k = 0; k < n; k++)
        shared[k*BLOCK+LOCAL_ID] = sums[k];
    SYNC_THREADS
    if (LOCAL_ID < BEADS)
        for (int k = 0; k < n; k++)
            for (int at = LOCAL_ID+BEADS; at < BLOCK; at += BEADS)
                sums[k] += shared[k*BLOCK+at];
    SYNC_THREADS
}
#endif
#define END_BEAD }
#define SUMMED (there && lane == 0) // who has all sums

#define GOLDEN 0x9E3779B97F4A7C15UL
#define STREAM 0xD1342543DE82EF95UL
#define SMOOTH 248

DEVICE mm_ulong dpdMix(mm_ulong z) {
    z = (z^(z>>30))*0xBF58476D1CE4E5B9UL;
    z = (z^(z>>27))*0x94D049BB133111EBUL;
    return z^(z>>31);
}

DEVICE mm_ulong dpdPairKey(mm_ulong key, int a, int b) {
    mm_ulong low = (mm_ulong) (a < b ? a : b), high = (mm_ulong) (a < b ? b : a);
    return dpdMix(dpdMix(((low<<32)|high)*GOLDEN+key)+key);
}

// Key of the noise of a layer; that of the first one is given (Tables.h).
DEVICE mm_ulong dpdKeyOf(int layer, mm_long key, mm_long begun, mm_long bits) {
    return layer == 0 ? key : dpdMix(dpdMix(begun+layer+GOLDEN)+bits+GOLDEN);
}

// Standard normal number of some bits, as openmm_dpd/kernels/noise.py makes it: a cubic in each cell of the inverse distribution function,
// and in the last cells Wichura's PPND7 (algorithm AS 241).
DEVICE real dpdNormal(mm_ulong bits, GLOBAL const real4* RESTRICT cubics) {
    int cell = (int) ((bits>>55)&0xFF);
    real place = ((real) (mm_long) ((bits&0x7FFFFFFFFFFFFFUL)>>3)+(real) 0.5)*(real) 2.220446049250313e-16;
    real z;
    if (cell < SMOOTH) {
        real4 c = cubics[cell];
        z = c.x+place*(c.y+place*(c.z+place*c.w));
    }
    else {
        // 255-cell and 1-place in one number that is never rounded to 0: single precision would draw infinity once in 8e9 times
        real p = ((real) (mm_long) ((~bits>>3)&0xFFFFFFFFFFFFFFFUL)+(real) 0.5)*(real) 4.336808689942018e-19;
        real r = SQRT(-LOG(p));
        if (r <= 5) {
            r -= (real) 1.6;
            z = ((((real) 0.17023821103*r+(real) 1.3067284816)*r+(real) 2.7568153900)*r+(real) 1.4234372777)/(((real) 0.12021132975*r+(real) 0.73700164250)*r+1);
        }
        else {
            r -= 5;
            z = ((((real) 0.017337203997*r+(real) 0.42868294337)*r+(real) 3.0812263860)*r+(real) 6.6579051150)/(((real) 0.012258202635*r+(real) 0.24197894225)*r+1);
        }
    }
    return (bits>>63) != 0 ? -z : z;
}

// Whether a number is finite, by its bits: compilers that are told that all numbers are leave out comparisons.
DEVICE bool dpdFinite(mixed x) {
    union { mixed value; unsigned int words[sizeof(mixed)/4]; } bits;
    bits.value = x;
    const unsigned int exponent = sizeof(mixed) == 4 ? 0x7F800000 : 0x7FF00000;
    return (bits.words[sizeof(mixed)/4-1]&exponent) != exponent;
}

DEVICE mixed3 dpdLoad(GLOBAL const real4* RESTRICT pos, GLOBAL const real4* RESTRICT corr, int i) {
    real4 a = pos[i];
#ifdef USE_MIXED_PRECISION
    real4 b = corr[i];
    return make_mixed3(a.x+(mixed) b.x, a.y+(mixed) b.y, a.z+(mixed) b.z);
#else
    return make_mixed3(a.x, a.y, a.z);
#endif
}

DEVICE void dpdStore(GLOBAL real4* RESTRICT pos, GLOBAL real4* RESTRICT corr, int i, mixed3 x, real q) {
    pos[i] = make_real4((real) x.x, (real) x.y, (real) x.z, q);
#ifdef USE_MIXED_PRECISION
    corr[i] = make_real4((real) (x.x-(real) x.x), (real) (x.y-(real) x.y), (real) (x.z-(real) x.z), 0);
#endif
}

DEVICE void dpdAdd(mixed4* v, mixed part, mixed4 a) {
    v->x += part*a.x;
    v->y += part*a.y;
    v->z += part*a.z;
}

// Whether positions in cells are those in the box, or in its place without one: there beads of other periods seem near, until they are looked at.
#define WRAPPED (PERIODIC || REPEATED)
#if LANES > 1 || defined(USE_MIXED_PRECISION)
#define REPEATED true
#else
#define REPEATED false
#endif

// The box: edges, their inverses, and the components below the diagonal (b.x, c.x, c.y).  Without a box it is the period of the cells alone.
#define BOX mixed4 edges, mixed4 inverse, mixed4 tilt, int nx, int ny, int nz
#define BOX_ edges, inverse, tilt, nx, ny, nz

// The cell along an axis, if a bead is at s in units of the box, which it is `periods` of away from it.
DEVICE int dpdAxis(mixed s, int n, mixed* periods) {
    *periods = floor(s);
    int c = (int) ((s-*periods)*n);
    if (c >= n) { // rounded up to 1
        *periods += 1;
        return 0;
    }
    return c >= 0 ? c : 0; // no number
}

// The cell of a bead, and where it is in the box.
DEVICE int dpdCellOf(mixed3 x, mixed3* inside, BOX) {
    mixed sz = x.z*inverse.z, sy = (x.y-sz*tilt.z)*inverse.y, sx = (x.x-sz*tilt.y-sy*tilt.x)*inverse.x, px, py, pz;
    int cell = (dpdAxis(sz, nz, &pz)*ny+dpdAxis(sy, ny, &py))*nx+dpdAxis(sx, nx, &px);
    *inside = WRAPPED ? make_mixed3(x.x-px*edges.x-py*tilt.x-pz*tilt.y, x.y-py*edges.y-pz*tilt.z, x.z-pz*edges.z) : x;
    return cell;
}

DEVICE real3 dpdNearest(mixed3 d, BOX) { // of the images of a difference
    if (PERIODIC) {
        mixed s = floor(d.z*inverse.z+(mixed) 0.5);
        d.z -= s*edges.z;
#ifdef TRICLINIC
        d.y -= s*tilt.z;
        d.x -= s*tilt.y;
#endif
        s = floor(d.y*inverse.y+(mixed) 0.5);
        d.y -= s*edges.y;
#ifdef TRICLINIC
        d.x -= s*tilt.x;
#endif
        d.x -= floor(d.x*inverse.x+(mixed) 0.5)*edges.x;
    }
    return make_real3((real) d.x, (real) d.y, (real) d.z);
}

// Cells: how many beads are in each, where in the box these are and which (`room` places per cell), and the place of each bead (-1: it takes no part).
#define FILL GLOBAL int* RESTRICT count, GLOBAL real4* RESTRICT beads, GLOBAL int* RESTRICT placeOf, GLOBAL int* RESTRICT dirty, int cells, int room
#define CELLS GLOBAL const int* RESTRICT count, GLOBAL const real4* RESTRICT beads, GLOBAL const int* RESTRICT placeOf, int room
#define CELLS_ count, beads, placeOf, room

DEVICE void dpdPut(int i, int type, mixed3 x, GLOBAL int* RESTRICT count, GLOBAL real4* RESTRICT beads, GLOBAL int* RESTRICT placeOf, int room,
        GLOBAL int* RESTRICT flags, int launch, BOX) {
    if (type < 0) {
        placeOf[i] = -1;
        return;
    }
    mixed3 inside;
    int cell = dpdCellOf(x, &inside, BOX_);
    int k = ATOMIC_ADD(&count[cell], 1);
    placeOf[i] = cell*room+k;
    if (k < room)
        beads[cell*room+k] = make_real4((real) inside.x, (real) inside.y, (real) inside.z, (real) i);
    else
        HALT(CELLS_FULL)
    if (k+1 > flags[MOST_IN_CELL])
        ATOMIC_MAX(&flags[MOST_IN_CELL], k+1);
}

// What the pair terms depend on beside positions and velocities.
#define TERMS GLOBAL const int* RESTRICT atomIndex, GLOBAL const int* RESTRICT types, GLOBAL const real4* RESTRICT params, \
        GLOBAL const real4* RESTRICT more, GLOBAL const real4* RESTRICT cubics, GLOBAL const int* RESTRICT exceptionStart, \
        GLOBAL const int* RESTRICT exceptionBead, GLOBAL const real* RESTRICT exceptionFactor, GLOBAL const real4* RESTRICT wallVelocity, \
        GLOBAL const real4* RESTRICT many, GLOBAL const real* RESTRICT weights, GLOBAL const real* RESTRICT densities, \
        GLOBAL const real4* RESTRICT carrying, GLOBAL const mixed4* RESTRICT carried, mm_long key, mm_long begun, mm_long bits, real noise, real perRoot2kT, real slide
#define TERMS_ atomIndex, types, params, more, cubics, exceptionStart, exceptionBead, exceptionFactor, wallVelocity, many, weights, densities, \
        carrying, carried, key, begun, bits, noise, perRoot2kT, slide
#define EACH_LAYER for (int layer = 0; layer < LAYERS; layer++)
#define ROW(layer) (type+types[j]+(layer)*NUM_TYPES*NUM_TYPES) // of a pair in tables

DEVICE real dpdFactor(int a, int b, GLOBAL const int* RESTRICT exceptionStart, GLOBAL const int* RESTRICT exceptionBead,
        GLOBAL const real* RESTRICT exceptionFactor) {
    for (int e = exceptionStart[a]; e < exceptionStart[a+1]; e++)
        if (exceptionBead[e] == b)
            return exceptionFactor[e];
    return 1;
}

DEVICE mixed4 dpdVelocity(GLOBAL const mixed4* RESTRICT vel, int i, GLOBAL const int* RESTRICT atomIndex, GLOBAL const real4* RESTRICT wallVelocity) {
    mixed4 v = vel[i];
#ifdef IMMOBILE
    if (v.w == 0) {
        real4 wall = wallVelocity[atomIndex[i]];
        v = make_mixed4(wall.x, wall.y, wall.z, 0);
    }
#endif
    return v;
}

// What beads carry (fields.cc): heat, as temperatures (with the heat of LAMMPS's code or not) or as ENERGIES, or species that diffuse.
#define HEAT 1
#define SPECIES 2
#ifndef CARRIES
#define CARRIES 0
#define LAMMPS 0
#define ENERGIES 0
#define CARRYING_ROWS 1 // of `carrying` for each pair of types
#endif

// 1 + c1 y + c2 y^2 + c3 y^3 + c4 y^4 at the temperature 1 + y
DEVICE real dpdPolynomial(real4 c, real y) {
    return 1+y*(c.x+y*(c.y+y*(c.z+y*c.w)));
}

// Mean and harmonic mean of the temperatures of two beads, the same from either of them, and the root of the weight of friction between them
DEVICE real3 dpdWarm(int row, int a, int b, real w, GLOBAL const real4* RESTRICT carrying, GLOBAL const mixed4* RESTRICT carried) {
    real s = (real) carried[a].x, t = (real) carried[b].x, low = min(s, t), high = max(s, t), mean = (real) 0.5*(low+high);
    if (ENERGIES)
        return make_real3(mean, 2*low*high/(low+high), w);
    real exponent = carrying[row*CARRYING_ROWS].w*dpdPolynomial(carrying[row*CARRYING_ROWS+1], mean-1);
    return make_real3(mean, 2*low*high/(low+high), POW(w, (real) 0.5*max((real) 0.01, exponent)));
}

// Coefficients of a pair: what w^s is multiplied with in friction (its root) and noise (times `kick`, too), along the line between beads and across.
typedef struct {
    real A, rc, root, w, rootAcross, wAcross, factor, kick;
} DPDPair;

DEVICE bool dpdPair(DPDPair* p, int row, int a, int b, real r, TERMS) {
    real4 c = params[row];
    real w = 1-r*c.z;
    if (w <= 0)
        return false;
    p->A = c.x*w;
    p->factor = 1;
    p->rc = 1/c.z;
    p->root = c.y;
    p->w = w;
    p->kick = 1;
#ifdef FIXED_SIGMA
    if (c.w != 0)
        p->root *= perRoot2kT;
#endif
#ifdef DETAILED
    real4 m = more[row];
    p->rootAcross = m.x;
    p->wAcross = m.z == 1 ? w : POW(w, m.z);
    if (m.y != 1)
        p->w = POW(w, m.y);
#else
    p->rootAcross = 0;
    p->wAcross = 0;
#endif
    if (CARRIES == HEAT) {
        real3 warm = dpdWarm(row, a, b, w, carrying, carried);
        p->kick = SQRT(warm.y);
        if (ENERGIES) // noise does not follow temperatures, friction does
            p->root /= p->kick;
        else
            p->A *= warm.x;
        p->w = warm.z;
    }
#ifdef EXCEPTIONS
    real f = dpdFactor(a, b, exceptionStart, exceptionBead, exceptionFactor);
    if (f == 0)
        return false;
    real root = SQRT(f);
    p->A *= f;
    p->factor = f;
    p->root *= root;
    p->rootAcross *= root;
    if (CARRIES == HEAT && LAMMPS)
        p->kick *= root;
#endif
    return true;
}

// The noise across of a pair, a vector that is the force on the bead with the lower index.
DEVICE real3 dpdAcross(mm_ulong pair, real3 e, bool lower, GLOBAL const real4* RESTRICT cubics) {
    real x = dpdNormal(dpdMix(pair+STREAM), cubics), y = dpdNormal(dpdMix(pair+2*STREAM), cubics), z = dpdNormal(dpdMix(pair+3*STREAM), cubics);
    real along = e.x*x+e.y*y+e.z*z;
    real sign = lower ? 1 : -1;
    return make_real3(sign*(x-along*e.x), sign*(y-along*e.y), sign*(z-along*e.z));
}

// The cell before another one along an axis (at = 0), itself (1) or the one after it (2), and how many periods it is away by that; all, of few.
DEVICE int dpdNext(int own, int at, int n, real* periods) {
    int c = n < 3 ? at : own+at-1;
    *periods = WRAPPED ? (c < 0) - (c >= n) : 0;
    return c < 0 ? c+n : c >= n ? c-n : c;
}

// Where a bead is in its cell along an axis, from 0 to 1, if it is at s in units of the box.  Both `dpdAxis` and the position in the cell may have
// rounded: to the other end of the box (far from 0 and 1), and out of the cell by a little.
DEVICE float dpdPlace(mixed s, int n, int own) {
    float f = (float) ((s-floor(s))*n-own);
    return f < -0.5f ? 1 : f > 1.5f ? 0 : f < 0 ? 0 : f > 1 ? 1 : f;
}

// The square of how far it is from the cells before its own (at = 0), in line with it (1) and after it (2).
DEVICE float dpdGap(int at, float place, mixed edge, int n) {
    float gap = at == 1 || n < 3 ? 0 : (at == 0 ? place : 1-place)*(float) (edge/n);
    return gap*gap;
}

#ifdef TRICLINIC // cells are not rectangular: all are looked into
#define PLACE(axis, n, own) 0
#define GAP(axis, at, n) 0
#else
#define PLACE(axis, n, own) dpdPlace(here.axis*inverse.axis, n, own)
#define GAP(axis, at, n) dpdGap(at, place##axis, edges.axis, n)
#endif

// Which of those that cells have near a bead are within the longest cutoff: delta is from j to i, r2 its square.
#define SQUARE(delta) (delta.x*delta.x+delta.y*delta.y+delta.z*delta.z)
#ifdef MANY_BODY // beads at the same point count in each other's densities; positions of one bead in cells are the same, too
#define WITHIN (r2 < MAX_CUTOFF*MAX_CUTOFF && j != i)
#define APART (r2 != 0)
#else
#define APART true
#define WITHIN (r2 < MAX_CUTOFF*MAX_CUTOFF && r2 != 0)
#endif
#if LANES > 1 || defined(USE_MIXED_PRECISION) // these look at the positions themselves
#define IS_NEAR (r2 < (real) (MAX_CUTOFF*MAX_CUTOFF*1.01) && (int) y.w != i) // positions in cells are rounded
#define TAKE(pair) \
    mixed3 z = dpdLoad(pos, corr, j); \
    real3 delta = dpdNearest(make_mixed3(x.x-z.x, x.y-z.y, x.z-z.z), BOX_); \
    real r2 = SQUARE(delta); \
    if (WITHIN) { \
        pair; \
    }
#else
#define IS_NEAR WITHIN
#define TAKE(pair) pair;
#endif

// What is to be done with all partners j of a bead within the longest cutoff, if it takes part.  Cells that are farther away are left out.
#define TAKES_PART (there && placeOf[i] >= 0)
#define ITSELF(vel) \
    mixed3 x = dpdLoad(pos, corr, i); \
    mixed4 v = dpdVelocity(vel, i, atomIndex, wallVelocity); \
    int type = types[i]*NUM_TYPES, index = atomIndex[i]; \
    real inertia = SQRT((real) v.w);
#define HERE \
    int place = max(placeOf[i], 0), cell = place/room, plane = cell/nx, hx = cell-plane*nx, hz = plane/ny, hy = plane-hz*ny; \
    real4 here = beads[place]; \
    float placex = PLACE(x, nx, hx), placey = PLACE(y, ny, hy), placez = PLACE(z, nz, hz); \
    bool few = PERIODIC && min(nx, min(ny, nz)) < 3;
#define FAR_CELL (GAP(z, c, nz)+GAP(y, b, ny)+GAP(x, a, nx) >= (float) (MAX_CUTOFF*MAX_CUTOFF*1.0002))
#define OTHER_CELL \
    real px, py, pz; \
    int other = (dpdNext(hz, c, nz, &pz)*ny+dpdNext(hy, b, ny, &py))*nx+dpdNext(hx, a, nx, &px), end = other*room+count[other]; \
    real3 away = make_real3(px*edges.x+py*tilt.x+pz*tilt.y, py*edges.y+pz*tilt.z, pz*edges.z);
#define OTHER_BEAD \
    real4 y = beads[slot]; \
    real3 delta = make_real3(here.x-y.x+away.x, here.y-y.y+away.y, here.z-y.z+away.z); \
    if (few) \
        delta = dpdNearest(make_mixed3(delta.x, delta.y, delta.z), BOX_); \
    real r2 = SQUARE(delta); \
    int j = (int) y.w;
#if LANES == 1
#define EACH_PARTNER(vel, pair) \
    if (TAKES_PART) { \
        HERE \
        ITSELF(vel) \
        for (int c = 0; c < min(nz, 3); c++) for (int b = 0; b < min(ny, 3); b++) for (int a = 0; a < min(nx, 3); a++) { \
            if (FAR_CELL) \
                continue; \
            OTHER_CELL \
            for (int slot = other*room; slot < end; slot++) { \
                OTHER_BEAD \
                if (IS_NEAR) { \
                    TAKE(pair) \
                } \
            } \
        } \
    }
#else
#define EACH_PARTNER(vel, pair) \
    HERE \
    for (int t = TAKES_PART ? lane : 27, from = 0; ; ) { /* a full list at a time; then cell t goes on at its bead `from` */ \
        for (bool full = false; t < 27 && !full; t += full ? 0 : LANES) { \
            int a = t%3, b = t/3%3, c = t/9; \
            if (a >= nx || b >= ny || c >= nz || FAR_CELL) \
                continue; \
            OTHER_CELL \
            int slot = other*room+from; \
            for (from = 0; slot < end; slot++) { \
                OTHER_BEAD \
                if (!IS_NEAR) \
                    continue; \
                int k = ATOMIC_ADD(&found[mine], 1); \
                if (k >= LISTED) { \
                    unfinished[0] = 1; \
                    from = slot-other*room; \
                    full = true; \
                    break; \
                } \
                list[k*BEADS+mine] = j; \
            } \
        } \
        SYNC_THREADS \
        ITSELF(vel) /* not before, for there are not that many registers */ \
        for (int k = lane, n = min(found[mine], LISTED); k < n; k += LANES) { \
            int j = list[k*BEADS+mine]; \
            TAKE(pair) \
        } \
        bool last = unfinished[0] == 0; \
        SYNC_THREADS \
        if (last) \
            break; \
        if (lane == 0) \
            found[mine] = unfinished[0] = 0; \
        SYNC_THREADS \
    }
#endif

#define CONSERVATIVE 1
#define THERMOSTAT 2
#ifndef LUCY // which of the two weight functions densities have
#define LUCY 0
#endif

// What a partner adds to the density at a bead.  Rows of `many`: B of the force B (density + density) w_B, 1/cutoff of w_B, 1/cutoff and
// norm of the weight function; its partner's mass weighs Lucy's, for which factors of bonded neighbours but 0 count in full.
DEVICE real dpdDensityOf(int layer, int j, real r2, int type, int index, TERMS) {
    real4 m = many[ROW(layer)];
    int partner = atomIndex[j];
    real s = r2 > 0 ? r2*RSQRT(r2)*m.z : 0, w = 1-s, f = 1;
    if (w <= 0)
        return 0;
#ifdef EXCEPTIONS
    f = dpdFactor(index, partner, exceptionStart, exceptionBead, exceptionFactor);
#endif
    if (LUCY)
        return f == 0 ? 0 : weights[partner]*m.w*(1+3*s)*w*w*w;
    return f*m.w*w*w;
}

KERNEL BOUNDS void dpdDensity(GLOBAL const real4* RESTRICT pos, GLOBAL const real4* RESTRICT corr, GLOBAL const mixed4* RESTRICT vel, TERMS, CELLS,
        GLOBAL real* RESTRICT density, GLOBAL const int* RESTRICT flags, int launch, BOX) {
    if (STOPPED)
        return;
    SHARED(1)
    EACH_BEAD
        mm_long sum[1] = {0};
        EACH_PARTNER(vel, EACH_LAYER sum[0] += realToFixedPoint(dpdDensityOf(layer, j, r2, type, index, TERMS_)))
        TOGETHER(sum, 1)
        if (SUMMED)
            density[i] = (real) sum[0]/(real) 0x100000000;
    END_BEAD
}

// Force of a pair on a bead of this type (times their number), index and velocity, added to f, and half of its energy.
DEVICE real dpdPush(int layer, int i, int j, real3 delta, real r2, int type, int index, mixed4 v, int terms, GLOBAL const mixed4* RESTRICT vel, TERMS, mm_long* f) {
    real invR = APART ? RSQRT(r2) : 0, r = r2*invR, energy = 0;
    int partner = atomIndex[j];
    DPDPair p;
    if (!dpdPair(&p, ROW(layer), index, partner, r, TERMS_))
        return energy;
    real3 e = make_real3(invR*delta.x, invR*delta.y, invR*delta.z), force = make_real3(0, 0, 0);
    real size = 0;
    if ((terms & CONSERVATIVE) != 0) {
        real w = 1-r/p.rc;
        size += p.A;
        energy = APART ? (real) 0.25*p.A*w*p.rc : 0;
#ifdef MANY_BODY
        real4 m = many[ROW(layer)];
        w = 1-r*m.y;
        if (w > 0) {
            real push = p.factor*m.x*(densities[i]+densities[j])*w;
            size += push;
            energy += (LUCY ? (APART ? (real) 0.25 : 0) : (real) 0.125)*push*w/m.y; // of Lucy's as if densities were constants: it has no potential
        }
#endif
    }
    if ((terms & THERMOSTAT) != 0) {
        mm_ulong pair = dpdPairKey(dpdKeyOf(layer, key, begun, bits), index, partner);
        mixed4 o = dpdVelocity(vel, j, atomIndex, wallVelocity);
        real3 u = make_real3((real) (v.x-o.x), (real) (v.y-o.y), (real) (v.z-o.z));
        if (SHEARED) // velocities are relative to the flow
            u.x += slide*delta.y;
        real along = e.x*u.x+e.y*u.y+e.z*u.z, s = p.root*p.w;
        size += s*(noise*p.kick*dpdNormal(pair, cubics)-s*along);
#ifdef TRANSVERSE
        if (p.rootAcross != 0) {
            real t = p.rootAcross*p.wAcross;
            real3 z = dpdAcross(pair, e, index < partner, cubics);
            force = make_real3(t*(noise*z.x-t*(u.x-along*e.x)), t*(noise*z.y-t*(u.y-along*e.y)), t*(noise*z.z-t*(u.z-along*e.z)));
        }
#endif
    }
    f[0] += realToFixedPoint(size*e.x+force.x);
    f[1] += realToFixedPoint(size*e.y+force.y);
    f[2] += realToFixedPoint(size*e.z+force.z);
    return energy;
}

// What drifts depend on: walls, whose rows are lower ones, upper ones, where the period begins, its length, 1 along axes with bounce-back; then velocities
// of the lower and the upper wall of each axis, which `swings` multiply; what is behind walls; and the momentum that walls have taken up.  `flow` of a
// shear: what velocities change by before and after a drift, per height, and its rate then.
#define DRIFT mixed drift, GLOBAL const mixed4* RESTRICT walls, GLOBAL const real4* RESTRICT behind, real behindReach, GLOBAL mm_ulong* RESTRICT impulses, \
        mixed4 swingsLow, mixed4 swingsHigh, mixed4 flow
#define DRIFT_ drift, walls, behind, behindReach, impulses, swingsLow, swingsHigh, flow

DEVICE void dpdTake(GLOBAL mm_ulong* RESTRICT impulses, int wall, int axis, mixed impulse) {
    ATOMIC_ADD(&impulses[3*wall+axis], (mm_ulong) (mm_long) floor(impulse*(mixed) 1073741824+(mixed) 0.5));
}

DEVICE mixed dpdOf(mixed4 v, int axis) {
    return axis == 0 ? v.x : axis == 1 ? v.y : v.z;
}

DEVICE mixed dpdSpeed(int wall, int axis, DRIFT) {
    return dpdOf(wall%2 ? swingsHigh : swingsLow, wall/2)*dpdOf(walls[5+wall], axis);
}

// What a bead feels of what is behind a wall (openmm_dpd/kernels/driven.py), of which there are rows with straight lines between: force, energy, friction
// along the axis and across it; false where it is out of reach.
DEVICE bool dpdBehind(mixed3 x, int side, int type, real4* found, DRIFT) {
    if (BEHIND_ROWS <= 0 || type < 0)
        return false;
    mixed at = dpdOf(make_mixed4(x.x, x.y, x.z, 0), BEHIND_AXIS), period = dpdOf(walls[3], BEHIND_AXIS);
    at -= period*floor((at-dpdOf(walls[2], BEHIND_AXIS))/period);
    real h = (real) (side ? dpdOf(walls[1], BEHIND_AXIS)-at : at-dpdOf(walls[0], BEHIND_AXIS)), place = max((real) 0, h)*(BEHIND_ROWS/behindReach);
    if (h >= behindReach)
        return false;
    int row = min((int) place, BEHIND_ROWS-1);
    real4 a = behind[(side*NUM_TYPES+type)*(BEHIND_ROWS+1)+row], b = behind[(side*NUM_TYPES+type)*(BEHIND_ROWS+1)+row+1];
    place -= row;
    real push = a.x+place*(b.x-a.x), energy = b.y+(real) 0.5*(push+b.x)*(behindReach/BEHIND_ROWS)*(1-place)-push*min((real) 0, h);
    *found = make_real4(push, energy, a.z+place*(b.z-a.z), a.w+place*(b.w-a.w));
    return true;
}

// Its force on a bead, added to f; returns its energy.  A kick for a time gives the walls what the bead loses.
DEVICE real dpdPushed(mixed3 x, int type, mm_long* f, DRIFT) {
    real energy = 0;
    real4 found;
    for (int side = 0; side < 2; side++)
        if (dpdBehind(x, side, type, &found, DRIFT_)) {
            f[BEHIND_AXIS] += realToFixedPoint(side ? -found.x : found.x);
            energy += found.y;
        }
    return energy;
}

DEVICE void dpdKickWalls(mixed3 x, int type, mixed time, DRIFT) {
    real4 found;
    for (int side = 0; side < 2; side++)
        if (dpdBehind(x, side, type, &found, DRIFT_))
            dpdTake(impulses, 2*BEHIND_AXIS+side, BEHIND_AXIS, time*(side ? found.x : -found.x));
}

// Its friction and noise for a time
DEVICE mixed dpdRubbed(mixed v, int wall, int axis, mixed gamma, mixed inverseMass, mixed time, mixed kT, mm_ulong pair, GLOBAL const real4* RESTRICT cubics, DRIFT) {
    int stream = 3*(wall%2)+axis;
    mixed lost = -expm1(-gamma*inverseMass*time), noise = sqrt(kT*inverseMass*lost*(2-lost))*dpdNormal(stream == 0 ? pair : dpdMix(pair+stream*STREAM), cubics);
    mixed change = noise-lost*(v-dpdSpeed(wall, axis, DRIFT_));
    dpdTake(impulses, wall, axis, -change/inverseMass);
    return v+change;
}

DEVICE void dpdRub(mixed3 x, mixed4* v, int type, mixed time, mixed kT, mm_ulong pair, GLOBAL const real4* RESTRICT cubics, DRIFT) {
    real4 found;
    for (int side = 0; side < 2; side++)
        if (dpdBehind(x, side, type, &found, DRIFT_)) {
            int wall = 2*BEHIND_AXIS+side;
            v->x = dpdRubbed(v->x, wall, 0, BEHIND_AXIS == 0 ? found.z : found.w, v->w, time, kT, pair, cubics, DRIFT_);
            v->y = dpdRubbed(v->y, wall, 1, BEHIND_AXIS == 1 ? found.z : found.w, v->w, time, kT, pair, cubics, DRIFT_);
            v->z = dpdRubbed(v->z, wall, 2, BEHIND_AXIS == 2 ? found.z : found.w, v->w, time, kT, pair, cubics, DRIFT_);
        }
}
// For OpenMM: adds to its force and energy buffers.
KERNEL BOUNDS void dpdEvaluate(GLOBAL const real4* RESTRICT pos, GLOBAL const real4* RESTRICT corr, GLOBAL const mixed4* RESTRICT vel, TERMS, CELLS,
        GLOBAL mm_ulong* RESTRICT force, GLOBAL mixed* RESTRICT energyBuffer, int terms, GLOBAL const int* RESTRICT flags, int launch, DRIFT, BOX) {
    if (STOPPED)
        return;
    SHARED(4)
    mixed energy = 0;
    EACH_BEAD
        mm_long f[4] = {0, 0, 0, 0};
        EACH_PARTNER(vel, EACH_LAYER f[3] += realToFixedPoint(dpdPush(layer, i, j, delta, r2, type, index, v, terms, vel, TERMS_, f)))
        TOGETHER(f, 4)
        if (SUMMED) {
            if ((terms & CONSERVATIVE) != 0)
                energy += dpdPushed(dpdLoad(pos, corr, i), types[i], f, DRIFT_);
            energy += (mixed) f[3]/(mixed) 0x100000000;
            ATOMIC_ADD(&force[i], (mm_ulong) f[0]);
            ATOMIC_ADD(&force[i+STRIDE], (mm_ulong) f[1]);
            ATOMIC_ADD(&force[i+2*STRIDE], (mm_ulong) f[2]);
        }
    END_BEAD
    energyBuffer[GLOBAL_ID] += energy;
}

DEVICE mixed dpdReflected(mixed x, mixed low, mixed high, mixed start, mixed period) {
    mixed t = x-period*floor((x-start)/period);
    return x+2*max((mixed) 0, low-t)-2*max((mixed) 0, t-high);
}

// Which wall of an axis has put a bead there: 0 the lower one, 1 the upper one, -1 none
DEVICE int dpdSide(mixed x, mixed put, mixed low, mixed start, mixed period) {
    return put == x ? -1 : x-period*floor((x-start)/period) < low ? 0 : 1;
}

// A component of a velocity after walls: one of its own axis turns it, of which `side` says whether there is any, or else the first one that turns all
DEVICE mixed dpdTurned(mixed v, int axis, int side, int first, mixed inverseMass, DRIFT) {
    int wall = side >= 0 ? 2*axis+side : first;
    if (wall < 0)
        return v;
#ifdef DRIVEN
    mixed turned = 2*(side >= 0 ? 0 : dpdSpeed(wall, axis, DRIFT_))-v;
    dpdTake(impulses, wall, axis, (v-turned)/inverseMass);
    return turned;
#else
    return -v;
#endif
}

DEVICE void dpdDrift(mixed3* x, mixed4* v, DRIFT) {
    if (SHEARED)
        v->x += flow.x*x->y;
    x->x += drift*v->x;
    x->y += drift*v->y;
    x->z += drift*v->z;
    if (SHEARED)
        v->x += flow.y*x->y;
#ifdef WALLS
    mixed4 low = walls[0], high = walls[1], start = walls[2], period = walls[3], back = walls[4];
    mixed3 put = make_mixed3(dpdReflected(x->x, low.x, high.x, start.x, period.x), dpdReflected(x->y, low.y, high.y, start.y, period.y),
        dpdReflected(x->z, low.z, high.z, start.z, period.z));
    int sx = dpdSide(x->x, put.x, low.x, start.x, period.x), sy = dpdSide(x->y, put.y, low.y, start.y, period.y), sz = dpdSide(x->z, put.z, low.z, start.z, period.z);
    int first = sx >= 0 && back.x != 0 ? sx : sy >= 0 && back.y != 0 ? 2+sy : sz >= 0 && back.z != 0 ? 4+sz : -1;
    *x = put;
    v->x = dpdTurned(v->x, 0, sx, first, v->w, DRIFT_);
    v->y = dpdTurned(v->y, 1, sy, first, v->w, DRIFT_);
    v->z = dpdTurned(v->z, 2, sz, first, v->w, DRIFT_);
#endif
}

#define CLEAR for (int c = GLOBAL_ID; c < cells; c += GLOBAL_SIZE) dirty[c] = 0;

// v += kick*acc + kickSlow*slow, x += drift*v, and the beads into cells; moves: 0 into cells only, 2 with v + predict*acc to `seen`, 3 with a copy of x.  Nobody reads positions of
// others here: posNew may be pos.  A bead runs away whose speed nobody has in equilibrium (hottest is its square times the mass) and that
// crosses more than a cutoff in a step; fastest2 = 0 asks for no check.
KERNEL void dpdMove(GLOBAL const real4* RESTRICT pos, GLOBAL const real4* RESTRICT corr, GLOBAL real4* RESTRICT posNew, GLOBAL real4* RESTRICT corrNew,
        GLOBAL mixed4* RESTRICT velm, GLOBAL const mixed4* RESTRICT acc, GLOBAL mixed4* RESTRICT seen, mixed kick, mixed predict, int moves,
        GLOBAL const mixed4* RESTRICT slow, mixed kickSlow, GLOBAL real4* RESTRICT posCopy, GLOBAL real4* RESTRICT corrCopy,
        GLOBAL const int* RESTRICT atomIndex, GLOBAL const int* RESTRICT types, FILL, GLOBAL int* RESTRICT flags, int launch, mixed fastest2, mixed hottest, DRIFT, BOX) {
    if (STOPPED)
        return;
    CLEAR
    if (GLOBAL_ID == 0)
        flags[BOUND] = 0;
    for (int i = GLOBAL_ID; i < NUM_ATOMS; i += GLOBAL_SIZE) {
        mixed3 x = dpdLoad(pos, corr, i);
        mixed4 v = velm[i];
        mixed along = SHEARED ? v.x-flow.z*x.y : v.x;
        bool finite = dpdFinite(v.x) && dpdFinite(v.y) && dpdFinite(v.z);
        if (fastest2 != 0 && v.w != 0 && (!finite || along*along+v.y*v.y+v.z*v.z > max(fastest2, hottest*v.w))) {
            HALT(RUNAWAY)
            flags[WHO] = atomIndex[i];
        }
        if (moves) {
            if (v.w != 0) {
                mixed4 a = acc[i], s = make_mixed4(v.x+predict*a.x, v.y+predict*a.y, v.z+predict*a.z, v.w);
                if (kick != 0) {
                    dpdAdd(&v, kick, a);
                    dpdKickWalls(x, types[i], kick, DRIFT_);
                }
                if (kickSlow != 0)
                    dpdAdd(&v, kickSlow, slow[i]);
                mixed4 straight = v;
                if (drift != 0)
                    dpdDrift(&x, &v, DRIFT_);
                velm[i] = v;
                if (moves == 2 && SHEARED) // relative to the flow
                    seen[i] = make_mixed4(s.x+(v.x-straight.x)-flow.w*x.y, s.y, s.z, v.w);
                else if (moves == 2) // turned round by walls as v is: to 2*speed-s
                    seen[i] = make_mixed4(v.x == straight.x ? s.x : v.x+straight.x-s.x, v.y == straight.y ? s.y : v.y+straight.y-s.y,
                        v.z == straight.z ? s.z : v.z+straight.z-s.z, v.w);
            }
            else if (moves == 2)
                seen[i] = v;
            real w = pos[i].w;
            dpdStore(posNew, corrNew, i, x, w);
            if (moves == 3)
                dpdStore(posCopy, corrCopy, i, x, w);
        }
        dpdPut(i, types[i], x, count, beads, placeOf, room, flags, launch, BOX_);
    }
}

// acc = F/m with these terms and the force of others, v += kick*acc, x += drift*v; moves: 1 the beads into the next cells, 2 only their positions to
// posNew, 3 as 1 and a copy of x.  `seen` are the velocities of friction, which may be velm without it.  useOthers: 2 keeps the force of others.
// partial: along some axes only the `external` force acts on a bead.
KERNEL BOUNDS void dpdKick(GLOBAL const real4* RESTRICT pos, GLOBAL const real4* RESTRICT corr, GLOBAL real4* RESTRICT posNew, GLOBAL real4* RESTRICT corrNew,
        GLOBAL const mixed4* seen, GLOBAL mixed4* velm, GLOBAL mixed4* RESTRICT acc, GLOBAL const mm_long* RESTRICT others, int useOthers,
        GLOBAL mm_long* RESTRICT kept, GLOBAL const int* RESTRICT alone, GLOBAL const mm_long* RESTRICT external, int partial, int terms, mixed kick, int moves, GLOBAL real4* RESTRICT posCopy, GLOBAL real4* RESTRICT corrCopy, TERMS, CELLS, GLOBAL int* RESTRICT countNew, GLOBAL real4* RESTRICT beadsNew, GLOBAL int* RESTRICT placeOfNew, GLOBAL int* RESTRICT dirty, int cells,
        GLOBAL int* RESTRICT flags, int launch, DRIFT, BOX) {
    if (STOPPED)
        return;
    bool drifts = moves == 1 || moves == 3;
    if (drifts) {
        CLEAR
    }
    if (GLOBAL_ID == 0)
        flags[BOUND] = 0;
    SHARED(3)
    EACH_BEAD
        mm_long f[3] = {0, 0, 0};
        if (terms) {
            EACH_PARTNER(seen, EACH_LAYER dpdPush(layer, i, j, delta, r2, type, index, v, terms, seen, TERMS_, f))
            TOGETHER(f, 3)
        }
        if (SUMMED) {
            if (useOthers) {
                f[0] += others[i];
                f[1] += others[i+STRIDE];
                f[2] += others[i+2*STRIDE];
            }
            for (int k = i; k < 3*STRIDE && useOthers == 2; k += STRIDE)
                kept[k] = others[k];
            mixed4 v = velm[i];
            mixed3 x = dpdLoad(pos, corr, i);
            if ((terms & CONSERVATIVE) != 0)
                dpdPushed(x, types[i], f, DRIFT_);
            for (int k = 0; k < 3 && partial; k++)
                if ((alone[atomIndex[i]]>>k&1) != 0)
                    f[k] = external[k*STRIDE+i];
            mixed scale = v.w/(mixed) 0x100000000;
            mixed4 a = make_mixed4(scale*f[0], scale*f[1], scale*f[2], 0);
            acc[i] = a;
            if (v.w != 0 && kick != 0) {
                dpdAdd(&v, kick, a);
                if ((terms & CONSERVATIVE) != 0)
                    dpdKickWalls(x, types[i], kick, DRIFT_);
                if (drifts)
                    dpdDrift(&x, &v, DRIFT_);
                velm[i] = v;
            }
            real q = pos[i].w;
            if (moves)
                dpdStore(posNew, corrNew, i, x, q);
            if (moves == 3)
                dpdStore(posCopy, corrCopy, i, x, q);
            if (drifts)
                dpdPut(i, types[i], x, countNew, beadsNew, placeOfNew, room, flags, launch, BOX_);
        }
    END_BEAD
}

// What the force of others has changed by since it was kept is added to acc, but where only the `external` force acts.
KERNEL void dpdRenew(GLOBAL const mm_long* RESTRICT others, GLOBAL const mm_long* RESTRICT kept, GLOBAL const int* RESTRICT alone,
        GLOBAL const mm_long* RESTRICT external, int partial, GLOBAL const int* RESTRICT atomIndex, GLOBAL const mixed4* RESTRICT velm,
        GLOBAL mixed4* RESTRICT acc, GLOBAL const int* RESTRICT flags, int launch) {
    if (STOPPED)
        return;
    for (int i = GLOBAL_ID; i < NUM_ATOMS; i += GLOBAL_SIZE) {
        mixed4 a = acc[i];
        mixed scale = velm[i].w/(mixed) 0x100000000;
        int axes = partial ? alone[atomIndex[i]] : 0;
        a.x = axes&1 ? scale*external[i] : a.x+scale*(others[i]-kept[i]);
        a.y = axes&2 ? scale*external[i+STRIDE] : a.y+scale*(others[i+STRIDE]-kept[i+STRIDE]);
        a.z = axes&4 ? scale*external[i+2*STRIDE] : a.z+scale*(others[i+2*STRIDE]-kept[i+2*STRIDE]);
        acc[i] = a;
    }
}

// Whether positions are those that were kept.
KERNEL void dpdCompare(GLOBAL const real4* RESTRICT pos, GLOBAL const real4* RESTRICT corr, GLOBAL const real4* RESTRICT posKept,
        GLOBAL const real4* RESTRICT corrKept, GLOBAL int* RESTRICT flags, int launch) {
    for (int i = GLOBAL_ID; i < NUM_ATOMS; i += GLOBAL_SIZE) {
        mixed3 x = dpdLoad(pos, corr, i), y = dpdLoad(posKept, corrKept, i);
        if (x.x != y.x || x.y != y.y || x.z != y.z)
            flags[MOVED] = launch;
    }
}

// Velocities and what is kept change places, and the positions are kept.
KERNEL void dpdExchange(GLOBAL const real4* RESTRICT pos, GLOBAL const real4* RESTRICT corr, GLOBAL real4* RESTRICT posKept,
        GLOBAL real4* RESTRICT corrKept, GLOBAL mixed4* RESTRICT velm, GLOBAL mixed4* RESTRICT kept, GLOBAL const int* RESTRICT flags, int launch) {
    if (STOPPED)
        return;
    for (int i = GLOBAL_ID; i < NUM_ATOMS; i += GLOBAL_SIZE) {
        mixed4 v = velm[i], k = kept[i];
        velm[i] = make_mixed4(k.x, k.y, k.z, v.w);
        kept[i] = v;
        dpdStore(posKept, corrKept, i, dpdLoad(pos, corr, i), pos[i].w);
    }
}

// Velocities to which a rate times the height is added, with which a flow goes
KERNEL void dpdFollow(GLOBAL const real4* RESTRICT pos, GLOBAL const real4* RESTRICT corr, GLOBAL const mixed4* from, GLOBAL mixed4* to, mixed rate,
        GLOBAL const int* RESTRICT flags, int launch) {
    if (STOPPED)
        return;
    for (int i = GLOBAL_ID; i < NUM_ATOMS; i += GLOBAL_SIZE) {
        mixed4 v = from[i];
        v.x += rate*dpdLoad(pos, corr, i).y;
        to[i] = v;
    }
}

// Pair updates of all pairs at once, an implicit midpoint step: (1 + h/2 M^-1 G) u = v + h/2 M^-1 R by Chebyshev iteration from u = v, and then
// v += h M^-1 (R - G u).  It leaves Maxwell's distribution unchanged for any h, whatever the number of pairs.
//
// Rows: entry k of bead i at k*STRIDE+i is a vector s along the line to the partner, whose index is in w.  The friction of a difference of
// velocities d is s (s.d), and with transverse friction sign*s (s.d) + t d, where t (with the sign) is in an array of its own.

DEVICE real3 dpdFriction(real4 s, real t, real x, real y, real z) {
    real along = s.x*x+s.y*y+s.z*z;
#ifdef TRANSVERSE
    if (t < 0) {
        along = -along;
        t = -t;
    }
    return make_real3(s.x*along+t*x, s.y*along+t*y, s.z*along+t*z);
#else
    return make_real3(s.x*along, s.y*along, s.z*along);
#endif
}

// What a row knows of a pair; sums: the noise, the friction at these velocities, and what bounds the eigenvalues.
DEVICE bool dpdRow(int layer, int j, real3 delta, real r2, int type, int index, mixed4 v, real inertia, GLOBAL const mixed4* RESTRICT vel, TERMS, real perRate,
        real4* row, real* rowAcross, mm_long* sums) {
    real invR = RSQRT(r2);
    int partner = atomIndex[j];
    DPDPair p;
    if (!dpdPair(&p, ROW(layer), index, partner, r2*invR, TERMS_))
        return false;
    real s = p.root*p.w, t = p.rootAcross*p.wAcross, radial = s*s, across = t*t;
    mixed4 o = dpdVelocity(vel, j, atomIndex, wallVelocity);
    if (!APART || (radial == 0 && across == 0) || (v.w == 0 && o.w == 0))
        return false;
    real3 e = make_real3(invR*delta.x, invR*delta.y, invR*delta.z);
    mm_ulong pair = dpdPairKey(dpdKeyOf(layer, key, begun, bits), index, partner);
    real push = noise*s*dpdNormal(pair, cubics);
    real3 kick = make_real3(push*e.x, push*e.y, push*e.z);
#ifdef TRANSVERSE
    if (t != 0) {
        real3 z = dpdAcross(pair, e, index < partner, cubics);
        kick = make_real3(kick.x+noise*t*z.x, kick.y+noise*t*z.y, kick.z+noise*t*z.z);
    }
    s = SQRT(fabs(radial-across));
    if (radial < across)
        across = -across;
#endif
    *row = make_real4(s*e.x, s*e.y, s*e.z, (real) j);
    *rowAcross = across;
    if (SHEARED) { // what friction makes of the flow is as constant as the noise
        real3 dragged = dpdFriction(*row, across, slide*delta.y, 0, 0);
        kick = make_real3(kick.x-dragged.x, kick.y-dragged.y, kick.z-dragged.z);
    }
    real3 drag = dpdFriction(*row, across, (real) (v.x-o.x), (real) (v.y-o.y), (real) (v.z-o.z));
    sums[0] += realToFixedPoint(kick.x);
    sums[1] += realToFixedPoint(kick.y);
    sums[2] += realToFixedPoint(kick.z);
    sums[3] += realToFixedPoint(drag.x);
    sums[4] += realToFixedPoint(drag.y);
    sums[5] += realToFixedPoint(drag.z);
    sums[6] += realToFixedPoint(perRate*max(radial, (real) fabs(across))*(inertia+SQRT((real) o.w)));
    return true;
}

#ifdef TRANSVERSE
#define KEEP_ACROSS rowsAcross[k*STRIDE+i] = across;
#else
#define KEEP_ACROSS
#endif
#define KEEP_ROW \
    real4 row; \
    real across; \
    EACH_LAYER if (dpdRow(layer, j, delta, r2, type, index, v, inertia, vel, TERMS_, perRate, &row, &across, sums)) { \
        int k = ENTRY; \
        if (k < rowRoom) { \
            rows[k*STRIDE+i] = row; \
            KEEP_ACROSS \
        } \
    }

KERNEL BOUNDS void dpdRows(GLOBAL const real4* RESTRICT pos, GLOBAL const real4* RESTRICT corr, GLOBAL const mixed4* RESTRICT vel, TERMS, CELLS,
        GLOBAL int* RESTRICT rowCount, GLOBAL real4* RESTRICT rows, GLOBAL real* RESTRICT rowsAcross, int rowRoom, GLOBAL mm_long* RESTRICT random,
        GLOBAL real4* RESTRICT u, GLOBAL real4* RESTRICT res, mixed halfdt, real perRate, GLOBAL int* RESTRICT flags, int launch, BOX) {
    if (STOPPED)
        return;
    const mixed unit = 1/(mixed) 0x100000000;
    SHARED(7)
    EACH_BEAD
        mm_long sums[7] = {0, 0, 0, 0, 0, 0, 0};
        EACH_PARTNER(vel, KEEP_ROW)
        TOGETHER(sums, 7)
        if (SUMMED) {
            mixed4 v = dpdVelocity(vel, i, atomIndex, wallVelocity);
            // Gershgorin's bound
            real most = (real) (unit*sums[6])*SQRT((real) v.w)*1048576;
            int bound = most < TOO_LARGE ? (int) most+1 : TOO_LARGE, n = ENTRIES;
            if (bound == TOO_LARGE)
                HALT(FEW_PASSES)
            if (bound > flags[BOUND])
                ATOMIC_MAX(&flags[BOUND], bound);
            if (bound > flags[MOST_BOUND])
                ATOMIC_MAX(&flags[MOST_BOUND], bound);
            if (n > flags[MOST_IN_ROW])
                ATOMIC_MAX(&flags[MOST_IN_ROW], n);
            if (n > rowRoom && rowRoom > 0) // without any room they are only counted
                HALT(ROWS_FULL)
            rowCount[i] = n;
            mixed scale = halfdt*v.w*unit;
            u[i] = make_real4((real) v.x, (real) v.y, (real) v.z, (real) v.w);
            res[i] = make_real4((real) (scale*(sums[0]-sums[3])), (real) (scale*(sums[1]-sums[4])), (real) (scale*(sums[2]-sums[5])), 0);
            random[i] = sums[0];
            random[i+STRIDE] = sums[1];
            random[i+2*STRIDE] = sums[2];
        }
    END_BEAD
}

// How many passes the present bound needs: the host has the largest bound for each number of them.
DEVICE int dpdPasses(GLOBAL const int* RESTRICT flags, GLOBAL const real* RESTRICT limits, real factor) {
    real bound = factor*(real) flags[BOUND];
    int passes = 1;
    while (passes < MOST_PASSES && bound > limits[passes])
        passes++;
    return passes;
}

// Corrections are in d: in `res` and d1 by turns, the first one is the residual itself, up to a factor.
KERNEL BOUNDS void dpdPass(GLOBAL const int* RESTRICT rowCount, GLOBAL const real4* RESTRICT rows, GLOBAL const real* RESTRICT rowsAcross,
        GLOBAL real4* RESTRICT u, GLOBAL const real4* RESTRICT res, GLOBAL real4* RESTRICT resNew, GLOBAL const real4* RESTRICT d, GLOBAL real4* RESTRICT dNew,
        GLOBAL const int* RESTRICT flags, int launch, GLOBAL const real* RESTRICT limits, GLOBAL const real4* RESTRICT weights, real factor, mixed halfdt, int pass) {
    int passes = dpdPasses(flags, limits, factor);
    if (STOPPED || pass+1 >= passes)
        return;
    real4 c = weights[passes*MOST_PASSES+pass]; // of the correction as it is, of the last correction and of the residual in the next one
    const mixed unit = 1/(mixed) 0x100000000;
    SHARED(3)
    EACH_BEAD
        real4 a = d[i];
        mm_long q[3] = {0, 0, 0};
        int n = there ? rowCount[i] : 0;
        for (int k = lane; k < n; k += LANES) {
            real4 s = rows[k*STRIDE+i];
            real4 o = d[(int) s.w];
#ifdef TRANSVERSE
            real3 f = dpdFriction(s, rowsAcross[k*STRIDE+i], a.x-o.x, a.y-o.y, a.z-o.z);
#else
            real3 f = dpdFriction(s, 0, a.x-o.x, a.y-o.y, a.z-o.z);
#endif
            q[0] += realToFixedPoint(f.x);
            q[1] += realToFixedPoint(f.y);
            q[2] += realToFixedPoint(f.z);
        }
        TOGETHER(q, 3)
        if (SUMMED) {
            real4 x = u[i], r = res[i];
            u[i] = make_real4(x.x+c.x*a.x, x.y+c.x*a.y, x.z+c.x*a.z, x.w);
            real f = (real) (halfdt*unit)*x.w;
            r = make_real4(r.x-c.x*(a.x+f*q[0]), r.y-c.x*(a.y+f*q[1]), r.z-c.x*(a.z+f*q[2]), 0);
            resNew[i] = r;
            dNew[i] = make_real4(c.y*a.x+c.z*r.x, c.y*a.y+c.z*r.y, c.y*a.z+c.z*r.z, 0);
        }
    END_BEAD
}

// v += h/m (R - G u) with the last correction added to u, and v and x move on: kick by acc, drift.  Where the impulses are asked for by OpenMM,
// they go to its force buffer too, divided by `share`.
KERNEL BOUNDS void dpdFinish(GLOBAL const real4* RESTRICT pos, GLOBAL const real4* RESTRICT corr, GLOBAL real4* RESTRICT posNew, GLOBAL real4* RESTRICT corrNew,
        GLOBAL const mixed4* RESTRICT vel, GLOBAL mixed4* RESTRICT velNew, GLOBAL const mixed4* RESTRICT acc,
        GLOBAL const int* RESTRICT rowCount, GLOBAL const real4* RESTRICT rows, GLOBAL const real* RESTRICT rowsAcross, GLOBAL const mm_long* RESTRICT random,
        GLOBAL const real4* RESTRICT u, GLOBAL const real4* RESTRICT res, GLOBAL const real4* RESTRICT d1,
        GLOBAL int* RESTRICT flags, int launch, GLOBAL const real* RESTRICT limits, GLOBAL const real4* RESTRICT weights, real factor, int launched,
        GLOBAL mm_ulong* RESTRICT force, int share, mixed halfdt, mixed kick, int moves, GLOBAL const int* RESTRICT atomIndex, GLOBAL const int* RESTRICT types,
        GLOBAL const real4* RESTRICT cubics, mixed rub, mixed kT, mm_long key, DRIFT) {
    if (STOPPED)
        return;
    int passes = dpdPasses(flags, limits, factor);
    if (passes-1 > launched || factor*(real) flags[BOUND] > limits[MOST_PASSES-1]) {
        HALT(FEW_PASSES)
        return;
    }
    real scale = weights[passes*MOST_PASSES+passes-1].x;
    GLOBAL const real4* RESTRICT d = passes%2 ? res : d1;
    SHARED(3)
    EACH_BEAD
        real4 a = d[i], y = u[i];
        real vx = y.x+scale*a.x, vy = y.y+scale*a.y, vz = y.z+scale*a.z;
        mm_long f[3] = {0, 0, 0};
        int n = there ? rowCount[i] : 0;
        for (int k = lane; k < n; k += LANES) {
            real4 s = rows[k*STRIDE+i];
            int j = (int) s.w;
            real4 b = d[j], o = u[j];
            real x = vx-(o.x+scale*b.x), y_ = vy-(o.y+scale*b.y), z = vz-(o.z+scale*b.z);
#ifdef TRANSVERSE
            real3 g = dpdFriction(s, rowsAcross[k*STRIDE+i], x, y_, z);
#else
            real3 g = dpdFriction(s, 0, x, y_, z);
#endif
            f[0] -= realToFixedPoint(g.x);
            f[1] -= realToFixedPoint(g.y);
            f[2] -= realToFixedPoint(g.z);
        }
        TOGETHER(f, 3)
        if (SUMMED) {
            f[0] += random[i];
            f[1] += random[i+STRIDE];
            f[2] += random[i+2*STRIDE];
            if (share != 0) {
                ATOMIC_ADD(&force[i], (mm_ulong) (f[0]/share));
                ATOMIC_ADD(&force[i+STRIDE], (mm_ulong) (f[1]/share));
                ATOMIC_ADD(&force[i+2*STRIDE], (mm_ulong) (f[2]/share));
            }
            mixed4 v = vel[i];
            mixed3 x = dpdLoad(pos, corr, i);
            if (v.w != 0) {
                mixed impulse = 2*halfdt*v.w/(mixed) 0x100000000;
                v.x += impulse*f[0];
                v.y += impulse*f[1];
                v.z += impulse*f[2];
                if (rub != 0) // beside walls with something behind them
                    dpdRub(x, &v, types[i], rub, kT, dpdPairKey((mm_ulong) key, atomIndex[i], atomIndex[i]), cubics, DRIFT_);
                if (kick != 0) {
                    dpdAdd(&v, kick, acc[i]);
                    dpdKickWalls(x, types[i], kick, DRIFT_);
                }
                if (moves)
                    dpdDrift(&x, &v, DRIFT_);
            }
            velNew[i] = v;
            if (moves)
                dpdStore(posNew, corrNew, i, x, pos[i].w);
        }
    END_BEAD
}
