// What beads carry: heat, as temperatures (openmm_dpd/model/edpd.py) or as energies (energy_dpd.py), or species that
// diffuse (tdpd.py).  Three values of a bead are in a block, and a block of all beads in the order of their numbers,
// which OpenMM never changes.
//
// Flows between two beads have the same bits from both sides, up to the sign, and fixed-point sums keep what flows.

DEVICE real dpdClamped(real x) {
    return min((real) 5, max((real) -5, x));
}

// Equations of state (openmm_dpd/kernels/eos.py).  Rows of `states`: of each bead its heat capacity and a mark; of a
// reservoir its temperature; with a curve the number of pieces, and the first one in place of the mark.  Then two of
// each piece, and of the end of a curve: energy and entropy at its left end; and 1/temperature from there on, a cubic
// in the energy, highest power first.
#define CONSTANT_CAPACITY -1
#define RESERVOIR -2

// The least or (upper: 1) the largest energy of a bead
DEVICE mixed dpdBound(mixed4 s, int upper, READS(mixed4) states) {
    if (s.y >= 0)
        return states[NUM_ATOMS+2*((int) s.y+upper*(int) s.x)].x;
    return upper ? (mixed) 1e30 : s.y == CONSTANT_CAPACITY ? (mixed) 1e-30 : (mixed) -1e30;
}

// 1/temperature, minus its slope, and the entropy of a bead with an energy; out of a curve's range those of its end
DEVICE mixed3 dpdState(mixed u, mixed4 s, READS(mixed4) states) {
    if (s.y == CONSTANT_CAPACITY)
        return make_mixed3(s.x/u, s.x/(u*u), s.x*log(u));
    if (s.y == RESERVOIR)
        return make_mixed3(1/s.x, 0, u/s.x);
    u = min(max(u, dpdBound(s, 0, states)), dpdBound(s, 1, states));
    int low = (int) s.y, high = low+(int) s.x;
    while (high-low > 1) {
        int middle = (low+high)/2;
        if (states[NUM_ATOMS+2*middle].x <= u)
            low = middle;
        else
            high = middle;
    }
    mixed4 from = states[NUM_ATOMS+2*low], c = states[NUM_ATOMS+2*low+1];
    mixed d = u-from.x;
    return make_mixed3(((c.x*d+c.y)*d+c.z)*d+c.w, -((3*c.x*d+2*c.y)*d+c.z), from.y+(((c.x/4*d+c.y/3)*d+c.z/2)*d+c.w)*d);
}

DEVICE bool dpdInRange(mixed u, mixed4 s, READS(mixed4) states) {
    return u >= dpdBound(s, 0, states) && u <= dpdBound(s, 1, states);
}

// The temperature of a bead with these energies, 0 if there is none
DEVICE mixed dpdTemperature(mixed4 value, mixed4 s, READS(mixed4) states) {
    mixed u = value.x+value.y+value.z;
    return dpdFinite(u) && dpdInRange(u, s, states) ? 1/dpdState(u, s, states).x : 0;
}

// Excluded neighbours exchange nothing; other factors of bonded ones are those of friction alone.

