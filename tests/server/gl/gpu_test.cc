// SPDX-License-Identifier: Apache-2.0
#include "server/gl/gpu.h"

#include <gtest/gtest.h>

#include <array>
#include <optional>
#include <thread>

#include "server/gl/clip_space.h"
#include "server/gl/framebuffer.h"
#include "server/gl/program.h"
#include "server/gl/read_back.h"
#include "server/gl/texture.h"
#include "server/gl/vertex_array.h"
#include "tests/support/egl_or_skip.h"

namespace mixstage::gl {
namespace {

class GpuTest : public testing::Test {
 protected:
  void SetUp() override { MIXSTAGE_SKIP_WITHOUT_EGL(); }
};

TEST_F(GpuTest, SaysWhatItIs) {
  const RendererInfo& info = test::SharedGpu()->info();
  EXPECT_FALSE(info.renderer.empty());
  EXPECT_FALSE(info.vendor.empty());
  EXPECT_GE(info.max_side_px, 16384);
  if (info.renderer.find("llvmpipe") != std::string::npos) {
    EXPECT_TRUE(info.software);
  }
}

TEST_F(GpuTest, ProgramsThatAreNoneAreRefusedInTheDriversWords) {
  const auto current = test::SharedGpu()->Enter();
  ASSERT_TRUE(current);
  const auto program = Program::Create(*current, "nonsense", {"void main() { gl_Position = teapot; }\n"},
                                       {"void main() {}\n"});
  ASSERT_FALSE(program);
  EXPECT_NE(program.error().message.find("nonsense"), std::string::npos);
  EXPECT_NE(program.error().message.find("teapot"), std::string::npos);
}

TEST_F(GpuTest, PicturesBeyondTheGpusLimitAreRefused) {
  const auto current = test::SharedGpu()->Enter();
  ASSERT_TRUE(current);
  EXPECT_FALSE(Texture::Create(*current, GL_R32F, current->info().max_side_px + 1, 1));
  EXPECT_FALSE(Texture::Create(*current, GL_R32F, 0, 1));
  EXPECT_TRUE(current->Check("after"));
}

// A quarter of the picture, which would be another one if any axis were turned.
TEST_F(GpuTest, RowZeroIsTheUpperRowOnTheWayUpAndBack) {
  const auto current = test::SharedGpu()->Enter();
  ASSERT_TRUE(current);
  const auto program = Program::Create(
      *current, "corner",
      {"uniform mat4 T_clip_pixel;\n"
       "void main() {\n"
       // Pixels -0.5..2.5 across and -0.5..1.5 down, in 2 m: 3 x 2 pixels.
       "  vec2 at = vec2(gl_VertexID % 2 == 0 ? -0.5 : 2.5, gl_VertexID / 2 == 0 ? -0.5 : 1.5);\n"
       "  gl_Position = T_clip_pixel * vec4(at, 0.5, 1.0);\n"
       "}\n"},
      {"layout(location = 0) out float z;\n"
       "void main() { z = gl_FragCoord.z; }\n"});
  ASSERT_TRUE(program) << program.error().message;
  const auto target = Texture::Create(*current, GL_R32F, 8, 6);
  ASSERT_TRUE(target);
  const auto framebuffer = Framebuffer::Create(*current, {&*target}, nullptr);
  ASSERT_TRUE(framebuffer);
  framebuffer->Bind(*current, 8, 6);
  framebuffer->ClearColor(*current, 0, 0.0f);
  UseClipFromPixel(*current);
  (*current)->Disable(GL_DEPTH_TEST);
  (*current)->Disable(GL_CULL_FACE);
  program->Use(*current);
  program->SetMatrix(*current, "T_clip_pixel", ClipFromPixel(8, 6, /*near_m=*/0.1f).data());
  const VertexArray none = VertexArray::Create(*current);
  none.Bind(*current);
  (*current)->DrawArrays(GL_TRIANGLE_STRIP, 0, 4);
  ReadBack read;
  ASSERT_TRUE(read.Start(*current, *framebuffer, 0, {0, 0, 8, 6}, GL_RED, GL_FLOAT, sizeof(float)));
  const auto bytes = read.Wait(*current);
  ASSERT_TRUE(bytes) << bytes.error().message;
  const auto* values = reinterpret_cast<const float*>(bytes->data());
  for (int y = 0; y < 6; ++y) {
    for (int x = 0; x < 8; ++x) {
      // 1/z = 0.5 at near_m = 0.1: half of that again.
      EXPECT_FLOAT_EQ(values[8 * y + x], x < 3 && y < 2 ? 0.025f : 0.0f) << x << "," << y;
    }
  }
}

TEST_F(GpuTest, ObjectsMayBeDroppedAnywhereAndAnyTime) {
  std::optional<Texture> outside, on_a_thread;
  {
    const auto current = test::SharedGpu()->Enter();
    ASSERT_TRUE(current);
    outside.emplace(*Texture::Create(*current, GL_R32F, 4, 4));
    on_a_thread.emplace(*Texture::Create(*current, GL_R32F, 4, 4));
  }
  outside.reset();
  std::thread([&] { on_a_thread.reset(); }).join();
  const auto current = test::SharedGpu()->Enter();
  ASSERT_TRUE(current);
  EXPECT_TRUE(current->Check("after"));
}

TEST_F(GpuTest, AThreadMayEnterWhatAnotherHasLeft) {
  auto gpu = *Gpu::Create();
  EXPECT_TRUE(gpu->Enter());
  std::thread([&] { EXPECT_TRUE(gpu->Enter()); }).join();
  EXPECT_TRUE(gpu->Enter());
  EXPECT_EQ(gpu->generation(), 1u);
}

TEST_F(GpuTest, ALossIsNoticedAndTheNextEnterHasANewContext) {
  auto gpu = *Gpu::Create();
  PerContext<Texture> texture;
  auto make = [](const Current& c) { return Texture::Create(c, GL_R32F, 4, 4); };
  {
    const auto current = gpu->Enter();
    ASSERT_TRUE(current);
    EXPECT_NE(texture.In(*gpu, *current, make), nullptr);
    gpu->LoseForTest();
    const Status drawn = current->Check("pass");
    ASSERT_FALSE(drawn);
    EXPECT_EQ(drawn.error().code, ErrorCode::kUnavailable);
  }
  const auto current = gpu->Enter();
  ASSERT_TRUE(current);
  EXPECT_EQ(gpu->generation(), 2u);
  EXPECT_NE(texture.In(*gpu, *current, make), nullptr);
  EXPECT_TRUE(current->Check("after"));
}

TEST_F(GpuTest, ObjectsThatCannotBeMadeAreTriedOnceAContext) {
  auto gpu = *Gpu::Create();
  int tried = 0;
  PerContext<Texture> texture;
  auto fail = [&](const Current&) -> Result<Texture> {
    ++tried;
    return Fail(ErrorCode::kInternal, "no");
  };
  for (int i = 0; i < 3; ++i) {
    const auto current = gpu->Enter();
    ASSERT_TRUE(current);
    EXPECT_EQ(texture.In(*gpu, *current, fail), nullptr);
    EXPECT_EQ(texture.failure().message, "no");
  }
  EXPECT_EQ(tried, 1);
}

}  // namespace
}  // namespace mixstage::gl
