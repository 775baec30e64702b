# SPDX-License-Identifier: Apache-2.0
# Debian 12 packages (deploy/packages.txt); what each is for stands in the README.
find_package(PkgConfig REQUIRED)
find_package(Threads REQUIRED)
find_package(Eigen3 REQUIRED NO_MODULE)
find_package(OpenCV 4.6 REQUIRED COMPONENTS core imgproc imgcodecs calib3d)
find_package(Ceres 2.1 REQUIRED)
find_package(meshoptimizer REQUIRED)
find_package(spdlog REQUIRED)
find_package(tl-expected REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(CLI11 REQUIRED)
find_package(yaml-cpp REQUIRED)
find_package(TinyGLTF REQUIRED)
find_package(tinyobjloader REQUIRED)
find_package(prometheus-cpp CONFIG REQUIRED)
find_package(draco CONFIG REQUIRED)
# Debian's libdraco carries a tinygltf of another version and exports it: of the two the first in the link is called.
# As a dependency of the real one it always comes behind.
target_link_libraries(TinyGLTF::TinyGLTF INTERFACE draco::draco)
find_package(Boost 1.74 REQUIRED)
find_package(OpenSSL 3.0 REQUIRED)
find_package(SDL2 REQUIRED)
find_package(Bullet REQUIRED)
pkg_check_modules(lcm REQUIRED IMPORTED_TARGET lcm) # 1.3.1 ships no CMake package
pkg_check_modules(libav REQUIRED IMPORTED_TARGET libavcodec libavutil)
pkg_check_modules(egl REQUIRED IMPORTED_TARGET egl)
find_program(LCM_GEN lcm-gen REQUIRED)

# Headers of third parties are system headers: their warnings are not ours.
add_library(mixstage_deps_base INTERFACE)
add_library(mixstage::deps_base ALIAS mixstage_deps_base)
target_include_directories(mixstage_deps_base SYSTEM INTERFACE ${OpenCV_INCLUDE_DIRS})
target_link_libraries(mixstage_deps_base INTERFACE opencv_core opencv_imgproc opencv_imgcodecs spdlog::spdlog
                      tl::expected Threads::Threads)
# Eigen may not assume wider alignment than the libraries it meets were built with.
target_compile_definitions(mixstage_deps_base INTERFACE EIGEN_MAX_ALIGN_BYTES=16 EIGEN_MAX_STATIC_ALIGN_BYTES=16
                           MIXSTAGE_VERSION="${PROJECT_VERSION}")

# Bullet's package names no targets, and paths relative to its root.
add_library(mixstage_bullet INTERFACE)
add_library(mixstage::bullet ALIAS mixstage_bullet)
target_include_directories(mixstage_bullet SYSTEM INTERFACE ${BULLET_ROOT_DIR}/${BULLET_INCLUDE_DIRS})
target_link_directories(mixstage_bullet INTERFACE ${BULLET_ROOT_DIR}/${BULLET_LIBRARY_DIRS})
target_link_libraries(mixstage_bullet INTERFACE BulletDynamics BulletCollision LinearMath)
