// SPDX-License-Identifier: Apache-2.0
#include "server/app/progress_sender.h"

#include <gtest/gtest.h>

#include <chrono>
#include <future>
#include <vector>

namespace mixstage {
namespace {

TEST(ProgressSender, RepeatsWhatWasSaidAndTheLastWordThreeTimes) {
  std::vector<mixstage_lcm::scan_progress_t> sent;  // of the sender's thread
  std::promise<void> repeated;
  {
    ProgressSender sender(
        [&](const mixstage_lcm::scan_progress_t& m) {
          sent.push_back(m);
          if (m.state == 2 && sent.size() >= 2 && sent[sent.size() - 2].state == 2) repeated.set_value();
        },
        {.positions = 4});
    sender.Say({.state = ScanState::kCompute, .positions = 4, .text = "register"});
    ASSERT_EQ(repeated.get_future().wait_for(std::chrono::seconds(20)), std::future_status::ready);
    sender.Say({.state = ScanState::kDone, .positions = 4, .recorded = 4});
  }
  ASSERT_GE(sent.size(), 5u);
  for (std::size_t i = 0; i < sent.size(); ++i) {
    EXPECT_EQ(sent[i].epoch, sent[0].epoch);
    EXPECT_EQ(sent[i].sequence, static_cast<std::int64_t>(i));
    EXPECT_TRUE(ReadScanProgress(sent[i]));
  }
  for (std::size_t i = sent.size() - 3; i < sent.size(); ++i) EXPECT_EQ(sent[i].state, 3);
}

}  // namespace
}  // namespace mixstage
