#include "../common/CommonDPDDevice.h"
#include "openmm/cuda/CudaContext.h"
#include "openmm/cuda/CudaPlatform.h"

extern "C" DPD_EXPORT void registerPlatforms() {}
extern "C" DPD_EXPORT void registerKernelFactories() {
    DPDDevice::registerFactory<OpenMM::CudaPlatform::PlatformData>("CUDA", {{"ATOMIC_OR", "atomicOr"}, {"ATOMIC_MAX", "atomicMax"}, {"FIRST_BIT(x)", "(__ffs(x)-1)"}, {"BITS_OF", "__popc"}});
}
