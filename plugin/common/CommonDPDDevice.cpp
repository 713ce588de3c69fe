#include "CommonDPDDevice.h"
#include "KernelSource.h"
#include "openmm/common/ComputeForceInfo.h"

using namespace DPDDevice;
using namespace OpenMM;
using namespace std;

void Device::make(Array& array, Kind kind, size_t size) {
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

// OpenMM may give beads of one type another order
class CommonDPDDeviceKernel::ForceInfo : public ComputeForceInfo {
public:
    ForceInfo(const vector<int>& types) : types(types) {}
    bool areParticlesIdentical(int a, int b) override { return types[a] == types[b]; }
private:
    vector<int> types;
};

// Checkpoints are loaded without any other word
class CommonDPDDeviceKernel::Listener : public ComputeContext::ReorderListener {
public:
    Listener(Device& device) : device(device) {}
    void execute() override { device.forget(); }
private:
    Device& device;
};

// g++ 12 believes from -O2 on that a double and its float are the same where it computes with several at once
static double single(double x) {
    volatile float rounded = (float) x;
    return rounded;
}

// Molecules farther away from the box than this go back into it by whole boxes, and States read as before: as OpenMM moves them when it gives beads
// another order, which it only does beside Forces with a cutoff.
bool Device::wrap(const vector<vector<int> >& molecules, double far) {
    vector<mm_double4> x, rest;
    posq().download(x, true);
    if (mixed())
        correction().download(rest, true);
    vector<int> place(beads());
    for (int k = 0; k < beads(); k++)
        place[cc.getAtomIndex()[k]] = k;
    Vec3 box[3];
    cc.getPeriodicBoxVectors(box[0], box[1], box[2]);
    auto at = [&](int bead) {
        mm_double4 a = x[place[bead]], b = mixed() ? rest[place[bead]] : mm_double4(0, 0, 0, 0);
        return Vec3(a.x+b.x, a.y+b.y, a.z+b.z);
    };
    bool moves = false;
    for (auto& molecule : molecules) {
        Vec3 start = at(molecule[0]), shift;
        mm_int4 cells(0, 0, 0, 0);
        int* count[3] = {&cells.x, &cells.y, &cells.z};
        for (int k = 2; k >= 0; k--) {
            *count[k] = (int) floor((start[k]-shift[k])/box[k][k]);
            shift += box[k]*(*count[k]);
        }
        if (!(max({fabs(shift[0]), fabs(shift[1]), fabs(shift[2])}) > far))
            continue;
        moves = true;
        for (int bead : molecule) {
            Vec3 y = at(bead)-shift;
            x[place[bead]] = mm_double4(y[0], y[1], y[2], x[place[bead]].w);
            if (mixed())
                rest[place[bead]] = mm_double4(y[0]-single(y[0]), y[1]-single(y[1]), y[2]-single(y[2]), 0);
            mm_int4& offset = cc.getPosCellOffsets()[place[bead]];
            offset = mm_int4(offset.x-cells.x, offset.y-cells.y, offset.z-cells.z, 0);
        }
    }
    if (moves) {
        posq().upload(x, true);
        if (mixed())
            correction().upload(rest, true);
    }
    return moves;
}

void CommonDPDDeviceKernel::initialize(const System& system, const DPDDeviceForce& force) {
    if (cc.getNumContexts() > 1)
        throw OpenMMException("DPDDeviceForce works on one device only");
    ContextSelector selector(cc);
    if (force.fluid.carries != NOTHING && force.fluid.word.size() > 1 && !cc.getUseMixedPrecision() && !cc.getUseDoublePrecision())
        throw OpenMMException("DPDDeviceForce: pair updates of what particles carry need mixed or double precision, or the energy would grow by rounding");
    if (!force.fluid.shear.empty() && !cc.getUseDoublePrecision() && (!cc.getUseMixedPrecision() || system.getNumForces() > 1))
        throw OpenMMException("DPDDeviceForce: a shear needs mixed precision, and double precision beside Forces of OpenMM, for beads never go back into the box");
    engine.reset(new Engine(device, force.fluid, system));
    Vec3 a, b, c;
    system.getDefaultPeriodicBoxVectors(a, b, c);
    triclinic = b[0] != 0 || c[0] != 0 || c[1] != 0; // OpenMM lets no box become triclinic later
    cc.addForce(new ForceInfo(force.fluid.types));
    cc.addReorderListener(new Listener(device));
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
    string source = kernelSources[0]+kernelSources[1];
    if (engine->fluid.carries != NOTHING) // these take time to compile
        source += kernelSources[2]+(engine->fluid.word.size() > 1 ? kernelSources[3] : "");
    device.program = cc.compileProgram(source, defines);
}
