// SPDX-License-Identifier: Apache-2.0
#include "proto/link/lcm_link.h"

#include <gtest/gtest.h>
#include <lcm/lcm.h>

#include "proto/link/reassembler.h"

namespace mixstage {
namespace {

TEST(LcmLink, APictureCrossesInsideTheProcess) {
  auto link = LcmLink::Create("memq://");
  ASSERT_TRUE(link) << link.error().message;
  ASSERT_TRUE((*link)->SelfTest());
  Reassembler reassembler;
  std::vector<EncodedFrame> received;
  (*link)->Subscribe({.on_slice = [&](const mixstage_lcm::frame_slice_t& s) {
    reassembler.Add(s, 0);
    while (auto f = reassembler.Next(0)) received.push_back(*f);
  }});
  EncodedFrame frame;
  frame.epoch = 1;
  frame.width = 10;
  frame.height = 10;
  frame.bytes.assign(100'000, 7);
  CutIntoSlices(frame, [&](const mixstage_lcm::frame_slice_t& s) { EXPECT_TRUE((*link)->Publish(s)); });
  (*link)->HandleFor(100);
  ASSERT_EQ(received.size(), 1u);
  EXPECT_EQ(received[0].bytes, frame.bytes);
}

TEST(LcmLink, AnEventOfTheSceneIsHeard) {
  auto link = LcmLink::Create("memq://");
  ASSERT_TRUE(link) << link.error().message;
  int heard = 0;
  (*link)->Subscribe({.on_event = [&](const mixstage_lcm::scene_event_t& event) {
    ++heard;
    EXPECT_EQ(event.sequence, 5);
  }});
  mixstage_lcm::scene_event_t event{};
  event.sequence = 5;
  EXPECT_TRUE((*link)->Publish(event));
  (*link)->HandleFor(100);
  EXPECT_EQ(heard, 1);
}

TEST(LcmLink, AWrongUrlNamesTheFix) {
  auto link = LcmLink::Create("nonsense://here");
  ASSERT_FALSE(link);
  EXPECT_NE(link.error().message.find("nonsense://here"), std::string::npos);
}

TEST(LcmLink, AMessageOfOurTypesIsOneDatagram) {
  EXPECT_EQ(mixstage_lcm::frame_slice_t{}.getEncodedSize(), 1338);
  EXPECT_LE(mixstage_lcm::agent_health_t{}.getEncodedSize(), 1400);
  EXPECT_LE(mixstage_lcm::agent_command_t{}.getEncodedSize(), 1400);
  EXPECT_EQ(mixstage_lcm::scan_progress_t{}.getEncodedSize(), 1185);
  EXPECT_EQ(mixstage_lcm::scene_event_t{}.getEncodedSize(), 357);
}

}  // namespace
}  // namespace mixstage
