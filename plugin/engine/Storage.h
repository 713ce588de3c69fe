#ifndef DPD_STORAGE_H_
#define DPD_STORAGE_H_
// What a Context has on its device: tables of pair terms, beads, and cells and rows with room for what they have to hold.
//
// A Device (common/CommonDPDDevice.h, reference/ReferenceDPDDevice.cpp), of which each library has one, makes, fills and reads arrays, has OpenMM's own arrays
// of a Context, and runs a kernel with arguments one by one or in tuples.
#include "Arguments.h"
#include "Fields.h"
#include "Tables.h"
#include "openmm/OpenMMException.h"
#include <chrono>
#include <iomanip>
#include <map>
#include <sstream>
#include <utility>

namespace DPDDevice {

class Storage {
public:
    using Array = Device::Array; // one of the Engine's
    using Base = Device::Base;   // any of the device's

    Fluid fluid;

    Storage(Device& device, const Fluid& fluid, const OpenMM::System& system) : fluid(fluid), device(device), fields(device, this->fluid) {
        int beads = system.getNumParticles();
        if (beads > 1<<24)
            throw OpenMM::OpenMMException("DPDDeviceForce: more than 16,777,216 beads, which single precision cannot count");
        makeTables();
        device.fill(massOf, Kind::Real, lucy() ? fluid.densityWeights : std::vector<double>(1, 1));
        device.fill(cubics, Kind::Real4, normalCubics());
        std::vector<double> limits = passLimits(fluid.tolerance);
        passRange = limits;
        device.fill(this->limits, Kind::Real, limits);
        device.fill(weights, Kind::Real4, passWeights(limits));
        std::vector<int> types = fluid.types, start(beads+1, 0), partner;
        types.resize(device.padded(), -1);
        device.fill(this->types, Kind::Int, types);
        for (size_t k = 0; k < fluid.exceptionBeads.size(); k += 2) {
            start[fluid.exceptionBeads[k]+1]++;
            partner.push_back(fluid.exceptionBeads[k+1]);
        }
        for (int i = 0; i < beads; i++)
            start[i+1] += start[i];
        partner.push_back(0);
        std::vector<double> factors = fluid.exceptionFactors;
        factors.push_back(1);
        device.fill(exceptionStart, Kind::Int, start);
        device.fill(exceptionBead, Kind::Int, partner);
        device.fill(exceptionFactor, Kind::Real, factors);
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
        device.fill(wallVelocity, Kind::Real4, wall);
        device.fill(walls, Kind::Mixed4, planes);
        device.fill(behind, Kind::Real4, inRows(fluid.behind));
        device.fill(alone, Kind::Int, partial() ? fluid.alone : std::vector<int>(1, 0));
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

    // Another repulsion and friction, for which the kernels are compiled already
    void update(const Fluid& other) {
        auto terms = [&] { return std::make_tuple(defines(false), thermostat, conservative); };
        auto before = terms();
        const Fluid old = std::exchange(fluid, other);
        makeTables();
        if (terms() == before)
            return;
        fluid = old;
        makeTables();
        throw OpenMM::OpenMMException("DPDDeviceForce: in a Context there cannot be friction, transverse friction, a fixed sigma or repulsion"
            " where there was none, nor none where there was; make a new one");
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

protected:
    static const int IMPULSES = 18; // a wall has three, along the axes; there are a lower and an upper one of three axes

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

    // Velocities that are not OpenMM's, for those that use them
    void needSeen() {
        if (!haveSeen)
            device.make(seen, Kind::Mixed4, device.padded());
        haveSeen = true;
    }

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

    template <class Tag, class... T> void run(T&&... arguments) { device.run<Tag>(flags, number(), std::forward<T>(arguments)...); }

    bool transverse() const { return *std::max_element(fluid.gammaAcross.begin(), fluid.gammaAcross.end()) > 0; }

    // Tables of pairs of types: repulsion and friction
    void makeTables() {
        size_t pairs = fluid.A.size();
        anyFixedSigma = thermostat = false;
        conservative = !fluid.behind.empty();
        std::vector<std::array<double, 4> > first(pairs), second(pairs), of(pairs, {0, 1e30, 1e30, 0});
        for (size_t k = 0; k < pairs; k++) {
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
        device.fill(many, Kind::Real4, of);
        device.fill(params, Kind::Real4, first);
        device.fill(more, Kind::Real4, second);
    }

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
        device.upload(walk, order);
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

    // The largest friction coefficient over the smallest mass: bounds of eigenvalues are counted in a millionth of it.
    double rate(const Now& now) const { return std::max(fluid.rate(now.kT)*inverseMass, 1e-30); }
    double unit(const Now& now) const { return rate(now)/1048576; }

    // Flags and number of a launch, for one after the other
    auto stop() { return [this] { return std::tuple<Base&, int>(flags, number()); }; }
    int number() { return launch = launch < 2000000000 ? launch+1 : 1; } // of a launch, never 0

    int next() const { return (cells+1)%3; }
    int spare() const { return (cells+2)%3; }

    void turn() {
        cells = next();
        side = 1-side;
        felt = 1-felt;
        binned = true;
    }

    Device& device;
    Fields fields;
    bool thermostat = false, conservative = false, anyFixedSigma = false, immobile = false, equalMasses = true;
    bool begun = false, sweeping = false, haveSeen = false; // whether there was a step, and which arrays were made beyond those that all need
    int members = 0;                           // beads that take part
    double inverseMass = 0, expected = 0;      // the largest 1/m; the bound of eigenvalues for which passes are launched
    std::vector<double> passRange;
    Mixed4 edges, inverse, tilt, width;
    int grid[3] = {0, 0, 0}, numCells = 0, cellCapacity = 0, cellRoom = 0, madeRoom = 0, walked = 0, share = 1, rowRoom = 0, rounds = 0;
    int launch = 0, here = 0, cells = 0, side = 0, felt = 0; // where the present positions are, which counts, places and velocities of cells are filled
    bool binned = false, standing = false;     // whether cells hold the present positions, and those after the last step
    bool unseen = false;                       // whether there were steps since the last look
    double slid = 0;                           // how long the box has been sheared, by now
    Mixed4 flow = {0, 0, 0, 0};                // what velocities change by before and after a drift, per height; the rate then
    Mixed4 swings[2] = {{1, 1, 1, 0}, {1, 1, 1, 0}}; // what velocities of lower and upper walls of three axes are multiplied with
    std::chrono::steady_clock::time_point looked;
    Array types, params, more, many, massOf, densities, cubics, limits, weights, exceptionStart, exceptionBead, exceptionFactor, wallVelocity, walls, behind, impulses, alone, external;
    Array posB, corrB, posC, corrC, acc, accSlow, seen, beside, walk, count[3], beads[2], rests[2], motion[2], flags, rowCount, rows, rowsAcross, random, u, res, res2, d1;
};

}
#endif
