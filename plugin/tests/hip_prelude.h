// What HIP and OpenMM's HIP platform define before a kernel, as far as kernels.cc names it: enough to compile it by clang alone.  Where HIP has a
// library function in double precision that clang does not know, single precision stands for it: nothing of this is ever run.
#define __device__ __attribute__((device))
#define KERNEL extern "C" __attribute__((global))
#define DEVICE __device__
#define BOUNDS __attribute__((amdgpu_flat_work_group_size(1, BLOCK)))
#define GLOBAL
#define LOCAL __attribute__((shared))
#define LOCAL_ARG
#define RESTRICT __restrict__
#define GLOBAL_ID (int) (__builtin_amdgcn_workgroup_id_x()*__builtin_amdgcn_workgroup_size_x()+__builtin_amdgcn_workitem_id_x())
#define LOCAL_ID (int) __builtin_amdgcn_workitem_id_x()
#define GROUP_ID (int) __builtin_amdgcn_workgroup_id_x()
#define NUM_GROUPS (int) (__builtin_amdgcn_grid_size_x()/__builtin_amdgcn_workgroup_size_x())
#define SYNC_THREADS __builtin_amdgcn_s_barrier();
#define GLOBAL_SIZE (int) __builtin_amdgcn_grid_size_x()
#define ATOMIC_ADD(at, value) __hip_atomic_fetch_add(at, value, __ATOMIC_RELAXED, __HIP_MEMORY_SCOPE_AGENT)
#define ATOMIC_OR(at, value) __hip_atomic_fetch_or(at, value, __ATOMIC_RELAXED, __HIP_MEMORY_SCOPE_AGENT)
#define ATOMIC_MAX(at, value) __hip_atomic_fetch_max(at, value, __ATOMIC_RELAXED, __HIP_MEMORY_SCOPE_AGENT)

#define FIRST_BIT(x) (__builtin_ffs(x)-1)
#define BITS_OF(x) __builtin_popcount(x)

typedef long long mm_long;
typedef unsigned long long mm_ulong;
template <class T> struct Three { T x, y, z; };
template <class T> struct alignas(4*sizeof(T)) Four { T x, y, z, w; };
#ifdef USE_DOUBLE_PRECISION
typedef double real;
#else
typedef float real;
#endif
#if defined(USE_DOUBLE_PRECISION) || defined(USE_MIXED_PRECISION)
typedef double mixed;
#else
typedef float mixed;
#endif
typedef Three<real> real3;
typedef Four<real> real4;
typedef Three<mixed> mixed3;
typedef Four<mixed> mixed4;
__device__ inline real3 make_real3(real x, real y, real z) { return {x, y, z}; }
__device__ inline real4 make_real4(real x, real y, real z, real w) { return {x, y, z, w}; }
__device__ inline mixed3 make_mixed3(mixed x, mixed y, mixed z) { return {x, y, z}; }
__device__ inline mixed4 make_mixed4(mixed x, mixed y, mixed z, mixed w) { return {x, y, z, w}; }

__device__ inline float floor(float x) { return __builtin_floorf(x); }
__device__ inline double floor(double x) { return __builtin_floor(x); }
__device__ inline float rint(float x) { return __builtin_rintf(x); }
__device__ inline double rint(double x) { return __builtin_rint(x); }
__device__ inline float fabs(float x) { return __builtin_fabsf(x); }
__device__ inline double fabs(double x) { return __builtin_fabs(x); }
__device__ inline int min(int x, int y) { return x < y ? x : y; }
__device__ inline int max(int x, int y) { return x > y ? x : y; }
__device__ inline float max(float x, float y) { return __builtin_fmaxf(x, y); }
__device__ inline double max(double x, double y) { return __builtin_fmax(x, y); }
#ifdef USE_DOUBLE_PRECISION
#define SQRT(x) __builtin_sqrt(x)
#else
#define SQRT(x) __builtin_sqrtf(x)
#endif
#define RSQRT(x) (1/SQRT(x))
#define LOG(x) (real) __builtin_logf((float) (x))
#define POW(x, y) (real) __builtin_powf((float) (x), (float) (y))
// of the precision of float alone: they stand for calls that take other registers
__device__ inline mixed exp(mixed x) { return (mixed) __builtin_expf((float) x); }
__device__ inline mixed log(mixed x) { return (mixed) __builtin_logf((float) x); }
__device__ inline mixed pow(mixed x, mixed y) { return (mixed) __builtin_powf((float) x, (float) y); }
__device__ inline mixed expm1(mixed x) { return exp(x)-1; }
__device__ inline mixed log1p(mixed x) { return log(1+x); }
__device__ inline mixed cbrt(mixed x) { return pow(x, (mixed) 1/3); }
__device__ inline float sqrt(float x) { return __builtin_sqrtf(x); }
__device__ inline double sqrt(double x) { return __builtin_sqrt(x); }
__device__ inline float min(float x, float y) { return __builtin_fminf(x, y); }
__device__ inline double min(double x, double y) { return __builtin_fmin(x, y); }
__device__ inline mm_long realToFixedPoint(real x) { return (mm_long) (x*0x100000000); }
