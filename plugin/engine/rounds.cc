// Sweeps from pair to pair: each changes velocities and what its two beads carry, and keeps energy or species to
// rounding (openmm_dpd/kernels/edpd.py, energy.py, tdpd.py, exchange.py, docs/theory_energy.md).
//
// The order of pairs is that of hashes of their own, which know nothing of their noise.  In a round each bead has a
// first pair, and a pair acts if it is the first of both its beads; so the result is that of one pair after the other,
// whatever runs at once.  The bead with the lower number does the work.

#define ORDER 1000 // number of the stream behind those of the noise

DEVICE mixed dpdUniform(mm_ulong pair, int stream) {
    return ((mixed) (mm_long) (dpdMix(pair+stream*STREAM)>>12)+(mixed) 0.5)*(mixed) 2.220446049250313e-16;
}

// What an update takes away of a number that decays by x, exactly or as Shardlow's does; and the number after it.
DEVICE mixed dpdDecay(bool exact, mixed x) {
    return exact ? -expm1(-x) : x/(1+(mixed) 0.5*x);
}
DEVICE mixed dpdRelaxed(mixed old, mixed lost, mixed variance, mixed xi) {
    return old*(1-lost)+sqrt(lost*(2-lost)*variance)*xi;
}

// The energy that each of two beads gets from their motion along a vector of this square, which is 1 but for rounding
DEVICE mixed dpdGain(mixed ev, mixed to, mixed im, mixed square) {
    return (mixed) 0.25/im*(ev-to)*(2*ev+square*(to-ev));
}

// The part of a difference that a pair exchanges among others: e flows at a difference of 1, b is what it changes a
// bead by, a what flows of all.
DEVICE mixed dpdExchanged(mixed e, mixed bi, mixed bj, mixed ai, mixed aj, mixed moving) {
    mixed y = e*(bi+bj), others = (bi*bi*max((mixed) 0, ai-e)+bj*bj*max((mixed) 0, aj-e))/(bi+bj), every = y+others,
        left = dpdDecay(true, every);
    mixed more = every+moving*every*others;
    return others == 0 ? left : min(1+(mixed) 0.75*min(bi, bj)/max(bi, bj), y-y*y/(every*more)*(more-left));
}

// Change of the entropy of a bead of temperature t that gets an energy, and is at `to` then unless it stays (a = 0).
DEVICE mixed dpdGained(mixed t, mixed to, mixed energy, mixed a) {
    return a > 0 ? log1p((to-t)/t)/a : energy/t;
}

// Weight (w^p) of the exchange of heat or of a species, times its coefficient
DEVICE mixed dpdRateOf(int row, int species, real r, READS(real4) carrying) {
    real4 c = carrying[row*CARRYING_ROWS+(CARRIES == HEAT ? 0 : 1+species)];
    real w = 1-r*(CARRIES == HEAT ? c.z : carrying[row*CARRYING_ROWS].x);
    return w > 0 ? c.x*POW(w, CARRIES == HEAT ? c.y : 2*c.z) : 0;
}

// Whether a pair does anything in a sweep, and what flows between its beads.
DEVICE bool dpdFlows(DPDBead* self, DPDBead* other, real r, READS(mixed4) vel, TERMS, READS(real) capacities,
        real perUnit, mm_long* sums) {
    int row = ROW(0);
    real4 p = params[row];
    bool acts = 1-r*p.z > 0 && p.y > 0;
#ifdef EXCEPTIONS
    if (dpdFactor(self->index, other->index, exceptionStart, exceptionBead, exceptionFactor) == 0)
        return false;
#endif
    for (int k = 0; k < (CARRIES == HEAT ? 1 : min(3, CARRYING_ROWS-1)); k++) { // words are refused for more
        mixed rate = dpdRateOf(row, k, r, carrying);
        acts = acts || rate > 0 || (CARRIES == SPECIES && carrying[row*CARRYING_ROWS+1+k].y > 0 &&
            1-r*carrying[row*CARRYING_ROWS].x > 0);
        sums[k] += realToFixedPoint((real) (perUnit*rate*(CARRIES == HEAT ? capacities[other->index] : 1)));
    }
    return acts && (vel[self->i].w != 0 || vel[other->i].w != 0);
}

#define KEEP_PAIR \
    real invR = RSQRT(r2); \
    if (dpdFlows(&self, &other, r2*invR, vel, TERMS_, capacities, perUnit, sums)) { \
        int k = ENTRY; \
        if (k < rowRoom) { \
            rows[k*STRIDE+i] = make_real4(invR*delta.x, invR*delta.y, invR*delta.z, (real) other.i); \
            distances[k*STRIDE+i] = r2*invR; \
            hashes[k*STRIDE+i] = (mm_long) (dpdMix(dpdPairKey((mm_ulong) key, self.index, other.index) \
                +ORDER*STREAM)>>1); \
        } \
    }

