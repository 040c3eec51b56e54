# Has packages of interfaces built in less time: to be given as CMAKE_PROJECT_TOP_LEVEL_INCLUDES.

# Types of the standard packages are for Python alone. A package that asks for all generators, ours, has the messages
# in C++ and their serialization compiled as well. rmw_fastrtps_cpp needs introspection for topics only, and ours
# are services; introspection in C++, and what finds a type support in C++, would be used by nobody here.
function(choose_generators registered)
  set(unused "^rosidl_[a-z_]*_cpp:")
  if(rosidl_default_generators_DIR)
    set(unused "^rosidl_typesupport_(introspection_c|introspection_cpp|cpp):")
  endif()
  list(FILTER registered EXCLUDE REGEX "${unused}")
  set(AMENT_EXTENSIONS_rosidl_generate_idl_interfaces "${registered}" PARENT_SCOPE)
endfunction()

# Each generator looks for Python anew, and starts it for each of a dozen questions: once is enough. What is not
# found here CMake looks for itself.
macro(find_quickly method package)
  if("${package}" STREQUAL "Python3")
    if(NOT Python3_FOUND)
      find_package(Python3 REQUIRED COMPONENTS Interpreter Development.Module NumPy BYPASS_PROVIDER)
    endif()
  elseif("${package}" MATCHES "^rosidl_(generator|typesupport)_")
    find_package("${package}" ${ARGN} BYPASS_PROVIDER)
    choose_generators("${AMENT_EXTENSIONS_rosidl_generate_idl_interfaces}")
  endif()
endmacro()
cmake_language(SET_DEPENDENCY_PROVIDER find_quickly SUPPORTED_METHODS FIND_PACKAGE)

# Each library from one source: most of the time goes into reading headers. Descriptions of types stay apart, whose
# variables have the same names in each.
function(unite)
  get_property(targets DIRECTORY PROPERTY BUILDSYSTEM_TARGETS)
  foreach(target ${targets})
    if(target MATCHES "__rosidl_(typesupport|generator)_")
      set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 0)
      get_target_property(sources ${target} SOURCES)
      list(FILTER sources INCLUDE REGEX "__description\\.c$")
      set_source_files_properties(${sources} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
    endif()
  endforeach()
endfunction()
cmake_language(DEFER CALL unite)
