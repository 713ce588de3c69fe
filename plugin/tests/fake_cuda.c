/* A libcuda.so.1 without a GPU: memory is malloc, kernels do nothing.  NVRTC compiles for real, and each launch is checked against the PTX: the
   kernel is there, and has as many parameters as values were given.  FAKE_SM=90 is the architecture, FAKE_DUMP a folder for the PTX. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
typedef int R; typedef unsigned long long P;
typedef struct { char name[128]; int params; long launches; int smem; } Fn;
typedef struct { char* ptx; } Mod;
long fake_counts[8]; /* launches, sync copies, async DtoH, async HtoD, event syncs, stream syncs, modules, errors */
static int sm(void) { const char* s = getenv("FAKE_SM"); return s ? atoi(s) : 80; }
R cuInit(unsigned f) { return 0; }
R cuDriverGetVersion(int* v) { *v = getenv("FAKE_VERSION") ? atoi(getenv("FAKE_VERSION")) : 12090; return 0; }
R cuDeviceGetCount(int* n) { *n = 1; return 0; }
R cuDeviceGet(int* d, int i) { *d = i; return 0; }
R cuDeviceGetName(char* s, int n, int d) { snprintf(s, n, "fake sm_%d", sm()); return 0; }
R cuDeviceGetAttribute(int* v, int a, int d) {
    switch (a) {
        case 75: *v = sm()/10; break; case 76: *v = sm()%10; break;
        case 16: *v = 132; break; case 39: *v = 2048; break; case 1: *v = 1024; break;
        case 2: case 3: *v = 1024; break; case 4: *v = 64; break; case 8: *v = 49152; break; case 81: *v = 233472; break; case 10: *v = 32; break; default: *v = 1; }
    return 0; }
R cuDeviceCanAccessPeer(int* v, int a, int b) { *v = 0; return 0; }
static void* stack[64]; static int top;
R cuCtxCreate_v2(void** c, unsigned f, int d) { *c = malloc(8); stack[++top] = *c; return 0; }
R cuCtxCreate_v4(void** c, void* p, unsigned f, int d) { return cuCtxCreate_v2(c, f, d); } /* CUDA 13 */
R cuCtxDestroy_v2(void* c) { return 0; }
R cuCtxEnablePeerAccess(void* c, unsigned f) { return 0; }
R cuCtxPopCurrent_v2(void** c) { if (c) *c = stack[top]; if (top) top--; return 0; }
R cuCtxPushCurrent_v2(void* c) { stack[++top] = c; return 0; }
R cuCtxSetCacheConfig(int c) { return 0; }
R cuCtxSetCurrent(void* c) { stack[top] = c; return 0; }
R cuCtxSynchronize(void) { return 0; }
R cuEventCreate(void** e, unsigned f) { *e = malloc(8); return 0; }
R cuEventDestroy_v2(void* e) { return 0; }
R cuEventRecord(void* e, void* s) { return 0; }
R cuEventSynchronize(void* e) { fake_counts[4]++; return 0; }
R cuFuncGetAttribute(int* v, int a, void* f) { *v = a == 0 ? 1024 : a == 4 ? 32 : 0; return 0; }
R cuGetErrorName(R e, const char** s) { *s = "FAKE_ERROR"; return 0; }
R cuMemAlloc_v2(P* p, size_t n) { *p = (P) calloc(1, n); return *p ? 0 : 2; }
R cuMemFree_v2(P p) { free((void*) p); return 0; }
R cuMemFreeHost(void* p) { free(p); return 0; }
R cuMemHostAlloc(void** p, size_t n, unsigned f) { *p = calloc(1, n); return 0; }
R cuMemHostGetDevicePointer_v2(P* d, void* p, unsigned f) { *d = (P) p; return 0; }
R cuMemcpyAsync(P d, P s, size_t n, void* q) { memmove((void*) d, (void*) s, n); return 0; }
R cuMemcpyDtoDAsync_v2(P d, P s, size_t n, void* q) { memmove((void*) d, (void*) s, n); return 0; }
R cuMemcpyDtoHAsync_v2(void* d, P s, size_t n, void* q) { fake_counts[2]++; memmove(d, (void*) s, n); return 0; }
R cuMemcpyDtoH_v2(void* d, P s, size_t n) { fake_counts[1]++; memmove(d, (void*) s, n); return 0; }
R cuMemcpyHtoDAsync_v2(P d, const void* s, size_t n, void* q) { fake_counts[3]++; memmove((void*) d, s, n); return 0; }
R cuMemcpyHtoD_v2(P d, const void* s, size_t n) { fake_counts[1]++; memmove((void*) d, s, n); return 0; }
static R load(void** m, const char* text) { Mod* x = malloc(sizeof(Mod)); x->ptx = strdup(text); *m = x; fake_counts[6]++; 
    const char* dump = getenv("FAKE_DUMP"); if (dump) { char name[512]; snprintf(name, 512, "%s/module%ld.ptx", dump, fake_counts[6]); FILE* f = fopen(name, "w"); fputs(text, f); fclose(f); }
    return 0; }
R cuModuleLoadDataEx(void** m, const void* image, unsigned n, void* o, void* v) { return load(m, image); }
R cuModuleLoad(void** m, const char* file) { FILE* f = fopen(file, "r"); if (!f) return 301; char* t = calloc(1, 64<<20); size_t k = fread(t, 1, (64<<20)-1, f); fclose(f); R r = load(m, t); free(t); return r; }
R cuModuleGetFunction(void** f, void* m, const char* name) {
    char entry[200]; snprintf(entry, 200, ".entry %s(", name);
    char* at = strstr(((Mod*) m)->ptx, entry);
    if (!at) { fake_counts[7]++; fprintf(stderr, "fake CUDA: no kernel %s\n", name); return 500; }
    Fn* x = calloc(1, sizeof(Fn)); snprintf(x->name, 128, "%s", name);
    char* end = strchr(at, ')');
    for (char* p = at; (p = strstr(p, ".param")) && p < end; p++) x->params++;
    *f = x; return 0; }
R cuLaunchKernel(void* f, unsigned gx, unsigned gy, unsigned gz, unsigned bx, unsigned by, unsigned bz, unsigned smem, void* s, void** params, void** extra) {
    Fn* x = f; volatile char sink; fake_counts[0]++;
    if (gx == 0 || bx == 0 || bx > 1024 || smem > 49152) { fake_counts[7]++; fprintf(stderr, "fake CUDA: %s: illegal launch %u x %u, %u B\n", x->name, gx, bx, smem); return 1; }
    for (int k = 0; k < x->params; k++) {
        if ((size_t) params[k] < 4096) { fake_counts[7]++; fprintf(stderr, "fake CUDA: %s: parameter %d was not given\n", x->name, k); return 1; }
        sink = *(char*) params[k]; }
    if (getenv("FAKE_LOG")) fprintf(stderr, "launch %s %u x %u, %d parameters\n", x->name, gx, bx, x->params);
    (void) sink; return 0; }
R cuGetExportTable(const void** t, const void* id) { *t = 0; return 500; } /* NVRTC asks */
R cuProfilerStop(void) { return 0; }
R cuStreamCreate(void** s, unsigned f) { *s = malloc(8); return 0; }
R cuStreamDestroy_v2(void* s) { return 0; }
R cuStreamSynchronize(void* s) { fake_counts[5]++; return 0; }
R cuStreamWaitEvent(void* s, void* e, unsigned f) { return 0; }
