// The Reference and CPU platforms: the kernels as C++, in double precision and by one thread.
#include "../api/DPDDeviceForce.h"
#include "../engine/Launch.h"
#include "openmm/KernelFactory.h"
#include "openmm/reference/ReferencePlatform.h"
#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>

using namespace OpenMM;
using namespace std;

namespace DPDDevice {

namespace Kernels {

typedef double real;
typedef double mixed;
struct real3 { real x, y, z; };
struct real4 { real x, y, z, w; };
typedef real3 mixed3;
typedef real4 mixed4;
typedef long long mm_long;
typedef unsigned long long mm_ulong;

inline real3 make_real3(real x, real y, real z) { return {x, y, z}; }
inline real4 make_real4(real x, real y, real z, real w) { return {x, y, z, w}; }
template <class T> inline T add(T* at, T value) { T old = *at; *at += value; return old; }
inline mm_long realToFixedPoint(double x) { return std::llrint(x*4294967296.0); }

// What the platforms with a compiler define for each System, one value for all here
thread_local int NUM_ATOMS, STRIDE, NUM_TYPES, LAYERS, BEHIND_AXIS, BEHIND_ROWS, CARRIES, CARRYING_ROWS;
thread_local double MAX_CUTOFF;
thread_local bool PERIODIC, SHEARED, LUCY, LAMMPS, ENERGIES;

}

class Device {
public:
    struct Array {
        vector<char> bytes;
        template <class T> T* as() { return reinterpret_cast<T*>(bytes.data()); }
    };
    using Base = Array;
    static constexpr bool everything = true; // the kernels are compiled for any scene

    Device(ContextImpl& context, const System& system) : data(*static_cast<ReferencePlatform::PlatformData*>(context.getPlatformData())), n(system.getNumParticles()) {
        make(x, Kind::Real4, n);
        make(v, Kind::Mixed4, n);
        make(f, Kind::Long, 3*n);
        make(order, Kind::Int, n);
        make(u, Kind::Real, 1);
        for (int i = 0; i < n; i++) {
            double mass = system.getParticleMass(i);
            inverseMass.push_back(mass > 0 ? 1/mass : 0);
            order.as<int>()[i] = i;
        }
    }
    int beads() const { return n; }
    int padded() const { return n; }
    void box(Vec3& a, Vec3& b, Vec3& c) const { a = data.periodicBoxVectors[0]; b = data.periodicBoxVectors[1]; c = data.periodicBoxVectors[2]; }
    void slide(double tilt) { data.periodicBoxVectors[1][0] = tilt; }
    Array& posq() { return x; }
    bool mixed() const { return false; }
    int share(double) const { return 1; }
    Array& correction() { return x; }
    Array& velm() { return v; }
    Array& index() { return order; }
    Array& force() { return f; }
    Array& energy() { return u; }

    void take() { // positions and velocities of the Context
        for (int i = 0; i < n; i++) {
            const Vec3 &a = (*data.positions)[i], &b = (*data.velocities)[i];
            x.as<Kernels::real4>()[i] = {a[0], a[1], a[2], 0};
            v.as<Kernels::mixed4>()[i] = {b[0], b[1], b[2], inverseMass[i]};
        }
        clear(f);
        clear(u);
    }
    void give() {
        for (int i = 0; i < n; i++) {
            auto &a = x.as<Kernels::real4>()[i], &b = v.as<Kernels::mixed4>()[i];
            (*data.positions)[i] = Vec3(a.x, a.y, a.z);
            (*data.velocities)[i] = Vec3(b.x, b.y, b.z);
        }
    }
    bool touched() { return true; } // nobody says
    bool wrap(const vector<vector<int> >&, double) { return false; } // double precision goes farther than any bead
    void note() {}
    void beforeOthers() { give(); }
    bool afterOthers() {
        for (int i = 0; i < n; i++)
            for (int k = 0; k < 3; k++)
                f.as<long long>()[k*n+i] = Kernels::realToFixedPoint((*data.forces)[i][k]);
        return true;
    }
    double result(bool includeForces, bool) {
        for (int i = 0; includeForces && i < n; i++)
            for (int k = 0; k < 3; k++)
                (*data.forces)[i][k] += f.as<long long>()[k*n+i]/4294967296.0;
        return *u.as<double>();
    }

    void make(Array& array, Kind kind, size_t size) {
        static const map<Kind, int> bytes = {{Kind::Int, 4}, {Kind::Long, 8}, {Kind::Real, 8}, {Kind::Real4, 32}, {Kind::Mixed4, 32}};
        array.bytes.assign(size*bytes.at(kind), 0);
    }
    void copy(Base& from, Array& to) { to = from; }
    void clear(Array& array) { array.bytes.assign(array.bytes.size(), 0); }
    template <class T> void fill(Array& array, Kind kind, const vector<T>& values) {
        make(array, kind, values.size());
        upload(array, values);
    }
    template <class T> void upload(Array& array, const vector<T>& values) { memcpy(array.bytes.data(), values.data(), values.size()*sizeof(T)); }
    template <class T> void download(Array& array, vector<T>& values) { memcpy(values.data(), array.bytes.data(), values.size()*sizeof(T)); }

