# The kernels as a string of C++, in pieces, since compilers limit their length
set(all "")
foreach(file ${FROM})
  file(READ ${file} text)
  string(APPEND all "R\"KERNEL(${text})KERNEL\"\n")
endforeach()
file(WRITE ${TO} "#pragma once\n#include <string>\nstatic const std::string kernelSource = ${all};\n")
