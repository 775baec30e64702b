// SPDX-License-Identifier: Apache-2.0
//
// The gateway's viewers over real sockets.
#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "server/delivery/gateway.h"
#include "tests/server/delivery/test_viewer.h"

namespace mixstage {
namespace {

std::shared_ptr<const WatchPicture> Picture(WatchStream stream, bool key_frame, std::uint64_t frame,
                                            std::size_t payload_bytes = 1000) {
  const std::vector<std::uint8_t> payload(payload_bytes, static_cast<std::uint8_t>(frame));
  WatchHeader header{.stream = stream, .key_frame = key_frame, .frame = frame};
  if (stream == WatchStream::kDepth) header.near_m = 1, header.far_m = 6;
  return MakeWatchPicture(header, payload);
}

// Goes on publishing as a pipeline would: both streams, key frames when asked for and every 60th.
class Source {
 public:
  explicit Source(Gateway& gateway, std::size_t payload_bytes = 1000)
      : thread_([this, &gateway, payload_bytes](const std::stop_token& stop) {
          for (std::uint64_t frame = 0; !stop.stop_requested(); ++frame) {
            const bool key_frame = gateway.TakeKeyFrameRequest() || frame % 60 == 0;
            gateway.Publish(Picture(WatchStream::kColor, key_frame, frame, payload_bytes));
            gateway.Publish(Picture(WatchStream::kDepth, key_frame, frame, payload_bytes));
            frames_ = frame + 1;
            std::this_thread::sleep_for(std::chrono::milliseconds(5));
          }
        }) {}
  [[nodiscard]] std::uint64_t frames() const { return frames_; }