// Rows of the pairs of each bead, and sums over them of the rates of exchange (times the partner's heat capacity).
KERNEL BOUNDS void dpdPairs(HALTS, PLACE, TERMS, CELLS, BOX, PAIRS_OF(TAKE, WRITES), WRITES(mm_long) hashes,
        READS(mixed4) vel, WRITES(int) heads, int rowRoom, real perUnit) {
    if (STOPPED) return;
    SHARED(3)
    EACH_BEAD
        mm_long sums[3] = {0, 0, 0};
        EACH_PARTNER(KEEP_PAIR)
        TOGETHER(sums, 3)
        if (SUMMED) {
            int n = ENTRIES;
            if (n > flags[MOST_IN_ROW])
                ATOMIC_MAX(&flags[MOST_IN_ROW], n);
            if (n > rowRoom && rowRoom > 0)
                HALT(ROWS_FULL)
            rowCount[i] = n;
            heads[i] = 0;
            mixed scale = 1/((mixed) 0x100000000*perUnit);
            around[i] = make_mixed4(scale*sums[0], scale*sums[1], scale*sums[2], 0);
        }
    END_BEAD
}

// The rows of each bead in the order of their hashes
KERNEL void dpdSort(HALTS, READS(int) rowCount, WRITES(real4) rows, WRITES(real) distances, WRITES(mm_long) hashes) {
    if (STOPPED) return;
    for (int i = GLOBAL_ID; i < NUM_ATOMS; i += GLOBAL_SIZE)
        for (int k = 1; k < rowCount[i]; k++) {
            mm_long hash = hashes[k*STRIDE+i];
            real4 row = rows[k*STRIDE+i];
            real r = distances[k*STRIDE+i];
            int to = k;
            for (; to > 0 && hashes[(to-1)*STRIDE+i] > hash; to--) {
                hashes[to*STRIDE+i] = hashes[(to-1)*STRIDE+i];
                rows[to*STRIDE+i] = rows[(to-1)*STRIDE+i];
                distances[to*STRIDE+i] = distances[(to-1)*STRIDE+i];
            }
            hashes[to*STRIDE+i] = hash;
            rows[to*STRIDE+i] = row;
            distances[to*STRIDE+i] = r;
        }
}

// Motion and temperatures of two beads whose temperature an energy of 1 changes by ai and aj, and then the heat between
// them; returns the change of the relative velocity.
DEVICE mixed dpdWarmPair(mixed ev, mixed im, mixed square, real r, int row, real f, bool exact, mixed dt, mixed* ti,
        mixed* tj, mixed ai, mixed aj, mixed ci, mixed cj, mixed wi, mixed wj, mm_ulong pair, READS(real4) params,
        READS(real4) carrying, READS(real4) cubics, bool* negative) {
    real4 p = params[row], c = carrying[row*CARRYING_ROWS];
    mixed change = 0, w = 1-r*p.z, strength = f*p.y*p.y*im*dt;
    if (w > 0 && strength > 0) {
        mixed quarter = (mixed) 0.25/im, part = quarter*ev*ev, si = *ti+ai*part, sj = *tj+aj*part,
            rest = (mixed) 0.5*si*sj/(si+sj);
        if (si > ai*rest && sj > aj*rest) {
            si -= ai*rest;
            sj -= aj*rest;
        }
        mixed theta = 2*si*sj/(si+sj),
            exponent = c.w*dpdPolynomial(carrying[row*CARRYING_ROWS+1], (real) ((mixed) 0.5*(si+sj)-1));
        mixed lost = dpdDecay(exact, strength*pow(w, max((mixed) 0.01, exponent))),
            to = dpdRelaxed(ev, lost, theta*im, dpdNormal(pair, cubics));
        mixed gain = dpdGain(ev, to, im, square), ni = *ti+ai*gain, nj = *tj+aj*gain;
        if (ni > 0 && nj > 0 && dpdUniform(pair, 2) < exp(min((mixed) 0, dpdGained(*ti, ni, gain, ai)
                +dpdGained(*tj, nj, gain, aj)-2*gain/theta))) {
            change = to-ev;
            *ti = ni;
            *tj = nj;
        }
    }
    mixed e = dpdRateOf(row, 0, r, carrying)*ci*cj*dt;
    if (e > 0) {
        mixed both = ai+aj, mean = (aj**ti+ai**tj)/both,
            warmer = dpdPolynomial(carrying[row*CARRYING_ROWS+2], (real) (mean-1));
        *negative = warmer < 0;
        if (warmer > 0) {
            mixed moving = 10*im*dt*c.z*dt*c.z*mean, lost = dpdExchanged(e*warmer, ai, aj, ci*wi*dt*warmer,
                cj*wj*dt*warmer, moving);
            mixed bent = (ai-aj)/mean, old = (*ti-*tj)/both, variance = mean*mean/both,
                root = cbrt((*ti+*tj-mean)/mean), z = 3*old/(1+root+root*root);
            mixed to = dpdRelaxed(z, lost, variance, dpdNormal(dpdMix(pair+STREAM), cubics)), y = bent*to/3;
            mixed flow = to*(1+y+y*y/3)-old, ni = *ti+ai*flow, nj = *tj-aj*flow;
            if (1+y > 0 && ni > 0 && nj > 0 && dpdUniform(pair, 3) < exp(min((mixed) 0, dpdGained(*ti, ni, flow, ai)
                +dpdGained(*tj, nj, -flow, aj)
                    +(mixed) 0.5*(to-z)*(to+z)/variance+2*log((1+y)/root)))) {
                *ti = ni;
                *tj = nj;
            }
        }
    }
    return change;
}

