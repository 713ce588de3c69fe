#ifndef DPD_STEPS_H_
#define DPD_STEPS_H_
// Whole steps and their parts, as launches of kernels.cc: kicks, drifts, pair updates, and what the next step can use of one.
#include "Storage.h"
#include "openmm/Integrator.h"

namespace DPDDevice {

class Steps : public Storage {
public:
    using Storage::Storage;

    // Another repulsion and friction: nothing is kept, and room is measured anew.
    void update(const Fluid& other) {
        Storage::update(other);
        haveKept = begun = false;
    }

    // A whole step, from OpenMM's positions and velocities to OpenMM's.  Beside a word the forces of groups that are not fast kick before and after it.
    void step(OpenMM::ContextImpl& context, int others) {
        Now now = at(context);
        fit();
        here = 0;
        owedSlow = 0;
        auto& word = fluid.word;
        if (word.empty())
            throw OpenMM::OpenMMException("DPDDeviceForce: it knows no whole step");
        bool predicts = word[0].first == 'V';
        // cells that the last step has filled serve this one, if it begins with forces, which depend on positions alone
        binned = std::exchange(standing, false) && word[0].first == 'B' && kept(now) && !device.touched();
        if (driven() && !std::exchange(complete, false))
            drop(); // what a step that failed has left
        pushed = driven();
        for (int wall = 0; wall < 6 && driven(); wall++) {
            double period = fluid.wallMotion[4*wall+3], swing = period > 0 ? std::cos(2*3.14159265358979323846*(now.time+0.5*now.dt)/period) : 1;
            Mixed4& side = swings[wall%2];
            (wall < 2 ? side.x : wall < 4 ? side.y : side.z) = swing;
        }
        begin(now, std::any_of(word.begin(), word.end(), [](auto& letter) { return letter.first == 'O' || letter.first == 'S'; }));
        int asked = (int) context.getParameter("dpd_phase");
        bool anew = asked == RUN_ANEW || !kept(now);
        if (predicts) {
            verlet(context, now, others, word[0].second, asked == RUN_ANEW, anew, asked == RUN_BESIDE);
            look(now, false);
            complete = true;
            return;
        }
        bool fresh = anew || device.touched();
        int slow = others&~fluid.fastGroups;
        others &= fluid.fastGroups;
        if (slow && fluid.slowKicks[0] != 0 && (fresh || !haveSlow || fluid.slowKicks[1] == 0))
            kickSlow(context, now, slow, 0); // else what the end of the last step has computed serves this one
        // whether acc is the acceleration here: where a step ends with a kick at the positions where the next one begins with one, it serves both
        std::string letters;
        for (auto& letter : word)
            letters += letter.first;
        copied = 0;
        copies = others != 0 && !sheared() && letters.find("ABA") != std::string::npos;
        if (copies && !haveCopies) {
            device.make(posC, Kind::Real4, device.padded());
            device.make(corrC, Kind::Real4, device.mixed() ? device.padded() : 1);
            haveCopies = true;
        }
        bool serves = letters.find('B') < letters.find('A') && letters.rfind('B') > letters.rfind('A'), known;
        // forces that follow temperatures are others after a sweep
        bool follows = fluid.hasTemperatures();
        known = serves = serves && !(follows && letters.find_last_of("OS") != std::string::npos && letters.find_last_of("OS") > letters.rfind('B'));
        fields.advance(stop(), 0, 0);
        if (serves && fresh)
            kick(context, now, others, 0, 0);
        owedSlow = slow ? fluid.slowKicks[0] : 0; // from here on, so that bits do not depend on what was computed anew
        double owed = 0;     // part of a kick by acc that velocities still lack
        auto is = [&](size_t n, char letter) { return n < word.size() && word[n].first == letter; };
        auto sweeps = [&](size_t n) { return is(n, 'O') || is(n, 'S'); };
        for (size_t n = 0; n < word.size(); n++) {
            char letter = word[n].first;
            double part = word[n].second;
            if (letter == 'A') {
                move(now, owed, part);
                owed = 0;
                known = false;
            }
            else if (letter == 'B' && known)
                owed += part;
            else if (letter == 'B') {
                if (owedSlow != 0)
                    move(now, 0, 0);
                // other Forces want positions in their place, where a sweep between two drifts puts them
                bool drifts = is(n+1, 'A');
                kick(context, now, others, part, drifts ? word[n+1].second : 0, nullptr, !others || (sweeps(n+2) && is(n+3, 'A')));
                known = !drifts;
                n += drifts;
            }
            else {
                if (owed != 0 || owedSlow != 0)
                    move(now, owed, 0);
                owed = 0;
                now.counter++;
                known = known && !follows;
                while (known && is(n+1, 'B'))
                    owed += word[++n].second;
                double drift = is(n+1, 'A') ? word[++n].second : 0;
                sweep(now, letter == 'O', part, owed, drift, false);
                owed = 0;
                known = known && drift == 0;
            }
        }
        if (owed != 0 || here == 1)
            move(now, owed, 0);
        bool same = !slow || fluid.slowKicks[1] == 0 || kickSlow(context, now, slow, fluid.slowKicks[1]);
        standing = same && binned;
        if (same && (serves || slow || standing))
            keep(now);
        look(now, false);
        complete = true;
    }

protected:
    // They slide on while beads drift for a part of the step; beads follow the flow if its rate changes.
    void slide(const Now& now, double part) {
        if (!sheared() || part == 0)
            return;
        double end = slid+part*now.dt, mean = (strain(end)-strain(slid))/(part*now.dt);
        bool steady = fluid.shear[0] == 0 && fluid.shear[4] == 0;
        flow = {steady ? 0 : mean-shearRate(slid), steady ? 0 : shearRate(end)-mean, shearRate(slid), shearRate(end)};
        slid = end;
        tilt.x = shearTilt(end);
        device.slide(tilt.x);
    }

