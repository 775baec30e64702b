# SPDX-License-Identifier: Apache-2.0
# The C++ client library as others use it: find_package(MixStageClient), link MixStage::client. One archive of the
# folders it is made of, without what only servers and programs need of them.
include(CMakePackageConfigHelpers)
include(GNUInstallDirs)

add_library(mixstage_client STATIC
  $<TARGET_OBJECTS:mixstage_native> $<TARGET_OBJECTS:mixstage_watch>
  $<FILTER:$<TARGET_OBJECTS:mixstage_codec>,INCLUDE,yuv_image>)
set_target_properties(mixstage_client PROPERTIES LINKER_LANGUAGE CXX EXPORT_NAME client)
target_compile_features(mixstage_client INTERFACE cxx_std_20)
target_include_directories(mixstage_client INTERFACE $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}/mixstage>)
target_link_libraries(mixstage_client INTERFACE opencv_core opencv_imgproc spdlog::spdlog tl::expected PkgConfig::libav
                      OpenSSL::SSL Threads::Threads)

# Every header that viewer_client/native/watch_client.h leads to, and view_measure.h; tests/repo/client_package.sh
# compiles each of them alone.
set(public_headers
  proto/base/check.h proto/base/image_view.h proto/base/result.h
  proto/codec/yuv_image.h
  proto/watch/depth_code.h proto/watch/mesh_message.h proto/watch/picture_message.h proto/watch/scene_message.h
  proto/watch/text_message.h
  viewer_client/native/stream_decoder.h viewer_client/native/video_decoder.h viewer_client/native/view_measure.h
  viewer_client/native/watch_client.h)
foreach(header IN LISTS public_headers)
  get_filename_component(folder ${header} DIRECTORY)
  install(FILES ${header} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/mixstage/${folder} COMPONENT client)
endforeach()

set(package_folder ${CMAKE_INSTALL_LIBDIR}/cmake/MixStageClient)
configure_file(cmake/MixStageClientConfig.cmake.in MixStageClientConfig.cmake @ONLY)
write_basic_package_version_file(MixStageClientConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(TARGETS mixstage_client EXPORT MixStageClient ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT client)
install(EXPORT MixStageClient NAMESPACE MixStage:: FILE MixStageClientTargets.cmake DESTINATION ${package_folder}
        COMPONENT client)
install(FILES ${PROJECT_BINARY_DIR}/MixStageClientConfig.cmake ${PROJECT_BINARY_DIR}/MixStageClientConfigVersion.cmake
        DESTINATION ${package_folder} COMPONENT client)
