# Takes the place of VAMP's module of this name, which downloads a package manager and sources with it. Of these:
# nanobind and Eigen are installed from the package index (cmeel-eigen), and pdqsort is Boost's (cmeel-boost).
# nigh and SIMDxorshift are on no package index. `src/nigh` has what RRT-Connect needs of nigh; the sampler that
# needs SIMDxorshift is not measured.
macro(CPMAddPackage source)
  if("${source}" MATCHES "nanobind")
    find_package(nanobind CONFIG REQUIRED)
  endif()
endmacro()
set(nigh_SOURCE_DIR ${PARTS})
set(pdqsort_SOURCE_DIR ${PARTS})