    // Velocities relative to the flow (sign -1) or with it again (1), to an array that may be the same
    void follow(Base& from, Base& to, int sign) {
        if (sheared())
            run<dpdFollow_>(place(), from, to, Mixed{sign*flow.w});
    }

    // Velocities as friction sees them
    Base& relative() {
        if (!sheared())
            return device.velm();
        needSeen();
        follow(device.velm(), seen, -1);
        return seen;
    }

    void drop() {
        device.clear(impulses);
        untold.assign(IMPULSES, 0);
    }

    // The first step of a Context: how much room its state needs.
    void begin(const Now& now, bool sweeps) {
        if (sweeps && !sweeping) {
            for (auto array : {&u, &res, &res2, &d1})
                device.make(*array, Kind::Real4, device.padded());
            device.make(rowCount, Kind::Int, device.padded());
            device.make(random, Kind::Long, 3*device.padded());
            device.make(rows, Kind::Real4, 1);
            device.make(rowsAcross, Kind::Real, 1);
            fields.makeRows(1);
            sweeping = true;
            begun = false;
        }
        if (begun)
            return;
        rowRoom = 0;
        do {
            binned = false;
            bin(now);
            if (sweeping && fluid.carries != NOTHING)
                fields.list(stop(), place(), termsOf(now, now.dt, 0), cellsOf(), boxOf(), rowCount, rows, 0);
            else if (sweeping)
                run<dpdRows_>(place(), termsOf(now, now.dt, 0), cellsOf(), boxOf(), rowsOf(), 0, device.velm(), random, u, res, Mixed{0.5*now.dt},
                    Real{1/rate(now)});
        } while (look(now, true));
        begun = true;
    }

    void bin(const Now& now) { move(now, 0, 0); }

    // Modified velocity Verlet: the acceleration of a step serves the next one, unless positions, box or parameters have changed in between.
    // differ: forces of others may have other parameters, and what that changes is added.
    void verlet(OpenMM::ContextImpl& context, Now now, int others, double lam, bool asked, bool anew, bool differ) {
        needSeen();
        if (others && !haveBeside)
            device.make(beside, Kind::Long, 3*device.padded());
        haveBeside = others != 0;
        bool changed = !anew && moved();
        if (anew || changed || (differ && others && !renewed(context, others))) {
            Now then = now; // the noise is that of the last half kick
            then.kT = haveKept && !asked ? keptKT : now.kT;
            fields.advance(stop(), 0, 0);
            kick(context, then, others, 0, 0, &device.velm());
            fields.flow(stop(), place(), device.velm(), termsOf(then, now.dt, 0), cellsOf(), boxOf(), now.dt, 0);
        }
        fields.advance(stop(), 0.5*now.dt, (fluid.hasTemperatures() ? lam : 0.5)*now.dt); // LAMMPS predicts temperatures alone
        move(now, 0.5, 1, lam);
        now.counter++;
        kick(context, now, others, 0.5, 0, &seen);
        fields.flow(stop(), place(), seen, termsOf(now, now.dt, 0), cellsOf(), boxOf(), now.dt, 0.5*now.dt);
        if (lam != 0.5) // what programs keep has the flow in it
            follow(seen, seen, 1);
        keep(now);
    }

    // Whether forces of others could be compared with those that were kept: not if they gave beads another order.
    bool renewed(OpenMM::ContextImpl& context, int others) {
        if (!evaluateAll(context, others))
            return false;
        run<dpdRenew_>(othersOf(partial()), device.index(), device.velm(), acc);
        return true;
    }

    // The positions, and what tells of changes since; within the same step it is known that there is none.
    void keep(const Now& now) {
        device.note();
        keptStep = now.dt;
        keptKT = now.kT;
        keptBox = edges;
        keptTilt = tilt;
        haveKept = true;
    }

