// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <memory>

#include "server/gl/gpu.h"

namespace mixstage::test {

// One context for all tests of the binary: making one takes 25 to 50 ms. Null without EGL.
inline std::shared_ptr<gl::Gpu> SharedGpu() {
  static const auto gpu = gl::Gpu::Create();
  return gpu ? *gpu : nullptr;
}

}  // namespace mixstage::test

// First line of a test (or of its SetUp) that draws through EGL.
#define MIXSTAGE_SKIP_WITHOUT_EGL() \
  if (!::mixstage::test::SharedGpu()) GTEST_SKIP() << "no EGL with OpenGL 4.5 on this machine"
