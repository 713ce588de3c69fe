/* The functions of libcufft.so.11 that OpenMM names; none is called. */
int cufftDestroy(int p) { return 0; } int cufftExecC2C(int p, void* a, void* b, int d) { return 0; } int cufftExecC2R(int p, void* a, void* b) { return 0; }
int cufftExecD2Z(int p, void* a, void* b) { return 0; } int cufftExecR2C(int p, void* a, void* b) { return 0; } int cufftExecZ2D(int p, void* a, void* b) { return 0; }
int cufftExecZ2Z(int p, void* a, void* b, int d) { return 0; } int cufftPlan3d(int* p, int x, int y, int z, int t) { *p = 1; return 0; } int cufftSetStream(int p, void* s) { return 0; }