    bool kept(const Now& now) const {
        auto same = [](const Mixed4& a, const Mixed4& b) { return a.x == b.x && a.y == b.y && a.z == b.z; };
        return haveKept && now.dt == keptStep && same(edges, keptBox) && same(tilt, keptTilt);
    }

    bool moved() {
        if (!device.touched())
            return false;
        run<dpdCompare_>(place(), posB, corrB);
        std::vector<int> f(FLAGS);
        device.download(flags, f);
        return f[MOVED] == launch;
    }

    // Forces of others in these groups, whether the beads have the order they had
    bool evaluate(OpenMM::ContextImpl& context, int groups) {
        device.beforeOthers();
        context.calcForcesAndEnergy(true, false, groups);
        return device.afterOthers();
    }

    // The same, where only body forces act along some axes with those apart
    bool evaluateAll(OpenMM::ContextImpl& context, int others) {
        bool same = true;
        if (partial() && others&1<<fluid.bodyGroup) {
            same = evaluate(context, 1<<fluid.bodyGroup);
            device.copy(device.force(), external);
        }
        return evaluate(context, others) && same;
    }

    // v += kick*acc (and what is owed by others), x += drift*v in units of the step, in place; the beads into cells.  predict: v + predict*acc is what
    // friction will see; else it sees the velocities, less the flow, or those of another array where there is no motion
    void move(const Now& now, double kick, double drift, double predict = -1, Base* sees = nullptr) {
        slide(now, drift);
        Mixed4 all = flow;
        if (sees)
            flow = {0, 0, 0, 0};
        bool copy = copies && drift != 0;
        int moves = predict >= 0 ? 2 : copy ? 3 : kick != 0 || drift != 0 || owedSlow != 0 || here == 1;
        int from = here;
        if (moves) {
            here = 0;
            copied = copy;
        }
        run<dpdMove_>(place(from), place(), place(1), kindsOf(), fillOf(now), driftOf(drift*now.dt), boxOf(), sees ? *sees : device.velm(), acc, seen, accSlow,
            Mixed{kick*now.dt}, Mixed{predict*now.dt}, Mixed{owedSlow*now.dt}, moves);
        seenBy = sees ? sees : predict >= 0 ? (Base*) &seen : &device.velm();
        bounded = true;
        owedSlow = 0;
        flow = {0, 0, all.w, all.w};
        turn();
    }

    // acc = F/m, v += kick*acc, and a drift if there is one; with friction and noise if it is said which velocities they see, and positions are kept.
    // away: a drift may put positions beside OpenMM's; if not, one in the same launch needs a copy of them, for others read them meanwhile
    void kick(OpenMM::ContextImpl& context, const Now& now, int others, double kick, double drift, Base* friction = nullptr, bool away = true) {
        if (others && !evaluateAll(context, others)) {
            binned = false;
            copied = 0;
        }
        int terms = (conservative ? 1 : 0)|(friction ? 2 : 0);
        if (!binned || (friction && seenBy != friction))
            move(now, 0, 0, -1, friction == &seen ? friction : nullptr);
        bool drifts = drift != 0 && !sheared() && (away || copied); // images slide on in a launch of its own
        int from = drifts && !away ? copied : here, to = drifts ? (away ? 1-here : 0) : friction ? 1-here : here, copy = drifts && !away ? 3-copied : 1;
        sumDensities(now, from, terms);
        run<dpdKick_>(place(from), place(to), place(copy), termsOf(now, friction ? now.dt : 0, 0), cellsOf(), fillOf(now), driftOf(drifts ? drift*now.dt : 0), boxOf(),
            othersOf(partial()), device.velm(), acc, Mixed{kick*now.dt}, others ? 1+(int) haveBeside : 0, terms, drifts ? (away ? 1 : 3) : friction ? 2 : 0);
        bounded = true;
        if (!friction)
            seenBy = &device.velm();
        if (!friction && !drifts)
            felt = 1-felt;
        if (drifts) {
            here = to;
            copied = away ? 0 : copy;
            turn();
        }
        else if (drift != 0)
            move(now, 0, drift);
    }

    // Densities at binned positions, which conservative terms (1) of many bodies depend on
    void sumDensities(const Now& now, int where, int terms) {
        if (manyBody() && terms&1)
            run<dpdDensity_>(place(where), termsOf(now, 0, 0), cellsOf(), boxOf(), densities);
    }

