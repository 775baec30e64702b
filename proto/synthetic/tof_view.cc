// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/tof_view.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "proto/base/check.h"

namespace mixstage {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
constexpr double kTwoPi = 2 * std::numbers::pi;

constexpr float kAmplitudeCounts = 16000;  // of light 1: a white wall seen straight at 1 m
constexpr int kMargin_px = 1;
// Phasors of a camera that does not wrap turn once in this range, beyond the room.
constexpr double kUnwrappedTurn_m = 30;

// Eight places of a pixel, no two in a row or column.
constexpr double kPlace[8][2] = {{-0.4375, -0.1875}, {-0.3125, 0.3125}, {-0.1875, -0.4375}, {-0.0625, 0.0625},
                                 {0.0625, 0.4375},   {0.1875, -0.3125}, {0.3125, -0.0625},  {0.4375, 0.1875}};

// In the infrared most materials are brighter and less coloured than to the eye; glass lets light out.
float InfraredAlbedo(Surface surface, const Eigen::Vector3f& albedo) {
  if (surface == Surface::kPane) return 0.06f;
  if (surface == Surface::kLeaf) return 0.55f;
  return 0.15f + 0.75f * albedo.mean();
}

}  // namespace

float TofView::RangeNoise_m(float light) {
  // Shot noise of the returning and of the ambient light over the modulated part.
  constexpr float kScale_m = 0.0026f;
  constexpr float kAmbient = 0.045f;
  return std::min(kScale_m * std::sqrt(kAmbient + light) / std::max(light, 1e-5f), 1.5f);
}

TofView::TofView(const Room& room, const std::vector<StandingBoard>& boards, const Rig& rig,
                 const RigidTransform& T_world_color) {
  MIX_CHECK(rig.depth.has_value());
  camera_ = *rig.depth;
  T_world_depth_ = rig.registered ? T_world_color : T_world_color * rig.T_color_depth;
  radians_per_m_ = static_cast<float>(kTwoPi / camera_.unambiguous_range_m.value_or(kUnwrappedTurn_m));
  TraceRoom(room, boards);
}

void TofView::TraceRoom(const Room& room, const std::vector<StandingBoard>& boards) {
  const PinholeCamera& c = camera_.camera;
  const auto pixels = static_cast<std::size_t>(c.width) * static_cast<std::size_t>(c.height);
  for (auto& plane : ray_) plane.assign(pixels * kRays, 0);
  length_.assign(pixels * kRays, 1);
  room_re_.assign(pixels * kRays, 0);
  room_im_.assign(pixels * kRays, 0);
  z_per_range_.assign(pixels, 1);
  room_range_m_.assign(pixels, 0);
  room_.assign(pixels, {});
  const Eigen::Matrix3d R = T_world_depth_.linear();
  cv::parallel_for_(cv::Range(0, c.height), [&](const cv::Range& rows) {
    for (int v = rows.start; v < rows.end; ++v) {
      for (int u = 0; u < c.width; ++u) {
        const auto pixel =
            static_cast<std::size_t>(v) * static_cast<std::size_t>(c.width) + static_cast<std::size_t>(u);
        const auto center = c.Unproject(Vector2d(u, v));
        if (!center) continue;  // stays without light: no measurement
        const Vector3d axis = R * Vector3d(center->x(), center->y(), 1);
        z_per_range_[pixel] = static_cast<float>(1 / axis.norm());
        const Ray central{T_world_depth_.translation(), axis.normalized()};
        double nearest_m = room.Trace(central).range_m;
        if (const auto hit = MeetBoards(boards, central, nearest_m)) nearest_m = hit->met.range_m;
        room_range_m_[pixel] = static_cast<float>(nearest_m);
        float re = 0;
        float im = 0;
        for (std::size_t k = 0; k < kRays; ++k) {
          const Vector2d n = c.Unproject(Vector2d(u + kPlace[k][0], v + kPlace[k][1])).value_or(*center);
          const Vector3d d = R * Vector3d(n.x(), n.y(), 1);
          const std::size_t at = pixel * kRays + k;
          for (int i = 0; i < 3; ++i) ray_[i][at] = static_cast<float>(d[i]);
          length_[at] = static_cast<float>(d.norm());
          const Ray ray{T_world_depth_.translation(), d.normalized()};
          const Room::Found found = room.Trace(ray);
          const Vector3d p = ray.origin + found.range_m * ray.direction;
          double range_m = found.range_m;
          Vector3d normal = found.normal;
          float albedo = 0;
          if (const auto hit = MeetBoards(boards, ray, found.range_m)) {
            const StandingBoard& board = boards[hit->board];
            range_m = hit->met.range_m;
            normal = board.FrontNormal();
            albedo = InfraredAlbedo(Surface::kPaint, Eigen::Vector3f::Constant(board.AlbedoAt(hit->met)));
          } else {
            albedo = InfraredAlbedo(found.surface, room.MaterialAt(found, p).albedo);
          }
          const double light = albedo * std::abs(normal.dot(ray.direction)) / (range_m * range_m);
          const double phase = range_m * radians_per_m_;
          room_re_[at] = static_cast<float>(light * std::cos(phase));
          room_im_[at] = static_cast<float>(light * std::sin(phase));
          re += room_re_[at];
          im += room_im_[at];
        }
        room_[pixel] = Measure(re, im, room_range_m_[pixel], pixel);
      }
    }
  });
}

