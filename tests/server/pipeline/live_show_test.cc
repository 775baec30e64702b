// SPDX-License-Identifier: Apache-2.0
//
// Every thread of a running show at once, over LCM inside the process: what the thread sanitizer is to see.
#include "server/pipeline/live_show.h"

#include <gtest/gtest.h>

#include <thread>

#include "proto/base/clock.h"
#include "proto/codec/depth_codec.h"
#include "proto/codec/jpeg.h"
#include "tests/server/delivery/test_viewer.h"

namespace mixstage {
namespace {

constexpr int kWidth = 64;
constexpr int kHeight = 48;

// An agent: a grey picture 50 times a second, depth with every other one, health with every tenth.
void PublishUntil(const std::stop_token& stop, LcmLink& link) {
  YuvImage grey;
  grey.Create(kWidth, kHeight, ChromaLayout::k420);
  grey.y.setTo(120), grey.cb.setTo(128), grey.cr.setTo(128);
  EncodedFrame color{.epoch = 7, .width = kWidth, .height = kHeight, .bytes = {}};
  ASSERT_TRUE(JpegEncoder().Encode(grey, 80, color.bytes));
  EncodedFrame depth{.epoch = 7,
                     .stream = Stream::kDepth,
                     .encoding = Encoding::kDepth16,
                     .width = kWidth,
                     .height = kHeight,
                     .bytes = {}};
  const cv::Mat1w wall(kHeight, kWidth, std::uint16_t{3000});
  DepthEncoder().Encode(View(wall), depth.bytes);
  const auto send = [&](const mixstage_lcm::frame_slice_t& slice) { link.Publish(slice); };
  for (std::int64_t i = 0; !stop.stop_requested(); ++i) {
    color.t_us = depth.t_us = MonotonicMicros();
    color.sequence = i;
    if (i % 2 == 0) {
      depth.sequence = i / 2;
      CutIntoSlices(depth, send);
    }
    CutIntoSlices(color, send);
    if (i % 10 == 0) {
      mixstage_lcm::agent_health_t health{};
      health.epoch = 7;
      link.Publish(health);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

TEST(LiveShow, PicturesReachViewersAndEverythingStops) {
  auto link = LcmLink::Create("memq://");
  ASSERT_TRUE(link) << link.error().message;
  LcmLink& agents_link = **link;
  const Rig rig = AssumedRig(kWidth, kHeight, 0.001);
  auto studio = Studio::Create({.rig = rig, .scene = {}, .poses = {}, .learn_frames = 5, .device = {}});
  ASSERT_TRUE(studio) << studio.error().message;
  const LiveShow* running = nullptr;
  std::mutex running_mutex;
  Gateway gateway({.listen = "127.0.0.1:0"}, [&] {
    const std::lock_guard lock(running_mutex);
    return running != nullptr ? running->MetricsText() : std::string();
  });
  ASSERT_TRUE(gateway.Start());
  auto broadcast = Broadcast::Create({}, rig.color, "test", &gateway);
  ASSERT_TRUE(broadcast) << broadcast.error().message;
  auto meshes = MeshBroadcast::Create(rig.color, gateway);
  ASSERT_TRUE(meshes) << meshes.error().message;
  {
    LiveShow show({.link = std::move(*link),
                   .studio = std::move(*studio),
                   .broadcast = std::move(*broadcast),
                   .meshes = std::move(*meshes)},
                  gateway);
    {
      const std::lock_guard lock(running_mutex);
      running = &show;
    }
    std::jthread agent([&](const std::stop_token& stop) { PublishUntil(stop, agents_link); });
    for (int i = 0; i < 3; ++i) {  // viewers come and go
      TestViewer viewer(gateway.port());
      ASSERT_TRUE(viewer.connected());
      for (int k = 0; k < 10; ++k) EXPECT_TRUE(viewer.ReadBinary());
    }
    TestViewer viewer(gateway.port());
    EXPECT_TRUE(viewer.ReadText(R"("state":"live")"));
    EXPECT_NE(HttpGet(gateway.port(), "/metrics").find("mixstage_frames_total"), std::string::npos);
    EXPECT_EQ(show.failure(), "");
    agent.request_stop();
    agent.join();
    const std::lock_guard lock(running_mutex);
    running = nullptr;
  }
  gateway.Stop();
}

}  // namespace
}  // namespace mixstage
