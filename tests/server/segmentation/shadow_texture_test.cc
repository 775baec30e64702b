// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/shadow_texture.h"

#include <gtest/gtest.h>

#include "tests/server/segmentation/flat_room.h"

namespace mixstage {
namespace {

class ShadowTextureTest : public ::testing::Test {
 protected:
  ShadowTextureTest() : room_(256, 192, 3.0f), model_(room_.Learn(12)) { room_.Shoot(); }
  void Run() {
    const ToneChange tone = FindToneChange(room_.picture, model_.mean, {});
    shadow_texture_.Run(room_.picture, model_, tone, &texture_, &kept_);
  }
  FlatRoom room_;
  BackgroundModel model_;
  ShadowTexture shadow_texture_;
  cv::Mat1f texture_, kept_;
};

TEST_F(ShadowTextureTest, AShadowKeepsTheRoomsTextureAndAnActorDoesNot) {
  room_.Darken({40, 40, 80, 100}, 0.7f);
  room_.PaintColor({160, 40, 60, 100}, 70, 70, 70);
  Run();
  EXPECT_LT(texture_(22, 20), 0.5f);
  EXPECT_GT(kept_(22, 20), 1);
  EXPECT_LT(kept_(22, 47), 0.5f);
}

TEST_F(ShadowTextureTest, BetweenHisLegsTheRoomInHisShadowIsFound) {
  room_.Darken({120, 40, 8, 100}, 0.7f);
  room_.PaintColor({70, 40, 50, 100}, 20, 20, 22);
  room_.PaintColor({128, 40, 50, 100}, 20, 20, 22);
  Run();
  for (const int y : {15, 22, 30}) EXPECT_LT(texture_(y, 30), 1) << y;
}

}  // namespace
}  // namespace mixstage