    // accSlow = F/m with these forces of others alone, v += kick*accSlow at positions in their place; returns whether the beads have the order they had
    bool kickSlow(OpenMM::ContextImpl& context, const Now& now, int groups, double kick) {
        if (!haveSlow)
            device.make(accSlow, Kind::Mixed4, device.padded());
        haveSlow = true;
        bool same = evaluate(context, groups);
        if (!same || !binned)
            move(now, 0, 0);
        run<dpdKick_>(place(), place(), place(1), termsOf(now, 0, 0), cellsOf(), fillOf(now), driftOf(0), boxOf(), othersOf(false), device.velm(), accSlow,
            Mixed{kick*now.dt}, 1, 0, 0);
        felt = 1-felt;
        seenBy = &device.velm();
        return same;
    }

    // A sweep over a part of the step at binned positions; exact ones in so many halves that what a midpoint step changes of an exponential is small.
    void sweep(const Now& now, bool exact, double part, double kick, double drift, bool toForce) {
        if (!binned || seenBy != &device.velm() || !bounded)
            move(now, 0, 0);
        if (sheared() && !toForce)
            follow(device.velm(), device.velm(), -1);
        if (fluid.carries != NOTHING) {
            fields.sweep(stop(), place(), termsOf(now, now.dt, 0), cellsOf(), boxOf(), rowCount, rows, rowRoom, rounds, exact, part*now.dt, now.kT);
            seenBy = nullptr;
            follow(device.velm(), device.velm(), 1);
            if (kick != 0 || drift != 0 || here == 1)
                move(now, kick, drift);
            return;
        }
        double h = part*now.dt, gamma = fluid.rate(now.kT)*inverseMass;
        int pieces = exact ? std::max(1, (int) std::ceil(gamma*h/2.1)) : 1;
        h /= pieces;
        double factor = 0.5*h*unit(now);
        if (toForce)
            needSeen();
        Base& start = toForce ? relative() : device.velm();
        double kickLater = sheared() ? kick : 0, driftLater = sheared() ? drift : 0;
        kick -= kickLater;
        drift -= driftLater;
        for (int k = 0; k < pieces; k++) {
            bool last = k == pieces-1;
            Base &vel = toForce && k > 0 ? (Base&) seen : start, &velNew = toForce ? (Base&) seen : device.velm();
            if (k > 0) // for velocities in cells
                move(now, 0, 0, -1, &vel);
            run<dpdRows_>(place(), termsOf(now, h, k), cellsOf(), boxOf(), rowsOf(), rowRoom, vel, random, u, res, Mixed{0.5*h}, Real{1/rate(now)});
            int launches = 0;
            while (launches+2 < MOST_PASSES && factor*expected > passRange[launches+1])
                launches++;
            for (int pass = 0; pass < launches; pass++)
                run<dpdPass_>(rowsOf(), solvesOf(factor, h), u, pass == 0 ? res : res2, res2, pass%2 ? d1 : res, pass%2 ? res : d1, pass);
            seenBy = nullptr;
            bounded = false;
            bool moves = last && !toForce && !sheared() && (drift != 0 || here == 1), drags = last && !toForce && !fluid.behind.empty();
            int to = moves ? 0 : here;
            long long key = (long long) callKey({now.seed, now.counter, 1ULL<<32, bitsOf(now.kT)});
            run<dpdFinish_>(place(), place(to), kindsOf(), fillOf(now), driftOf(last ? drift*now.dt : 0), boxOf(), rowsOf(), solvesOf(factor, h), vel, velNew, acc,
                random, u, res, d1, device.force(), cubics, Mixed{last ? kick*now.dt : 0}, Mixed{drags ? part*now.dt : 0}, Mixed{now.kT}, key, launches,
                toForce ? pieces : 0, moves ? drift != 0 ? 2 : 1 : 0);
            if (moves) // rows hold all that is needed of positions: no other bead reads them
                here = copied = 0;
            if (moves && drift != 0) {
                turn();
                seenBy = &device.velm();
            }
        }
        if (sheared() && !toForce) {
            follow(device.velm(), device.velm(), 1);
            if (kickLater != 0 || driftLater != 0 || here == 1)
                move(now, kickLater, driftLater);
        }
    }

    double keptStep = 0, keptKT = 0;
    Mixed4 keptBox, keptTilt;
    bool haveKept = false;                     // whether acc is of positions in posB, in a box keptBox, with noise for keptStep
    bool haveBeside = false, haveSlow = false, haveCopies = false; // which arrays were made beyond those that all need
    Base* seenBy = nullptr;                    // the array whose velocities cells have
    bool bounded = false;                      // whether the bound of eigenvalues was reset
    bool copies = false;                       // whether drifts in their place leave a copy of positions, for a kick that drifts in its launch
    int copied = 0;                            // which array has the present positions beside OpenMM's: 1 posB, 2 posC, 0 none
    double owedSlow = 0;                       // part of a kick by accSlow that velocities still lack
    bool complete = true, pushed = false;      // whether the last step was, and walls may have taken up something since they were asked
    std::vector<long long> untold = std::vector<long long>(IMPULSES, 0); // what walls have taken up, in 2^-30
};

}
#endif