// Of two beads with these energies: the harmonic mean of their temperatures, the sum of their entropies, and whether
// both are in range (1 or 0)
DEVICE mixed3 dpdStates(mixed ui, mixed uj, mixed4 si, mixed4 sj, READS(mixed4) states) {
    mixed3 a = dpdState(ui, si, states), b = dpdState(uj, sj, states);
    return make_mixed3(2/(a.x+b.x), a.z+b.z, dpdInRange(ui, si, states) && dpdInRange(uj, sj, states) ? 1 : 0);
}

// Metropolis test of energies that two beads get, with what is to be added to the change of their entropies
DEVICE bool dpdTakes(mixed ui, mixed uj, mixed gi, mixed gj, mixed more, mixed4 si, mixed4 sj, mixed drawn,
        READS(mixed4) states) {
    mixed3 then = dpdStates(ui+gi, uj+gj, si, sj, states);
    return then.z > 0 && drawn < exp(min((mixed) 0, then.y-dpdStates(ui, uj, si, sj, states).y+more));
}

// The energy of the first of two beads that have a sum of energies and one temperature: by Newton's method between
// bounds, with curves, whose temperatures follow the energy without a jump.  A reservoir takes what is left.
DEVICE mixed dpdBalance(mixed total, mixed4 si, mixed4 sj, READS(mixed4) states) {
    if (si.y < 0 && sj.y < 0)
        return si.y == RESERVOIR ? total-si.x*sj.x : sj.y == RESERVOIR ? si.x*sj.x : total*si.x/(si.x+sj.x);
    mixed low = max(dpdBound(si, 0, states), total-dpdBound(sj, 1, states)),
        high = min(dpdBound(si, 1, states), total-dpdBound(sj, 0, states)), share = (mixed) 0.5*(low+high),
        close = (mixed) 1e-15*(high-low+fabs(total));
    for (int k = 0; k < 100; k++) {
        mixed3 a = dpdState(share, si, states), b = dpdState(total-share, sj, states);
        mixed gap = a.x-b.x, next = share+gap/max(a.y+b.y, (mixed) 1e-30);
        if (gap < 0)
            high = share;
        else
            low = share;
        if (!(next >= low && next <= high))
            next = (mixed) 0.5*(low+high);
        bool done = fabs(next-share) <= close;
        share = next;
        if (done)
            break;
    }
    return share;
}

// Motion of two beads with energies (openmm_dpd/kernels/energy_updates.py): the change of the relative velocity, and in
// `gained` what each bead gets.  ti and tj are temperatures before the sweep, at which updates act that are not exact.
DEVICE mixed dpdEnergyMotion(mixed ev, mixed im, mixed square, real r, int row, real f, bool exact, mixed dt, mixed ui,
        mixed uj, mixed4 si, mixed4 sj, mixed ti, mixed tj, mm_ulong pair, READS(real4) params, READS(real4) cubics,
        READS(mixed4) states, mixed* gained) {
    real4 p = params[row];
    mixed w = 1-r*p.z, strength = f*p.y*p.y*w*w*im*dt, part = (mixed) 0.25/im*ev*ev, theta = 2*ti*tj/(ti+tj);
    if (w <= 0 || strength == 0)
        return 0;
    if (exact) {
        theta = dpdStates(ui+part, uj+part, si, sj, states).x;
        mixed rest = (mixed) 0.25*theta;
        mixed3 usual = dpdStates(ui+part-rest, uj+part-rest, si, sj, states);
        theta = usual.z > 0 ? usual.x : theta;
    }
    mixed to = dpdRelaxed(ev, dpdDecay(exact, strength/theta), theta*im, dpdNormal(pair, cubics)),
        gain = dpdGain(ev, to, im, square);
    if (exact && !dpdTakes(ui, uj, gain, gain, -2*gain/theta, si, sj, dpdUniform(pair, 2), states))
        return 0;
    *gained = gain;
    return to-ev;
}

