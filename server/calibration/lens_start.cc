// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/lens_start.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/calib3d.hpp>

#include "server/calibration/board_pose.h"
#include "server/calibration/joint_adjustment.h"

namespace mixstage {
namespace {

constexpr int kFewestSightings = 3;

bool IsFree(const Lens& lens, int number) {
  return std::find(lens.free.begin(), lens.free.end(), number) != lens.free.end();
}

int OpenCvFlags(const Lens& lens) {
  int flags = 0;
  if (!IsFree(lens, 4)) flags |= cv::CALIB_FIX_K1;
  if (!IsFree(lens, 5)) flags |= cv::CALIB_FIX_K2;
  if (!IsFree(lens, 6)) flags |= cv::CALIB_ZERO_TANGENT_DIST;
  if (!IsFree(lens, 8)) flags |= cv::CALIB_FIX_K3;
  return flags;
}

Result<LensStart> StartPinhole(const Lens& guess, const std::vector<Board>& boards,
                               std::vector<const BoardSighting*> sightings) {
  LensStart start;
  start.lens = guess;
  while (true) {
    if (static_cast<int>(sightings.size()) < kFewestSightings)
      return Fail(ErrorCode::kQualityGate,
                  "only " + std::to_string(sightings.size()) + " boards fit together; 3 are the least");
    std::vector<std::vector<cv::Point3f>> points;
    std::vector<std::vector<cv::Point2f>> pixels;
    for (const BoardSighting* s : sightings) {
      auto& p = points.emplace_back();
      auto& q = pixels.emplace_back();
      for (std::size_t i = 0; i < s->corners.size(); ++i) {
        const Eigen::Vector3d corner = boards[s->board].Corner(s->corners[i]);
        p.emplace_back(static_cast<float>(corner.x()), static_cast<float>(corner.y()), 0.0f);
        q.emplace_back(static_cast<float>(s->pixels[i].x()), static_cast<float>(s->pixels[i].y()));
      }
    }
    cv::Matx33d K = cv::Matx33d::eye();
    cv::Mat distortion = cv::Mat::zeros(1, 5, CV_64F);
    std::vector<cv::Mat> turns;
    std::vector<cv::Mat> shifts;
    cv::Mat deviations;
    cv::Mat pose_deviations;
    cv::Mat errors;
    try {
      start.rms_px =
          cv::calibrateCamera(points, pixels, cv::Size(guess.width, guess.height), K, distortion, turns,
                              shifts, deviations, pose_deviations, errors, OpenCvFlags(guess));
    } catch (const cv::Exception& e) {
      return Fail(ErrorCode::kQualityGate, std::string("no lens fits these boards (") + e.err + ")");
    }
    start.sightings = static_cast<int>(sightings.size());
    start.lens.numbers = {
        K(0, 0), K(1, 1), K(0, 2), K(1, 2), distortion.at<double>(0), distortion.at<double>(1)};
    start.lens.numbers[6] = distortion.at<double>(2);
    start.lens.numbers[7] = distortion.at<double>(3);
    start.lens.numbers[8] = distortion.at<double>(4);
    std::vector<double> sorted(errors.begin<double>(), errors.end<double>());
    std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2),
                     sorted.end());
    const double limit = std::max(1.0, 5 * sorted[sorted.size() / 2]);
    const auto worst = std::max_element(errors.begin<double>(), errors.end<double>());
    if (*worst <= limit) break;
    sightings.erase(sightings.begin() + (worst - errors.begin<double>()));
  }
  if (!std::all_of(start.lens.numbers.begin(), start.lens.numbers.end(),
                   [](double x) { return std::isfinite(x); }) ||
      !(start.lens.numbers[0] > 0 && start.lens.numbers[1] > 0)) {
    return Fail(ErrorCode::kQualityGate, "no lens fits these boards");
  }
  return start;
}

BoardScene OneCamera(const Lens& lens, const std::vector<Board>& boards,
                     const std::vector<const BoardSighting*>& sightings) {
  BoardScene scene;
  scene.boards = boards;
  scene.cameras.push_back({"", lens, RigidTransform::Identity(), 0.2});
  for (const BoardSighting* s : sightings) {
    scene.placements.push_back({"", 0, s->board, PoseOfBoard(lens, boards[s->board], *s), false});
    scene.sightings.push_back({0, scene.placements.size() - 1, *s, "", "", 0});
  }
  return scene;
}

// Of every sighting, rising; infinite where it has no pose.
std::vector<double> SortedRms(const BoardScene& scene) {
  std::vector<double> rms;
  for (const SceneSighting& s : scene.sightings) {
    double sum = 0;
    if (scene.Used(s)) {
      const auto residuals = CornerResiduals(scene, s);
      for (const Eigen::Vector2d& r : residuals)
        sum += r.squaredNorm() / static_cast<double>(residuals.size());
    }
    rms.push_back(scene.Used(s) ? std::sqrt(sum) : std::numeric_limits<double>::infinity());
  }
  std::sort(rms.begin(), rms.end());
  return rms;
}

double MedianRms(const BoardScene& scene) {
  const auto rms = SortedRms(scene);
  return rms[rms.size() / 2];
}

