#include "../common/CommonDPDDevice.h"
#include "openmm/hip/HipContext.h"
#include "openmm/hip/HipPlatform.h"

extern "C" DPD_EXPORT void registerPlatforms() {}
extern "C" DPD_EXPORT void registerKernelFactories() {
    DPDDevice::registerFactory<OpenMM::HipPlatform::PlatformData>("HIP", {{"ATOMIC_OR", "atomicOr"}, {"ATOMIC_MAX", "atomicMax"}, {"FIRST_BIT(x)", "(__ffs(x)-1)"}, {"BITS_OF", "__popc"}, {"BOUNDS", "__launch_bounds__(BLOCK)"}});
}
