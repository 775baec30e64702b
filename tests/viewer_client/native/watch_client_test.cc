// SPDX-License-Identifier: Apache-2.0
//
// Encoder, gateway and client together over a real socket.
#include "viewer_client/native/watch_client.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <mutex>
#include <thread>

#include "proto/base/clock.h"
#include "server/delivery/depth_packer.h"
#include "server/delivery/gateway.h"
#include "server/delivery/video_encoder.h"
#include "tests/server/delivery/test_viewer.h"

namespace mixstage {
namespace {

constexpr int kWidth = 160, kHeight = 128;
constexpr DepthRange kRange{1.0f, 6.0f};

// A pipeline's end: encodes a plain picture and publishes it, over and over.
class Studio {
 public:
  explicit Studio(Gateway& gateway)
      : thread_([this, &gateway](const std::stop_token& stop) { Run(gateway, stop); }) {}
  void BreakNextPicture() { break_next_ = true; }

 private:
  void Run(Gateway& gateway, const std::stop_token& stop) {
    auto color = VideoEncoder::Create({}, kWidth, kHeight);
    auto depth = VideoEncoder::Create({.format = VideoFormat::kDepth10}, kWidth, kHeight);
    YuvImage image;
    image.Create(kWidth, kHeight, ChromaLayout::k420);
    image.cb.setTo(100);
    image.cr.setTo(150);
    Yuv10Image planes;
    for (std::uint64_t frame = 0; !stop.stop_requested(); ++frame) {
      const std::int64_t capture_us = MonotonicMicros();
      if (gateway.TakeKeyFrameRequest()) {
        color->RequestKeyFrame();
        depth->RequestKeyFrame();
      }
      image.y.setTo(60 + static_cast<int>(frame % 100));
      PackDepth(View(cv::Mat1f(kHeight, kWidth, 3.0f)), View(cv::Mat1b(kHeight, kWidth, std::uint8_t{200})),
                {}, kRange, &planes);
      Publish(gateway, {.stream = WatchStream::kColor, .frame = frame, .capture_us = capture_us},
              color->Encode(image, capture_us));
      Publish(gateway,
              {.stream = WatchStream::kDepth,
               .frame = frame,
               .capture_us = capture_us,
               .near_m = kRange.near_m,
               .far_m = kRange.far_m},
              depth->Encode(planes, capture_us));
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
  }
  void Publish(Gateway& gateway, WatchHeader header, const Result<EncodedPicture>& encoded) {
    ASSERT_TRUE(encoded);
    header.key_frame = encoded->key_frame;
    std::vector<std::uint8_t> payload(encoded->access_unit.begin(), encoded->access_unit.end());
    if (header.stream == WatchStream::kColor && !header.key_frame && break_next_.exchange(false)) {
      payload.assign(payload.size(), 0xEE);
    }
    gateway.Publish(MakeWatchPicture(header, payload));
  }

  std::atomic<bool> break_next_{false};
  std::jthread thread_;
};

// What the callbacks saw.
struct Seen {
  std::atomic<int> color{0}, depth{0}, undecodable{0}, connected{0}, disconnected{0}, hellos{0};
  std::atomic<int> luma{-1}, alpha{-1};
  std::atomic<float> depth_m{-1};
  std::atomic<double> latency_ms{-1};

