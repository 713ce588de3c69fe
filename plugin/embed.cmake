# The files with kernels as strings of C++
set(all "")
foreach(file ${FROM})
  file(READ ${file} text)
  string(APPEND all "R\"KERNEL(${text})KERNEL\",\n")
endforeach()
file(WRITE ${TO} "#pragma once\n#include <string>\nstatic const std::string kernelSources[] = {${all}};\n")