// Heat that flows to a bead from a partner; and in `rubbed` what friction and noise between them give to it. Rows of
// `carrying`: kappa, exponent and 1/cutoff of conduction, exponent of friction; polynomials of the latter and of kappa.
DEVICE real dpdHeat(DPDBead* self, DPDBead* other, real3 delta, real r2, READS(mixed4) vel, TERMS,
        READS(real) capacities, real perRootDt, HALTS, real* rubbed) {
    real invR = RSQRT(r2), r = r2*invR;
    int index = self->index, partner = other->index, row = ROW(0);
    bool lower = index < partner;
#ifdef EXCEPTIONS
    real f = dpdFactor(index, partner, exceptionStart, exceptionBead, exceptionFactor);
    if (f == 0)
        return 0;
#endif
    mm_ulong pair = dpdPairKey((mm_ulong) key, index, partner);
    real xi = dpdNormal(pair, cubics), w = 1-r*params[row].z, wT = 1-r*carrying[row*CARRYING_ROWS].z;
    if (w > 0 && !(LAMMPS && wT <= 0)) {
        real mine = INVERSE_MASS(vel, self->i), theirs = INVERSE_MASS(vel, other->i);
        real along = invR*(delta.x*(self->v.x-other->v.x)+delta.y*(self->v.y-other->v.y)
            +delta.z*(self->v.z-other->v.z));
        if (SHEARED)
            along += slide*delta.y*invR*delta.x;
        real3 warm = dpdWarm(row, index, partner, w, carrying, carried);
        real s = params[row].y*warm.z, shaken = SQRT(warm.y)*xi*along;
        if (ENERGIES)
            s /= SQRT(warm.y);
        if (LAMMPS)
            *rubbed = s*(s*(along*along-2*(lower ? mine : theirs)*warm.y)-(real) 1.4142135623730951*shaken)
                /(capacities[index]+capacities[partner]);
        else {
#ifdef EXCEPTIONS
            s *= SQRT(f);
#endif
            *rubbed = (real) 0.5*s*(s*(along*along-(mine+theirs)*warm.y)-noise*shaken);
        }
    }
    if (wT > 0 && !(LAMMPS && w <= 0)) {
        real4 conducts = carrying[row*CARRYING_ROWS];
        mixed difference = carried[index].x-carried[partner].x;
        real s = (real) carried[index].x, t = (real) carried[partner].x, low = min(s, t), high = max(s, t),
            mean = (real) 0.5*(low+high);
        real strength = conducts.x*wT*wT, z = LAMMPS ? xi : dpdNormal(dpdMix(pair+STREAM), cubics);
        if (!ENERGIES) {
            real c = capacities[index], d = capacities[partner], weight = mean*POW(wT, (real) 0.5*conducts.y);
            real kappa = conducts.x*dpdPolynomial(carrying[row*CARRYING_ROWS+2], mean-1);
            if (kappa < 0) {
                HALT(NO_HEAT)
                flags[WHO] = index;
            }
            strength = kappa*(min(c, d)*max(c, d))*(weight*weight);
            z = dpdClamped(z);
        }
        return (lower ? 1 : -1)*(SQRT(2*max((real) 0, strength))*perRootDt*z)-strength/(low*high)*(real) difference;
    }
    return 0;
}

// A species' flow to a bead from a partner.  Rows of `carrying`: 1/cutoff; of each species kappa, epsilon, exponent/2.
DEVICE real dpdSpecies(DPDBead* self, DPDBead* other, real r2, int species, mixed mine, mixed theirs, TERMS,
        real perRootDt) {
    int index = self->index, partner = other->index, row = ROW(0)*CARRYING_ROWS;
    real w = 1-r2*RSQRT(r2)*carrying[row].x;
    real4 c = carrying[row+1+species];
    if (w <= 0 || (c.x == 0 && c.y == 0))
        return 0;
#ifdef EXCEPTIONS
    if (dpdFactor(index, partner, exceptionStart, exceptionBead, exceptionFactor) == 0)
        return 0;
#endif
    w = POW(w, c.z);
    real flow = -c.x*w*w*(real) (mine-theirs);
    if (c.y != 0) {
        real z = dpdClamped(dpdNormal(dpdMix(dpdPairKey((mm_ulong) key, index, partner)+(species+1)*STREAM), cubics));
        flow += (index < partner ? 1 : -1)*(c.y*w*perRootDt*z*(real) (mine+theirs));
    }
    return flow;
}

DEVICE void dpdFlow(DPDBead* self, DPDBead* other, real3 delta, real r2, READS(mixed4) vel, TERMS,
        READS(real) capacities, int block, real perRootDt, real perUnit, HALTS, mm_long* sums) {
    if (CARRIES == HEAT) {
        real rubbed = 0, conducted = dpdHeat(self, other, delta, r2, vel, TERMS_, capacities, perRootDt, flags, launch,
            &rubbed);
        sums[0] += realToFixedPoint(perUnit*(ENERGIES ? conducted : conducted+rubbed));
        if (ENERGIES)
            sums[1] += realToFixedPoint(perUnit*rubbed);
    }
    if (CARRIES == SPECIES) {
        mixed4 a = carried[block*NUM_ATOMS+self->index], b = carried[block*NUM_ATOMS+other->index];
        for (int k = 0; k < min(3, CARRYING_ROWS-1-3*block); k++)
            sums[k] += realToFixedPoint(perUnit*dpdSpecies(self, other, r2, 3*block+k,
                k == 0 ? a.x : k == 1 ? a.y : a.z, k == 0 ? b.x : k == 1 ? b.y : b.z, TERMS_, perRootDt));
    }
}

