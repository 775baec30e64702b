// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/opencv_figures.h"

#include <opencv2/calib3d.hpp>

#include "server/calibration/lens_start.h"

namespace mixstage {
namespace {

const SceneSighting* WholeSighting(const BoardScene& scene, std::size_t camera, std::size_t placement) {
  for (const SceneSighting& s : scene.sightings) {
    const Board& board = scene.boards[scene.placements[placement].board];
    if (s.camera == camera && s.placement == placement && s.left_out.empty() &&
        static_cast<int>(s.corners.corners.size()) == board.corners()) {
      return &s;
    }
  }
  return nullptr;
}

std::vector<cv::Point2f> Pixels(const BoardSighting& s) {
  std::vector<cv::Point2f> pixels;
  for (const auto& p : s.pixels) pixels.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()));
  return pixels;
}

double StereoRms(const BoardScene& scene, std::size_t camera, const Lens& first, const Lens& second) {
  std::vector<std::vector<cv::Point3f>> points;
  std::vector<std::vector<cv::Point2f>> a;
  std::vector<std::vector<cv::Point2f>> b;
  for (std::size_t p = 0; p < scene.placements.size(); ++p) {
    const SceneSighting* one = WholeSighting(scene, 0, p);
    const SceneSighting* other = WholeSighting(scene, camera, p);
    if (!one || !other) continue;
    const Board& board = scene.boards[scene.placements[p].board];
    auto& list = points.emplace_back();
    for (int i = 0; i < board.corners(); ++i)
      list.emplace_back(static_cast<float>(board.Corner(i).x()), static_cast<float>(board.Corner(i).y()),
                        0.0f);
    a.push_back(Pixels(one->corners));
    b.push_back(Pixels(other->corners));
  }
  if (points.size() < 3) return 0;
  auto K = [](const Lens& l) {
    return cv::Mat(cv::Matx33d(l.numbers[0], 0, l.numbers[2], 0, l.numbers[1], l.numbers[3], 0, 0, 1));
  };
  auto D = [](const Lens& l) {
    return cv::Mat(cv::Vec<double, 5>(l.numbers[4], l.numbers[5], l.numbers[6], l.numbers[7], l.numbers[8]));
  };
  cv::Mat K1 = K(first);
  cv::Mat K2 = K(second);
  cv::Mat D1 = D(first);
  cv::Mat D2 = D(second);
  cv::Mat R;
  cv::Mat T;
  cv::Mat E;
  cv::Mat F;
  try {
    return cv::stereoCalibrate(points, a, b, K1, D1, K2, D2, cv::Size(first.width, first.height), R, T, E, F,
                               cv::CALIB_FIX_INTRINSIC);
  } catch (const cv::Exception&) {
    return 0;
  }
}

}  // namespace

std::vector<OpenCvFigures> MeasureOpenCv(const BoardScene& scene) {
  std::vector<OpenCvFigures> figures(scene.cameras.size());
  std::optional<Lens> first;
  for (std::size_t c = 0; c < scene.cameras.size(); ++c) {
    if (scene.cameras[c].lens.kind != LensKind::kPinhole) continue;
    std::vector<BoardSighting> sightings;
    for (std::size_t p = 0; p < scene.placements.size(); ++p) {
      if (const SceneSighting* s = WholeSighting(scene, c, p)) sightings.push_back(s->corners);
    }
    const auto start = StartLens(scene.cameras[c].lens, scene.boards, sightings);
    if (!start) continue;
    figures[c].single_rms_px = start->rms_px;
    if (c == 0) first = start->lens;
    if (c > 0 && first) figures[c].stereo_rms_px = StereoRms(scene, c, *first, start->lens);
  }
  return figures;
}

}  // namespace mixstage
