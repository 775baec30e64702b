// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/predicted_background.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <random>

#include "server/segmentation/key.h"
#include "server/segmentation/labels.h"
#include "server/segmentation/refined_background.h"
#include "tests/server/segmentation/flat_room.h"

namespace mixstage {
namespace {

constexpr int kWidth = 320, kHeight = 240;

// A wall 3 m away, two greys beside each other; its right quarter was never observed.
RoomPrediction SomeRoom() {
  RoomPrediction room;
  room.drawing = 1;
  room.width = kWidth;
  room.height = kHeight;
  for (cv::Mat1b* plane : {&room.r, &room.g, &room.b}) {
    plane->create(kHeight / 2, kWidth / 2);
    plane->setTo(150);
    (*plane)(cv::Rect(0, 0, 60, kHeight / 2)).setTo(80);
  }
  room.seen = cv::Mat1b(kHeight / 2, kWidth / 2, RoomPrediction::kSeen);
  room.depth_m = cv::Mat1f(kHeight, kWidth, 3.0f);
  const cv::Rect unseen(120, 0, 40, kHeight / 2);
  for (cv::Mat1b* plane : {&room.r, &room.g, &room.b, &room.seen}) (*plane)(unseen).setTo(0);
  room.depth_m(cv::Rect(240, 0, 80, kHeight)).setTo(0);
  return room;
}

struct Show {
  HalfPicture picture;
  cv::Mat1b luma;
  cv::Mat1f depth_m;
};

// What the cameras see of it, brighter by a tenth, with noise of sigma grey levels and sigma_m; an actor of
// 140 80 60 stands 2 m away in `actor` (half pixels).
Show Record(const RoomPrediction& room, double sigma, double sigma_m, cv::Rect actor, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Show show;
  const std::array<std::pair<const cv::Mat1b*, cv::Mat1b*>, 3> planes = {
      {{&room.r, &show.picture.r}, {&room.g, &show.picture.g}, {&room.b, &show.picture.b}}};
  const std::array<double, 3> coat = {140, 80, 60};
  for (std::size_t c = 0; c < 3; ++c) {
    planes[c].second->create(room.r.size());
    for (int y = 0; y < room.r.rows; ++y) {
      for (int x = 0; x < room.r.cols; ++x) {
        const double here = room.seen(y, x) == 0 ? 110 : (*planes[c].first)(y, x);
        const double color = actor.contains({x, y}) ? coat[c] : 1.1 * here;
        (*planes[c].second)(y, x) = cv::saturate_cast<std::uint8_t>(color + sigma * normal(random));
      }
    }
  }
  show.luma = LumaOf(show.picture, kWidth, kHeight);
  show.depth_m.create(kHeight, kWidth);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const double z = actor.contains({x / 2, y / 2}) ? 2 : 3;
      show.depth_m(y, x) = static_cast<float>(z + sigma_m * normal(random));
    }
  }
  return show;
}

TEST(PredictionNoise, IsTheSensorsEvenWithAnActorInThePicture) {
  const RoomPrediction room = SomeRoom();
  PredictionNoise noise;
  for (unsigned seed = 0; seed < 4; ++seed) {
    const Show show = Record(room, 4.0, 0.05, {30, 30, 40, 60}, seed);
    noise.Add(room, show.picture, View(std::as_const(show.depth_m)));
  }
  EXPECT_NEAR(noise.color_sigma(0, 150), 4.0, 0.5);
  EXPECT_NEAR(noise.color_sigma(1, 80), 4.0, 0.5);
  EXPECT_NEAR(noise.depth_sigma_m(3.0f), 0.05, 0.01);
}

TEST(PredictedBackground, DoubtsColorsWhereTheRoomIsPatterned) {
  BackgroundModel model;
  PredictBackground(SomeRoom(), {}, {.registration_px = 0.5f, .depth_sigma_m = 0}, &model);
  EXPECT_GT(model.variance[0](50, 60), 10 * model.variance[0](50, 30));  // where the greys meet
}

