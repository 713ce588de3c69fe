#include "CommonDPDDevice.h"
#include "KernelSource.h"
#include "openmm/common/ComputeForceInfo.h"
#include "openmm/common/ContextSelector.h"

using namespace DPDDevice;
using namespace OpenMM;
using namespace std;

void CommonDevice::make(Array& array, Kind kind, size_t size) {
    bool wideReal = cc.getUseDoublePrecision();
    int each = kind == Kind::Int ? 4 : kind == Kind::Long ? 8 : kind == Kind::Real ? (wideReal ? 8 : 4) : kind == Kind::Real4 ? (wideReal ? 32 : 16) : wide ? 32 : 16;
    long long more = (long long) size*each;
    if (array.isInitialized()) {
        more -= (long long) array.getSize()*each;
        array.resize(size);
    }
    else
        array.initialize(cc, size, each, "dpd");
    bytes += more;
    bytesOfArrays += more;
}

void CommonDevice::upload(Array& array, Kind, const vector<double>& values) {
    if (cc.getUseDoublePrecision())
        array.upload(values);
    else
        array.upload(vector<float>(values.begin(), values.end()));
}

void CommonDevice::upload4(Array& array, Kind kind, const vector<std::array<double, 4> >& values) {
    if (kind == Kind::Mixed4 ? wide : cc.getUseDoublePrecision()) {
        vector<mm_double4> numbers;
        for (auto& v : values)
            numbers.push_back(mm_double4(v[0], v[1], v[2], v[3]));
        array.upload(numbers);
    }
    else {
        vector<mm_float4> numbers;
        for (auto& v : values)
            numbers.push_back(mm_float4((float) v[0], (float) v[1], (float) v[2], (float) v[3]));
        array.upload(numbers);
    }
}

// OpenMM may give beads of one type another order
class CommonDPDDeviceKernel::ForceInfo : public ComputeForceInfo {
public:
    ForceInfo(const vector<int>& types) : types(types) {}
    bool areParticlesIdentical(int a, int b) override { return types[a] == types[b]; }
private:
    vector<int> types;
};

void CommonDPDDeviceKernel::initialize(const System& system, const DPDDeviceForce& force) {
    if (cc.getNumContexts() > 1)
        throw OpenMMException("DPDDeviceForce works on one device only");
    ContextSelector selector(cc);
    engine.reset(new Engine<CommonDevice>(device, force.fluid, system));
    Vec3 a, b, c;
    system.getDefaultPeriodicBoxVectors(a, b, c);
    triclinic = b[0] != 0 || c[0] != 0 || c[1] != 0; // OpenMM lets no box become triclinic later
    cc.addForce(new ForceInfo(force.fluid.types));
}

void CommonDPDDeviceKernel::compile() {
    if (device.program)
        return;
    map<string, string> defines = engine->defines(triclinic);
    defines.insert(names.begin(), names.end());
    defines["NUM_ATOMS"] = cc.intToString(cc.getNumAtoms());
    defines["STRIDE"] = cc.intToString(cc.getPaddedNumAtoms());
    defines["LANES"] = cc.intToString(device.lanes);
    defines["BLOCK"] = cc.intToString(device.block(true));
    defines["MAX_CUTOFF"] = cc.doubleToString(engine->reach());
    device.program = cc.compileProgram(kernelSource, defines);
}

double CommonDPDDeviceKernel::execute(ContextImpl& context, bool includeForces, bool includeEnergy) {
    ContextSelector selector(cc);
    compile();
    return engine->execute(context, includeForces, includeEnergy);
}

void CommonDPDDeviceKernel::step(ContextImpl& context, int others) {
    ContextSelector selector(cc);
    compile();
    engine->step(context, others);
}