 private:
  std::atomic<std::uint64_t> frames_{0};
  std::jthread thread_;
};

WatchPictureView Read(const Received& received) {
  const auto picture =
      ReadWatchPicture({reinterpret_cast<const std::uint8_t*>(received.bytes.data()), received.bytes.size()});
  EXPECT_TRUE(picture);
  return picture ? *picture : WatchPictureView{};
}

const GatewayConfig kAnyPort{.listen = "127.0.0.1:0"};

TEST(GatewayWatch, HelloComesFirstAndAgainWhenItChanges) {
  Gateway gateway(kAnyPort);
  ASSERT_TRUE(gateway.Start());
  gateway.SetHello({.name = "studio-1"});
  TestViewer early(gateway.port());
  auto first = early.Read();
  ASSERT_TRUE(first && first->text);
  EXPECT_NE(first->bytes.find(R"("streams":[])"), std::string::npos) << first->bytes;
  gateway.SetHello({.name = "studio-1", .streams = {{WatchStream::kColor, "avc1.42C01F", 1024, 768}}});
  const auto second = early.ReadText("avc1.42C01F");
  ASSERT_TRUE(second);
  const auto hello = ParseServerMessage(second->bytes);
  ASSERT_TRUE(hello);
  EXPECT_EQ(std::get<WatchHello>(*hello).name, "studio-1");
  EXPECT_GT(std::get<WatchHello>(*hello).server_us, 0);
}

TEST(GatewayWatch, TwoViewersGetTheSameBytesFromTheKeyFrameOn) {
  Gateway gateway(kAnyPort);
  ASSERT_TRUE(gateway.Start());
  TestViewer a(gateway.port()), b(gateway.port());
  ASSERT_TRUE(Eventually([&] { return gateway.counters().viewers == 2; }));
  std::vector<std::shared_ptr<const WatchPicture>> sent;
  sent.push_back(Picture(WatchStream::kColor, false, 1));  // before any key frame: for nobody
  for (std::uint64_t frame = 2; frame < 6; ++frame) {
    sent.push_back(Picture(WatchStream::kColor, frame == 2, frame));
    sent.push_back(Picture(WatchStream::kDepth, frame == 2, frame));
  }
  for (const auto& picture : sent) gateway.Publish(picture);
  for (TestViewer* viewer : {&a, &b}) {
    for (std::size_t i = 1; i < sent.size(); ++i) {
      const auto received = viewer->ReadBinary();
      ASSERT_TRUE(received);
      EXPECT_EQ(std::vector<std::uint8_t>(received->bytes.begin(), received->bytes.end()), sent[i]->message);
    }
  }
}

TEST(GatewayWatch, ANewViewerAsksForAKeyFrameAndStartsWithIt) {
  Gateway gateway(kAnyPort);
  ASSERT_TRUE(gateway.Start());
  EXPECT_FALSE(gateway.TakeKeyFrameRequest()) << "nobody is there";
  EXPECT_FALSE(gateway.WantsStream(WatchStream::kColor));
  const Source source(gateway);
  for (int i = 0; i < 3; ++i) {
    TestViewer viewer(gateway.port());
    for (int n = 0; n < 2; ++n) {
      const auto received = viewer.ReadBinary();
      ASSERT_TRUE(received);
      EXPECT_TRUE(Read(*received).header.key_frame);
    }
    EXPECT_TRUE(gateway.WantsStream(WatchStream::kColor));
    EXPECT_TRUE(gateway.WantsStream(WatchStream::kDepth));
  }
  EXPECT_TRUE(Eventually([&] { return !gateway.WantsStream(WatchStream::kColor); })) << "all have left";
}

TEST(GatewayWatch, AWishForAKeyFrameIsPassedOn) {
  Gateway gateway(kAnyPort);
  ASSERT_TRUE(gateway.Start());
  TestViewer viewer(gateway.port());
  ASSERT_TRUE(Eventually([&] { return gateway.TakeKeyFrameRequest(); })) << "for the new viewer";
  EXPECT_FALSE(gateway.TakeKeyFrameRequest());
  ASSERT_TRUE(viewer.SendText(R"({"type":"keyframe"})"));
  EXPECT_TRUE(Eventually([&] { return gateway.TakeKeyFrameRequest(); }));
}

TEST(GatewayWatch, SubscriptionsChooseTheStreams) {
  Gateway gateway(kAnyPort);
  ASSERT_TRUE(gateway.Start());
  const Source source(gateway);
  TestViewer viewer(gateway.port());
  ASSERT_TRUE(viewer.ReadBinary());  // it has joined
  ASSERT_TRUE(viewer.SendText(R"({"type":"subscribe","streams":["depth"]})"));
  ASSERT_TRUE(Eventually([&] { return !gateway.WantsStream(WatchStream::kColor); }));
  EXPECT_TRUE(gateway.WantsStream(WatchStream::kDepth));
  int depth_in_a_row = 0;
  ASSERT_TRUE(viewer.ReadUntil([&](const Received& received) {
    if (received.text) return false;
    depth_in_a_row = Read(received).header.stream == WatchStream::kDepth ? depth_in_a_row + 1 : 0;
    return depth_in_a_row == 50;
  }));
  ASSERT_TRUE(viewer.SendText(R"({"type":"subscribe","streams":["color","depth"]})"));
  const auto color = viewer.ReadUntil([&](const Received& received) {
    return !received.text && Read(received).header.stream == WatchStream::kColor;
  });
  ASSERT_TRUE(color);
  EXPECT_TRUE(Read(*color).header.key_frame) << "a stream that is taken up again starts at a key frame";
}

TEST(GatewayWatch, PingsAreAnsweredAndStatsReachEverybody) {
  Gateway gateway(kAnyPort);
  ASSERT_TRUE(gateway.Start());
  TestViewer viewer(gateway.port());
  ASSERT_TRUE(viewer.SendText(R"({"type":"ping","viewer_us":1784732123456789})"));
  EXPECT_TRUE(viewer.ReadText(R"("viewer_us":1784732123456789)"));
  const std::string stats = ToJson(WatchStats{.state = "live", .frames = 77});
  gateway.PublishStats(stats);
  const auto received = viewer.ReadText("\"stats\"");
  ASSERT_TRUE(received);
  EXPECT_EQ(received->bytes, stats);
}

TEST(GatewayWatch, AStalledViewerHoldsUpNobodyAndIsClosed) {
  GatewayConfig config = kAnyPort;
  config.send_buffer_bytes = 16 << 10;
  config.queued_bytes = 1 << 20;
  config.stall_timeout_s = 1.5;
  Gateway gateway(config);
  ASSERT_TRUE(gateway.Start());
  const TestViewer stalled(gateway.port(), {.receive_buffer_bytes = 8 << 10});  // never reads
  ASSERT_TRUE(stalled.connected());
  TestViewer reader(gateway.port());
  ASSERT_TRUE(Eventually([&] { return gateway.counters().viewers == 2; }));
  // The next picture is published when the reader has this one: only the stalled one can fall behind.
  std::uint64_t frame = 0;
  const auto end = std::chrono::steady_clock::now() + kTestPatience;
  while (gateway.counters().closed_slow == 0 && std::chrono::steady_clock::now() < end) {
    gateway.Publish(Picture(WatchStream::kColor, frame % 60 == 0, frame, 20'000));
    const auto received = reader.ReadBinary();
    ASSERT_TRUE(received);
    ASSERT_EQ(Read(*received).header.frame, frame++) << "the other one misses nothing";
  }
  EXPECT_EQ(gateway.counters().closed_slow, 1u);
  EXPECT_GT(gateway.counters().dropped_viewer_slow, 0u)
      << "its queue is bounded: the rest was not kept for it";
  EXPECT_TRUE(Eventually([&] { return gateway.counters().viewers == 1; }));
}

TEST(GatewayWatch, ASlowViewerGoesOnAtAKeyFrame) {
  GatewayConfig config = kAnyPort;
  config.send_buffer_bytes = 16 << 10;
  config.queued_pictures = 4;
  Gateway gateway(config);
  ASSERT_TRUE(gateway.Start());
  TestViewer viewer(gateway.port(), {.receive_buffer_bytes = 8 << 10});
  ASSERT_TRUE(Eventually([&] { return gateway.counters().viewers == 1; }));
  const Source source(gateway, 20'000);
  ASSERT_TRUE(
      Eventually([&] { return gateway.counters().dropped_viewer_slow > 20; }));  // it did not read so far
  std::optional<std::uint64_t> last;
  const auto after_gap = viewer.ReadUntil([&](const Received& received) {
    if (received.text) return false;
    const WatchPictureView picture = Read(received);
    if (picture.header.stream != WatchStream::kColor) return false;
    const bool gap = last && picture.header.frame != *last + 1;
    last = picture.header.frame;
    return gap;
  });
  ASSERT_TRUE(after_gap);
  EXPECT_TRUE(Read(*after_gap).header.key_frame)
      << "a gap ends with a key frame, never with a predicted picture";
}

TEST(GatewayWatch, RubbishOversizeAndFloodsCloseWithPolicy) {
  Gateway gateway(kAnyPort);
  ASSERT_TRUE(gateway.Start());
  for (const std::string& text :
       {std::string("{"), std::string("{\"type\":\"reboot\"}"), std::string("[]"),
        "{\"type\":\"keyframe\",\"x\":\"" + std::string(4096, 'x') + "\"}", std::string(300'000, ' ')}) {
    TestViewer viewer(gateway.port());
    ASSERT_TRUE(viewer.connected());
    viewer.SendText(text);
    EXPECT_EQ(viewer.ReadCloseCode(), 1008) << text.substr(0, 40);
  }
  TestViewer binary(gateway.port());
  binary.Send("\x01\x02", false);
  EXPECT_EQ(binary.ReadCloseCode(), 1008);
  EXPECT_EQ(gateway.counters().closed_message, 6u);

  TestViewer flood(gateway.port());
  for (int i = 0; i < 2000 && flood.SendText(R"({"type":"ping","viewer_us":1})"); ++i) {
  }
  EXPECT_EQ(flood.ReadCloseCode(), 1008);
  EXPECT_EQ(gateway.counters().closed_rate, 1u);
  EXPECT_TRUE(TestViewer(gateway.port()).Read()) << "and others are still welcome";
}

TEST(GatewayWatch, ABurstWithinTheRateIsServed) {
  Gateway gateway(kAnyPort);
  ASSERT_TRUE(gateway.Start());
  TestViewer viewer(gateway.port());
  for (int i = 0; i < 35; ++i)
    ASSERT_TRUE(viewer.SendText(R"({"type":"ping","viewer_us":)" + std::to_string(i) + "}"));
  EXPECT_TRUE(viewer.ReadText(R"("viewer_us":34})"));
}

TEST(GatewayWatch, OnlyItsOwnPageMayWatch) {
  Gateway gateway(kAnyPort);
  ASSERT_TRUE(gateway.Start());
  const std::string own = "http://127.0.0.1:" + std::to_string(gateway.port());
  EXPECT_TRUE(TestViewer(gateway.port(), {.origin = own}).connected());
  EXPECT_TRUE(TestViewer(gateway.port()).connected()) << "a program sends no Origin";
  for (const char* origin : {"http://evil.example", "http://127.0.0.1:1", "null", "https://127.0.0.1"}) {
    const TestViewer foreign(gateway.port(), {.origin = origin});
    EXPECT_FALSE(foreign.connected()) << origin;
    EXPECT_EQ(foreign.http_status(), 403) << origin;
  }
  EXPECT_EQ(gateway.counters().refused_origin, 4u);
}

TEST(GatewayWatch, MoreViewersThanAllowedAreTurnedAway) {
  GatewayConfig config = kAnyPort;
  config.max_viewers = 2;
  Gateway gateway(config);
  ASSERT_TRUE(gateway.Start());
  const TestViewer a(gateway.port()), b(gateway.port());
  ASSERT_TRUE(Eventually([&] { return gateway.counters().viewers == 2; }));
  const TestViewer c(gateway.port());
  EXPECT_FALSE(c.connected());
  EXPECT_EQ(c.http_status(), 503);
}

TEST(GatewayWatch, StopSaysGoodbyeAndPublishingAfterwardsIsHarmless) {
  Gateway gateway(kAnyPort);
  ASSERT_TRUE(gateway.Start());
  TestViewer viewer(gateway.port());
  ASSERT_TRUE(Eventually([&] { return gateway.counters().viewers == 1; }));
  std::thread stopper([&] { gateway.Stop(); });
  EXPECT_EQ(viewer.ReadCloseCode(), 1001);
  stopper.join();
  gateway.Stop();
  for (std::uint64_t frame = 0; frame < 1000; ++frame)
    gateway.Publish(Picture(WatchStream::kColor, true, frame));
  gateway.PublishStats("{}");
}

TEST(GatewayWatch, ThreadsMayPublishWhileViewersComeAndGo) {
  Gateway gateway(kAnyPort);
  ASSERT_TRUE(gateway.Start());
  const Source source(gateway);
  const std::jthread stats([&](const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      gateway.PublishStats(ToJson(WatchStats{.state = "live", .viewers = gateway.counters().viewers}));
      gateway.SetHello({.name = "changing"});
      std::this_thread::sleep_for(std::chrono::milliseconds(3));
    }
  });
  for (int i = 0; i < 30; ++i) {
    TestViewer viewer(gateway.port());
    ASSERT_TRUE(viewer.connected());
    if (i % 3 == 0) {
      EXPECT_TRUE(viewer.ReadBinary());
    } else if (i % 3 == 1) {
      EXPECT_TRUE(viewer.SendText(R"({"type":"subscribe","streams":[]})"));
    }
  }
  EXPECT_TRUE(TestViewer(gateway.port()).ReadBinary());
}

}  // namespace
}  // namespace mixstage
