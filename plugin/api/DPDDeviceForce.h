#ifndef DPD_DEVICE_FORCE_H_
#define DPD_DEVICE_FORCE_H_
// The pair terms of DPD as a Force: conservative DPD with an energy to everybody; friction, noise, pair updates and whole steps to the programs of
// openmm_dpd, which ask for them by the context parameter dpd_phase.
#include "openmm/Force.h"
#include "openmm/KernelImpl.h"
#include "openmm/System.h"
#include "openmm/internal/ContextImpl.h"
#include "openmm/internal/ForceImpl.h"
#include <algorithm>
#include <atomic>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#define DPD_EXPORT __attribute__((visibility("default")))

namespace DPDDevice {

// Values of dpd_phase (openmm_dpd/base/names.py); all others ask for the conservative force.
enum { FORCE_SEEN = 4, FORCE_KEPT = 5, SWEEP = 100, EXCHANGE = 500, FIELDS = 10, RATES = 50, TAKEN = 80, RUN = 600, RUN_ANEW = 601, RUN_BESIDE = 602 };

// What beads carry
enum { NOTHING, HEAT, SPECIES };

// What openmm_dpd knows of the pair terms; tables have numTypes*numTypes values, those of several layers one after the other.
struct DPD_EXPORT Fluid {
    int numTypes = 1;
    bool periodic = true;
    double tolerance = 5e-4;                    // of the pair updates, relative to what they change
    std::vector<int> types;                     // -1: takes no part
    std::vector<double> A, gamma, sigma, gammaAcross, exponent, exponentAcross, cutoff; // sigma < 0: gamma is the fixed one
    std::vector<double> B, cutoffB, cutoffDensity; // of many-body terms, or none
    std::vector<double> densityWeights;         // masses of particles in Lucy's densities; none: beads count in Warren's, quadratic ones
    int carries = NOTHING;
    bool lammps = false;                        // heat of LAMMPS's code
    std::vector<double> carrying, cutoffCarried; // rows of four numbers for each pair of types (fields.cc), and how far they reach
    std::vector<double> carried, capacities;    // what particles carry at the start, all values of one after the other; heat capacities, of energies 1
    std::vector<double> states;                 // rows of four numbers: equations of state of particles (fields.cc), or none
    std::vector<double> sources;                // twelve numbers of each (fields.cc)
    std::vector<int> takes;                     // bits of the sources that act on a particle
    std::vector<int> exceptionBeads;            // pairs, both ways, sorted by the first
    std::vector<double> exceptionFactors;
    std::vector<double> wallVelocity;           // three per particle, or none
    std::vector<double> walls;                  // low, high, start, period, back along three axes, or none
    std::vector<double> wallMotion;             // velocity and period of the lower and the upper wall of three axes, or none
    std::vector<double> behind;                 // walls of one axis: force, its integral, friction along the axis and across it, for both sides, each
    int behindAxis = 0;                         // type and distances up to a reach, or none
    double behindReach = 0;
    std::vector<double> shear;                  // Lees-Edwards: amplitude and frequency, rate, end and duration of its ramp (0: none), tilt at the start; or none
    std::vector<int> alone;                     // bits of the axes along which only forces of one group act on a particle, or none
    int bodyGroup = 0;
    int fastGroups = -1;                        // of other Forces, at every kick of a word; those in other groups kick before and after a step,
    std::vector<double> slowKicks;              // over these two parts of it
    std::vector<std::pair<char, double> > word; // letters of a whole step, or V: modified velocity Verlet with this weight of the prediction
    std::map<std::string, double> globals;

    double maxCutoff() const;
    int layers() const { return A.size()/(numTypes*numTypes); }
    int columns() const { return carried.size()/std::max<size_t>(1, types.size()); } // values that a particle carries
    bool hasTemperatures() const { return carries == HEAT && states.empty(); } // which change, and not energies
    int carryingRows() const { return carrying.empty() ? 1 : carrying.size()/(4*numTypes*numTypes); }
    double rate(double kT) const;               // the largest friction coefficient, of all layers together
    void check() const;
};

class DPD_EXPORT DPDDeviceForce : public OpenMM::Force {
public:
    DPDDeviceForce();
    Fluid fluid;
    // Repulsion and friction (A, B, gamma, sigma, gammaAcross) as `fluid` has them now, to a Context
    void updateParametersInContext(OpenMM::Context& context);
    bool usesPeriodicBoundaryConditions() const override { return fluid.periodic; }
protected:
    OpenMM::ForceImpl* createImpl() const override;
};

extern DPD_EXPORT std::atomic<long long> bytesOfArrays; // that the plugin has on devices now

class DPD_EXPORT DPDDeviceKernel : public OpenMM::KernelImpl {
public:
    static std::string Name() { return "DPDDevice"; }
    DPDDeviceKernel(std::string name, const OpenMM::Platform& platform) : OpenMM::KernelImpl(name, platform) {}
    virtual void initialize(const OpenMM::System& system, const DPDDeviceForce& force) = 0;
    // For calcForcesAndEnergy
    virtual double execute(OpenMM::ContextImpl& context, bool includeForces, bool includeEnergy) = 0;
    // What is far from the box goes back into it, at steps with certain numbers; returns whether anything was moved
    virtual bool wrap(OpenMM::ContextImpl& context) = 0;
    // A whole step; others: groups of the other Forces that act in it
    virtual void step(OpenMM::ContextImpl& context, int others) = 0;
    // Another repulsion and friction
    virtual void update(const Fluid& fluid) = 0;
};

}
#endif
