/* Counts what OpenMM asks of OpenCL; to be preloaded.  Types are as wide as those of OpenCL's headers, which are not needed. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stddef.h>
typedef unsigned int uint;
long counts[3]; /* launches, blocking transfers, waits */
#define REAL(name, ...) int (*real)(__VA_ARGS__) = (int (*)(__VA_ARGS__)) dlsym(dlopen("libOpenCL.so.1", RTLD_NOW), #name)
int clEnqueueNDRangeKernel(void* q, void* k, uint d, const size_t* o, const size_t* g, const size_t* l, uint n, void* w, void* e) {
    REAL(clEnqueueNDRangeKernel, void*, void*, uint, const size_t*, const size_t*, const size_t*, uint, void*, void*);
    counts[0]++;
    return real(q, k, d, o, g, l, n, w, e);
}
int clEnqueueReadBuffer(void* q, void* b, uint blocking, size_t o, size_t s, void* p, uint n, void* w, void* e) {
    REAL(clEnqueueReadBuffer, void*, void*, uint, size_t, size_t, void*, uint, void*, void*);
    counts[1] += blocking != 0;
    return real(q, b, blocking, o, s, p, n, w, e);
}
int clEnqueueWriteBuffer(void* q, void* b, uint blocking, size_t o, size_t s, const void* p, uint n, void* w, void* e) {
    REAL(clEnqueueWriteBuffer, void*, void*, uint, size_t, size_t, const void*, uint, void*, void*);
    counts[1] += blocking != 0;
    return real(q, b, blocking, o, s, p, n, w, e);
}
int clWaitForEvents(uint n, void* e) {
    REAL(clWaitForEvents, uint, void*);
    counts[2]++;
    return real(n, e);
}
int clFinish(void* q) {
    REAL(clFinish, void*);
    counts[2]++;
    return real(q);
}
