// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/scene.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "proto/base/check.h"
#include "proto/synthetic/board_view.h"
#include "proto/synthetic/figure_view.h"
#include "proto/synthetic/rig.h"
#include "proto/synthetic/tof_view.h"

namespace mixstage {

using Eigen::Vector2d;
using Eigen::Vector3d;

struct SyntheticScene::Impl {
  Impl(const Rig& the_rig, const SyntheticConfig& the_config)
      : config(the_config),
        rig(the_rig),
        T_world_color(SyntheticTWorldColor(rig)),
        light(room),
        figure_light(light),
        tape(config.seed) {
    figure_light.At(Vector2d(3.5, 0), empty_light);
    Color();
    if (rig.depth) Tof();
  }

  // The cameras' views of the empty room from here, rendered where they are asked for first: each by its own
  // thread.
  ColorView& Color() {
    if (color) return *color;
    const PlateLens lens = ColorLens(rig);
    if (boards.empty()) {
      // A head that shows the set keeps no plate beside its pictures.
      return color.emplace(RenderRoomPlate(room, light, lens, T_world_color), rig.color, T_world_color);
    }
    if (!bare_color) bare_color = RenderRoomPlate(room, light, lens, T_world_color, PlateRays::kOne);
    return color.emplace(WithBoards(*bare_color), rig.color, T_world_color);
  }
  TofView& Tof() {
    MIX_CHECK(rig.depth.has_value());
    if (!tof) tof.emplace(room, boards, rig, T_world_color);
    return *tof;
  }
  ColorView& Fisheye() {
    MIX_CHECK(rig.fisheye.has_value());
    if (fisheye) return *fisheye;
    if (!bare_fisheye) {
      bare_fisheye =
          RenderRoomPlate(room, light, FisheyeLens(*rig.fisheye), T_world_color * rig.T_color_fisheye);
    }
    return fisheye.emplace(WithBoards(*bare_fisheye));
  }
  RoomPlate WithBoards(const RoomPlate& bare) const {
    RoomPlate plate = CopyOf(bare);
    DrawBoards(boards, room, light, plate);
    return plate;
  }

  // The figure at a time; null while the set is empty.
  const Figure* FigureAt(double time_s, Figure& figure) const {
    if (!config.figure || !Walk::Present(time_s)) return nullptr;
    PoseFigure(walk.At(time_s), figure);
    return &figure;
  }
  static std::uint32_t FrameOf(double time_s) {
    const auto micros = static_cast<std::uint64_t>(std::llround(time_s * 1e6));
    return Mix(static_cast<std::uint32_t>(micros), static_cast<std::uint32_t>(micros >> 32));
  }
  const PinholeCamera& CameraOf(SyntheticCamera camera) const {
    MIX_CHECK(camera == SyntheticCamera::kColor || rig.depth.has_value());
    return camera == SyntheticCamera::kColor ? rig.color : rig.depth->camera;
  }
  RigidTransform PoseOf(SyntheticCamera camera) const {
    return camera == SyntheticCamera::kColor || rig.registered ? T_world_color
                                                               : T_world_color * rig.T_color_depth;
  }
  // Range of the figure along a ray, infinite where it misses.
  static double FigureRange(const Figure& figure, const Ray& ray, int& part) {
    double best = INFINITY;
    for (int i = 0; i < figure.count; ++i) {
      const auto t =
          figure.parts[static_cast<std::size_t>(i)].cone.Intersect(ray.origin, ray.direction, 1e-6);
      if (t && *t < best) {
        best = *t;
        part = i;
      }
    }
    return best;
  }