    template <class Tag, class... T> void run(T&&... arguments);

private:
    struct Pointer { // to whatever a kernel takes
        void* at;
        template <class T> operator T*() const { return static_cast<T*>(at); }
    };
    static Pointer given(Array& array) { return {array.bytes.data()}; }
    static int given(int value) { return value; }
    static long long given(long long value) { return value; }
    static double given(Mixed value) { return value.value; }
    static double given(Real value) { return value.value; }
    static Kernels::mixed4 given(Mixed4 v) { return {v.x, v.y, v.z, v.w}; }

    ReferencePlatform::PlatformData& data;
    const int n;
    vector<double> inverseMass;
    Array x, v, f, u, order;
};

}
#include "../engine/Engine.h" // of this Device
namespace DPDDevice {

namespace Kernels {

#define make_mixed3 make_real3
#define make_mixed4 make_real4
#define KERNEL static
#define DEVICE static inline
#define GLOBAL
#define RESTRICT __restrict__
#define LANES 1
#define GLOBAL_ID 0
#define GLOBAL_SIZE 1
#define ATOMIC_ADD(at, value) add(at, value)
#define ATOMIC_OR(at, value) (*(at) |= (value))
#define ATOMIC_MAX(at, value) (*(at) = max(*(at), value))
#define SQRT sqrt
#define RSQRT(x) (1/sqrt(x))
#define LOG log
#define POW pow
#define TRICLINIC
#define WALLS
#define DRIVEN
#define EXCEPTIONS
#define IMMOBILE
#define MASSES
#define FIXED_SIGMA
#define DETAILED
#define TRANSVERSE
#define MANY_BODY
#define LUCY LUCY
#define CARRIES CARRIES
#include "../engine/kernels.cc"
#include "../engine/fields.cc"
#include "../engine/rounds.cc"

#define DPD_CALL(name, share) template <class... T> void call(name##_, T... values) { name(values...); }
DPD_KERNELS(DPD_CALL)

}

template <class Tag, class... T> void Device::run(T&&... arguments) {
    apply([&](auto&&... values) { Kernels::call(Tag(), given(values)...); }, tuple_cat(flat(std::forward<T>(arguments))...));
}

class ReferenceDPDDeviceKernel : public DPDDeviceKernel {
public:
    ReferenceDPDDeviceKernel(string name, const Platform& platform, ContextImpl& context) : DPDDeviceKernel(name, platform), context(context) {}
    void initialize(const System& system, const DPDDeviceForce& force) override {
        device.reset(new Device(context, system));
        engine.reset(new Engine(*device, force.fluid, system));
    }
    double execute(ContextImpl& context, bool includeForces, bool includeEnergy) override {
        begin();
        return engine->execute(context, includeForces, includeEnergy);
    }
    bool wrap(ContextImpl&) override { return false; }
    void step(ContextImpl& context, int others) override {
        begin();
        engine->step(context, others);
        device->give();
    }
    void update(const Fluid& fluid) override { engine->update(fluid); }
private:
    void begin() {
        const Fluid& fluid = engine->fluid;
        Kernels::NUM_ATOMS = Kernels::STRIDE = device->beads();
        Kernels::NUM_TYPES = fluid.numTypes;
        Kernels::LAYERS = fluid.layers();
        Kernels::BEHIND_AXIS = fluid.behindAxis;
        Kernels::BEHIND_ROWS = engine->behindRows();
        Kernels::MAX_CUTOFF = engine->reach();
        Kernels::PERIODIC = fluid.periodic;
        Kernels::LUCY = engine->lucy();
        Kernels::SHEARED = engine->sheared();
        Kernels::CARRIES = fluid.carries;
        Kernels::CARRYING_ROWS = fluid.carryingRows();
        Kernels::LAMMPS = fluid.lammps;
        Kernels::ENERGIES = !fluid.states.empty();
        device->take();
    }
    ContextImpl& context;
    unique_ptr<Device> device;
    unique_ptr<Engine > engine;
};

class ReferenceFactory : public KernelFactory {
public:
    KernelImpl* createKernelImpl(string name, const Platform& platform, ContextImpl& context) const override {
        return new ReferenceDPDDeviceKernel(name, platform, context);
    }
};

}

extern "C" DPD_EXPORT void registerPlatforms() {}
extern "C" DPD_EXPORT void registerKernelFactories() {
    for (int k = 0; k < Platform::getNumPlatforms(); k++)
        if (dynamic_cast<ReferencePlatform*>(&Platform::getPlatform(k)) != nullptr)
            Platform::getPlatform(k).registerKernelFactory(DPDDevice::DPDDeviceKernel::Name(), new DPDDevice::ReferenceFactory());
}
