// SPDX-License-Identifier: Apache-2.0
#include "server/render/reflections.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "proto/base/check.h"
#include "proto/base/image_mat.h"
#include "proto/base/log.h"
#include "proto/base/srgb.h"
#include "server/render/spread.h"

namespace mixstage {
namespace {

constexpr double kOffPlane_m = 0.001;  // of a patch itself and of what rests on it
constexpr float kOnPlane_m = 0.01f, kSurfaceSigmas = 3;
constexpr float kBehindRoom_m = 0.03f;  // an object stands before the room though the scan says so much less
constexpr float kSeenAgain = 0.02f;     // share of z: the camera sees the same point of the object
constexpr int kCoarse = 8;              // half pixels
constexpr double kBetween_m = 0.1;
constexpr float kMostSpread_px = 32;
constexpr float kLeastSpread_px = 0.3f;

bool operator==(const Reflector& a, const Reflector& b) {
  return a.name == b.name && a.plane == b.plane && a.polygon == b.polygon && a.color == b.color &&
         a.reflectivity == b.reflectivity && a.roughness == b.roughness;
}

// The deviation of mirrored rays: GGX's slopes (alpha = roughness^2) have alpha / sqrt(2) along an axis, a
// mirrored ray turns by twice as much.
float DeviationOf(double roughness) {
  return static_cast<float>(std::numbers::sqrt2 * roughness * roughness);
}

cv::Rect TurnedOver(const cv::Rect& rect, int width) {
  return {width - rect.br().x, rect.y, rect.width, rect.height};
}

cv::Vec3f LinearAt(const YuvImage& color, int x, int y) {
  const int right = std::min(x + 1, color.width() - 1), below = std::min(y + 1, color.height() - 1);
  const int luma = (color.y(y, x) + color.y(y, right) + color.y(below, x) + color.y(below, right) + 2) / 4;
  const int u = x >> ChromaShiftX(color.layout), v = y >> ChromaShiftY(color.layout);
  const Rgb8 rgb = YcbcrToRgb(static_cast<std::uint8_t>(luma), color.cb(v, u), color.cr(v, u));
  const SrgbTables& srgb = SrgbTables::Get();
  return {srgb.ToLinear(rgb.r), srgb.ToLinear(rgb.g), srgb.ToLinear(rgb.b)};
}

// n . p + d of the scene's frame, for points of the camera's.
Eigen::Vector4f InCamera(const Eigen::Vector4d& plane, const RigidTransform& T_scene_camera) {
  const Eigen::Vector3d normal = plane.head<3>();
  const Eigen::Vector3d turned = T_scene_camera.linear().transpose() * normal;
  Eigen::Vector4f in_camera;
  in_camera << turned.cast<float>(), static_cast<float>(plane.w() + normal.dot(T_scene_camera.translation()));
  return in_camera;
}

}  // namespace

Reflections::Reflections(const PinholeCamera& color, const RenderDevice& device,
                         std::shared_ptr<PreparedMeshes> meshes)
    : color_(color),
      mirrored_(MirroredCamera(color)),
      device_(device),
      meshes_(std::move(meshes)),
      rays_(UnprojectionTable(color)),
      mirrored_rays_(UnprojectionTable(mirrored_)) {
  even_rays_.create(mirrored_rays_.size());
  half_rays_.create(mirrored_rays_.size());
  for (int y = 0; y < half_rays_.rows; ++y) {
    for (int x = 0; x < half_rays_.cols; ++x) {
      even_rays_(y, x) = rays_(2 * y, 2 * x);
      const cv::Vec2f& turned = mirrored_rays_(y, half_rays_.cols - 1 - x);
      half_rays_(y, x) = {-turned[0], turned[1]};
    }
  }
  auto rasteriser = CreateRasteriser(RasterBackend::kCpu, mirrored_, {});
  MIX_CHECK(rasteriser.has_value());
  actor_rasteriser_ = std::move(*rasteriser);
}

void Reflections::SetRoom(const RoomModel& room, float sigma_m) {
  room_.emplace(room, sigma_m, mirrored_);
  placed_ = false;
}

void Reflections::Rebuild(const std::vector<Reflector>& reflectors) {
  const bool same = std::equal(
      mirrors_.begin(), mirrors_.end(), reflectors.begin(), reflectors.end(),
      [](const auto& mirror, const Reflector& reflector) { return mirror->reflector == reflector; });
  if (same) return;
  placed_ = false;
  mirrors_.clear();
  for (const Reflector& reflector : reflectors) {
    auto mirror = std::make_unique<Mirror>();
    mirror->reflector = reflector;
    auto renderer = CgRenderer::Create({}, mirrored_, device_, meshes_);
    if (renderer) {
      mirror->renderer.emplace(std::move(*renderer));
    } else if (!std::exchange(reported_, true)) {
      spdlog::warn("reflect event=left_out reason=\"{}\"", renderer.error().message);
    }
    mirrors_.push_back(std::move(mirror));
  }
}

// Where the room's depth, looked at here and there, says that its surface is the plane.
cv::Rect Reflections::SeenPart(const Reflector& reflector, const ReflectionInput& in) const {
  const Eigen::Vector4f plane = InCamera(reflector.plane, in.T_scene_color);
  cv::Rect part;
  for (int y = kCoarse / 2; y < half_rays_.rows; y += kCoarse) {
    for (int x = kCoarse / 2; x < half_rays_.cols; x += kCoarse) {
      const float z = in.room_depth_m(2 * y, 2 * x);
      const cv::Vec2f& ray = rays_(2 * y, 2 * x);
      if (!(z > 0) || ray[0] != ray[0]) continue;
      const float slope = plane.head<3>().dot(Eigen::Vector3f(ray[0], ray[1], 1));
      const float doubt = kOnPlane_m + kSurfaceSigmas * in.room_sigma_m(2 * y, 2 * x) * std::abs(slope);
      if (std::abs(z * slope + plane.w()) < doubt)
        part |= cv::Rect(x - kCoarse, y - kCoarse, 2 * kCoarse, 2 * kCoarse);
    }
  }
  return part;
}

void Reflections::FindSurface(Mirror& mirror, const ReflectionInput& in) const {
  const Eigen::Vector4f plane = InCamera(mirror.reflector.plane, in.T_scene_color);
  const Eigen::Matrix3f R = in.T_scene_color.linear().cast<float>();
  const Eigen::Vector3f t = in.T_scene_color.translation().cast<float>();
  const PolygonTest polygon(mirror.reflector);
  const cv::Rect pixels =
      cv::Rect(2 * mirror.window.x, 2 * mirror.window.y, 2 * mirror.window.width, 2 * mirror.window.height) &
      cv::Rect(0, 0, color_.width, color_.height);
  mirror.picture.surface = cv::Mat1b(pixels.size(), std::uint8_t{0});
  for (int y = 0; y < pixels.height; ++y) {
    for (int x = 0; x < pixels.width; ++x) {
      const cv::Vec2f& ray = rays_(pixels.y + y, pixels.x + x);
      const Eigen::Vector3f along(ray[0], ray[1], 1);
      const float slope = plane.head<3>().dot(along);
      const float z = -plane.w() / slope;
      if (!(z > 0 && std::isfinite(z))) continue;
      if (in.room_revision != 0) {
        const float room_m = in.room_depth_m(pixels.y + y, pixels.x + x);
        const float doubt =
            kOnPlane_m + kSurfaceSigmas * in.room_sigma_m(pixels.y + y, pixels.x + x) * std::abs(slope);
        if (!(room_m > 0) || std::abs((room_m - z) * slope) > doubt) continue;
      }
      if (polygon.Contains(R * (z * along) + t)) mirror.picture.surface(y, x) = 255;
    }
  }
  // A scan's edges are a pixel off.
  if (in.room_revision != 0) cv::erode(mirror.picture.surface, mirror.picture.surface, cv::Mat());
}

void Reflections::Place(Mirror& mirror, const ReflectionInput& in) {
  mirror.view.reset();
  mirror.drawing = 0;
  const Reflector& reflector = mirror.reflector;
  const bool patch = reflector.color.has_value();
  if (!mirror.renderer || !(reflector.reflectivity > 0)) return;
  if (!patch && in.room_revision == 0 && reflector.polygon.empty()) return;
  const auto view = ViewInto(reflector, in.T_scene_color);
  cv::Rect window = view ? WindowOf(reflector, in.T_scene_color, color_) : cv::Rect();
  if (!patch && in.room_revision != 0 && !window.empty()) window &= SeenPart(reflector, in);
  if (window.empty()) return;
  // Even-aligned, as the renderer's parts are.
  const cv::Size all = mirrored_rays_.size();
  const cv::Rect turned = TurnedOver(window, all.width);
  const int x = turned.x & ~1, y = turned.y & ~1;
  mirror.mirrored_window = {x, y, std::min(all.width, (turned.br().x + 1) & ~1) - x,
                            std::min(all.height, (turned.br().y + 1) & ~1) - y};
  mirror.window = TurnedOver(mirror.mirrored_window, all.width);
  mirror.view = view;
  const Eigen::Vector4f plane = InCamera(view->plane, in.T_scene_color);
  for (cv::Mat1f* picture : {&mirror.fresnel, &mirror.cosine, &mirror.plane_m})
    *picture = cv::Mat1f(mirror.window.size(), 0.0f);
  for (int v = 0; v < mirror.window.height; ++v) {
    for (int u = 0; u < mirror.window.width; ++u) {
      const cv::Vec2f& ray = half_rays_(mirror.window.y + v, mirror.window.x + u);
      const Eigen::Vector3f along(ray[0], ray[1], 1);
      const float slope = plane.head<3>().dot(along);
      if (!(slope < 0)) continue;
      mirror.plane_m(v, u) = -plane.w() / slope;
      mirror.cosine(v, u) = -slope / along.norm();
      mirror.fresnel(v, u) = Fresnel(reflector.reflectivity, reflector.roughness, mirror.cosine(v, u));
    }
  }
  mirror.picture.window = mirror.window;
  mirror.picture.surface.release();
  if (!patch) FindSurface(mirror, in);
  DrawRoom(mirror, in);
}

void Reflections::DrawRoom(Mirror& mirror, const ReflectionInput& in) {
  const cv::Rect& window = mirror.window;
  if (room_ && in.scene->frame == SceneFrame::kWorld) {
    cv::Mat3f radiance;
    cv::Mat1f depth_m;
    room_->Draw(*mirror.view, mirror.mirrored_window, mirrored_rays_, radiance, depth_m);
    cv::flip(radiance, mirror.room, 1);
    cv::flip(depth_m, mirror.room_m, 1);
  } else {
    mirror.room.create(window.size());
    mirror.room_m = cv::Mat1f(window.size(), 0.0f);
  }
  // What nobody has scanned shines as the room does from about there.
  const Eigen::Matrix3f R = mirror.view->T_scene_mirrored.linear().cast<float>();
  for (int v = 0; v < window.height; ++v) {
    for (int u = 0; u < window.width; ++u) {
      if (mirror.room_m(v, u) > 0) continue;
      const cv::Vec2f& ray = half_rays_(window.y + v, window.x + u);
      mirror.room(v, u) = cv::Vec3f::all(0);
      if (!(mirror.plane_m(v, u) > 0)) continue;
      const Eigen::Vector3f light =
          in.light->ambient.At((R * Eigen::Vector3f(-ray[0], ray[1], 1)).normalized());
      mirror.room(v, u) = {light.x(), light.y(), light.z()};
    }
  }
  mirror.spread_room = mirror.room.clone();
  SpreadBy(mirror, {{}, window.size()}, Away(mirror, mirror.room_m), true, mirror.spread_room);
}

// How far behind the plane, as a share of the way from the camera; 1 where it is not known.
cv::Mat1f Reflections::Away(const Mirror& mirror, const cv::Mat1f& depth_m) const {
  cv::Mat1f away(depth_m.size());
  for (int v = 0; v < away.rows; ++v) {
    for (int u = 0; u < away.cols; ++u) {
      const float z = depth_m(v, u);
      away(v, u) = z > 0 ? std::max(0.0f, 1 - mirror.plane_m(v, u) / z) : 1.0f;
    }
  }
  return away;
}

void Reflections::SpreadBy(const Mirror& mirror, const cv::Rect& part, const cv::Mat1f& away, bool goes_on,
                           cv::Mat3f& picture) const {
  const auto focal_px = static_cast<float>(std::sqrt(mirrored_.fx * mirrored_.fy));
  const float whole_px = focal_px * DeviationOf(mirror.reflector.roughness);
  if (whole_px < kLeastSpread_px) return;
  const cv::Mat1f along(cv::min(whole_px * away, kMostSpread_px));
  const cv::Mat1f across(along.mul(mirror.cosine(part)));
  const Beyond beyond = goes_on ? Beyond::kMore : Beyond::kNothing;
  // A rough surface draws things out toward the eye: along the normal as it is seen in the picture.
  const Eigen::Vector3d normal =
      mirror.view->T_scene_mirrored.linear().transpose() * mirror.view->plane.head<3>();
  const bool upright = std::abs(normal.y()) >= std::abs(normal.x());
  Spread(SpreadAxis::kY, upright ? along : across, beyond, picture);
  Spread(SpreadAxis::kX, upright ? across : along, beyond, picture);
}

// Around what the camera sees of him and his back behind it; scene frame.
Eigen::AlignedBox3d Reflections::BoxOfTheActor(const ReflectionInput& in) const {
  Eigen::AlignedBox3d box;
  if (in.actor_depth_m.empty() || in.color == nullptr) return box;
  for (int y = kCoarse / 2; y < in.actor_depth_m.height(); y += kCoarse) {
    for (int x = kCoarse / 2; x < in.actor_depth_m.width(); x += kCoarse) {
      const double z = double{in.actor_depth_m.row(y)[x]};
      const cv::Vec2f& ray = even_rays_(y, x);
      if (!(z > 0) || ray[0] != ray[0]) continue;
      const Eigen::Vector3d along(double{ray[0]}, double{ray[1]}, 1);
      for (const double behind : {0.0, double{ActorShape::kActorThickness_m}})
        box.extend(in.T_scene_color * ((z + behind) * along));
    }
  }
  // Between the places looked at.
  if (!box.isEmpty()) box.min().array() -= kBetween_m, box.max().array() += kBetween_m;
  return box;
}

bool Reflections::MaySee(const Mirror& mirror, const Eigen::AlignedBox3d& box, const cv::Rect& pixels) const {
  if (box.isEmpty() || pixels.empty()) return false;
  const RigidTransform T_mirrored_scene = mirror.view->T_scene_mirrored.inverse();
  Eigen::AlignedBox2d seen;
  for (int k = 0; k < 8; ++k) {
    const auto corner = static_cast<Eigen::AlignedBox3d::CornerType>(k);
    const auto pixel = mirrored_.Project(T_mirrored_scene * box.corner(corner));
    if (!pixel) return true;
    seen.extend(*pixel);
  }
  // The lens bends the box's sides a little.
  const Eigen::Vector2d low(pixels.x - kCoarse, pixels.y - kCoarse);
  const Eigen::Vector2d high(pixels.br().x + kCoarse, pixels.br().y + kCoarse);
  return seen.intersects(Eigen::AlignedBox2d(low, high));
}

bool Reflections::ShapeTheActor(const ReflectionInput& in) {
  actor_shape_ = &actor_.Run(even_rays_, AsMat(in.actor_depth_m), in.T_scene_color);
  return !actor_shape_->indices.empty();
}

void Reflections::DrawActor(const Mirror& mirror, const ReflectionInput& in, cv::Mat3f& radiance,
                            cv::Mat1f& depth_m) {
  const RigidTransform& T_scene_mirrored = mirror.view->T_scene_mirrored;
  PictureGrid grid{.region_px = mirror.mirrored_window};
  grid.half_space = InCamera(mirror.view->plane, T_scene_mirrored);
  actor_rasteriser_->Begin(grid);
  actor_rasteriser_->DrawDepth({actor_shape_->positions, actor_shape_->indices},
                               Eigen::Affine3d(T_scene_mirrored.inverse().matrix()), Faces::kBoth);
  const VisibilityBuffer& visible = actor_rasteriser_->Finish();
  const RigidTransform T_color_mirrored = in.T_scene_color.inverse() * T_scene_mirrored;
  for (int v = visible.touched.y; v < visible.touched.br().y; ++v) {
    for (int u = visible.touched.x; u < visible.touched.br().x; ++u) {
      const float z = visible.depth_m(v, u);
      const int x = mirror.window.width - 1 - u;
      if (!(z > 0) || (depth_m(v, x) > 0 && depth_m(v, x) < z)) continue;
      const cv::Vec2f& ray = mirrored_rays_(mirror.mirrored_window.y + v, mirror.mirrored_window.x + u);
      const auto pixel =
          color_.Project(T_color_mirrored *
                         Eigen::Vector3d(double{z} * double{ray[0]}, double{z} * double{ray[1]}, double{z}));
      if (!pixel) continue;
      const int at_x = static_cast<int>(std::lround(pixel->x())),
                at_y = static_cast<int>(std::lround(pixel->y()));
      if (at_x < 0 || at_y < 0 || at_x >= color_.width || at_y >= color_.height) continue;
      radiance(v, x) = LinearAt(*in.color, at_x, at_y);
      depth_m(v, x) = z;
    }
  }
}

void Reflections::Compose(Mirror& mirror, const ReflectionInput& in, const CgLayer& layer, bool with_actor) {
  const bool patch = mirror.reflector.color.has_value();
  const cv::Size size = mirror.window.size();
  cv::Mat3f behind = mirror.room;
  cv::Mat1f behind_m = mirror.room_m;
  if (with_actor) {
    behind = behind.clone();
    behind_m = behind_m.clone();
    DrawActor(mirror, in, behind, behind_m);
  }
  // Sharp pictures are not subtracted from blurred ones: their edges would stay.
  cv::Mat3f spread_behind = mirror.spread_room;
  if (with_actor) {
    spread_behind = behind.clone();
    SpreadBy(mirror, {{}, size}, Away(mirror, behind_m), true, spread_behind);
  }
  MirrorPicture& picture = mirror.picture;
  picture.added = cv::Mat3f(size, cv::Vec3f::all(0));
  picture.changed = {};
  const cv::Rect drawn =
      TurnedOver(layer.bounds, mirrored_rays_.cols) & mirror.window;  // of the half-size picture
  if (!drawn.empty()) {
    cv::Mat1f weight(size, 0.0f), object_m(size, 0.0f);
    cv::Mat3f covered(size, cv::Vec3f::all(0));
    const RigidTransform T_color_mirrored = in.T_scene_color.inverse() * mirror.view->T_scene_mirrored;
    for (int y = drawn.y; y < drawn.br().y; ++y) {
      for (int x = drawn.x; x < drawn.br().x; ++x) {
        const int u = mirrored_rays_.cols - 1 - x - layer.bounds.x, v = y - layer.bounds.y;
        const cv::Vec4f& color = layer.color(v, u);
        const float z = layer.depth_m(v, u);
        const int column = x - mirror.window.x, row = y - mirror.window.y;
        if (!(color[3] > 0) || !(mirror.plane_m(row, column) > 0)) continue;
        if (behind_m(row, column) > 0 && z > behind_m(row, column) + kBehindRoom_m) continue;
        cv::Vec3f s = cv::Vec3f::all(1);
        // Shadows on it are known where the camera sees the point itself.
        const cv::Vec2f& ray = mirrored_rays_(y, mirrored_rays_.cols - 1 - x);
        const Eigen::Vector3d p = T_color_mirrored * Eigen::Vector3d(double{z} * double{ray[0]},
                                                                     double{z} * double{ray[1]}, double{z});
        if (const auto pixel = in.light_map != nullptr ? color_.Project(p) : std::nullopt) {
          const cv::Point at(static_cast<int>(pixel->x()), static_cast<int>(pixel->y()));
          if (in.cg->bounds.contains(at) &&
              std::abs(static_cast<double>(in.cg->depth_m(at - in.cg->bounds.tl())) - p.z()) <
                  double{kSeenAgain} * p.z())
            s = in.light_map->cg(at.y / 2, at.x / 2);
        }
        for (int c = 0; c < 3; ++c) picture.added(row, column)[c] = color[c] * s[c];
        weight(row, column) = color[3];
        covered(row, column) = cv::Vec3f::all(color[3]);
        object_m(row, column) = z;
      }
    }
    cv::Rect part = drawn - mirror.window.tl();
    const auto focal_px = static_cast<float>(std::sqrt(mirrored_.fx * mirrored_.fy));
    const float most_px = std::min(kMostSpread_px, focal_px * DeviationOf(mirror.reflector.roughness));
    if (most_px > kLeastSpread_px) {
      const int reach = static_cast<int>(std::ceil(2.5f * most_px));
      part = (part - cv::Point(reach, reach) + cv::Size(2 * reach, 2 * reach)) & cv::Rect({}, size);
      cv::Mat1f away = Away(mirror, object_m)(part);
      away = Continued(away, weight(part), reach);
      cv::Mat3f added = picture.added(part), spread_covered = covered(part);
      SpreadBy(mirror, part, away, false, added);
      SpreadBy(mirror, part, away, false, spread_covered);
    }
    for (int y = part.y; y < part.br().y; ++y) {
      for (int x = part.x; x < part.br().x; ++x)
        picture.added(y, x) -= covered(y, x)[0] * spread_behind(y, x);
    }
    picture.changed = part;
  }
  picture.before = (patch ? spread_behind : mirror.spread_room).clone();
  for (int v = 0; v < size.height; ++v) {
    for (int u = 0; u < size.width; ++u) {
      picture.added(v, u) *= mirror.fresnel(v, u);
      picture.before(v, u) *= mirror.fresnel(v, u);
    }
  }
}

const ReflectionPictures& Reflections::Run(const ReflectionInput& in) {
  MIX_CHECK(in.scene != nullptr && in.light != nullptr && in.cg != nullptr);
  Rebuild(in.scene->reflectors);
  const bool place = !placed_ || T_scene_color_.matrix() != in.T_scene_color.matrix() ||
                     room_revision_ != in.room_revision || ambient_ != in.light->ambient;
  placed_ = true;
  T_scene_color_ = in.T_scene_color;
  room_revision_ = in.room_revision;
  ambient_ = in.light->ambient;
  // The actor is looked for, and shaped, once and only when asked for.
  std::optional<Eigen::AlignedBox3d> box;
  std::optional<bool> actor;
  bool changed = place;
  pictures_.mirrors.clear();
  std::size_t patches = 0;
  for (const std::unique_ptr<Mirror>& mirror : mirrors_) {
    const bool patch = mirror->reflector.color.has_value();
    const std::size_t number = in.first_patch + patches;
    patches += patch ? 1 : 0;
    if (place) Place(*mirror, in);
    if (!mirror->view) continue;
    CgPart part{mirror->mirrored_window, mirror->view->plane};
    part.half_space.w() -= kOffPlane_m;
    const CgLayer& layer =
        mirror->renderer->Run(*in.scene, mirror->view->T_scene_mirrored.inverse(), *in.light, part);
    const bool shows_objects = !layer.bounds.empty();
    bool with_actor = false;
    if (patch || shows_objects) {
      if (!box) box = BoxOfTheActor(in);
      if (MaySee(*mirror, *box, patch ? mirror->mirrored_window : layer.bounds)) {
        if (!actor) actor = ShapeTheActor(in);
        with_actor = *actor;
      }
    }
    const std::uint64_t factors = shows_objects && in.light_map != nullptr ? in.light_map->cg_revision : 0;
    if (mirror->drawing != layer.drawing || mirror->factors != factors || with_actor || mirror->with_actor) {
      Compose(*mirror, in, layer, with_actor);
      changed = true;
    }
    mirror->drawing = layer.drawing;
    mirror->factors = factors;
    mirror->with_actor = with_actor;
    mirror->picture.patch = patch ? static_cast<std::uint8_t>(std::min<std::size_t>(number + 1, 255)) : 0;
    pictures_.mirrors.push_back(mirror->picture);
  }
  pictures_.revision += changed ? 1 : 0;
  return pictures_;
}

}  // namespace mixstage
