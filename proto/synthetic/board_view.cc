// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/board_view.h"

#include <algorithm>
#include <cmath>

#include "proto/synthetic/texture.h"

namespace mixstage {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr int kSide = 8;                          // rays along a pixel's side
constexpr int kLightColumns = 6, kLightRows = 5;  // where a board's light is computed
constexpr int kLightRays = 40;

// What a white surface in the board's place would show, over the board: the plate's three layers.
class BoardLight {
 public:
  BoardLight(const StandingBoard& board, const RoomLight& light, const Vector3d& viewer)
      : low_(board.board.Low()), size_(board.board.High() - low_) {
    Vector3d normal = board.FrontNormal();
    if (normal.dot(viewer - board.Center()) < 0) normal = -normal;
    for (int j = 0; j < kLightRows; ++j) {
      for (int i = 0; i < kLightColumns; ++i) {
        const Vector2d at =
            low_ + Vector2d(size_.x() * i / (kLightColumns - 1), size_.y() * j / (kLightRows - 1));
        const Vector3d p = board.T_world_board * Vector3d(at.x(), at.y(), 0);
        const auto seed = static_cast<std::uint32_t>(j * kLightColumns + i);
        auto lamp = [&](const SyntheticLamp& l) -> Vector3f {
          return light.Visibility(l, p, normal, kLightRays, seed) * UnitIrradiance(l, p, normal) * l.radiance;
        };
        Layers& here = nodes_[j][i];
        here.window = lamp(light.window());
        here.softbox = lamp(light.softbox());
        here.rest = light.Bounced(p, normal, kLightRays, Mix(seed, 2)) + light.Lamp(p, normal, Mix(seed, 3));
      }
    }
  }

  struct Layers {
    Vector3f window = Vector3f::Zero(), softbox = Vector3f::Zero(), rest = Vector3f::Zero();
    void Add(const Layers& other, float weight) {
      window += weight * other.window;
      softbox += weight * other.softbox;
      rest += weight * other.rest;
    }
  };

  [[nodiscard]] Layers At(const Vector2d& at) const {
    const double x = std::clamp((at.x() - low_.x()) / size_.x(), 0.0, 1.0) * (kLightColumns - 1);
    const double y = std::clamp((at.y() - low_.y()) / size_.y(), 0.0, 1.0) * (kLightRows - 1);
    const int i = std::min(static_cast<int>(x), kLightColumns - 2);
    const int j = std::min(static_cast<int>(y), kLightRows - 2);
    const auto fx = static_cast<float>(x - i);
    const auto fy = static_cast<float>(y - j);
    Layers sum;
    sum.Add(nodes_[j][i], (1 - fx) * (1 - fy));
    sum.Add(nodes_[j][i + 1], fx * (1 - fy));
    sum.Add(nodes_[j + 1][i], (1 - fx) * fy);
    sum.Add(nodes_[j + 1][i + 1], fx * fy);
    return sum;
  }

 private:
  Vector2d low_, size_;
  Layers nodes_[kLightRows][kLightColumns];
};

class BoardPainter {
 public:
  BoardPainter(const std::vector<StandingBoard>& boards, const Room& room, const RoomLight& light,
               RoomPlate& plate)
      : boards_(boards), room_(room), plate_(plate) {
    lights_.reserve(boards.size());
    for (const StandingBoard& board : boards) {
      lights_.emplace_back(board, light, plate.origin);
      cones_.push_back(ConeOf(board, plate.origin));
    }
  }

  void Run() {
    cv::parallel_for_(cv::Range(0, plate_.padded_height), [&](const cv::Range& rows) {
      for (int v = rows.start; v < rows.end; ++v) {
        for (int u = 0; u < plate_.padded_width; ++u) {
          if (plate_.vignette(v, u) > 0 && MayMeet(u, v)) PaintPixel(u, v);
        }
      }
    });
  }

