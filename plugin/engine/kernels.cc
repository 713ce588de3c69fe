// Pair terms of DPD and whole steps on cells of our own: one source for OpenCL, CUDA, HIP and C++.
//
// Sums over partners are sums of fixed-point numbers, pair by pair, so that neither the order of beads in a cell nor
// that of threads changes a bit, and that momentum is conserved to the last one.
//
// On a CPU a thread has a cell, gathers what is around it, and does all for its beads.  On a GPU LANES threads of a
// block share a bead: the block gathers what is around its cells, each thread looks for partners in a part of that,
// what they find is listed in the memory of the block (else nearly all threads of a warp would wait while one draws
// noise), each takes its part of the list, and what they sum up comes together in lane 0.
//
// Where anything is wrong (a cell or row is full, a bead runs away) a kernel sets flags[STOP], and all kernels after it
// do nothing: the host finds out when it looks.  Launches have numbers, so that all of the one that found it still
// counts what room would be needed.

#define TOO_LARGE 2000000000 // for a bound of eigenvalues
#define STOPPED (flags[STOP] != 0 && flags[WHEN] != 0 && flags[WHEN] != launch)
#define HALT(why) { flags[WHEN] = launch; ATOMIC_OR(&flags[STOP], why); }

#ifndef BOUNDS // what a compiler has to be told of the size of blocks
#define BOUNDS
#endif
// and, on a CPU, of functions that have too many arguments to be called for each pair
#if !defined(INLINED) || LANES > 1
#undef INLINED
#define INLINED
#endif
// Beads are taken in the order of cells, so that those of a block have the same few cells around them: each block (on a
// CPU each thread) has some that are beside each other in `walk`, which has their places along the axes, ten bits each;
// below 0 are cells of beads that take no part (dpdPut).
#if LANES == 1
#define GATHERED 256 // beads around a cell at a time
#define SHARED(sums) \
    float offsets[4*GATHERED]; \
    int slots[GATHERED], list[GATHERED];