  SyntheticConfig config;
  Rig rig;
  RigidTransform T_world_color;
  Room room;
  RoomLight light;
  FigureLight figure_light;
  NoiseTape tape;
  Walk walk;
  std::vector<StandingBoard> boards;
  std::optional<RoomPlate> bare_color, bare_fisheye;  // of this pose, without boards, where they were needed
  std::optional<ColorView> color, fisheye;
  std::optional<TofView> tof;
  BodyLight empty_light{}, body_light{};
  Figure color_figure, tof_figure;  // one for each of the two threads that may render
};

SyntheticScene::SyntheticScene(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
SyntheticScene::SyntheticScene(SyntheticScene&&) noexcept = default;
SyntheticScene& SyntheticScene::operator=(SyntheticScene&&) noexcept = default;
SyntheticScene::~SyntheticScene() = default;

Result<SyntheticScene> SyntheticScene::Create(const Rig& rig, const SyntheticConfig& config) {
  if (auto ok = rig.color.Validate(); !ok) {
    return Fail(ErrorCode::kInvalidConfig, "synthetic rig: cameras.color." + ok.error().message);
  }
  if (rig.depth) {
    if (auto ok = rig.depth->camera.Validate(); !ok) {
      return Fail(ErrorCode::kInvalidConfig, "synthetic rig: cameras.depth." + ok.error().message);
    }
  }
  if (rig.fisheye) {
    if (auto ok = rig.fisheye->Validate(); !ok) {
      return Fail(ErrorCode::kInvalidConfig, "synthetic rig: cameras.fisheye." + ok.error().message);
    }
  }
  return SyntheticScene(std::make_unique<Impl>(rig, config));
}

void SyntheticScene::Arrange(double pan_deg, double tilt_deg, std::vector<StandingBoard> boards) {
  const RigidTransform T_world_color = SyntheticTWorldColor(impl_->rig, pan_deg, tilt_deg);
  if (!(T_world_color.matrix() == impl_->T_world_color.matrix())) {
    impl_->T_world_color = T_world_color;
    impl_->bare_color.reset();
    impl_->bare_fisheye.reset();
  } else if (boards.empty() && impl_->boards.empty()) {
    return;
  }
  impl_->boards = std::move(boards);
  impl_->color.reset();
  impl_->tof.reset();
  impl_->fisheye.reset();
}

void SyntheticScene::RenderColor(double time_s, YuvImage& out) {
  const Figure* figure = impl_->FigureAt(time_s, impl_->color_figure);
  if (figure != nullptr) impl_->figure_light.At(impl_->walk.At(time_s).body, impl_->body_light);
  impl_->Color().Render(figure, figure != nullptr ? impl_->body_light : impl_->empty_light,
                        Impl::FrameOf(time_s), impl_->tape, impl_->config.noise, out);
}

void SyntheticScene::RenderTof(double time_s, cv::Mat1w& range, cv::Mat1w& amplitude) {
  impl_->Tof().Render(impl_->FigureAt(time_s, impl_->tof_figure), Impl::FrameOf(time_s), impl_->tape,
                      impl_->config.noise, range, amplitude);
}

void SyntheticScene::RenderFisheye(double time_s, YuvImage& out) {
  constexpr std::uint32_t kFisheye = 0xf15e;  // its noise is not the colour camera's
  impl_->Fisheye().Render(nullptr, impl_->empty_light, Mix(Impl::FrameOf(time_s), kFisheye), impl_->tape,
                          impl_->config.noise, out);
}

Hit SyntheticScene::Trace(const Ray& ray, double time_s) const {
  const Room::Found found = impl_->room.Trace(ray);
  Hit hit{found.range_m, found.normal, found.surface,
          impl_->room.MaterialAt(found, ray.origin + found.range_m * ray.direction).albedo};
  if (const auto met = MeetBoards(impl_->boards, ray, hit.range_m)) {
    const StandingBoard& board = impl_->boards[met->board];
    hit = {met->met.range_m, met->met.front ? board.FrontNormal() : Vector3d(-board.FrontNormal()),
           Surface::kPaint, Eigen::Vector3f::Constant(board.AlbedoAt(met->met))};
  }
  Figure figure;
  if (impl_->FigureAt(time_s, figure) == nullptr) return hit;
  int part = 0;
  const double range_m = Impl::FigureRange(figure, ray, part);
  if (range_m < hit.range_m) {
    const BodyPart& body = figure.parts[static_cast<std::size_t>(part)];
    hit = {range_m, body.cone.Normal(ray.origin + range_m * ray.direction), Surface::kFigure, body.albedo};
  }
  return hit;
}

std::optional<SyntheticTruth> SyntheticScene::TruthAt(SyntheticCamera camera, double u, double v,
                                                      double time_s) const {
  const auto n = impl_->CameraOf(camera).Unproject(Vector2d(u, v));
  if (!n) return std::nullopt;
  const RigidTransform T_world_camera = impl_->PoseOf(camera);
  const Vector3d d(n->x(), n->y(), 1);
  const Hit hit = Trace({T_world_camera.translation(), (T_world_camera.linear() * d).normalized()}, time_s);
  return SyntheticTruth{static_cast<float>(hit.range_m / d.norm()), hit.surface == Surface::kFigure};
}

cv::Mat1f SyntheticScene::TruthDepth(SyntheticCamera camera, double time_s) const {
  const PinholeCamera& model = impl_->CameraOf(camera);
  const RigidTransform T_world_camera = impl_->PoseOf(camera);
  Figure figure;
  const Figure* present = impl_->FigureAt(time_s, figure);
  FigureView view;
  if (present != nullptr) ViewFigure(figure, model, T_world_camera, 2, view);
  cv::Mat1f depth(model.height, model.width, 0.f);
  cv::parallel_for_(cv::Range(0, model.height), [&](const cv::Range& rows) {
    for (int v = rows.start; v < rows.end; ++v) {
      for (int u = 0; u < model.width; ++u) {
        const auto n = model.Unproject(Vector2d(u, v));
        if (!n) continue;
        const Vector3d d(n->x(), n->y(), 1);
        const Ray ray{T_world_camera.translation(), (T_world_camera.linear() * d).normalized()};
        double range_m = impl_->room.Trace(ray).range_m;
        if (const auto met = MeetBoards(impl_->boards, ray, range_m)) range_m = met->met.range_m;
        int part = 0;
        if (present != nullptr && u >= view.u0 && u <= view.u1 && v >= view.v0 && v <= view.v1) {
          range_m = std::min(range_m, Impl::FigureRange(figure, ray, part));
        }
        depth(v, u) = static_cast<float>(range_m / d.norm());
      }
    }
  });
  return depth;
}

cv::Mat1b SyntheticScene::TruthMatte(double time_s) const {
  const PinholeCamera& model = impl_->rig.color;
  cv::Mat1b matte(model.height, model.width, std::uint8_t{0});
  Figure figure;
  if (impl_->FigureAt(time_s, figure) == nullptr) return matte;
  FigureView view;
  ViewFigure(figure, model, impl_->T_world_color, 2, view);
  constexpr int kSide = 6;  // 36 rays a pixel
  cv::parallel_for_(cv::Range(view.v0, view.v1 + 1), [&](const cv::Range& rows) {
    for (int v = rows.start; v < rows.end; ++v) {
      for (int u = view.u0; u <= view.u1; ++u) {
        int covered = 0;
        for (int k = 0; k < kSide * kSide; ++k) {
          const double us = u + (k % kSide + 0.5) / kSide - 0.5;
          const double vs = v + (k / kSide + 0.5) / kSide - 0.5;
          const auto n = model.Unproject(Vector2d(us, vs));
          if (!n) continue;
          const Vector3d d = (impl_->T_world_color.linear() * Vector3d(n->x(), n->y(), 1)).normalized();
          const Ray ray{impl_->T_world_color.translation(), d};
          int part = 0;
          const double range_m = Impl::FigureRange(figure, ray, part);
          covered += std::isfinite(range_m) && range_m < impl_->room.Trace(ray).range_m ? 1 : 0;
        }
        matte(v, u) = static_cast<std::uint8_t>((covered * 255 + kSide * kSide / 2) / (kSide * kSide));
      }
    }
  });
  return matte;
}

cv::Mat1b SyntheticScene::TruthLabel(double time_s) {
  // Shadow: without noise, the room's picture with the figure against the one without him.
  cv::Mat1b label(impl_->rig.color.height, impl_->rig.color.width, std::uint8_t{0});
  const Figure* figure = impl_->FigureAt(time_s, impl_->color_figure);
  if (figure == nullptr) return label;
  impl_->figure_light.At(impl_->walk.At(time_s).body, impl_->body_light);
  const cv::Mat1f left = impl_->Color().LightLeft(*figure, impl_->body_light);
  const cv::Mat1b matte = TruthMatte(time_s);
  for (int v = 0; v < label.rows; ++v) {
    for (int u = 0; u < label.cols; ++u) {
      constexpr float kShadow = 0.9f;
      label(v, u) = matte(v, u) >= 128 ? 1 : left(v, u) < kShadow ? 2 : 0;
    }
  }
  return label;
}

const RigidTransform& SyntheticScene::TruthPose() const { return impl_->T_world_color; }
const Rig& SyntheticScene::rig() const { return impl_->rig; }
const Room& SyntheticScene::room() const { return impl_->room; }

std::optional<WalkState> SyntheticScene::FigureState(double time_s) const {
  if (!impl_->config.figure || !Walk::Present(time_s)) return std::nullopt;
  return impl_->walk.At(time_s);
}

}  // namespace mixstage
