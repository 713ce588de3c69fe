# The kernels as a string of C++
file(READ ${FROM} text)
file(WRITE ${TO} "#pragma once\n#include <string>\nstatic const std::string kernelSource = R\"KERNEL(${text})KERNEL\";\n")