 private:
  // Directions around a board's middle in which the board can be.
  struct Cone {
    Vector3d axis;
    double least_cosine;
  };
  static Cone ConeOf(const StandingBoard& board, const Vector3d& viewer) {
    constexpr double kPixel_rad = 0.02;  // wider than any lens' pixel
    const Vector3d to = board.Center() - viewer;
    const double radius_m = 0.5 * (board.board.High() - board.board.Low()).norm();
    const double distance_m = to.norm();
    if (distance_m <= radius_m) return {Vector3d::UnitX(), -2};
    return {to / distance_m, std::cos(std::asin(radius_m / distance_m) + kPixel_rad)};
  }
  [[nodiscard]] bool MayMeet(int u, int v) const {
    const Vector3d ray(plate_.ray[0](v, u), plate_.ray[1](v, u), plate_.ray[2](v, u));
    const double length = ray.norm();
    return std::any_of(cones_.begin(), cones_.end(),
                       [&](const Cone& cone) { return ray.dot(cone.axis) > cone.least_cosine * length; });
  }

  // Rays along a pixel's side: none where no corner of it meets a board (the paper's own corners may lose a
  // part of a pixel), one where all lie in one square, which has one colour.
  [[nodiscard]] int RaysAlong(int u, int v) const {
    struct Square {
      std::size_t board;
      double i, j;
      bool operator==(const Square&) const = default;
    };
    std::optional<Square> first;
    int met = 0;
    bool one = true;
    for (int k = 0; k < 4; ++k) {
      const Ray ray{plate_.origin, plate_.RayAt(u - 0.5 + k % 2, v - 0.5 + k / 2).normalized()};
      const auto hit = MeetBoards(boards_, ray, INFINITY);
      if (!hit) continue;
      ++met;
      const double square_m = boards_[hit->board].board.square_m;
      const Square square{hit->board, std::floor(hit->met.at.x() / square_m),
                          std::floor(hit->met.at.y() / square_m)};
      one = one && (!first || square == *first);
      first = square;
    }
    return met == 0 ? 0 : one && met == 4 ? 1 : kSide;
  }

  void PaintPixel(int u, int v) {
    const int side = RaysAlong(u, v);
    BoardLight::Layers sum;
    int met = 0;
    double room_m = -1;  // along the pixel's first ray that meets a board
    for (int k = 0; k < side * side; ++k) {
      const double us = u + (k % side + 0.5) / side - 0.5;
      const double vs = v + (k / side + 0.5) / side - 0.5;
      const Ray ray{plate_.origin, plate_.RayAt(us, vs).normalized()};
      const auto hit = MeetBoards(boards_, ray, INFINITY);
      if (!hit) continue;
      // What hides a board rarely does so in a part of a pixel: one ray decides where nothing is near.
      if (room_m < 0) room_m = room_.Trace(ray).range_m;
      if (room_m < hit->met.range_m + 0.05 && room_.Trace(ray).range_m < hit->met.range_m) continue;
      ++met;
      const StandingBoard& board = boards_[hit->board];
      sum.Add(lights_[hit->board].At(hit->met.at), board.AlbedoAt(hit->met));
    }
    if (met == 0) return;
    const auto rays = static_cast<float>(side * side);
    const float covered = static_cast<float>(met) / rays;
    const float gain = plate_.vignette(v, u) / rays;
    for (int c = 0; c < 3; ++c) {
      Mix(plate_.window[c](v, u), covered, gain * sum.window[c]);
      Mix(plate_.softbox[c](v, u), covered, gain * sum.softbox[c]);
      Mix(plate_.rest[c](v, u), covered, gain * sum.rest[c]);
    }
  }
  static void Mix(float& value, float covered, float board) { value = (1 - covered) * value + board; }

  const std::vector<StandingBoard>& boards_;
  const Room& room_;
  RoomPlate& plate_;
  std::vector<BoardLight> lights_;
  std::vector<Cone> cones_;
};

}  // namespace

void DrawBoards(const std::vector<StandingBoard>& boards, const Room& room, const RoomLight& light,
                RoomPlate& plate) {
  if (!boards.empty()) BoardPainter(boards, room, light, plate).Run();
}

RoomPlate CopyOf(const RoomPlate& plate) {
  RoomPlate copy = plate;
  auto own = [](cv::Mat1f& picture) { picture = picture.clone(); };
  own(copy.vignette);
  for (int c = 0; c < 3; ++c) {
    for (cv::Mat1f* picture : {&copy.ray[c], &copy.window[c], &copy.softbox[c], &copy.rest[c],
                               &copy.node_point[c], &copy.node_normal[c]}) {
      own(*picture);
    }
  }
  return copy;
}

}  // namespace mixstage
