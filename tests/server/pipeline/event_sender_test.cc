// SPDX-License-Identifier: Apache-2.0
#include "server/pipeline/event_sender.h"

#include <gtest/gtest.h>

#include "proto/link/fixed_text.h"

namespace mixstage {
namespace {

TEST(EventSender, ATouchIsOneMessageOfAll) {
  EventSender sender;
  PhysicsEvent event{.kind = PhysicsEventKind::kTouch,
                     .t_us = 7,
                     .object = 3,
                     .name = "vase",
                     .with = "ball",
                     .with_object = 4};
  event.point = {1, -2, 0.5};
  event.normal = {0, 0, 1};
  event.impulse_ns = 0.25;
  const auto first = sender.Next(event);
  EXPECT_NE(first.epoch, 0);
  EXPECT_EQ(first.sequence, 0);
  EXPECT_EQ(first.t_us, 7);
  EXPECT_EQ(first.kind, 1);
  EXPECT_EQ(first.object, 3);
  EXPECT_EQ(first.with_object, 4);
  EXPECT_EQ(first.point[1], -2);
  EXPECT_EQ(first.normal[2], 1);
  EXPECT_EQ(first.impulse_ns, 0.25f);
  EXPECT_EQ(ReadFixedText(first.name), "vase");
  EXPECT_EQ(ReadFixedText(first.with), "ball");
  EXPECT_EQ(ReadFixedText(first.text), "");
  EXPECT_EQ(sender.Next(event).sequence, 1);
}

TEST(EventSender, LongTextsEndWithAWholeCharacter) {
  EventSender sender;
  const std::string umlauts = [] {
    std::string text = "x";
    for (int i = 0; i < 100; ++i) text += "\xc3\xa4";
    return text;
  }();
  const auto message = sender.Next({.kind = PhysicsEventKind::kMessage, .name = umlauts, .text = umlauts});
  EXPECT_EQ(ReadFixedText(message.name), umlauts.substr(0, 63));
  EXPECT_EQ(ReadFixedText(message.text), umlauts.substr(0, 159));
}

}  // namespace
}  // namespace mixstage