TofView::Pixel TofView::Measure(float re, float im, float near_m, std::size_t pixel) const {
  Pixel out;
  out.light = std::hypot(re, im) / kRays;
  if (out.light <= 0) return out;
  // The phase knows the range up to whole turns; the curve of systematic errors is that of the true range.
  const double turn_m = kTwoPi / radians_per_m_;
  double range_m = std::atan2(im, re) / radians_per_m_;
  range_m += turn_m * std::round((near_m - range_m) / turn_m);
  if (range_m <= 0) range_m += turn_m;
  const double measured = camera_.measures == DepthMeasure::kZ ? range_m * z_per_range_[pixel] : range_m;
  out.reported_m = static_cast<float>(measured + camera_.range_error.At(measured));
  return out;
}

void TofView::Render(const Figure* figure, std::uint32_t frame, const NoiseTape& tape, SensorNoise noise,
                     cv::Mat1w& range, cv::Mat1w& amplitude) {
  const PinholeCamera& c = camera_.camera;
  range.create(c.height, c.width);
  amplitude.create(c.height, c.width);
  if (figure != nullptr) {
    ViewFigure(*figure, c, T_world_depth_, kMargin_px, view_);
  } else {
    view_.u0 = view_.v0 = 0;
    view_.u1 = view_.v1 = -1;
  }
  const float noise_scale = noise == SensorNoise::kReal ? 1.f : 0.f;
  const auto counts_per_m = static_cast<float>(1 / camera_.unit_m);
  const auto wrap_m = static_cast<float>(camera_.unambiguous_range_m.value_or(0));
  std::uint8_t in_row[Figure::kMaxParts];
  std::uint8_t here[Figure::kMaxParts];
  for (int v = 0; v < c.height; ++v) {
    const float* normal = tape.Normal(frame, static_cast<std::uint32_t>(v) + 100'000);
    const float* amplitude_noise = tape.Normal(frame, static_cast<std::uint32_t>(v) + 200'000);
    int row_count = 0;
    if (v >= view_.v0 && v <= view_.v1) {
      for (int k = 0; k < view_.count; ++k) {
        const PartView& part = view_.parts[static_cast<std::size_t>(k)];
        if (part.u0 <= part.u1 && v >= part.v0 && v <= part.v1)
          in_row[row_count++] = static_cast<std::uint8_t>(k);
      }
    }
    for (int u = 0; u < c.width; ++u) {
      const auto pixel =
          static_cast<std::size_t>(v) * static_cast<std::size_t>(c.width) + static_cast<std::size_t>(u);
      Pixel measured = room_[pixel];
      if (row_count > 0 && u >= view_.u0 && u <= view_.u1) {
        int count = 0;
        for (int k = 0; k < row_count; ++k) {
          const PartView& part = view_.parts[in_row[k]];
          if (u >= part.u0 && u <= part.u1) here[count++] = in_row[k];
        }
        if (count > 0) {
          const std::size_t at = pixel * kRays;
          const float* const rays[3] = {&ray_[0][at], &ray_[1][at], &ray_[2][at]};
          float re = 0;
          float im = 0;
          const int met = BodyPhasor(view_.parts.data(), here, count, rays, &length_[at], &room_re_[at],
                                     &room_im_[at], radians_per_m_, re, im);
          if (met > 0) {
            const float near_m = met > kRays / 2 ? view_.parts[here[0]].near_m : room_range_m_[pixel];
            measured = Measure(re, im, near_m, pixel);
          }
        }
      }
      if (measured.light <= 0) {
        range(v, u) = 0;
        amplitude(v, u) = 0;
        continue;
      }
      float m = measured.reported_m + noise_scale * RangeNoise_m(measured.light) * normal[u];
      if (wrap_m > 0) m -= wrap_m * std::floor(m / wrap_m);
      range(v, u) = static_cast<std::uint16_t>(std::clamp(std::lround(m * counts_per_m), 1L, 65535L));
      const float light =
          measured.light + noise_scale * amplitude_noise[u] * (0.0004f + 0.01f * measured.light);
      amplitude(v, u) =
          static_cast<std::uint16_t>(std::clamp(std::lround(light * kAmplitudeCounts), 0L, 65535L));
    }
  }
}

}  // namespace mixstage