// The energy that goes to the first of two beads from the other one
DEVICE mixed dpdEnergyHeat(mixed im, real r, int row, bool exact, mixed dt, mixed ui, mixed uj, mixed4 si, mixed4 sj,
        mixed wi, mixed wj, mixed ti, mixed tj, mm_ulong pair, READS(real4) carrying, READS(real4) cubics,
        READS(mixed4) states) {
    real4 c = carrying[row*CARRYING_ROWS];
    mixed w = 1-r*c.z, e = c.x*w*w*dt, moving = 10*im*(dt*c.z)*(dt*c.z);
    if (w <= 0 || e == 0)
        return 0;
    if (!exact)
        return sqrt(2*e)*dpdNormal(dpdMix(pair+STREAM), cubics)+e*(tj-ti)/(ti*tj);
    mixed share = dpdBalance(ui+uj, si, sj, states);
    mixed3 a = dpdState(share, si, states), b = dpdState(ui+uj-share, sj, states);
    // a flat piece of a curve has no slope; any positive number that depends on the sum of energies alone will do
    mixed more = max((mixed) 0, (mixed) 0.5e-6*a.x*a.x-(mixed) 0.5*(a.y+b.y)), ci = a.y+more, cj = b.y+more,
        variance = 1/(ci+cj), old = ui-share;
    mixed to = dpdRelaxed(old, dpdExchanged(e, ci, cj, wi*dt, wj*dt, moving/a.x), variance,
        dpdNormal(dpdMix(pair+STREAM), cubics)), flow = to-old;
    return dpdTakes(ui, uj, flow, -flow, (mixed) 0.5*flow*(to+old)/variance, si, sj, dpdUniform(pair, 3), states)
        ? flow : 0;
}

// The exchange of a species of two beads, of which bi and bj are 1, or 0 where it stays
DEVICE void dpdMixedPair(real r, int row, int species, mixed dt, mixed moving, mixed* ci, mixed* cj, mixed bi, mixed bj,
        mixed wi, mixed wj, mm_ulong pair, READS(real4) carrying, READS(real4) cubics) {
    real4 c = carrying[row*CARRYING_ROWS+1+species];
    real w = 1-r*carrying[row*CARRYING_ROWS].x;
    if (w <= 0)
        return;
    w = POW(w, 2*c.z);
    mixed both = bi+bj, e = (mixed) c.x*w*dt, y = e*both,
        lost = y > 0 ? dpdExchanged(e, bi, bj, wi*dt, wj*dt, moving) : 0, flow = -lost/both*(*ci-*cj);
    if (c.y > 0 && *ci >= 0 && *cj >= 0) {
        mixed shaken = sqrt((mixed) c.y*c.y*w*dt*(y > 0 ? lost*(2-lost)/(2*y) : 1));
        flow += (*ci+*cj)*shaken*dpdNormal(dpdMix(pair+(species+1)*STREAM), cubics);
        if ((bi > 0 && *ci+flow < 0) || (bj > 0 && *cj-flow < 0))
            return;
    }
    *ci += bi*flow;
    *cj -= bj*flow;
}