// Of the sightings within three times their median.
double RmsWithoutOutliers(const BoardScene& scene) {
  const auto rms = SortedRms(scene);
  double sum = 0, n = 0;
  for (const double r : rms) {
    if (r > 3 * rms[rms.size() / 2]) break;
    sum += r * r;
    ++n;
  }
  return n > 0 ? std::sqrt(sum / n) : std::numeric_limits<double>::infinity();
}

Result<LensStart> StartFisheye(const Lens& guess, const std::vector<Board>& boards,
                               const std::vector<const BoardSighting*>& sightings) {
  if (static_cast<int>(sightings.size()) < kFewestSightings)
    return Fail(ErrorCode::kQualityGate,
                "only " + std::to_string(sightings.size()) + " boards; 3 are the least");
  std::vector<Lens> candidates = {guess};
  for (double half_field_deg : {60, 70, 80, 90, 100, 110}) {
    for (int side : {std::min(guess.width, guess.height), std::max(guess.width, guess.height)}) {
      Lens lens = AssumedLens(LensKind::kFisheye, guess.width, guess.height);
      lens.numbers[0] = lens.numbers[1] = 0.5 * side / (half_field_deg * std::numbers::pi / 180);
      candidates.push_back(lens);
    }
  }
  const Lens* best = nullptr;
  double best_rms = std::numeric_limits<double>::infinity();
  for (Lens& lens : candidates) {
    lens.max_angle_rad = std::numbers::pi;  // a guess may not refuse a corner
    BoardScene scene = OneCamera(lens, boards, sightings);
    const double rms = MedianRms(scene);
    if (rms < best_rms) {
      best = &lens;
      best_rms = rms;
    }
  }
  if (!best) return Fail(ErrorCode::kQualityGate, "no equidistant lens fits these boards");
  BoardScene scene = OneCamera(*best, boards, sightings);
  scene.cameras[0].lens.free = {0, 1, 2, 3};
  if (auto ok = AdjustJointly(scene); !ok) return tl::unexpected(ok.error());
  scene = OneCamera(scene.cameras[0].lens, boards, sightings);  // boards that the first guess turned over
  scene.cameras[0].lens.free = guess.free;
  if (auto ok = AdjustJointly(scene); !ok) return tl::unexpected(ok.error());
  LensStart start{scene.cameras[0].lens, RmsWithoutOutliers(scene), static_cast<int>(sightings.size())};
  start.lens.max_angle_rad = guess.max_angle_rad;
  if (!(start.lens.numbers[0] > 0 && start.lens.numbers[1] > 0) || !(start.rms_px < 0.02 * guess.width))
    return Fail(ErrorCode::kQualityGate, "no fisheye lens fits these boards");
  return start;
}

}  // namespace

Result<LensStart> StartLens(const Lens& guess, const std::vector<Board>& boards,
                            const std::vector<BoardSighting>& sightings) {
  std::vector<const BoardSighting*> whole;
  std::vector<BoardSighting> by_gradient;
  for (const BoardSighting& s : sightings) {
    if (static_cast<int>(s.corners.size()) != boards[s.board].corners()) continue;
    whole.push_back(&s);
    if (s.gradient_pixels.size() != s.pixels.size()) continue;
    by_gradient.push_back(s);
    by_gradient.back().pixels = s.gradient_pixels;
  }
  const auto start = [&](const std::vector<const BoardSighting*>& with) {
    return guess.kind == LensKind::kPinhole ? StartPinhole(guess, boards, with)
                                            : StartFisheye(guess, boards, with);
  };
  auto saddle = start(whole);
  if (!saddle || by_gradient.size() != whole.size()) return saddle;
  std::vector<const BoardSighting*> others;
  for (const BoardSighting& s : by_gradient) others.push_back(&s);
  auto gradient = start(others);
  if (!gradient || gradient->sightings < saddle->sightings || gradient->rms_px > 0.98 * saddle->rms_px)
    return saddle;
  gradient->corners = CornerKind::kGradient;
  return gradient;
}

void UseCorners(BoardScene& scene, std::size_t camera, CornerKind kind) {
  if (kind == CornerKind::kSaddle) return;
  for (SceneSighting& s : scene.sightings)
    if (s.camera == camera && s.corners.gradient_pixels.size() == s.corners.pixels.size())
      s.corners.pixels = s.corners.gradient_pixels;
}

Lens AssumedLens(LensKind kind, int width_px, int height_px) {
  constexpr double kRad = std::numbers::pi / 180;
  Lens lens = kind == LensKind::kPinhole ? LensOf(PinholeCamera{}) : LensOf(FisheyeCamera{});
  lens.width = width_px;
  lens.height = height_px;
  const double f = kind == LensKind::kPinhole ? 0.5 * width_px / std::tan(30 * kRad)
                                              : std::min(width_px, height_px) / (190 * kRad);
  lens.numbers[0] = lens.numbers[1] = f;
  lens.numbers[2] = 0.5 * (width_px - 1);
  lens.numbers[3] = 0.5 * (height_px - 1);
  return lens;
}

}  // namespace mixstage