TEST(PredictedBackground, KeysTheActorAndSaysUnknownWhereNothingWasObserved) {
  const RoomPrediction room = SomeRoom();
  const cv::Rect actor(40, 30, 50, 70);
  PredictionNoise noise;
  const Show show = Record(room, 2.0, 0.05, actor, 1);
  noise.Add(room, show.picture, View(std::as_const(show.depth_m)));
  BackgroundModel model;
  PredictBackground(room, noise, {}, &model);
  auto key = Key::Create({});
  ASSERT_TRUE(key);
  cv::Mat1b label(kHeight, kWidth), alpha(kHeight, kWidth);
  key->Run(model, View(std::as_const(show.luma)), show.picture, View(std::as_const(show.depth_m)), 0,
           View(label), View(alpha));
  int wrong = 0;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const bool is_actor = actor.contains({x / 2, y / 2});
      const int expected = is_actor ? kLabelActor : x >= 240 ? kLabelUnknown : kLabelBackground;
      wrong += label(y, x) == expected ? 0 : 1;
    }
  }
  EXPECT_LT(wrong, 200);  // of 76,800; the actor's outline has 480 pixels
}

TEST(RefinedBackground, SeesTheRoomSharperAndAbsorbsNoStandingActor) {
  const RoomPrediction truth = SomeRoom();
  // The scan has the edge between the greys blurred and is off by 2 levels everywhere.
  RoomPrediction scan = truth;
  for (cv::Mat1b* plane : {&scan.r, &scan.g, &scan.b}) {
    *plane = plane->clone();
    cv::blur(*plane, *plane, {5, 1});
    (*plane)(cv::Rect(0, 0, 120, kHeight / 2)) += 2;
  }
  const cv::Rect stands(20, 40, 20, 50);
  PredictionNoise noise;
  for (unsigned seed = 0; seed < 4; ++seed) {
    const Show show = Record(truth, 1.5, 0.05, stands, seed);
    noise.Add(scan, show.picture, View(std::as_const(show.depth_m)));
  }
  auto predicted = std::make_shared<BackgroundModel>();
  PredictBackground(scan, noise, {}, predicted.get());
  RefinedBackground refined;
  refined.Begin(predicted);
  auto key = Key::Create({});
  ASSERT_TRUE(key);
  cv::Mat1b label(kHeight, kWidth), alpha(kHeight, kWidth);
  for (unsigned seed = 0; !refined.complete(); ++seed) {
    const Show show = Record(truth, 1.5, 0.05, stands, seed + 100);
    key->Run(*predicted, View(std::as_const(show.luma)), show.picture, View(std::as_const(show.depth_m)), 0,
             View(label), View(alpha));
    refined.Add(show.picture, key->tone(), key->half_mask(), View(std::as_const(label)));
  }
  BackgroundModel model;
  refined.Refine(&model);
  // Beside the edge: the scan has a ramp, the camera sees a step. Up to one gain, which the tone change takes
  // up.
  const float step = model.mean[1](110, 60) / model.mean[1](110, 59);
  EXPECT_NEAR(step, 150.0 / 80, 0.08);
  EXPECT_NEAR(predicted->mean[1](110, 60) / predicted->mean[1](110, 59), 112.0 / 96, 0.1);
  EXPECT_LT(model.variance[1](110, 60), 0.2f * predicted->variance[1](110, 60));
  // Where he stands the prediction is left as it was.
  EXPECT_EQ(model.mean[0](65, 30), predicted->mean[0](65, 30));
  const Show show = Record(truth, 1.5, 0.05, stands, 7);
  key->Run(model, View(std::as_const(show.luma)), show.picture, View(std::as_const(show.depth_m)), 0,
           View(label), View(alpha));
  EXPECT_EQ(label(130, 60), kLabelActor);
}

}  // namespace
}  // namespace mixstage
