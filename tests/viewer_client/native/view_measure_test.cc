// SPDX-License-Identifier: Apache-2.0
#include "viewer_client/native/view_measure.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "viewer_client/native/server_clock.h"
#include "viewer_client/native/watch_client.h"
#include "viewer_client/native/watch_url.h"

namespace mixstage {
namespace {

WatchHeader Color(std::uint64_t frame) { return {.stream = WatchStream::kColor, .frame = frame}; }

TEST(LatencyHistogram, PercentilesAreThoseOfTheSortedValuesToATenthOfAMillisecond) {
  LatencyHistogram histogram;
  EXPECT_FALSE(histogram.Percentile(0.5));
  for (int i = 100; i >= 1; --i) histogram.Add(i);
  EXPECT_NEAR(*histogram.Percentile(0.5), 50, 0.11);
  EXPECT_NEAR(*histogram.Percentile(0.99), 99, 0.11);
  histogram.Add(1e9);
  histogram.Add(-5);
  EXPECT_NEAR(*histogram.Percentile(1), 5000, 1);
}

TEST(CounterSince, CountsFromTheFirstReadingAndAcrossARestart) {
  CounterSince counter;
  counter.Read(100);
  EXPECT_EQ(counter.total(), 0u);
  counter.Read(103);
  EXPECT_EQ(counter.total(), 3u);
  counter.Read(2);  // a new server
  EXPECT_EQ(counter.total(), 5u);
}

TEST(ViewMeasure, FramesPerSecondAreFromTheFirstToTheLastPicture) {
  ViewMeasure measure(0);
  EXPECT_EQ(measure.Total().fps, 0);
  for (int i = 0; i <= 30; ++i)
    measure.OnPicture(Color(static_cast<std::uint64_t>(i)), 25'000, 5'000'000 + i * 33'333, 40);
  const ViewReport report = measure.Total();
  EXPECT_NEAR(report.fps, 30.0, 0.01);
  EXPECT_EQ(report.frames, 31u);
  EXPECT_NEAR(*report.first_picture_ms, 5000, 1e-9);
  EXPECT_NEAR(*report.latency_p50_ms, 40, 0.11);
  EXPECT_NEAR(report.bitrate_mbps, 31 * 25'000 * 8 / 1e6, 0.01);
}

TEST(ViewMeasure, GapsAreMissingNumbersButNotWhatAReconnectSkips) {
  ViewMeasure measure(0);
  measure.OnConnected();
  measure.OnPicture(Color(10), 1, 0, {});
  measure.OnPicture(Color(13), 1, 100, {});
  EXPECT_EQ(measure.Total().gaps, 2u);
  measure.OnConnected();
  measure.OnPicture(Color(50), 1, 200, {});
  measure.OnPicture(Color(0), 1, 300, {});  // a new server's numbers
  EXPECT_EQ(measure.Total().gaps, 2u);
  EXPECT_EQ(measure.Total().reconnects, 1u);
}

TEST(ViewMeasure, LostAreTheServersAndOurs) {
  ViewMeasure measure(0);
  measure.OnStats({.drops = {{"late", 7}, {"lost", 1}}});
  measure.OnStats({.drops = {{"late", 9}, {"lost", 4}}});
  measure.OnUndecodable();
  EXPECT_EQ(measure.Total().late, 2u);
  EXPECT_EQ(measure.Total().lost, 4u);
}

TEST(ViewMeasure, AnIntervalHoldsOnlyItsOwnPictures) {
  ViewMeasure measure(0);
  for (int i = 0; i < 10; ++i) measure.OnPicture(Color(static_cast<std::uint64_t>(i)), 1000, i * 100'000, 10);
  EXPECT_EQ(measure.TakeInterval().frames, 10u);
  EXPECT_EQ(measure.TakeInterval().frames, 0u);
  for (int i = 10; i < 13; ++i)
    measure.OnPicture(Color(static_cast<std::uint64_t>(i)), 1000, i * 100'000, 90);
  const ViewReport report = measure.TakeInterval();
  EXPECT_EQ(report.frames, 3u);
  EXPECT_NEAR(report.fps, 10, 1e-6);
  EXPECT_NEAR(*report.latency_p50_ms, 90, 0.11);
  EXPECT_EQ(measure.Total().frames, 13u);
}

TEST(ViewReport, TheJsonLineBeginsWithWhatOthersReadOfIt) {
  ViewReport report{.fps = 29.97, .late = 1, .lost = 2, .latency_p50_ms = 41.5, .latency_p99_ms = 60.0};
  EXPECT_TRUE(ToJsonLine(report).starts_with(
      R"({"fps":29.97,"late":1,"lost":2,"latency_p50_ms":41.5,"latency_p99_ms":60.0,)"))
      << ToJsonLine(report);
  report.latency_p50_ms.reset();
  EXPECT_TRUE(nlohmann::json::parse(ToJsonLine(report))["latency_p50_ms"].is_null()) << "not known is not 0";
}

TEST(ServerClock, TrustsTheQuickestAnswer) {
  ServerClock clock;
  EXPECT_FALSE(clock.offset_us());
  clock.Answered(1000, 9000, 1'005'000 + 3000);  // 8 ms round trip, off by 3 ms
  clock.Answered(20'000, 20'200, 1'020'100);     // 0.2 ms: exact
  clock.Answered(50'000, 70'000, 1'050'000);
  EXPECT_EQ(*clock.offset_us(), 1'000'000);
  clock.Answered(90'000, 80'000, 5);  // an answer before its question is none
  EXPECT_EQ(*clock.offset_us(), 1'000'000);
}

TEST(WatchUrl, ThePagesAddressWillDo) {
  const auto url = ParseWatchUrl("http://localhost:8090/");
  ASSERT_TRUE(url);
  EXPECT_EQ(url->host, "localhost");
  EXPECT_EQ(url->port, "8090");
  EXPECT_EQ(url->host_header, "localhost:8090");
  EXPECT_EQ(ParseWatchUrl("ws://studio/watch?x")->port, "80");
  EXPECT_EQ(ParseWatchUrl("http://[::1]:9000")->host, "::1");
  EXPECT_EQ(ParseWatchUrl("http://[::1]")->host, "::1");
  EXPECT_FALSE(url->tls);
  EXPECT_TRUE(ParseWatchUrl("https://studio/")->tls);
  EXPECT_EQ(ParseWatchUrl("wss://studio")->port, "443");
}

TEST(WatchUrl, LoopbackIsKnownByItsAddress) {
  for (const char* url : {"http://localhost:1", "http://127.0.0.1", "http://[::1]:80", "http://127.3.2.1"})
    EXPECT_TRUE(IsThisMachine(*ParseWatchUrl(url))) << url;
  for (const char* url :
       {"http://127.evil.example", "http://studio", "http://10.0.0.1", "http://localhost.x"})
    EXPECT_FALSE(IsThisMachine(*ParseWatchUrl(url))) << url;
}

TEST(WatchUrl, OthersAreRefusedWithTheReason) {
  for (const char* url : {"", "localhost:8090", "ftp://x", "http://", "http://:80", "http://x:0",
                          "http://x:99999", "http://x:8o", "http://user@x", "http://x y/"}) {
    EXPECT_FALSE(ParseWatchUrl(url)) << url;
  }
}

}  // namespace
}  // namespace mixstage
