// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <string_view>
#include <thread>

#include "proto/base/bounded_queue.h"
#include "proto/base/crc32c.h"

namespace mixstage {
namespace {

TEST(Crc32c, GivesTheCheckValueOfTheStandard) {
  constexpr std::string_view kCheck = "123456789";
  EXPECT_EQ(Crc32c({reinterpret_cast<const std::uint8_t*>(kCheck.data()), kCheck.size()}), 0xE3069283u);
  const std::array<std::uint8_t, 32> zeros{};
  EXPECT_EQ(Crc32c(zeros), 0x8A9136AAu);  // RFC 3720 B.4
}

TEST(BoundedQueue, DropsTheOldestWhenFull) {
  BoundedQueue<int> queue(2, WhenFull::kDropOldest);
  EXPECT_EQ(queue.Push(1), 0);
  EXPECT_EQ(queue.Push(2), 0);
  EXPECT_EQ(queue.Push(3), 1);
  EXPECT_EQ(queue.Pop(), 2);
  EXPECT_EQ(queue.Pop(), 3);
}

TEST(BoundedQueue, AWaitingProducerGoesOnWhenSpaceAppears) {
  BoundedQueue<int> queue(1, WhenFull::kWait);
  queue.Push(1);
  std::jthread producer([&] { queue.Push(2); });
  EXPECT_EQ(queue.Pop(), 1);
  EXPECT_EQ(queue.Pop(), 2);
}

TEST(BoundedQueue, WhatIsQueuedSurvivesClose) {
  BoundedQueue<int> queue(2, WhenFull::kWait);
  queue.Push(7);
  queue.Close();
  EXPECT_EQ(queue.Push(8), 1);
  EXPECT_EQ(queue.Pop(), 7);
  EXPECT_EQ(queue.Pop(), std::nullopt);
}

}  // namespace
}  // namespace mixstage