  WatchCallbacks Callbacks() {
    WatchCallbacks callbacks;
    callbacks.on_color = [this](const ColorPicture& picture, const PictureArrival& arrival) {
      luma = picture.image.y(kHeight / 2, kWidth / 2) - 60 - static_cast<int>(picture.header.frame % 100);
      if (arrival.decoded_server_us) {
        latency_ms = static_cast<double>(*arrival.decoded_server_us - picture.header.capture_us) / 1e3;
      }
      ++color;
    };
    callbacks.on_depth = [this](const WatchedDepth& picture, const PictureArrival&) {
      depth_m = picture.depth_m(kHeight / 2, kWidth / 2);
      alpha = picture.alpha(kHeight / 4, kWidth / 4);
      ++depth;
    };
    callbacks.on_undecodable = [this](WatchStream) { ++undecodable; };
    callbacks.on_connected = [this] { ++connected; };
    callbacks.on_disconnected = [this](const std::string&) { ++disconnected; };
    callbacks.on_hello = [this](const WatchHello&) { ++hellos; };
    return callbacks;
  }
};

std::unique_ptr<WatchClient> Client(std::uint16_t port, Seen& seen, WatchSubscribe streams = {true, true}) {
  return *WatchClient::Create({.url = "http://localhost:" + std::to_string(port) + "/",
                               .streams = streams,
                               .shortest_backoff_s = 0.05,
                               .longest_backoff_s = 0.2},
                              seen.Callbacks());
}

TEST(WatchClient, DecodesBothStreamsAndKnowsTheLatency) {
  Gateway gateway({.listen = "127.0.0.1:0"});
  ASSERT_TRUE(gateway.Start());
  const Studio studio(gateway);
  Seen seen;
  const auto client = Client(gateway.port(), seen);
  const std::jthread thread([&](const std::stop_token& stop) { client->Run(stop); });
  ASSERT_TRUE(Eventually([&] { return seen.color > 20 && seen.depth > 20 && seen.latency_ms >= 0; }));
  EXPECT_NEAR(seen.luma, 0, 4);
  EXPECT_NEAR(seen.depth_m, 3.0, 0.02);
  EXPECT_NEAR(seen.alpha, 200, 4);
  EXPECT_LT(seen.latency_ms, 10'000);
  EXPECT_GE(seen.hellos, 1);
  EXPECT_EQ(seen.undecodable, 0);
}

TEST(WatchClient, TakesOnlyTheStreamsItSubscribesTo) {
  Gateway gateway({.listen = "127.0.0.1:0"});
  ASSERT_TRUE(gateway.Start());
  Seen seen;
  const auto client = Client(gateway.port(), seen, {.color = false, .depth = true});
  const std::jthread thread([&](const std::stop_token& stop) { client->Run(stop); });
  ASSERT_TRUE(Eventually(
      [&] { return gateway.WantsStream(WatchStream::kDepth) && !gateway.WantsStream(WatchStream::kColor); }));
  const Studio studio(gateway);
  ASSERT_TRUE(Eventually([&] { return seen.depth > 5; }));
  EXPECT_EQ(seen.color, 0);
}

TEST(WatchClient, ComesBackAfterTheServerDid) {
  Seen seen;
  std::uint16_t port = 0;
  std::unique_ptr<WatchClient> client;
  std::optional<std::jthread> thread;
  {
    Gateway gateway({.listen = "127.0.0.1:0"});
    ASSERT_TRUE(gateway.Start());
    port = gateway.port();
    const Studio studio(gateway);
    client = Client(port, seen);
    thread.emplace([&](const std::stop_token& stop) { client->Run(stop); });
    ASSERT_TRUE(Eventually([&] { return seen.color > 5; }));
  }
  ASSERT_TRUE(Eventually([&] { return seen.disconnected > 1; }))
      << "the goodbye and at least one vain attempt";
  Gateway gateway({.listen = "127.0.0.1:" + std::to_string(port)});
  ASSERT_TRUE(gateway.Start());
  const Studio studio(gateway);
  const int before = seen.color;
  EXPECT_TRUE(Eventually([&] { return seen.color > before + 5; }));
  EXPECT_EQ(seen.connected, 2);
}

TEST(WatchClient, AfterADamagedPictureItAsksForAKeyFrameAndGoesOn) {
  Gateway gateway({.listen = "127.0.0.1:0"});
  ASSERT_TRUE(gateway.Start());
  Studio studio(gateway);
  Seen seen;
  const auto client = Client(gateway.port(), seen);
  const std::jthread thread([&](const std::stop_token& stop) { client->Run(stop); });
  ASSERT_TRUE(Eventually([&] { return seen.color > 5; }));
  studio.BreakNextPicture();
  ASSERT_TRUE(Eventually([&] { return seen.undecodable > 0; }));
  const int before = seen.color;
  EXPECT_TRUE(Eventually([&] { return seen.color > before + 5; }));
  EXPECT_EQ(seen.connected, 1);
}

TEST(WatchClient, StopsAtOnceWhereNobodyListens) {
  Seen seen;
  const auto client = Client(1, seen);  // no server has port 1 in a test
  std::jthread thread([&](const std::stop_token& stop) { client->Run(stop); });
  EXPECT_TRUE(Eventually([&] { return seen.disconnected > 0; }));
  thread.request_stop();
  thread.join();
  EXPECT_EQ(seen.connected, 0);
}

TEST(WatchClient, ConfigurationIsChecked) {
  EXPECT_FALSE(WatchClient::Create({.url = "https://localhost/", .ca_file = "gone.pem"}, {}));
  const std::string token(43, 'a');
  EXPECT_TRUE(WatchClient::Create({.url = "http://localhost/", .token = token}, {}));
  EXPECT_TRUE(WatchClient::Create({.url = "https://studio/", .token = token}, {}));
  EXPECT_FALSE(WatchClient::Create({.url = "http://localhost/", .token = "short"}, {}));
  EXPECT_FALSE(WatchClient::Create({.url = "http://studio/", .token = token}, {})) << "in the clear";
  EXPECT_FALSE(WatchClient::Create({.url = "http://localhost/", .connect_timeout_s = 0}, {}));
  EXPECT_FALSE(WatchClient::Create({.url = "http://localhost/", .shortest_backoff_s = 9}, {}));
}

}  // namespace
}  // namespace mixstage