// What sources give to a bead per time.  Rows of each: the corner of the box, and whether it is a sphere; the lower
// corner or the centre, and the rate; the upper corner or the square of the radius, and which value it is.
DEVICE mixed4 dpdGiven(int index, int block, mixed3 x, SOURCES, BOX) {
    mixed4 sum = make_mixed4(0, 0, 0, 0);
    for (int k = 0; k < numSources; k++) {
        mixed4 corner = sources[3*k], a = sources[3*k+1], b = sources[3*k+2];
        int column = (int) b.w-3*block;
        if ((takes[index]>>k&1) == 0 || column < 0 || column > 2)
            continue;
        mixed3 y = make_mixed3(x.x-corner.x, x.y-corner.y, x.z-corner.z), inside = y;
        if (PERIODIC)
            dpdCellOf(y, &inside, BOX_);
        y = make_mixed3(inside.x+corner.x, inside.y+corner.y, inside.z+corner.z);
        mixed3 d = make_mixed3(y.x-a.x, y.y-a.y, y.z-a.z);
        if (corner.w != 0 ? SQUARE(d) < b.x : d.x >= 0 && d.y >= 0 && d.z >= 0 && y.x <= b.x && y.y <= b.y &&
                y.z <= b.z) {
            sum.x += column == 0 ? a.w : 0;
            sum.y += column == 1 ? a.w : 0;
            sum.z += column == 2 ? a.w : 0;
        }
    }
    return sum;
}

// Changes per time of a block of what beads carry, at positions in cells and with velocities and values that friction
// sees; `own` += part*rates.
KERNEL BOUNDS void dpdCarry(HALTS, PLACE, TERMS, CELLS, BOX, SOURCES, READS(mixed4) vel, GLOBAL mixed4* own,
        WRITES(mixed4) rates, READS(real) capacities, int block, real perRootDt, real perUnit, mixed part) {
    if (STOPPED) return;
    SHARED(3)
    EACH_BEAD
        mm_long sums[3] = {0, 0, 0};
        EACH_PARTNER(dpdFlow(&self, &other, delta, r2, vel, TERMS_, capacities, block, perRootDt, perUnit, flags,
            launch, sums))
        TOGETHER(sums, 3)
        if (SUMMED && vel[i].w != 0) {
            int bead = atomIndex[i], at = block*NUM_ATOMS+bead;
            mixed scale = 1/((mixed) 0x100000000*perUnit*(CARRIES == HEAT ? (mixed) capacities[bead] : 1));
            mixed4 rate = dpdGiven(bead, block, dpdLoad(pos, corr, i), SOURCES_, BOX_), value = own[at];
            rate = make_mixed4(rate.x+scale*sums[0], rate.y+scale*sums[1], rate.z+scale*sums[2], 0);
            rates[at] = rate;
            if (part != 0) {
                dpdAdd(&value, part, rate);
                own[at] = value;
            }
        }
    END_BEAD
}

// own += part*rates, and shown = own + predict*rates as they were (of energies the temperature), which friction sees.
KERNEL void dpdAdvance(HALTS, READS(mixed4) velm, READS(int) atomIndex, WRITES(mixed4) own, READS(mixed4) rates,
        WRITES(mixed4) shown, READS(mixed4) states, int block, mixed part, mixed predict) {
    if (STOPPED) return;
    for (int i = GLOBAL_ID; i < NUM_ATOMS; i += GLOBAL_SIZE) {
        int at = block*NUM_ATOMS+atomIndex[i];
        mixed4 value = own[at], seen = value, rate = rates[at];
        if (velm[i].w != 0) {
            dpdAdd(&value, part, rate);
            dpdAdd(&seen, predict, rate);
            own[at] = value;
        }
        if (ENERGIES)
            seen.x = dpdTemperature(seen, states[at], states);
        shown[at] = seen;
        if (CARRIES == HEAT && !(dpdFinite(seen.x) && seen.x > 0)) {
            HALT(COLD)
            flags[WHO] = atomIndex[i];
        }
    }
}

// Velocities of beads that move and a block change places.
KERNEL void dpdSwap(HALTS, WRITES(mixed4) velm, READS(int) atomIndex, WRITES(mixed4) values, int block) {
    if (STOPPED) return;
    for (int i = GLOBAL_ID; i < NUM_ATOMS; i += GLOBAL_SIZE) {
        int at = block*NUM_ATOMS+atomIndex[i];
        mixed4 v = velm[i], kept = values[at];
        if (v.w != 0) {
            velm[i] = make_mixed4(kept.x, kept.y, kept.z, v.w);
            values[at] = v;
        }
    }
}
