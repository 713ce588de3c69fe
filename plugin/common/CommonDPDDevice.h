#ifndef COMMON_DPD_DEVICE_H_
#define COMMON_DPD_DEVICE_H_
// The platforms with OpenMM's common compute interface: OpenCL, CUDA and HIP.
#include "../api/DPDDeviceForce.h"
#include "../engine/Launch.h"
#include "openmm/KernelFactory.h"
#include "openmm/common/ComputeArray.h"
#include "openmm/common/ComputeContext.h"
#include "openmm/common/ContextSelector.h"
#include <cstdlib>
#include <memory>

namespace DPDDevice {

class Device {
public:
    using Base = OpenMM::ArrayInterface;
    using Array = OpenMM::ComputeArray;
    static constexpr bool everything = false; // the kernels are compiled for one scene

    Device(OpenMM::ComputeContext& cc) : lanes(lanesOf(cc)), cc(cc), wide(cc.getUseDoublePrecision() || cc.getUseMixedPrecision()) {}
    ~Device() { bytesOfArrays -= bytes; }
    int beads() const { return cc.getNumAtoms(); }
    int padded() const { return cc.getPaddedNumAtoms(); }
    void box(OpenMM::Vec3& a, OpenMM::Vec3& b, OpenMM::Vec3& c) const { cc.getPeriodicBoxVectors(a, b, c); }
    void slide(double tilt) { // of the second box vector along the first
        OpenMM::Vec3 a, b, c;
        box(a, b, c);
        cc.setPeriodicBoxVectors(a, OpenMM::Vec3(tilt, b[1], b[2]), c);
    }
    Base& posq() { return cc.getPosq(); }
    bool mixed() const { return cc.getUseMixedPrecision(); }
    Base& correction() { return cc.getUseMixedPrecision() ? cc.getPosqCorrection() : cc.getPosq(); }
    Base& velm() { return cc.getVelm(); }
    Base& index() { return cc.getAtomIndexArray(); }
    Base& force() { return cc.getLongForceBuffer(); }
    Base& energy() { return cc.getEnergyBuffer(); }
    double result(bool, bool) { return 0.0; } // OpenMM adds up its buffers by itself
    void give() {}
    // Whether somebody may have moved beads since the last step: forces were evaluated, or it was not OpenMM's count of steps alone that went on
    bool touched() { return std::make_tuple(cc.getComputeForceCount(), cc.getStepCount(), cc.getStepsSinceReorder()) != expected; }
    void forget() { expected = std::make_tuple(-1, -1LL, -1); }
    void note() { expected = std::make_tuple(cc.getComputeForceCount(), cc.getStepCount()+1, cc.getStepsSinceReorder()+1); }
    void beforeOthers() { stepsBefore = cc.getStepsSinceReorder(); }
    bool afterOthers() { return stepsBefore > 0 && cc.getStepsSinceReorder() == stepsBefore; } // whether beads have the order they had

    bool wrap(const std::vector<std::vector<int> >& molecules, double far);
    void copy(Base& from, Array& to) { from.copyTo(to); }
    void make(Array& array, Kind kind, size_t size);
    void clear(Array& array) { cc.clearBuffer(array); }
    template <class T> void fill(Array& array, Kind kind, const std::vector<T>& values) {
        make(array, kind, values.size());
        upload(array, values);
    }
    template <class T> void upload(Array& array, const std::vector<T>& values) { array.upload(values, true); } // doubles rounded, where the array has floats
    template <class T> void download(Array& array, std::vector<T>& values) { array.download(values); }

    template <class Tag, class... T> void run(T&&... arguments) {
        OpenMM::ComputeKernel& kernel = kernels[Tag::text];
        auto all = std::tuple_cat(flat(std::forward<T>(arguments))...);
        if (!kernel) {
            kernel = program->createKernel(Tag::text);
            for (size_t k = 0; k < std::tuple_size<decltype(all)>::value; k++)
                kernel->addArg();
        }
        int at = 0;
        std::apply([&](auto&&... values) { (set(*kernel, at++, values), ...); }, all);
        // whole blocks are started, as many as run at once for all their registers, and each thread of dpdEvaluate has a place in OpenMM's buffer
        const int size = block(Tag::shared), places = cc.getEnergyBuffer().getSize()/size*size;
        long long threads = (long long) beads()*(Tag::shared ? lanes : 1)*5/4; // blocks are not quite full of beads
        if (Tag::shared && lanes > 1)
            threads = std::min(threads, (long long) cc.getNumThreadBlocks()*std::min(6, std::max(1, kernel->getMaxBlockSize()/size))/6*size);
        kernel->execute((int) std::min(threads, (long long) (std::is_same<Tag, dpdEvaluate_>::value ? places : 1<<30)), size);
    }

    // Threads of a block: OpenMM starts at most six of them per multiprocessor, of 64 threads unless told otherwise: too few for many beads
    int block(bool shared) const {
        bool together = shared && lanes > 1, few = together ? runAtOnce(cc, lanes) : beads() < 65536;
        return std::min(!few ? 256 : together ? 128 : 64, cc.getMaxThreadBlockSize());
    }