#define EACH_BEAD for (int at = GLOBAL_ID; at < walked; at += GLOBAL_SIZE) { \
    const int where = walk[at], cell = dpdCellAt(where, BOX_), held = count[cell], lane = 0; \
    const bool edge = dpdAtEdge(where, BOX_); \
    bool whole = false; \
    int gathered = 0; \
    for (int slot = cell*room; slot < cell*room+held; slot++) { \
        const bool there = true; \
        const int i = (int) beads[slot].w; \
        int entries = 0;
#define END_BEAD }}
#define EACH_INDEX for (int i = GLOBAL_ID; i < NUM_ATOMS; i += GLOBAL_SIZE) { \
    const bool there = true; \
    const int lane = 0;
#define TOGETHER(sums, n)
#define TOGETHER_SHARED(sums)
#define ENTRY (entries++)
#define ENTRIES entries
#else
#define BEADS (BLOCK/LANES) // that a block has at a time
#define LISTED 40           // partners of a bead at a time
#define AROUND (LANES < 4 ? 32*LANES : 128) // beads around a cell at a time
#define MOST_CELLS (BLOCK/9) // of a block: each row around each of them has a thread
#define TOGETHER_SHARED(sums) LOCAL mm_long shared[(sums)*BLOCK];
#define SHARED(sums) /* sums come together where the beads around cells were */ \
    LOCAL mm_long shared[(sums)*BLOCK > AROUND*MOST_CELLS/2 ? (sums)*BLOCK : AROUND*MOST_CELLS/2]; \
    LOCAL int found[BEADS+4], entered[BEADS], members[BEADS], owners[BEADS], list[LISTED*BEADS], rowSums[BLOCK], \
        totals[MOST_CELLS]; \
    LOCAL_ARG int* nearby = (LOCAL_ARG int*) shared;
#define EACH_BEAD for (int group = GROUP_ID*share; group < walked; group += NUM_GROUPS*share) { \
    const int lane = LOCAL_ID/BEADS, mine = LOCAL_ID%BEADS; \
    int cell = 0, held = 0, start = 0; \
    if (LOCAL_ID == 0) \
        ALL_MEMBERS = AT_EDGE = 0; \
    SYNC_THREADS \
    if (LOCAL_ID < share && group+LOCAL_ID < walked) { \
        const int place = walk[group+LOCAL_ID]; \
        if (dpdAtEdge(place, BOX_)) \
            AT_EDGE = 1; \
        cell = dpdCellAt(place, BOX_); \
        held = count[cell]; \
        start = ATOMIC_ADD(&ALL_MEMBERS, held); \
    } \
    SYNC_THREADS \
    for (int first = 0; first < ALL_MEMBERS; first += BEADS) { \
        for (int k = max(0, first-start); k < min(held, first+BEADS-start); k++) { \
            members[start+k-first] = cell*room+k; \
            owners[start+k-first] = LOCAL_ID; \
        } \
        if (lane == 0) \
            found[mine] = entered[mine] = UNFINISHED = 0; \
        SYNC_THREADS \
        const bool there = first+mine < ALL_MEMBERS; \
        const int slot = members[there ? mine : 0], owner = owners[there ? mine : 0], where = walk[group+owner], \
            i = (int) beads[slot].w; \
        const bool edge = AT_EDGE != 0; /* of all, for a warp goes one way then */
#define UNFINISHED found[BEADS]
#define ALL_MEMBERS found[BEADS+1]
#define MORE found[BEADS+2]
#define AT_EDGE found[BEADS+3]
#define END_BEAD SYNC_THREADS }}
#define EACH_INDEX for (int first = GROUP_ID*BEADS; first < NUM_ATOMS; first += NUM_GROUPS*BEADS) { \
    const int lane = LOCAL_ID/BEADS, mine = LOCAL_ID%BEADS, i = min(first+mine, NUM_ATOMS-1); \
    const bool there = first+mine < NUM_ATOMS;
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
#define END_INDEX }
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

// Standard normal number of some bits, as openmm_dpd/kernels/noise.py makes it: a cubic in each cell of the inverse
// distribution function, and in the last cells Wichura's PPND7 (algorithm AS 241).
DEVICE real dpdNormal(mm_ulong bits, READS(real4) cubics) {
    int cell = (int) ((bits>>55)&0xFF);
    real place = ((real) (mm_long) ((bits&0x7FFFFFFFFFFFFFUL)>>3)+(real) 0.5)*(real) 2.220446049250313e-16;
    real z;
    if (cell < SMOOTH) {
        real4 c = cubics[cell];
        z = c.x+place*(c.y+place*(c.z+place*c.w));
    }
    else {
        // 255-cell and 1-place in one number that is never rounded to 0, for else one draw in 8e9 would be infinite
        real p = ((real) (mm_long) ((~bits>>3)&0xFFFFFFFFFFFFFFFUL)+(real) 0.5)*(real) 4.336808689942018e-19;
        real r = SQRT(-LOG(p));
        if (r <= 5) {
            r -= (real) 1.6;
            z = ((((real) 0.17023821103*r+(real) 1.3067284816)*r+(real) 2.7568153900)*r+(real) 1.4234372777)
                /(((real) 0.12021132975*r+(real) 0.73700164250)*r+1);
        }
        else {
            r -= 5;
            z = ((((real) 0.017337203997*r+(real) 0.42868294337)*r+(real) 3.0812263860)*r+(real) 6.6579051150)
                /(((real) 0.012258202635*r+(real) 0.24197894225)*r+1);
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

DEVICE mixed3 dpdLoad(PLACE, int i) {
    real4 a = pos[i];
#ifdef USE_MIXED_PRECISION
    real4 b = corr[i];
    return make_mixed3(a.x+(mixed) b.x, a.y+(mixed) b.y, a.z+(mixed) b.z);
#else
    return make_mixed3(a.x, a.y, a.z);
#endif
}

// Rounds x to what was stored.
DEVICE void dpdStore(WRITES(real4) pos, WRITES(real4) corr, int i, mixed3* x, real q) {
    pos[i] = make_real4((real) x->x, (real) x->y, (real) x->z, q);
#ifdef USE_MIXED_PRECISION
    corr[i] = make_real4((real) (x->x-(real) x->x), (real) (x->y-(real) x->y), (real) (x->z-(real) x->z), 0);
    *x = dpdLoad(pos, corr, i);
#endif
}

DEVICE void dpdAdd(mixed4* v, mixed part, mixed4 a) {
    v->x += part*a.x;
    v->y += part*a.y;
    v->z += part*a.z;
}

// The number of a cell of `walk`
DEVICE int dpdCellAt(int where, BOX) {
    return where < 0 ? nx*ny*nz-1-where : ((where>>20)*ny+(where>>10&1023))*nx+(where&1023);
}

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
    *inside = make_mixed3(x.x-px*edges.x-py*tilt.x-pz*tilt.y, x.y-py*edges.y-pz*tilt.z, x.z-pz*edges.z);
    return cell;
}

// Whether some of the cells around one are beyond the box
DEVICE bool dpdAtEdge(int where, BOX) {
    int x = where&1023, y = where>>10&1023, z = where>>20;
    return min(x, min(y, z)) == 0 || x == nx-1 || y == ny-1 || z == nz-1;
}

// Of the images of a difference of positions the nearest one
DEVICE real3 dpdNearest(mixed3 d, BOX) {
    mixed s = rint(d.z*inverse.z);
    d.z -= s*edges.z;
#ifdef TRICLINIC
    d.y -= s*tilt.z;
    d.x -= s*tilt.y;
#endif
    s = rint(d.y*inverse.y);
    d.y -= s*edges.y;
#ifdef TRICLINIC
    d.x -= s*tilt.x;
#endif
    d.x -= rint(d.x*inverse.x)*edges.x;
    return make_real3((real) d.x, (real) d.y, (real) d.z);
}

#define CLEAR for (int c = GLOBAL_ID; c < cells; c += GLOBAL_SIZE) dirty[c] = 0;

typedef struct {
    int i, index, type;
    real4 v;
} DPDBead;

// A velocity with number and type of its bead; as bits, for single precision has 24 of them in a number
DEVICE real4 dpdMotion(mixed4 v, int index, int type) {
    union { real number; unsigned int word; } bits;
    bits.number = 0;
    bits.word = (unsigned int) index+(unsigned int) max(type, 0)*(unsigned int) NUM_ATOMS;
    return make_real4((real) v.x, (real) v.y, (real) v.z, bits.number);
}

DEVICE DPDBead dpdBead(real4 place, real4 v) {
    union { real number; unsigned int word; } bits;
    bits.number = v.w;
    DPDBead bead;
    bead.i = (int) place.w;
    bead.type = NUM_TYPES == 1 ? 0 : (int) (bits.word/(unsigned int) NUM_ATOMS);
    bead.index = (int) (bits.word-(unsigned int) bead.type*(unsigned int) NUM_ATOMS);
    bead.v = v;
    return bead;
}

// A bead into its cell.  Those that take no part are in cells behind the others, where each has a place.  A bead runs
// away whose speed nobody has in equilibrium (hottest is its square times the mass) and that crosses more than a cutoff
// in a step; fastest2 = 0 asks for no check.
DEVICE void dpdPut(int i, int type, int index, mixed3 x, mixed4 v, HALTS, FILL, BOX) {
    mixed3 inside;
    int cell = dpdCellOf(x, &inside, BOX_);
    if (type < 0)
        cell = nx*ny*nz+i/room;
    int k = ATOMIC_ADD(&countNew[cell], 1), slot = cell*room+k;
    if (k < room) {
        beadsNew[slot] = make_real4((real) inside.x, (real) inside.y, (real) inside.z, (real) i);
#ifdef USE_MIXED_PRECISION
        restsNew[slot] = make_real4((real) (inside.x-(real) inside.x), (real) (inside.y-(real) inside.y),
            (real) (inside.z-(real) inside.z), 0);
#endif
        motionNew[slot] = dpdMotion(v, index, type);
    }
    else
        HALT(CELLS_FULL)
    if (type >= 0 && k+1 > flags[MOST_IN_CELL])
        ATOMIC_MAX(&flags[MOST_IN_CELL], k+1);
    bool finite = dpdFinite(v.x) && dpdFinite(v.y) && dpdFinite(v.z);
    if (fastest2 != 0 && v.w != 0 && (!finite || v.x*v.x+v.y*v.y+v.z*v.z > max(fastest2, hottest*v.w))) {
        HALT(RUNAWAY)
        flags[WHO] = index;
    }
}

#define EACH_LAYER for (int layer = 0; layer < LAYERS; layer++)
#define ROW(layer) (self->type*NUM_TYPES+other->type+(layer)*NUM_TYPES*NUM_TYPES) // of a pair in tables

DEVICE real dpdFactor(int a, int b, READS(int) exceptionStart, READS(int) exceptionBead, READS(real) exceptionFactor) {
    for (int e = exceptionStart[a]; e < exceptionStart[a+1]; e++)
        if (exceptionBead[e] == b)
            return exceptionFactor[e];
    return 1;
}

// The velocity of a bead that friction feels: that of its wall, if it is immobile
DEVICE mixed4 dpdFelt(mixed4 v, int index, READS(real4) wallVelocity) {
#ifdef IMMOBILE
    if (v.w == 0) {
        real4 wall = wallVelocity[index];
        v = make_mixed4(wall.x, wall.y, wall.z, 0);
    }
#endif
    return v;
}

// 1/mass of a bead, a constant where all are equal
#ifdef MASSES
#define INVERSE_MASS(vel, i) ((real) vel[i].w)
#else
#define INVERSE_MASS(vel, i) ((real) EQUAL_MASS)
#endif

// What beads carry (fields.cc): heat, as temperatures (maybe with LAMMPS's heat) or as ENERGIES, or species.
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

// Mean and harmonic mean of the temperatures of two beads, the same from either, and the root of their friction weight
DEVICE real3 dpdWarm(int row, int a, int b, real w, READS(real4) carrying, READS(mixed4) carried) {
    real s = (real) carried[a].x, t = (real) carried[b].x, low = min(s, t), high = max(s, t),
        mean = (real) 0.5*(low+high);
    if (ENERGIES)
        return make_real3(mean, 2*low*high/(low+high), w);
    real exponent = carrying[row*CARRYING_ROWS].w*dpdPolynomial(carrying[row*CARRYING_ROWS+1], mean-1);
    return make_real3(mean, 2*low*high/(low+high), POW(w, (real) 0.5*max((real) 0.01, exponent)));
}

// Coefficients of a pair: what w^s is multiplied with in friction (its root) and noise (times `kick`, too), along the
// line between beads and across.
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
DEVICE real3 dpdAcross(mm_ulong pair, real3 e, bool lower, READS(real4) cubics) {
    real x = dpdNormal(dpdMix(pair+STREAM), cubics), y = dpdNormal(dpdMix(pair+2*STREAM), cubics),
        z = dpdNormal(dpdMix(pair+3*STREAM), cubics);
    real along = e.x*x+e.y*y+e.z*z;
    real sign = lower ? 1 : -1;
    return make_real3(sign*(x-along*e.x), sign*(y-along*e.y), sign*(z-along*e.z));
}

// The cell before another one along an axis (at = 0), itself (1) or the one after it (2), and how many periods it is
// away by that; all, of few.
DEVICE int dpdNext(int own, int at, int n, real* periods) {
    int c = n < 3 ? at : own+at-1;
    *periods = (c < 0) - (c >= n);
    return c < 0 ? c+n : c >= n ? c-n : c;
}

#define SQUARE(delta) (delta.x*delta.x+delta.y*delta.y+delta.z*delta.z)
#define NEAR ((float) (MAX_CUTOFF*MAX_CUTOFF*1.01)) // for positions in cells are rounded

// The number of the first cell in a row of those around one, and how far beads there are away by periods
DEVICE int dpdRowOf(int where, int row, real3* away, BOX) {
    real py, pz;
    int hy = where>>10&1023, hz = where>>20, y = dpdNext(hy, row%3, ny, &py), z = dpdNext(hz, row/3, nz, &pz);
    *away = make_real3(py*(real) tilt.x+pz*(real) tilt.y, py*(real) edges.y+pz*(real) tilt.z, pz*(real) edges.z);
    return (z*ny+y)*nx;
}

#if LANES == 1
// Where the search for partners of a bead goes on: in a row of three cells, in a cell of it, behind so many beads.
typedef struct {
    int row, cell, from;
} DPDSearch;

// Beads around a cell, as its first bead sees them, to arrays that all its beads go through, until there is no more
// room: returns how many.
DEVICE int dpdGather(DPDSearch* search, int cell, int where, float* around, int* slots, CELLS, BOX) {
    real4 origin = beads[cell*room];
    int n = 0;
    for (; search->row < 9; search->row++, search->cell = 0) {
        if (search->row%3 >= ny || search->row/3 >= nz)
            continue;
        real3 away;
        int row = dpdRowOf(where, search->row, &away, BOX_);
        for (; search->cell < min(nx, 3); search->cell++, search->from = 0) {
            real px;
            int beside = row+dpdNext(where&1023, search->cell, nx, &px);
            real x = away.x+px*(real) edges.x+origin.x, y = away.y+origin.y, z = away.z+origin.z;
            for (; search->from < count[beside]; search->from++) {
                if (n == GATHERED)
                    return n;
                int other = beside*room+search->from;
                real4 o = beads[other];
                around[n] = (float) (x-o.x);
                around[n+GATHERED] = (float) (y-o.y);
                around[n+2*GATHERED] = (float) (z-o.z);
                slots[n++] = other;
            }
        }
    }
    return n;
}

// Which of them, and how many, are near a bead of the cell, itself too, without branches, which nobody could predict
DEVICE int dpdFind(int cell, int slot, float* around, int* slots, int n, int* list, CELLS, BOX) {
    real4 origin = beads[cell*room], here = beads[slot];
    float hx = (float) (here.x-origin.x), hy = (float) (here.y-origin.y), hz = (float) (here.z-origin.z);
    if (PERIODIC && min(nx, min(ny, nz)) < 3)
        for (int k = 0; k < n; k++) {
            real3 delta = dpdNearest(make_mixed3(hx+around[k], hy+around[k+GATHERED], hz+around[k+2*GATHERED]), BOX_);
            around[k+3*GATHERED] = (float) SQUARE(delta);
        }
    else
        for (int k = 0; k < n; k++) {
            float x = hx+around[k], y = hy+around[k+GATHERED], z = hz+around[k+2*GATHERED];
            around[k+3*GATHERED] = x*x+y*y+z*z;
        }
    int found = 0;
    for (int k = 0; k < n; k++) {
        list[found] = slots[k];
        found += around[k+3*GATHERED] < NEAR;
    }
    return found;
}
#else
// Beads around each cell of a block, from one of them on: how many are left, and places of as many as there is room
// for.  A thread has a row of three cells.
DEVICE void dpdGather(int group, int from, LOCAL_ARG int* rows, LOCAL_ARG int* totals, LOCAL_ARG int* around,
        LOCAL_ARG int* more, CELLS, BOX) {
    int own = LOCAL_ID/9, row = LOCAL_ID%9, where = own < share && group+own < walked ? walk[group+own] : -1;
    int a = 0, b = 0, c = 0, inA = 0, inB = 0, inC = 0; // its cells, and how many beads they have
    if (where >= 0 && row%3 < ny && row/3 < nz) {
        real3 away;
        real px;
        int first = dpdRowOf(where, row, &away, BOX_);
        a = first+dpdNext(where&1023, 0, nx, &px);
        b = first+dpdNext(where&1023, 1, nx, &px);
        c = first+dpdNext(where&1023, 2, nx, &px);
        inA = count[a];
        inB = nx > 1 ? count[b] : 0;
        inC = nx > 2 ? count[c] : 0;
    }
    int end = inA+inB+inC;
    rows[LOCAL_ID] = end;
    if (LOCAL_ID == 0)
        *more = 0;
    SYNC_THREADS
    int before = -from;
    for (int k = LOCAL_ID-row; k < LOCAL_ID; k++)
        before += rows[k];
    if (row == 8 && own < share) {
        totals[own] = before+end;
        if (before+end > AROUND)
            *more = 1;
    }
    a *= room;
    b = b*room-inA;
    c = c*room-inA-inB;
    end = min(end, AROUND-before);
    for (int k = max(0, -before); k < end; k++)
        around[own*AROUND+before+k] = k+(k < inA ? a : k < inA+inB ? b : c);
    SYNC_THREADS
}

// A bit for each LANES-th of them that is near a bead, which may be itself
DEVICE unsigned int dpdFind(int slot, bool edge, int lane, int n, LOCAL_ARG const int* around, CELLS, BOX) {
    real4 here = beads[slot];
    unsigned int hits = 0, bit = 1;
    if (edge)
        for (int k = lane; k < n; k += LANES, bit <<= 1) {
            real4 o = beads[around[k]];
            real3 delta = dpdNearest(make_mixed3(here.x-o.x, here.y-o.y, here.z-o.z), BOX_);
            hits |= (float) SQUARE(delta) < NEAR ? bit : 0;
        }
    else
        for (int k = lane; k < n; k += LANES, bit <<= 1) {
            real4 o = beads[around[k]];
            real3 delta = make_real3(here.x-o.x, here.y-o.y, here.z-o.z);
            hits |= (float) SQUARE(delta) < NEAR ? bit : 0;
        }
    return hits;
}

// Those with bits go to the list of a bead, and lose them, until it is full.
DEVICE void dpdEnter(unsigned int* hits, int lane, int mine, LOCAL_ARG const int* around, LOCAL_ARG int* list,
        LOCAL_ARG int* found, LOCAL_ARG int* unfinished) {
    int k = *hits == 0 ? 0 : ATOMIC_ADD(&found[mine], (int) BITS_OF(*hits));
    for (; *hits != 0 && k < LISTED; k++, *hits &= *hits-1)
        list[k*BEADS+mine] = around[FIRST_BIT(*hits)*LANES+lane];
    if (*hits != 0)
        *unfinished = 1;
}
#endif

// Which of those that are near a bead are within the longest cutoff: delta is from j to i, r2 its square.  In the box
// positions are those in cells.
#ifdef MANY_BODY // beads at the same point count in each other's densities
#define WITHIN (r2 < MAX_CUTOFF*MAX_CUTOFF && at != slot)
#define APART (r2 != 0)
#else
#define APART true
#define WITHIN (r2 < MAX_CUTOFF*MAX_CUTOFF && r2 != 0)
#endif

DEVICE mixed3 dpdPlace(real4 place, int slot, READS(real4) rests, PLACE) {
    if (!PERIODIC)
        return dpdLoad(pos, corr, (int) place.w);
#ifdef USE_MIXED_PRECISION
    real4 rest = rests[slot];
    return make_mixed3(place.x+(mixed) rest.x, place.y+(mixed) rest.y, place.z+(mixed) rest.z);
#else
    return make_mixed3(place.x, place.y, place.z);
#endif
}

// What is to be done with all partners (`other`) of a bead (`self`) within the longest cutoff, if it takes part: found
// first, a full list at a time, for else nearly all threads of a warp would wait while one draws noise.
#define LOOK_AT(k, pair) \
    int at = list[k]; \
    real4 theirs_ = beads[at]; \
    mixed3 y = dpdPlace(theirs_, at, rests, pos, corr); \
    real3 delta = make_real3((real) (x.x-y.x), (real) (x.y-y.y), (real) (x.z-y.z)); \
    if (PERIODIC && edge) \
        delta = dpdNearest(make_mixed3(x.x-y.x, x.y-y.y, x.z-y.z), BOX_); \
    real r2 = SQUARE(delta); \
    if (WITHIN) { \
        DPDBead other = dpdBead(theirs_, motion[at]); \
        pair; \
    }
#define MYSELF \
    real4 mine_ = beads[slot]; \
    DPDBead self = dpdBead(mine_, motion[slot]); \
    mixed3 x = dpdPlace(mine_, slot, rests, pos, corr);
#if LANES == 1
#define EACH_PARTNER(pair) \
    DPDSearch search = {0, 0, 0}; \
    for (bool first = true; where >= 0 && (first || (!whole && search.row < 9)); first = false) { \
        if (!whole) \
            gathered = dpdGather(&search, cell, where, offsets, slots, CELLS_, BOX_); \
        whole = whole || (first && search.row == 9); \
        MYSELF \
        for (int k = 0, n = dpdFind(cell, slot, offsets, slots, gathered, list, CELLS_, BOX_); k < n; k++) { \
            LOOK_AT(k, pair) \
        } \
    }
#else
#define EACH_PARTNER(pair) \
    for (int from = 0, further = 1; further; from += AROUND) { \
        dpdGather(group, from, rowSums, totals, nearby, &MORE, CELLS_, BOX_); \
        further = MORE; \
        unsigned int hits = there && where >= 0 ? dpdFind(slot, edge, lane, min(totals[owner], AROUND), \
            &nearby[owner*AROUND], CELLS_, BOX_) : 0; \
        for (bool last = false; !last; ) { \
            dpdEnter(&hits, lane, mine, &nearby[owner*AROUND], list, found, &UNFINISHED); \
            SYNC_THREADS \
            MYSELF /* not before, for there are not that many registers */ \
            for (int k = lane, n = min(found[mine], LISTED); k < n; k += LANES) { \
                LOOK_AT(k*BEADS+mine, pair) \
            } \
            last = UNFINISHED == 0; \
            SYNC_THREADS \
            if (!last || further) { \
                if (lane == 0) \
                    found[mine] = UNFINISHED = 0; \
                SYNC_THREADS \
            } \
        } \
    }
#endif

#define CONSERVATIVE 1
#define THERMOSTAT 2
#ifndef LUCY // which of the two weight functions densities have
#define LUCY 0
#endif

// What a partner adds to the density at a bead.  Rows of `many`: B of the force B (density + density) w_B, 1/cutoff of
// w_B, 1/cutoff and norm of the weight function; its partner's mass weighs Lucy's, for which factors of bonded
// neighbours but 0 count in full.
DEVICE real dpdDensityOf(int layer, DPDBead* self, DPDBead* other, real r2, TERMS) {
    real4 m = many[ROW(layer)];
    real s = r2 > 0 ? r2*RSQRT(r2)*m.z : 0, w = 1-s, f = 1;
    if (w <= 0)
        return 0;
#ifdef EXCEPTIONS
    f = dpdFactor(self->index, other->index, exceptionStart, exceptionBead, exceptionFactor);
#endif
    if (LUCY)
        return f == 0 ? 0 : weights[other->index]*m.w*(1+3*s)*w*w*w;
    return f*m.w*w*w;
}

KERNEL BOUNDS void dpdDensity(HALTS, PLACE, TERMS, CELLS, BOX, WRITES(real) density) {
    if (STOPPED) return;
    SHARED(1)
    EACH_BEAD
        mm_long sum[1] = {0};
        EACH_PARTNER(EACH_LAYER sum[0] += realToFixedPoint(dpdDensityOf(layer, &self, &other, r2, TERMS_)))
        TOGETHER(sum, 1)
        if (SUMMED)
            density[i] = (real) sum[0]/(real) 0x100000000;
    END_BEAD
}

// Force of a pair on a bead of this type (times their number), index and velocity, added to f, and half of its energy.
DEVICE INLINED real dpdPush(int layer, DPDBead* self, DPDBead* other, real3 delta, real r2, int terms, TERMS,
        mm_long* f) {
    real invR = APART ? RSQRT(r2) : 0, r = r2*invR, energy = 0;
    DPDPair p;
    if (!dpdPair(&p, ROW(layer), self->index, other->index, r, TERMS_))
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
            real push = p.factor*m.x*(densities[self->i]+densities[other->i])*w;
            size += push;
            // of Lucy's as if densities were constants: it has no potential
            energy += (LUCY ? (APART ? (real) 0.25 : 0) : (real) 0.125)*push*w/m.y;
        }
#endif
    }
    if ((terms & THERMOSTAT) != 0) {
        mm_ulong pair = dpdPairKey(dpdKeyOf(layer, key, begun, bits), self->index, other->index);
        real3 u = make_real3(self->v.x-other->v.x, self->v.y-other->v.y, self->v.z-other->v.z);
        if (SHEARED) // velocities are relative to the flow
            u.x += slide*delta.y;
        real along = e.x*u.x+e.y*u.y+e.z*u.z, s = p.root*p.w;
        size += s*(noise*p.kick*dpdNormal(pair, cubics)-s*along);
#ifdef TRANSVERSE
        if (p.rootAcross != 0) {
            real t = p.rootAcross*p.wAcross;
            real3 z = dpdAcross(pair, e, self->index < other->index, cubics);
            force = make_real3(t*(noise*z.x-t*(u.x-along*e.x)), t*(noise*z.y-t*(u.y-along*e.y)),
                t*(noise*z.z-t*(u.z-along*e.z)));
        }
#endif
    }
    f[0] += realToFixedPoint(size*e.x+force.x);
    f[1] += realToFixedPoint(size*e.y+force.y);
    f[2] += realToFixedPoint(size*e.z+force.z);
    return energy;
}

DEVICE void dpdTake(WRITES(mm_ulong) impulses, int wall, int axis, mixed impulse) {
    ATOMIC_ADD(&impulses[3*wall+axis], (mm_ulong) (mm_long) floor(impulse*(mixed) 1073741824+(mixed) 0.5));
}

DEVICE mixed dpdOf(mixed4 v, int axis) {
    return axis == 0 ? v.x : axis == 1 ? v.y : v.z;
}

DEVICE mixed dpdSpeed(int wall, int axis, DRIFT) {
    return dpdOf(wall%2 ? swingsHigh : swingsLow, wall/2)*dpdOf(walls[5+wall], axis);
}

// What a bead feels of what is behind a wall (openmm_dpd/kernels/driven.py), of which there are rows with straight
// lines between: force, energy, friction along the axis and across it; false where it is out of reach.
DEVICE bool dpdBehind(mixed3 x, int side, int type, real4* found, DRIFT) {
    if (BEHIND_ROWS <= 0 || type < 0)
        return false;
    mixed at = dpdOf(make_mixed4(x.x, x.y, x.z, 0), BEHIND_AXIS), period = dpdOf(walls[3], BEHIND_AXIS);
    at -= period*floor((at-dpdOf(walls[2], BEHIND_AXIS))/period);
    real h = (real) (side ? dpdOf(walls[1], BEHIND_AXIS)-at : at-dpdOf(walls[0], BEHIND_AXIS)),
        place = max((real) 0, h)*(BEHIND_ROWS/behindReach);
    if (h >= behindReach)
        return false;
    int row = min((int) place, BEHIND_ROWS-1);
    real4 a = behind[(side*NUM_TYPES+type)*(BEHIND_ROWS+1)+row],
        b = behind[(side*NUM_TYPES+type)*(BEHIND_ROWS+1)+row+1];
    place -= row;
    real push = a.x+place*(b.x-a.x),
        energy = b.y+(real) 0.5*(push+b.x)*(behindReach/BEHIND_ROWS)*(1-place)-push*min((real) 0, h);
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
DEVICE mixed dpdRubbed(mixed v, int wall, int axis, mixed gamma, mixed inverseMass, mixed time, mixed kT, mm_ulong pair,
        READS(real4) cubics, DRIFT) {
    int stream = 3*(wall%2)+axis;
    mixed lost = -expm1(-gamma*inverseMass*time), noise = sqrt(kT*inverseMass*lost*(2-lost))
        *dpdNormal(stream == 0 ? pair : dpdMix(pair+stream*STREAM), cubics);
    mixed change = noise-lost*(v-dpdSpeed(wall, axis, DRIFT_));
    dpdTake(impulses, wall, axis, -change/inverseMass);
    return v+change;
}

DEVICE void dpdRub(mixed3 x, mixed4* v, int type, mixed time, mixed kT, mm_ulong pair, READS(real4) cubics, DRIFT) {
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
KERNEL BOUNDS void dpdEvaluate(HALTS, PLACE, TERMS, CELLS, DRIFT, BOX, WRITES(mm_ulong) force,
        WRITES(mixed) energyBuffer, int terms) {
    if (STOPPED) return;
    SHARED(4)
    mixed energy = 0;
    EACH_BEAD
        mm_long f[4] = {0, 0, 0, 0};
        EACH_PARTNER(EACH_LAYER f[3] += realToFixedPoint(dpdPush(layer, &self, &other, delta, r2, terms, TERMS_, f)))
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

// A component of a velocity after walls: one of its own axis turns it, of which `side` says whether there is any, or
// else the first one that turns all
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
    mixed3 put = make_mixed3(dpdReflected(x->x, low.x, high.x, start.x, period.x),
        dpdReflected(x->y, low.y, high.y, start.y, period.y), dpdReflected(x->z, low.z, high.z, start.z, period.z));
    int sx = dpdSide(x->x, put.x, low.x, start.x, period.x), sy = dpdSide(x->y, put.y, low.y, start.y, period.y),
        sz = dpdSide(x->z, put.z, low.z, start.z, period.z);
    int first = sx >= 0 && back.x != 0 ? sx : sy >= 0 && back.y != 0 ? 2+sy : sz >= 0 && back.z != 0 ? 4+sz : -1;
    *x = put;
    v->x = dpdTurned(v->x, 0, sx, first, v->w, DRIFT_);
    v->y = dpdTurned(v->y, 1, sy, first, v->w, DRIFT_);
    v->z = dpdTurned(v->z, 2, sz, first, v->w, DRIFT_);
#endif
}

// v += kick*acc + kickSlow*slow, x += drift*v, and the beads into cells; moves: 0 into cells only, 2 with v +
// predict*acc to `seen`, 3 with a copy of x.  Nobody reads positions of others here: posNew may be pos.
KERNEL void dpdMove(HALTS, PLACE, PLACE_NEW, PLACE_COPY, KINDS, FILL, DRIFT, BOX, WRITES(mixed4) velm,
        READS(mixed4) acc, WRITES(mixed4) seen, READS(mixed4) slow, mixed kick, mixed predict, mixed kickSlow,
        int moves) {
    if (STOPPED) return;
    CLEAR
    if (GLOBAL_ID == 0)
        flags[BOUND] = 0;
    for (int i = GLOBAL_ID; i < NUM_ATOMS; i += GLOBAL_SIZE) {
        mixed3 x = dpdLoad(pos, corr, i);
        mixed4 v = velm[i], felt;
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
                    seen[i] = make_mixed4(v.x == straight.x ? s.x : v.x+straight.x-s.x,
                        v.y == straight.y ? s.y : v.y+straight.y-s.y, v.z == straight.z ? s.z : v.z+straight.z-s.z,
                            v.w);
            }
            else if (moves == 2)
                seen[i] = v;
            real w = pos[i].w;
            dpdStore(posNew, corrNew, i, &x, w);
            if (moves == 3)
                dpdStore(posCopy, corrCopy, i, &x, w);
        }
        felt = moves == 2 ? seen[i] : v;
        if (moves != 2 && SHEARED)
            felt.x -= flow.w*x.y;
        dpdPut(i, types[i], atomIndex[i], x, dpdFelt(felt, atomIndex[i], wallVelocity), flags, launch, FILL_, BOX_);
    }
}

// acc = F/m with these terms and the force of others, v += kick*acc, x += drift*v; moves: 1 the beads into the next
// cells, 2 only their positions to posNew, 3 as 1 and a copy of x.  Without friction, velocities in cells are the new
// ones (in `motionNew`).  useOthers: 2 keeps the force of others.
KERNEL BOUNDS void dpdKick(HALTS, PLACE, PLACE_NEW, PLACE_COPY, TERMS, CELLS, FILL, DRIFT, BOX, OTHERS,
        WRITES(mixed4) velm, WRITES(mixed4) acc, mixed kick, int useOthers, int terms, int moves) {
    if (STOPPED) return;
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
            EACH_PARTNER(EACH_LAYER dpdPush(layer, &self, &other, delta, r2, terms, TERMS_, f))
            TOGETHER(f, 3)
        }
        if (SUMMED) {
            if (useOthers)
                for (int k = 0; k < 3; k++)
                    f[k] += others[i+k*STRIDE];
            for (int k = 0; k < 3 && useOthers == 2; k++)
                kept[i+k*STRIDE] = others[i+k*STRIDE];
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
                dpdStore(posNew, corrNew, i, &x, q);
            if (moves == 3)
                dpdStore(posCopy, corrCopy, i, &x, q);
            mixed4 felt = dpdFelt(v, atomIndex[i], wallVelocity);
            if (drifts)
                dpdPut(i, types[i], atomIndex[i], x, felt, flags, launch, FILL_, BOX_);
            else if ((terms & THERMOSTAT) == 0) {
                if (SHEARED)
                    felt.x -= flow.w*x.y;
                motionNew[slot] = dpdMotion(felt, atomIndex[i], types[i]);
            }
        }
    END_BEAD
}

// What the force of others has changed by since it was kept is added to acc, but where only the `external` force acts.
KERNEL void dpdRenew(HALTS, OTHERS, READS(int) atomIndex, READS(mixed4) velm, WRITES(mixed4) acc) {
    if (STOPPED) return;
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
KERNEL void dpdCompare(HALTS, PLACE, READS(real4) posKept, READS(real4) corrKept) {
    for (int i = GLOBAL_ID; i < NUM_ATOMS; i += GLOBAL_SIZE) {
        mixed3 x = dpdLoad(pos, corr, i), y = dpdLoad(posKept, corrKept, i);
        if (x.x != y.x || x.y != y.y || x.z != y.z)
            flags[MOVED] = launch;
    }
}

// Velocities and what is kept change places, and the positions are kept.
KERNEL void dpdExchange(HALTS, PLACE, PLACE_COPY, WRITES(mixed4) velm, WRITES(mixed4) kept) {
    if (STOPPED) return;
    for (int i = GLOBAL_ID; i < NUM_ATOMS; i += GLOBAL_SIZE) {
        mixed4 v = velm[i], k = kept[i];
        velm[i] = make_mixed4(k.x, k.y, k.z, v.w);
        kept[i] = v;
        mixed3 x = dpdLoad(pos, corr, i);
        dpdStore(posCopy, corrCopy, i, &x, pos[i].w);
    }
}

// Velocities to which a rate times the height is added, with which a flow goes
KERNEL void dpdFollow(HALTS, PLACE, GLOBAL const mixed4* from, GLOBAL mixed4* to, mixed rate) {
    if (STOPPED) return;
    for (int i = GLOBAL_ID; i < NUM_ATOMS; i += GLOBAL_SIZE) {
        mixed4 v = from[i];
        v.x += rate*dpdLoad(pos, corr, i).y;
        to[i] = v;
    }
}

// Pair updates of all pairs at once, an implicit midpoint step: (1 + h/2 M^-1 G) u = v + h/2 M^-1 R by Chebyshev
// iteration from u = v, and then v += h M^-1 (R - G u).  It leaves Maxwell's distribution unchanged for any h.
//
// Rows: entry k of bead i at k*STRIDE+i is a vector s along the line to the partner, whose index is in w.  The friction
// of a difference of velocities d is s (s.d), and with transverse friction sign*s (s.d) + t d, where t (with the sign)
// is in an array of its own.

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
DEVICE INLINED bool dpdRow(int layer, DPDBead* self, DPDBead* other, real3 delta, real r2, READS(mixed4) vel, TERMS,
        real perRate, real4* row, real* rowAcross, mm_long* sums) {
    real invR = RSQRT(r2);
    DPDPair p;
    if (!dpdPair(&p, ROW(layer), self->index, other->index, r2*invR, TERMS_))
        return false;
    real mine = INVERSE_MASS(vel, self->i), theirs = INVERSE_MASS(vel, other->i);
    real s = p.root*p.w, t = p.rootAcross*p.wAcross, radial = s*s, across = t*t;
    if (!APART || (radial == 0 && across == 0) || (mine == 0 && theirs == 0))
        return false;
    real3 e = make_real3(invR*delta.x, invR*delta.y, invR*delta.z);
    mm_ulong pair = dpdPairKey(dpdKeyOf(layer, key, begun, bits), self->index, other->index);
    real push = noise*s*dpdNormal(pair, cubics);
    real3 kick = make_real3(push*e.x, push*e.y, push*e.z);
#ifdef TRANSVERSE
    if (t != 0) {
        real3 z = dpdAcross(pair, e, self->index < other->index, cubics);
        kick = make_real3(kick.x+noise*t*z.x, kick.y+noise*t*z.y, kick.z+noise*t*z.z);
    }
    s = SQRT(fabs(radial-across));
    if (radial < across)
        across = -across;
#endif
    *row = make_real4(s*e.x, s*e.y, s*e.z, (real) other->i);
    *rowAcross = across;
    if (SHEARED) { // what friction makes of the flow is as constant as the noise
        real3 dragged = dpdFriction(*row, across, slide*delta.y, 0, 0);
        kick = make_real3(kick.x-dragged.x, kick.y-dragged.y, kick.z-dragged.z);
    }
    real3 drag = dpdFriction(*row, across, self->v.x-other->v.x, self->v.y-other->v.y, self->v.z-other->v.z);
    sums[0] += realToFixedPoint(kick.x);
    sums[1] += realToFixedPoint(kick.y);
    sums[2] += realToFixedPoint(kick.z);
    sums[3] += realToFixedPoint(drag.x);
    sums[4] += realToFixedPoint(drag.y);
    sums[5] += realToFixedPoint(drag.z);
    sums[6] += realToFixedPoint(perRate*max(radial, (real) fabs(across))*(SQRT(mine)+SQRT(theirs)));
    return true;
}

#ifdef TRANSVERSE
#define KEEP_ACROSS rowsAcross[k*STRIDE+i] = across;
#define ACROSS(k) rowsAcross[(k)*STRIDE+i]
#else
#define KEEP_ACROSS
#define ACROSS(k) 0
#endif
#define KEEP_ROW \
    real4 row; \
    real across; \
    EACH_LAYER if (dpdRow(layer, &self, &other, delta, r2, vel, TERMS_, perRate, &row, &across, sums)) { \
        int k = ENTRY; \
        if (k < rowRoom) { \
            rows[k*STRIDE+i] = row; \
            KEEP_ACROSS \
        } \
    }

KERNEL BOUNDS void dpdRows(HALTS, PLACE, TERMS, CELLS, BOX, ROWS_OF(TAKE, WRITES), int rowRoom, READS(mixed4) vel,
        WRITES(mm_long) random, WRITES(real4) u, WRITES(real4) res, mixed halfdt, real perRate) {
    if (STOPPED) return;
    const mixed unit = 1/(mixed) 0x100000000;
    SHARED(7)
    EACH_BEAD
        mm_long sums[7] = {0, 0, 0, 0, 0, 0, 0};
        EACH_PARTNER(KEEP_ROW)
        TOGETHER(sums, 7)
        if (SUMMED) {
            real4 v = motion[slot];
            real weight = INVERSE_MASS(vel, i);
            // Gershgorin's bound
            real most = (real) (unit*sums[6])*SQRT(weight)*1048576;
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
            mixed scale = halfdt*weight*unit;
            u[i] = make_real4(v.x, v.y, v.z, weight);
            res[i] = make_real4((real) (scale*(sums[0]-sums[3])), (real) (scale*(sums[1]-sums[4])),
                (real) (scale*(sums[2]-sums[5])), 0);
            random[i] = sums[0];
            random[i+STRIDE] = sums[1];
            random[i+2*STRIDE] = sums[2];
        }
    END_BEAD
}

// How many passes the present bound needs: the host has the largest bound for each number of them.
DEVICE int dpdPasses(READS(int) flags, READS(real) limits, real factor) {
    real bound = factor*(real) flags[BOUND];
    int passes = 1;
    while (passes < MOST_PASSES && bound > limits[passes])
        passes++;
    return passes;
}

// Corrections are in d: in `res` and d1 by turns, the first one is the residual itself, up to a factor.
KERNEL BOUNDS void dpdPass(HALTS, ROWS_OF(TAKE, READS), SOLVES, WRITES(real4) u, READS(real4) res, WRITES(real4) resNew,
        READS(real4) d, WRITES(real4) dNew, int pass) {
    int passes = dpdPasses(flags, limits, factor);
    if (STOPPED || pass+1 >= passes)
        return;
    // of the correction as it is, of the last correction and of the residual in the next one
    real4 c = weights[passes*MOST_PASSES+pass];
    const mixed unit = 1/(mixed) 0x100000000;
    TOGETHER_SHARED(3)
    EACH_INDEX
        real4 a = d[i];
        mm_long q[3] = {0, 0, 0};
        int n = there ? rowCount[i] : 0;
        for (int k = lane; k < n; k += LANES) {
            real4 s = rows[k*STRIDE+i];
            real4 o = d[(int) s.w];
            real3 f = dpdFriction(s, ACROSS(k), a.x-o.x, a.y-o.y, a.z-o.z);
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
    END_INDEX
}

// v += h/m (R - G u) with the last correction added to u, and v and x move on: kick by acc, drift, and (moves: 2) into
// the next cells.  Where the impulses are asked for by OpenMM, they go to its force buffer too, divided by `share`.
KERNEL BOUNDS void dpdFinish(HALTS, PLACE, PLACE_NEW, KINDS, FILL, DRIFT, BOX, ROWS_OF(TAKE, READS), SOLVES,
        READS(mixed4) vel, WRITES(mixed4) velNew, READS(mixed4) acc, READS(mm_long) random, READS(real4) u,
        READS(real4) res, READS(real4) d1, WRITES(mm_ulong) force, READS(real4) cubics, mixed kick, mixed rub, mixed kT,
        mm_long key, int launched, int share, int moves) {
    if (STOPPED) return;
    int passes = dpdPasses(flags, limits, factor);
    if (passes-1 > launched || factor*(real) flags[BOUND] > limits[MOST_PASSES-1]) {
        HALT(FEW_PASSES)
        return;
    }
    if (moves == 2) {
        CLEAR
    }
    real scale = weights[passes*MOST_PASSES+passes-1].x;
    READS(real4) d = passes%2 ? res : d1;
    TOGETHER_SHARED(3)
    EACH_INDEX
        real4 a = d[i], y = u[i];
        real vx = y.x+scale*a.x, vy = y.y+scale*a.y, vz = y.z+scale*a.z;
        mm_long f[3] = {0, 0, 0};
        int n = there ? rowCount[i] : 0;
        for (int k = lane; k < n; k += LANES) {
            real4 s = rows[k*STRIDE+i];
            int j = (int) s.w;
            real4 b = d[j], o = u[j];
            real x = vx-(o.x+scale*b.x), y_ = vy-(o.y+scale*b.y), z = vz-(o.z+scale*b.z);
            real3 g = dpdFriction(s, ACROSS(k), x, y_, z);
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
                    dpdRub(x, &v, types[i], rub, kT, dpdPairKey((mm_ulong) key, atomIndex[i], atomIndex[i]), cubics,
                        DRIFT_);
                if (kick != 0) {
                    dpdAdd(&v, kick, acc[i]);
                    dpdKickWalls(x, types[i], kick, DRIFT_);
                }
                if (moves)
                    dpdDrift(&x, &v, DRIFT_);
            }
            velNew[i] = v;
            if (moves)
                dpdStore(posNew, corrNew, i, &x, pos[i].w);
            if (moves == 2)
                dpdPut(i, types[i], atomIndex[i], x, dpdFelt(v, atomIndex[i], wallVelocity), flags, launch, FILL_,
                    BOX_);
        }
    END_INDEX
}
