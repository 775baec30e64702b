// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/viewer_hub.h"

#include <gtest/gtest.h>

#include "server/delivery/token_bucket.h"

namespace mixstage {
namespace {

TEST(ViewerHub, GivesKeyFramesTwiceASecondAtMost) {
  const GatewayConfig config;
  ViewerHub hub(config);
  EXPECT_FALSE(hub.TakeKeyFrameRequest(1'000'000)) << "nobody asked";
  hub.WishKeyFrame();
  EXPECT_TRUE(hub.TakeKeyFrameRequest(1'000'000));
  EXPECT_FALSE(hub.TakeKeyFrameRequest(9'000'000)) << "once for each wish";
  hub.WishKeyFrame();
  hub.WishKeyFrame();
  EXPECT_TRUE(hub.TakeKeyFrameRequest(9'000'000));
  hub.WishKeyFrame();
  EXPECT_FALSE(hub.TakeKeyFrameRequest(9'499'999));
  EXPECT_TRUE(hub.TakeKeyFrameRequest(9'500'000)) << "the wish was kept";
}

TEST(TokenBucket, AllowsABurstAndThenTheRate) {
  TokenBucket bucket(20, 40);
  std::int64_t now_us = 1'000'000;
  for (int i = 0; i < 40; ++i) EXPECT_TRUE(bucket.Take(now_us)) << i;
  EXPECT_FALSE(bucket.Take(now_us));
  int taken = 0;
  for (int i = 0; i < 1000; ++i) taken += bucket.Take(now_us += 10'000) ? 1 : 0;
  EXPECT_NEAR(taken, 200, 1);
  now_us += 3'600'000'000;
  for (int i = 0; i < 40; ++i) EXPECT_TRUE(bucket.Take(now_us)) << i;
  EXPECT_FALSE(bucket.Take(now_us)) << "a pause saves up no more than the burst";
}

}  // namespace
}  // namespace mixstage