    // Consecutive cells of a block: beads of a few more than it has at a time are rare.
    int share(double beadsOfCell) const { return lanes == 1 ? 1 : std::min(std::max(1, (int) (0.9*block(true)/lanes/beadsOfCell)), block(true)/9); }

    OpenMM::ComputeProgram program;
    const int lanes;

private:
    // Threads that share a bead: as many as run at once, 4 to 16 of them.  Tests on a CPU ask for what GPUs do.
    static int lanesOf(OpenMM::ComputeContext& cc) {
        if (const char* asked = std::getenv("OPENMM_DPD_DEVICE_LANES")) {
            int lanes = std::atoi(asked);
            if (lanes < 1 || 32%lanes != 0)
                throw OpenMM::OpenMMException("OPENMM_DPD_DEVICE_LANES has to be 1, 2, 4, 8, 16 or 32");
            return lanes;
        }
        int lanes = cc.getIsCPU() ? 1 : 16;
        while (lanes > 4 && !runAtOnce(cc, lanes))
            lanes /= 2;
        return lanes;
    }
    static bool runAtOnce(OpenMM::ComputeContext& cc, int lanes) { return (long long) cc.getNumAtoms()*lanes <= 128*cc.getNumThreadBlocks(); }

    void set(OpenMM::ComputeKernelImpl& kernel, int at, Base& array) { kernel.setArg(at, array); }
    void set(OpenMM::ComputeKernelImpl& kernel, int at, int value) { kernel.setArg(at, value); }
    void set(OpenMM::ComputeKernelImpl& kernel, int at, long long value) { kernel.setArg(at, value); }
    void set(OpenMM::ComputeKernelImpl& kernel, int at, Mixed value) { number(kernel, at, value.value, wide); }
    void set(OpenMM::ComputeKernelImpl& kernel, int at, Real value) { number(kernel, at, value.value, cc.getUseDoublePrecision()); }
    void set(OpenMM::ComputeKernelImpl& kernel, int at, Mixed4 v) {
        if (wide)
            kernel.setArg(at, OpenMM::mm_double4(v.x, v.y, v.z, v.w));
        else
            kernel.setArg(at, OpenMM::mm_float4((float) v.x, (float) v.y, (float) v.z, (float) v.w));
    }
    void number(OpenMM::ComputeKernelImpl& kernel, int at, double value, bool asDouble) {
        if (asDouble)
            kernel.setArg(at, value);
        else
            kernel.setArg(at, (float) value);
    }

    OpenMM::ComputeContext& cc;
    const bool wide;
    int stepsBefore = 0;
    long long bytes = 0; // of arrays
    std::tuple<int, long long, int> expected; // counts of OpenMM at the next step
    std::map<std::string, OpenMM::ComputeKernel> kernels;
};

}
#include "../engine/Engine.h" // of this Device
namespace DPDDevice {

class CommonDPDDeviceKernel : public DPDDeviceKernel {
public:
    // names: what OR and MAX of an int are called on this platform, and how its compiler is told how large blocks are, if it asks
    CommonDPDDeviceKernel(std::string name, const OpenMM::Platform& platform, OpenMM::ComputeContext& cc, std::map<std::string, std::string> names) :
        DPDDeviceKernel(name, platform), cc(cc), device(cc), names(names) {}
    void initialize(const OpenMM::System& system, const DPDDeviceForce& force) override;
    double execute(OpenMM::ContextImpl& context, bool includeForces, bool includeEnergy) override {
        return here([&] { return engine->execute(context, includeForces, includeEnergy); });
    }
    bool wrap(OpenMM::ContextImpl& context) override { return here([&] { return engine->wrap(context); }); }
    void step(OpenMM::ContextImpl& context, int others) override { here([&] { engine->step(context, others); }); }
    void update(const Fluid& fluid) override { here([&] { engine->update(fluid); }); }
private:
    template <class T> auto here(T&& what) -> decltype(what()) {
        OpenMM::ContextSelector selector(cc);
        compile();
        return what();
    }
    class ForceInfo;
    class Listener;
    void compile();
    OpenMM::ComputeContext& cc;
    Device device;
    std::map<std::string, std::string> names;
    std::unique_ptr<Engine> engine;
    bool triclinic = false;
};

// A factory for a platform's Contexts
template <class PlatformData> class CommonFactory : public OpenMM::KernelFactory {
public:
    CommonFactory(std::map<std::string, std::string> names) : names(names) {}
    OpenMM::KernelImpl* createKernelImpl(std::string name, const OpenMM::Platform& platform, OpenMM::ContextImpl& context) const override {
        auto& data = *static_cast<PlatformData*>(context.getPlatformData());
        return new CommonDPDDeviceKernel(name, platform, *data.contexts[0], names);
    }
private:
    std::map<std::string, std::string> names;
};

template <class PlatformData> void registerFactory(const std::string& platform, std::map<std::string, std::string> names) {
    for (int k = 0; k < OpenMM::Platform::getNumPlatforms(); k++)
        if (OpenMM::Platform::getPlatform(k).getName() == platform)
            OpenMM::Platform::getPlatform(k).registerKernelFactory(DPDDeviceKernel::Name(), new CommonFactory<PlatformData>(names));
}

}
#endif
