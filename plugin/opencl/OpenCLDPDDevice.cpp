#include "../common/CommonDPDDevice.h"
#include "openmm/opencl/OpenCLContext.h"
#include "openmm/opencl/OpenCLPlatform.h"

extern "C" DPD_EXPORT void registerPlatforms() {}
extern "C" DPD_EXPORT void registerKernelFactories() {
    DPDDevice::registerFactory<OpenMM::OpenCLPlatform::PlatformData>("OpenCL", {{"ATOMIC_OR", "atomic_or"}, {"ATOMIC_MAX", "atomic_max"}, {"FIRST_BIT(x)", "(31-clz((x)&-(x)))"}, {"BITS_OF", "popcount"},
        {"BOUNDS", "__attribute__((reqd_work_group_size(BLOCK, 1, 1)))"}, {"INLINED", "__attribute__((always_inline))"}});
}
