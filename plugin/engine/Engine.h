#ifndef DPD_ENGINE_H_
#define DPD_ENGINE_H_
// Launches of kernels.cc, for any device: what evaluates the pair terms and carries out whole steps.
//
// A Device makes, fills and reads arrays, has OpenMM's own arrays of a Context, and runs a kernel with arguments one by one or in tuples.
#include "../api/DPDDeviceForce.h"
#include "Arguments.h"
#include "Fields.h"
#include "Tables.h"
#include "openmm/Integrator.h"
#include "openmm/OpenMMException.h"
#include <chrono>
#include <iomanip>
#include <map>
#include <sstream>
#include <utility>

namespace DPDDevice {

template <class Device> class Engine {
public:
    using Array = typename Device::Array; // one of the Engine's
    using Base = typename Device::Base;   // any of the device's

    const Fluid fluid;

    Engine(Device& device, const Fluid& fluid, const OpenMM::System& system) : fluid(fluid), device(device), fields(device, this->fluid) {
        int beads = system.getNumParticles();
        size_t rowsOfTables = fluid.A.size();
        if (beads > 1<<24)
            throw OpenMM::OpenMMException("DPDDeviceForce: more than 16,777,216 beads, which single precision cannot count");
        std::vector<std::array<double, 4> > first(rowsOfTables), second(rowsOfTables), of(rowsOfTables, {0, 1e30, 1e30, 0});
        for (size_t k = 0; k < rowsOfTables; k++) {
            bool fixedSigma = fluid.sigma[k] >= 0;
            first[k] = {fluid.A[k], fixedSigma ? fluid.sigma[k] : std::sqrt(fluid.gamma[k]), fluid.cutoff[k] > 0 ? 1/fluid.cutoff[k] : 1e30, fixedSigma ? 1.0 : 0.0};
            second[k] = {std::sqrt(fluid.gammaAcross[k]), fluid.exponent[k], fluid.exponentAcross[k], 0};
            anyFixedSigma |= fixedSigma;
            thermostat |= first[k][1] != 0 || second[k][0] != 0 || fluid.carries != NOTHING;
            conservative |= fluid.A[k] != 0 || manyBody();
            if (manyBody()) {
                double h = fluid.cutoffDensity[k];
                of[k] = {fluid.B[k], fluid.cutoffB[k] > 0 ? 1/fluid.cutoffB[k] : 1e30, h > 0 ? 1/h : 1e30, h > 0 ? (lucy() ? 105/16.0 : 7.5)/(3.14159265358979323846*h*h*h) : 0};
            }
        }
        fill4(many, of);
        fill(massOf, Kind::Real, lucy() ? fluid.densityWeights : std::vector<double>(1, 1));
        fill4(params, first);
        fill4(more, second);
        fill4(cubics, normalCubics());
        std::vector<double> limits = passLimits(fluid.tolerance);
        passRange = limits;
        fill(this->limits, Kind::Real, limits);
        fill4(weights, passWeights(limits));
        std::vector<int> types = fluid.types, start(beads+1, 0), partner;
        types.resize(device.padded(), -1);
        fill(this->types, Kind::Int, types);
        for (size_t k = 0; k < fluid.exceptionBeads.size(); k += 2) {
            start[fluid.exceptionBeads[k]+1]++;
            partner.push_back(fluid.exceptionBeads[k+1]);
        }
        for (int i = 0; i < beads; i++)
            start[i+1] += start[i];
        partner.push_back(0);
        std::vector<double> factors = fluid.exceptionFactors;
        factors.push_back(1);
        fill(exceptionStart, Kind::Int, start);
        fill(exceptionBead, Kind::Int, partner);
        fill(exceptionFactor, Kind::Real, factors);
        if ((double) beads*fluid.numTypes > 4294967295.0)
            throw OpenMM::OpenMMException("DPDDeviceForce: beads times types are more than 4,294,967,295, which have no room in 32 bits");
        std::vector<std::array<double, 4> > wall(fluid.wallVelocity.empty() ? 1 : beads, {0, 0, 0, 0}), planes = {{-1e30, -1e30, -1e30, 0}, {1e30, 1e30, 1e30, 0}, {-1e9, -1e9, -1e9, 0}, {4e9, 4e9, 4e9, 0}, {0, 0, 0, 0}};
        for (int i = 0; i < beads; i++) {
            double mass = system.getParticleMass(i);
            immobile |= mass == 0 && fluid.types[i] >= 0;
            if (fluid.types[i] < 0)
                continue;
            members++;
            equalMasses = equalMasses && mass > 0 && (inverseMass == 0 || inverseMass == 1/mass);
            if (mass > 0)
                inverseMass = std::max(inverseMass, 1/mass);
        }
        if (immobile) {
            wall.resize(beads, {0, 0, 0, 0});
            for (size_t k = 0; k < fluid.wallVelocity.size(); k++)
                wall[k/3][k%3] = fluid.wallVelocity[k];
        }
        for (size_t k = 0; k < fluid.walls.size(); k++)
            planes[k/3][k%3] = fluid.walls[k];
        planes.resize(11, {0, 0, 0, 0});
        for (size_t k = 0; k < fluid.wallMotion.size(); k++)
            planes[5+k/4][k%4] = fluid.wallMotion[k];
        fill4(wallVelocity, wall);
        device.make(walls, Kind::Mixed4, planes.size());
        device.upload4(walls, Kind::Mixed4, planes);
        std::vector<std::array<double, 4> > behind(std::max<size_t>(1, fluid.behind.size()/4), {0, 0, 0, 0});
        for (size_t k = 0; k < fluid.behind.size(); k++)
            behind[k/4][k%4] = fluid.behind[k];
        fill4(this->behind, behind);
        conservative |= !fluid.behind.empty();
        fill(alone, Kind::Int, partial() ? fluid.alone : std::vector<int>(1, 0));
        device.make(external, Kind::Long, partial() ? 3*device.padded() : 1);
        device.clear(external);
        device.make(impulses, Kind::Long, IMPULSES);
        device.clear(impulses);
        int padded = device.padded();
        device.make(posB, Kind::Real4, padded);
        device.make(corrB, Kind::Real4, device.mixed() ? padded : 1);
        device.make(acc, Kind::Mixed4, padded);
        device.make(densities, Kind::Real, manyBody() ? padded : 1);
        device.make(accSlow, Kind::Mixed4, 1);
        for (auto array : {&posC, &corrC})
            device.make(*array, Kind::Real4, 1);
        device.make(seen, Kind::Mixed4, 1); // these grow when somebody needs them
        device.make(beside, Kind::Long, 1);
        device.make(flags, Kind::Int, FLAGS);
        device.clear(flags);
    }

    // What kernels.cc is compiled with
    std::map<std::string, std::string> defines(bool triclinic) const {
        std::map<std::string, std::string> defines;
        auto yes = [&](const char* name, bool holds) { if (holds) defines[name] = "1"; };
        double most = 0;
        for (size_t k = 0; k < fluid.exponent.size(); k++)
            most = std::max({most, std::fabs(fluid.exponent[k]-1), fluid.gammaAcross[k]});
        yes("TRICLINIC", fluid.periodic && (triclinic || sheared()));
        yes("WALLS", !fluid.walls.empty());
        yes("DRIVEN", driven());
        defines["SHEARED"] = sheared() ? "1" : "0";
        defines["BEHIND_AXIS"] = std::to_string(fluid.behindAxis);
        defines["BEHIND_ROWS"] = std::to_string(behindRows());
        yes("EXCEPTIONS", !fluid.exceptionFactors.empty());
        yes("IMMOBILE", immobile);
        yes("MASSES", !equalMasses);
        std::stringstream mass;
        mass << std::scientific << std::setprecision(17) << inverseMass;
        defines["EQUAL_MASS"] = mass.str();
        yes("FIXED_SIGMA", anyFixedSigma);
        yes("DETAILED", most > 0);
        yes("TRANSVERSE", transverse());
        yes("MANY_BODY", manyBody());
        yes("LUCY", lucy());
        defines["CARRIES"] = std::to_string(fluid.carries);
        defines["CARRYING_ROWS"] = std::to_string(fluid.carryingRows());
        defines["LAMMPS"] = fluid.lammps ? "1" : "0";
        defines["ENERGIES"] = fluid.states.empty() ? "0" : "1";
        defines["PERIODIC"] = fluid.periodic ? "1" : "0";
        defines["NUM_TYPES"] = std::to_string(fluid.numTypes);
        defines["LAYERS"] = std::to_string(fluid.layers());
        defines["MOST_PASSES"] = std::to_string(MOST_PASSES);
        return defines;
    }

    double reach() const { return fluid.maxCutoff(); }
    bool manyBody() const { return !fluid.B.empty(); }
    bool partial() const { return !fluid.alone.empty(); }
    bool sheared() const { return !fluid.shear.empty(); }
    bool driven() const { return !fluid.wallMotion.empty(); }
    int behindRows() const { return (int) fluid.behind.size()/(8*fluid.numTypes)-1; } // of a table, before its last one
    bool lucy() const { return !fluid.densityWeights.empty(); }

    double execute(OpenMM::ContextImpl& context, bool includeForces, bool includeEnergy) {
        int phase = (int) context.getParameter("dpd_phase");
        if (phase >= EXCHANGE+TAKEN && phase < RUN)
            return phase == EXCHANGE+TAKEN+IMPULSES ? tell(context) : taken(phase-EXCHANGE-TAKEN);
        if (phase >= RUN) // a barostat asks
            phase = 0;
        bool inStep = phase == FORCE_SEEN || phase == FORCE_KEPT || phase >= SWEEP;
        Now now = at(context);
        fit();
        here = 0;
        owedSlow = 0;
        binned = standing = false;
        if (phase >= EXCHANGE+FIELDS) {
            fields.swap(stop(), phase%100);
            device.give();
            return 0.0;
        }
        if (phase >= SWEEP && phase < EXCHANGE && fluid.carries != NOTHING)
            throw OpenMM::OpenMMException("DPDDeviceForce: pair updates of what particles carry are those of whole steps alone");
        if (phase >= EXCHANGE) {
            needSeen();
            run<dpdExchange_>(place(), posB, corrB, device.velm(), phase%100 == 0 ? acc : seen);
            device.give();
            keep(now);
            return 0.0;
        }
        if (inStep)
            begin(now, phase >= SWEEP);
        if (phase >= SWEEP) {
            if (!thermostat || !includeForces)
                return 0.0;
            sweep(now, phase%100 == 0, 1, 0, 0, true);
            look(now, false);
            return device.result(true, false);
        }
        int terms = (phase != FORCE_KEPT && conservative ? 1 : 0)|(inStep && thermostat ? 2 : 0);
        if (!inStep && unseen)
            look(now, false, true);
        if (terms == 0)
            return 0.0;
        do { // outside a step there is time to look whether all beads found a place
            binned = false;
            bin(inStep ? now : Now{0, 0, 0, 0});
        } while (!inStep && look(now, true));
        sumDensities(now, here, terms);
        fields.advance(stop(), 0, 0);
        if (inStep)
            fields.flow(stop(), place(), device.velm(), termsOf(now, now.dt, 0), cellsOf(), boxOf(), now.dt, 0);
        run<dpdEvaluate_>(place(), termsOf(now, now.dt, 0), cellsOf(), driftOf(0), boxOf(), device.force(), device.energy(), terms);
        if (inStep)
            look(now, false);
        return device.result(includeForces, includeEnergy);
    }

    // Molecules that are far from the box go back into it, for digits of positions are few.  When that is is a matter of the count of steps, which
    // States and checkpoints have: no bit depends on calls of step() or restarts.
    bool wrap(OpenMM::ContextImpl& context) {
        if (!fluid.periodic || sheared() || context.getStepCount()%1000 != 0)
            return false;
        here = 0;
        bool known = haveKept && !moved();
        if (!device.wrap(context.getMolecules(), 1000*fluid.maxCutoff()))
            return false;
        standing = false;
        if (known) {
            device.copy(position(), posB);
            if (device.mixed())
                device.copy(correction(), corrB);
        }
        return true;
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

private:
    static const int FLAGS = 8, IMPULSES = 18; // a wall has three, along the axes; there are a lower and an upper one of three axes
    enum { STOP, MOST_IN_CELL, MOST_IN_ROW, BOUND, MOST_BOUND, WHO, WHEN, MOVED }; // of flags
    enum { CELLS_FULL = 1, ROWS_FULL = 2, FEW_PASSES = 4, RUNAWAY = 8, COLD = 16, NO_HEAT = 32, FEW_ROUNDS = 64 };

    struct Now { // parameters of the Context
        double dt, kT;
        uint64_t seed, counter;
        double time;
    };

    Now at(OpenMM::ContextImpl& context) {
        if (sheared()) {
            slid = context.getParameter("dpd_sheared");
            flow = {0, 0, shearRate(slid), shearRate(slid)};
        }
        Now now = {context.getParameter("dpd_dt"), context.getParameter("dpd_kT"), (uint64_t) context.getParameter("dpd_seed"), (uint64_t) context.getParameter("dpd_counter"), context.getTime()};
        if (!(now.kT >= 0 && std::isfinite(now.kT)) || (anyFixedSigma && now.kT == 0))
            throw OpenMM::OpenMMException("the context parameter dpd_kT must be >= 0 and finite (and > 0 where sigma is fixed), but is "+std::to_string(now.kT));
        if (!(now.dt > 0)) {
            std::stringstream text;
            text << "the step size must be > 0, but the integrator's is " << now.dt << " ps";
            throw OpenMM::OpenMMException(text.str());
        }
        return now;
    }

    // Lees-Edwards shear (openmm_dpd/kernels/shear.py): strain and rate after a time, and how much farther along x the images above the box are.
    double strain(double time) const {
        auto& s = fluid.shear;
        double inside = std::min(time, s[4]);
        return s[0] != 0 ? s[0]*std::sin(s[1]*time) : s[4] == 0 ? s[2]*time : s[2]*inside+0.5*(s[3]-s[2])*inside*inside/s[4]+s[3]*(time-inside);
    }
    double shearRate(double time) const {
        auto& s = fluid.shear;
        return s[0] != 0 ? s[0]*s[1]*std::cos(s[1]*time) : s[4] == 0 ? s[2] : s[2]+(s[3]-s[2])*std::min(time/s[4], 1.0);
    }
    double shearTilt(double time) const {
        double shift = strain(time)*edges.y+fluid.shear[5];
        return std::min(std::max(shift-edges.x*std::floor(shift/edges.x+0.5), -0.5*edges.x), 0.5*edges.x);
    }

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

    // Momentum that a wall has taken up since this was asked last: a program adds it to a context parameter, which is what a restart has.
    double taken(int number) {
        if (std::exchange(pushed, false)) {
            std::vector<long long> now(IMPULSES);
            device.download(impulses, now);
            device.clear(impulses);
            for (int k = 0; k < IMPULSES; k++)
                untold[k] += now[k];
        }
        return std::ldexp((double) std::exchange(untold[number%IMPULSES], 0), -30);
    }

    // The same of all walls, added to the parameters: outside of a step, for a program keeps its own values of them
    double tell(OpenMM::ContextImpl& context) {
        for (int k = 0; k < IMPULSES; k++) {
            std::string name = std::string("dpd_wall_")+"xyz"[k/6]+(k/3%2 ? "_below_" : "_above_")+"xyz"[k%3];
            if (fluid.globals.count(name))
                context.setParameter(name, context.getParameter(name)+taken(k));
        }
        return 0;
    }

    void drop() {
        device.clear(impulses);
        untold.assign(IMPULSES, 0);
    }

    // Velocities that are not OpenMM's, for those that use them
    void needSeen() {
        if (!haveSeen)
            device.make(seen, Kind::Mixed4, device.padded());
        haveSeen = true;
    }

    // -- arguments -----------------------------------------------------------------------------------------------------------------
    auto boxOf() { return together(BOX_OF(GIVE)); }
    auto cellsOf() { return together(CELLS_OF(GIVE)); }
    auto fillOf(const Now& now) {
        double fastest = now.dt > 0 ? (thermostat ? fluid.maxCutoff()/now.dt : 1e15) : 0; // without friction any speed may be meant
        return together(FILL_OF(GIVE));
    }
    auto kindsOf() { return together(KINDS_OF(GIVE)); }
    auto termsOf(const Now& now, double dt, int part) { return together(TERMS_OF(GIVE)); }
    auto driftOf(double drift) { return together(DRIFT_OF(GIVE)); }
    auto othersOf(bool apart) { return together(OTHERS_OF(GIVE)); }
    auto rowsOf() { return together(ROWS_OF(GIVE, READS)); }
    auto solvesOf(double factor, double h) { return together(SOLVES_OF(GIVE)); }
    auto place(int where) { return std::tuple<Base&, Base&>(position(where), correction(where)); }
    auto place() { return place(here); }

    Base& position(int where) { return where == 2 ? (Base&) posC : where ? (Base&) posB : device.posq(); }
    Base& correction(int where) { return !where || !device.mixed() ? device.correction() : where == 2 ? (Base&) corrC : (Base&) corrB; }
    Base& position() { return position(here); }
    Base& correction() { return correction(here); }

    template <class Tag, class... T> void run(T&&... arguments) { device.template run<Tag>(flags, number(), std::forward<T>(arguments)...); }

    bool transverse() const { return *std::max_element(fluid.gammaAcross.begin(), fluid.gammaAcross.end()) > 0; }

    template <class T> void fill(Array& array, Kind kind, const std::vector<T>& values) {
        device.make(array, kind, values.size());
        device.upload(array, kind, values);
    }
    void fill4(Array& array, const std::vector<std::array<double, 4> >& values) {
        device.make(array, Kind::Real4, values.size());
        device.upload4(array, Kind::Real4, values);
    }

    // -- room ----------------------------------------------------------------------------------------------------------------------
    // As many cells as fit between the faces of the box; without a box as many as beads need, which repeat.
    void fit() {
        double reach = fluid.maxCutoff();
        int n[3];
        if (fluid.periodic) {
            OpenMM::Vec3 a, b, c;
            device.box(a, b, c);
            if (reach > 0.5*std::min({a[0], b[1], c[2]})*(1+1e-9)) {
                std::stringstream text;
                text << "the box has shrunk to " << a[0] << " x " << b[1] << " x " << c[2] << " nm, less than twice the cutoff of " << reach << " nm";
                throw OpenMM::OpenMMException(text.str());
            }
            edges = {a[0], b[1], c[2], 0};
            tilt = {b[0], c[0], c[1], 0};
            if (sheared()) {
                double off = (b[0]-shearTilt(slid))/a[0];
                if (std::fabs(off-std::round(off)) > 1e-6) {
                    std::stringstream text;
                    text << "the box is tilted by " << b[0] << " and not by the " << shearTilt(slid) << " nm of the shear: it was set, or comes from a state"
                        " without its parameters; load states whole";
                    throw OpenMM::OpenMMException(text.str());
                }
                b[0] = 0.5*a[0]; // cells are those of the largest tilt
            }
            double volume = a[0]*b[1]*c[2];
            OpenMM::Vec3 faces[3] = {b.cross(c), c.cross(a), a.cross(b)};
            for (int k = 0; k < 3; k++)
                n[k] = std::max(1, std::min(1024, (int) std::floor(volume/std::sqrt(faces[k].dot(faces[k]))/reach/1.0001)));
        }
        else {
            n[0] = n[1] = n[2] = std::max(4, std::min(128, (int) std::cbrt((double) device.beads())));
            double edge = n[0]*reach*1.0001;
            edges = {edge, edge, edge, 0};
            tilt = {0, 0, 0, 0};
        }
        // a nearly empty box has larger cells, for each has room for some beads
        double most = std::max(100000.0, 8.0*device.beads()), many = (double) n[0]*n[1]*n[2];
        for (int k = 0; k < 3 && many > most; k++)
            n[k] = std::max(1, (int) (n[k]*std::cbrt(most/many)));
        inverse = {1/edges.x, 1/edges.y, 1/edges.z, 0};
        width = {edges.x/n[0], edges.y/n[1], edges.z/n[2], 0};
        if (std::equal(n, n+3, grid))
            return;
        std::copy(n, n+3, grid);
        numCells = n[0]*n[1]*n[2];
        makeCells();
    }

    void makeCells() {
        double perCell = std::max(1.0, (double) members)/numCells;
        if (cellRoom == 0)
            cellRoom = 2*(int) std::ceil(perCell)+4;
        // behind them are cells of beads that take no part
        walked = numCells+(members < device.beads() ? (device.beads()+cellRoom-1)/cellRoom : 0);
        if (walked > cellCapacity || cellRoom > madeRoom) {
            cellCapacity = cellCapacity == 0 ? walked : std::max(cellCapacity, walked+walked/8);
            madeRoom = std::max(madeRoom, cellRoom);
            if ((double) cellCapacity*madeRoom > 2e9)
                throw OpenMM::OpenMMException("DPDDeviceForce: too many cells of beads for 32-bit numbers");
            device.make(walk, Kind::Int, cellCapacity);
            for (auto& array : count)
                device.make(array, Kind::Int, cellCapacity);
            for (int k = 0; k < 2; k++) {
                for (auto array : {&beads[k], &motion[k]})
                    device.make(*array, Kind::Real4, (size_t) cellCapacity*madeRoom);
                device.make(rests[k], Kind::Real4, device.mixed() ? (size_t) cellCapacity*madeRoom : 1);
            }
        }
        for (auto& array : count)
            device.clear(array);
        // columns of two by two cells, so that those of a block share their neighbours
        std::vector<int> order;
        for (int z = 0; z < grid[2]; z += 2)
            for (int y = 0; y < grid[1]; y += 2)
                for (int x = 0; x < grid[0]; x++)
                    for (int k = 0; k < 4; k++)
                        if (z+k/2 < grid[2] && y+k%2 < grid[1])
                            order.push_back(x|(y+k%2)<<10|(z+k/2)<<20);
        for (int k = 1; (int) order.size() < cellCapacity; k++)
            order.push_back(-k);
        device.upload(walk, Kind::Int, order);
        share = device.share(perCell);
        binned = standing = false;
    }

    // See what the kernels have found: in time at the first step and when asked, else every ten seconds.  Returns whether something was full
    // and the present evaluation, which has changed nothing yet, has to be done again; in a step that is an error.
    bool look(const Now& now, bool again, bool atOnce = false) {
        auto time = std::chrono::steady_clock::now();
        unseen = !again && !atOnce && time-looked < std::chrono::seconds(10);
        if (unseen)
            return false;
        looked = time;
        std::vector<int> f(FLAGS);
        device.download(flags, f);
        int stop = f[STOP];
        if (stop) { // kernels that did nothing have emptied no cells
            for (auto& array : count)
                device.clear(array);
            binned = standing = false;
        }
        if (stop & RUNAWAY) {
            device.clear(flags);
            throw OpenMM::OpenMMException("bead "+std::to_string(f[WHO])+" has a velocity that is not finite, or crosses more than a cutoff in one step; the step size is too large"
                " for this scheme, or the start is too far from equilibrium");
        }
        if (stop & (COLD|NO_HEAT)) {
            device.clear(flags);
            if (stop & COLD && !fluid.states.empty())
                throw OpenMM::OpenMMException("the internal energy of bead "+std::to_string(f[WHO])+" is outside its equation of state; the step size may be too"
                    " large for this scheme (middle, aboba and bababo never leave the range)");
            throw OpenMM::OpenMMException(stop & COLD ? "the temperature of bead "+std::to_string(f[WHO])+" is not > 0 (the step size may be too large, the heat capacity too small"
                " for its noise, or a source take what is not there)" : "the heat conduction coefficient of bead "+std::to_string(f[WHO])+" and another one is negative;"
                " kappa_polynomial must keep it >= 0 at every temperature of the run");
        }
        bool grows = false;
        if (f[MOST_IN_CELL] > 0.85*cellRoom) {
            cellRoom = f[MOST_IN_CELL]+f[MOST_IN_CELL]/2+4;
            makeCells();
            grows = true;
        }
        int most = f[MOST_IN_ROW];
        if (sweeping && (most > 0.95*rowRoom || rowRoom == 0)) {
            // rows take most of the memory; among many beads some have nearly as many partners as any will have
            rowRoom = device.beads() < 65536 ? most+most/3+8 : most+most/8+3;
            if ((double) rowRoom*device.padded() > 2e9)
                throw OpenMM::OpenMMException("DPDDeviceForce: too many partners of beads for 32-bit numbers");
            device.make(rows, Kind::Real4, (size_t) rowRoom*device.padded());
            fields.makeRows((size_t) rowRoom*device.padded());
            rounds = std::max(rounds, 2*rowRoom+20);
            if (transverse() || Device::everything)
                device.make(rowsAcross, Kind::Real, (size_t) rowRoom*device.padded());
        }
        expected = std::max(expected, 1.3*f[MOST_BOUND]);
        if (stop & FEW_ROUNDS)
            rounds *= 2;
        if (stop || grows)
            device.clear(flags);
        if (stop)
            begun = false; // measured anew: a step may need more of everything
        if (stop & FEW_PASSES && f[BOUND] >= 2000000000)
            throw OpenMM::OpenMMException("a bead has more than some thousand others within its cutoff, too many for pair updates");
        if (stop & FEW_PASSES && 0.5*now.dt*unit(now)*f[BOUND] > passRange[MOST_PASSES-1])
            throw OpenMM::OpenMMException("friction times step size is too large for pair updates; take a shorter step, or less friction");
        if (stop && !again)
            throw OpenMM::OpenMMException("beads have come closer together than there was room for on the device; there is more room now, so go on from the last checkpoint");
        return stop != 0 || grows; // larger cells are empty
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

    // The largest friction coefficient over the smallest mass: bounds of eigenvalues are counted in a millionth of it.
    double rate(const Now& now) const { return std::max(fluid.rate(now.kT)*inverseMass, 1e-30); }
    double unit(const Now& now) const { return rate(now)/1048576; }

    // Flags and number of a launch, for one after the other
    auto stop() { return [this] { return std::tuple<Base&, int>(flags, number()); }; }
    int number() { return launch = launch < 2000000000 ? launch+1 : 1; } // of a launch, never 0

    // -- launches ------------------------------------------------------------------------------------------------------------------
    int next() const { return (cells+1)%3; }
    int spare() const { return (cells+2)%3; }

    void turn() {
        cells = next();
        side = 1-side;
        felt = 1-felt;
        binned = true;
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

    Device& device;
    Fields<Device> fields;
    bool thermostat = false, conservative = false, anyFixedSigma = false, immobile = false, equalMasses = true, begun = false;
    int members = 0;                           // beads that take part
    double inverseMass = 0, expected = 0;      // the largest 1/m; the bound of eigenvalues for which passes are launched
    std::vector<double> passRange;
    Mixed4 edges, inverse, tilt, width, keptBox, keptTilt;
    double keptStep = 0, keptKT = 0;
    bool haveKept = false;                     // whether acc is of positions in posB, in a box keptBox, with noise for keptStep
    bool sweeping = false, haveSeen = false, haveBeside = false, haveSlow = false, haveCopies = false; // which arrays were made beyond those that all need
    int grid[3] = {0, 0, 0}, numCells = 0, cellCapacity = 0, cellRoom = 0, madeRoom = 0, walked = 0, share = 1, rowRoom = 0, rounds = 0;
    int launch = 0, here = 0, cells = 0, side = 0, felt = 0; // where the present positions are, which counts, places and velocities of cells are filled
    Base* seenBy = nullptr;                    // the array whose velocities cells have
    bool bounded = false, standing = false;    // whether the bound of eigenvalues was reset; cells have the positions after the last step
    bool unseen = false;                       // whether there were steps since the last look
    bool binned = false;                       // whether they hold the present positions
    bool copies = false;                       // whether drifts in their place leave a copy of positions, for a kick that drifts in its launch
    int copied = 0;                            // which array has the present positions beside OpenMM's: 1 posB, 2 posC, 0 none
    double owedSlow = 0;                       // part of a kick by accSlow that velocities still lack
    bool complete = true, pushed = false;      // whether the last step was, and walls may have taken up something since they were asked
    double slid = 0;                           // how long the box has been sheared, by now
    Mixed4 flow = {0, 0, 0, 0};                // what velocities change by before and after a drift, per height; the rate then
    Mixed4 swings[2] = {{1, 1, 1, 0}, {1, 1, 1, 0}}; // what velocities of lower and upper walls of three axes are multiplied with
    std::vector<long long> untold = std::vector<long long>(IMPULSES, 0); // what walls have taken up, in 2^-30
    std::chrono::steady_clock::time_point looked;
    Array types, params, more, many, massOf, densities, cubics, limits, weights, exceptionStart, exceptionBead, exceptionFactor, wallVelocity, walls, behind, impulses, alone, external;
    Array posB, corrB, posC, corrC, acc, accSlow, seen, beside, walk, count[3], beads[2], rests[2], motion[2], flags, rowCount, rows, rowsAcross, random, u, res, res2, d1;
};

}
#endif
