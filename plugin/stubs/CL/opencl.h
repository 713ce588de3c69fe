// The types that OpenMM's OpenCL headers name, in place of Khronos's: no object of them is made or looked into here.
#pragma once
typedef int cl_int;
typedef unsigned short cl_ushort;
typedef unsigned long cl_ulong;
typedef float cl_float;
#define CL_MEM_READ_WRITE 1
enum { CL_DEVICE_MAX_WORK_GROUP_SIZE, CL_DEVICE_TYPE, CL_DEVICE_TYPE_CPU };
#define CL_HPP_ // OpenMM's copy of opencl.hpp, which needs all of Khronos's headers, is skipped
namespace cl {
struct Handle { void* object; };
class Context : Handle {};
class Device : Handle {
public:
    template <int name> int getInfo() const; // named by inline functions that nobody calls here
};
class Kernel : Handle {};
class Program : Handle {};
class CommandQueue : Handle {};
class Event : Handle {};
class Memory : Handle {};
class Buffer : public Memory {};
}