// The first pairs of beads, where they are that of both
KERNEL void dpdRound(HALTS, TERMS, PAIRS_OF(TAKE, READS), READS(mixed4) states, WRITES(mixed4) velm, WRITES(mixed4) own,
        READS(int) heads, WRITES(int) headsNew, mixed dt, mixed kT, int exact, int last) {
    if (STOPPED) return;
    for (int i = GLOBAL_ID; i < NUM_ATOMS; i += GLOBAL_SIZE) {
        int h = heads[i];
        headsNew[i] = h;
        if (h >= rowCount[i])
            continue;
        if (last) // there should be none left
            HALT(FEW_ROUNDS)
        real4 at = rows[h*STRIDE+i];
        int j = (int) at.w, g = heads[j];
        if (g >= rowCount[j] || (int) rows[g*STRIDE+j].w != i)
            continue;
        headsNew[i] = h+1;
        int a = atomIndex[i], b = atomIndex[j], row = types[i]*NUM_TYPES+types[j];
        if (a > b)
            continue;
        real r = distances[h*STRIDE+i], f = 1;
#ifdef EXCEPTIONS
        f = dpdFactor(a, b, exceptionStart, exceptionBead, exceptionFactor);
#endif
        mm_ulong pair = dpdPairKey((mm_ulong) key, a, b);
        mixed4 v = velm[i], w = velm[j], u = dpdFelt(v, a, wallVelocity), o = dpdFelt(w, b, wallVelocity), c = own[a],
            d = own[b], s = around[i], t = around[j];
        mixed mine[3] = {c.x, c.y, c.z}, theirs[3] = {d.x, d.y, d.z}, ours[3] = {s.x, s.y, s.z},
            others[3] = {t.x, t.y, t.z};
        mixed im = v.w+w.w, ev = at.x*(u.x-o.x)+at.y*(u.y-o.y)+at.z*(u.z-o.z), change = 0,
            square = (mixed) at.x*at.x+(mixed) at.y*at.y+(mixed) at.z*at.z, bi = v.w > 0 ? 1 : 0, bj = w.w > 0 ? 1 : 0;
        if (SHEARED)
            ev += slide*at.y*r*at.x;
        if (CARRIES == HEAT && ENERGIES) {
            mixed gain = 0;
            change = dpdEnergyMotion(ev, im, square, r, row, f, exact, dt, c.x+c.y+c.z, d.x+d.y+d.z, states[a],
                states[b], carried[a].x, carried[b].x, pair, params, cubics, states, &gain);
            mine[1] += bi*gain;
            theirs[1] += bj*gain;
        }
        else if (CARRIES == HEAT) {
            mixed ci = capacities[a], cj = capacities[b];
            bool negative = false;
            change = dpdWarmPair(ev, im, square, r, row, f, exact, dt, &mine[0], &theirs[0], bi/ci, bj/cj, ci, cj, s.x,
                t.x, pair, params, carrying, cubics, &negative);
            if (negative) {
                HALT(NO_HEAT)
                flags[WHO] = a;
            }
        }
        else {
            real4 p = params[row];
            mixed wF = 1-r*p.z, range = carrying[row*CARRYING_ROWS].x, moving = 10*kT*im*(dt*range)*(dt*range);
            if (wF > 0 && p.y > 0) {
                DPDPair found;
                dpdPair(&found, row, a, b, r, TERMS_);
                mixed root = found.root*found.w;
                change = dpdRelaxed(ev, dpdDecay(exact, root*root*im*dt), kT*im, dpdNormal(pair, cubics))-ev;
            }
            for (int k = 0; k < min(3, CARRYING_ROWS-1); k++)
                dpdMixedPair(r, row, k, dt, moving, &mine[k], &theirs[k], bi, bj, ours[k], others[k], pair, carrying,
                    cubics);
        }
        change /= im;
        velm[i] = make_mixed4(v.x+change*v.w*at.x, v.y+change*v.w*at.y, v.z+change*v.w*at.z, v.w);
        velm[j] = make_mixed4(w.x-change*w.w*at.x, w.y-change*w.w*at.y, w.z-change*w.w*at.z, w.w);
        if (CARRIES == HEAT && ENERGIES) { // here, for there are not that many registers
            mixed flow = dpdEnergyHeat(im, r, row, exact, dt, mine[0]+mine[1]+mine[2], theirs[0]+theirs[1]+theirs[2],
                states[a], states[b], s.x, t.x, carried[a].x, carried[b].x, pair, carrying, cubics, states);
            mine[0] += bi*flow;
            theirs[0] -= bj*flow;
        }
        own[a] = make_mixed4(mine[0], mine[1], mine[2], 0);
        own[b] = make_mixed4(theirs[0], theirs[1], theirs[2], 0);
    }
}

// What sources give in a time
KERNEL void dpdGive(HALTS, PLACE, SOURCES, BOX, READS(mixed4) velm, READS(int) atomIndex, WRITES(mixed4) own,
        mixed time) {
    if (STOPPED) return;
    for (int i = GLOBAL_ID; i < NUM_ATOMS; i += GLOBAL_SIZE)
        if (velm[i].w != 0) {
            int bead = atomIndex[i];
            mixed4 value = own[bead];
            dpdAdd(&value, time, dpdGiven(bead, 0, dpdLoad(pos, corr, i), SOURCES_, BOX_));
            own[bead] = value;
            if (CARRIES == HEAT && !(dpdFinite(value.x) && value.x > 0)) {
                HALT(COLD)
                flags[WHO] = bead;
            }
        }
}
