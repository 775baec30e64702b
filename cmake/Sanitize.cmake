# SPDX-License-Identifier: Apache-2.0
# Builds for finding bugs (presets asan and tsan): Clang's sanitizers over all code of ours. Lean, because it is built
# beside the release: little optimisation, line tables only, and of Highway's targets one fast and the plain one.
set(MIXSTAGE_SANITIZE "" CACHE STRING "address (with undefined and fuzzers) or thread; empty = none")
if(NOT MIXSTAGE_SANITIZE)
  return()
endif()
if(NOT CMAKE_CXX_COMPILER_ID STREQUAL "Clang")
  message(FATAL_ERROR "MIXSTAGE_SANITIZE needs Clang: cmake --preset asan, or tsan")
endif()
set(CMAKE_BUILD_TYPE Sanitize)
# Folders whose time goes into templates of Asio and JSON, not into pictures, and the tests: optimising them makes Clang
# slow and nothing fast.
set(MIXSTAGE_UNOPTIMISED server/delivery server/app viewer_client/native tests)
# Every other test calls it pixel by pixel, and at -O1 Clang leaves each of Eigen's operators a call.
set(MIXSTAGE_OPTIMISED proto/geometry)
# Draw what other tests look at, ray by ray, and no byte of it is a stranger's.
set(MIXSTAGE_UNCHECKED proto/synthetic tests/support)
add_compile_options(-O1 -gline-tables-only -fno-omit-frame-pointer)
add_compile_definitions("HWY_DISABLED_TARGETS=(HWY_AVX3_DL|HWY_AVX3|HWY_SSE4|HWY_SSSE3)")
if(MIXSTAGE_SANITIZE STREQUAL "address")
  set(sanitizers -fsanitize=address,undefined -fno-sanitize-recover=undefined)
  add_compile_options(-fsanitize=fuzzer-no-link) # so that the fuzzers see which branches are taken
  add_compile_definitions(_GLIBCXX_ASSERTIONS)
  # Checks around every vector operation take Clang minutes; the scalar twins have them all.
  set(MIXSTAGE_KERNEL_OPTIONS -fno-sanitize=undefined -fno-sanitize=fuzzer-no-link)
else()
  set(sanitizers -fsanitize=thread)
endif()
add_compile_options(${sanitizers})
add_link_options(${sanitizers})
