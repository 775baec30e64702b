// SPDX-License-Identifier: Apache-2.0
#include "server/ingest/clock_map.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <limits>
#include <random>

namespace mixstage {
namespace {

TEST(ClockMap, FindsTheOffsetUnderJitterFromTheFastestMessage) {
  ClockMap clock;
  std::mt19937 random(1);
  std::exponential_distribution<double> jitter_us(1.0 / 3000);
  constexpr std::int64_t kOffset = 123'456'789;
  for (std::int64_t t = 0; t < 9'000'000; t += 33'000) {
    clock.Observe(t, t + kOffset + 200 + static_cast<std::int64_t>(jitter_us(random)));
  }
  EXPECT_NEAR(static_cast<double>(clock.ToServer(5'000'000)), 5'000'000.0 + kOffset + 200, 100);
}

TEST(ClockMap, FollowsDrift) {
  ClockMap clock;
  // The agent's clock runs 100 ppm slow: the offset grows by 6 ms a minute.
  for (std::int64_t t = 0; t < 60'000'000; t += 33'000) clock.Observe(t, t + t / 10'000 + 1000);
  EXPECT_LT(std::llabs(clock.ToServer(60'000'000) - (60'000'000 + 6'000 + 1000)), 1100);
}

TEST(ClockMap, ForgedTimesDoNotOverflow) {
  ClockMap clock;
  clock.Observe(std::numeric_limits<std::int64_t>::min(), std::numeric_limits<std::int64_t>::max());
  clock.Observe(std::numeric_limits<std::int64_t>::max(), 5);
  EXPECT_LT(clock.ToServer(std::numeric_limits<std::int64_t>::min()), 0);
  EXPECT_EQ(ClockMap().ToServer(7), 7);
}

}  // namespace
}  // namespace mixstage
