// SPDX-License-Identifier: Apache-2.0
#include "server/render/light_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "proto/base/check.h"
#include "proto/base/image_mat.h"

namespace mixstage {
namespace {

constexpr std::size_t kRoomTriangles = 30'000;
constexpr int kRefinedAFrame = 24;          // squares, once everything stands
constexpr std::size_t kRoomMapsAFrame = 4;  // after lamps have changed; a few ms each
constexpr int kTile = LightMap::kTile;
constexpr int kReach = 4;       // pixels of the factors to the neighbours that a normal is taken from
constexpr float kStep = 0.03f;  // share of z: neighbours beyond are another surface
// A surface casts nothing on itself, for all that its reduced shape, the maps' pixels and the depth's noise
// put between.
constexpr float kOffCg_m = 0.015f, kOffRoom_m = 0.05f, kOffActor_m = 0.05f;
constexpr float kLeastHidden = 0.012f;  // share of the ambient light: less is not seen
constexpr float kUnseen = 0.99f;        // less than a grey level
constexpr float kHidingRadii = 4;       // an object hides less than that of it farther away
// An object gives back a part of the ambient light that it hides.
constexpr float kGivenBack = 0.3f;

bool IsDim(float lit) { return lit < 1; }

int HalfUp(int size) { return (size + 1) / 2; }

// Whether points in a sphere may lie in the shadow of a caster inside another.
bool IsBehind(const LampSample& lamp, const Eigen::Vector3f& caster, float caster_m,
              const Eigen::Vector3f& points, float points_m) {
  if (lamp.kind == LampSample::Kind::kDirectional) {
    const Eigen::Vector3f from = points - caster;
    const float along = -from.dot(lamp.vector);
    return along > -points_m - caster_m && (from + along * lamp.vector).norm() < points_m + caster_m;
  }
  const Eigen::Vector3f to_points = points - lamp.vector, to_caster = caster - lamp.vector;
  const float points_away = to_points.norm(), caster_away = to_caster.norm();
  if (points_away + points_m < caster_away - caster_m) return false;
  if (points_m >= points_away || caster_m >= caster_away) return true;
  // Cosine of the sum of both spheres' angles.
  const float sin_a = points_m / points_away, sin_b = caster_m / caster_away;
  const float cosine = std::sqrt((1 - sin_a * sin_a) * (1 - sin_b * sin_b)) - sin_a * sin_b;
  return to_points.dot(to_caster) > cosine * points_away * caster_away;
}

}  // namespace

LightMapper::LightMapper(const PinholeCamera& color)
    : color_(color), half_(HalfUp(color.width), HalfUp(color.height)) {
  const cv::Mat2f all = UnprojectionTable(color);
  rays_.create(half_);
  for (int y = 0; y < half_.height; ++y)
    for (int x = 0; x < half_.width; ++x) rays_(y, x) = all(2 * y, 2 * x);
  for (cv::Mat3f* factors : {&map_.room, &map_.actor, &map_.cg}) {
    factors->create(half_);
    factors->setTo(cv::Scalar::all(1));
  }
  for (cv::Mat1b* touched : {&map_.touched, &room_touched_, &room_coarse_})
    *touched =
        cv::Mat1b((half_.height + kTile - 1) / kTile, (half_.width + kTile - 1) / kTile, std::uint8_t{0});
}

// A factor reaches half a pixel beyond its own, to the left and upward.
void LightMapper::Touch(const cv::Rect& tile, cv::Mat1b& touched) const {
  const int x = tile.x / kTile, y = tile.y / kTile;
  touched(cv::Rect(x - 1, y - 1, 2, 2) & cv::Rect({}, touched.size())).setTo(255);
}

void LightMapper::SetRoom(const RoomModel& room) {
  MIX_CHECK(room.Validate().has_value());
  room_shape_ = Reduced(room.positions, room.indices, kRoomTriangles);
}

bool LightMapper::SameObjects(const Scene& scene) const {
  std::size_t k = 0;
  for (const SceneObject& object : scene.objects) {
    if (object.hidden) continue;
    if (k == objects_.size() || objects_[k].mesh != object.mesh || objects_[k].posed != object.posed ||
        objects_[k].T_scene_object.matrix() != object.T_scene_object.matrix())
      return false;
    ++k;
  }
  return k == objects_.size();
}

std::shared_ptr<const ShadowShape> LightMapper::ShapeOf(const SceneObject& object) {
  std::shared_ptr<const ShadowShape>& shape = shapes_[object.mesh];
  if (shape == nullptr) shape = std::make_shared<const ShadowShape>(ShadowShapeOf(*object.mesh));
  if (object.posed == nullptr) return shape;
  return std::make_shared<const ShadowShape>(Posed(*shape, object.posed->positions));
}

void LightMapper::PlaceObjects(const Scene& scene) {
  ++objects_revision_;
  const std::vector<Object> before = std::exchange(objects_, {});
  surfels_.Clear();
  for (const SceneObject& object : scene.objects) {
    if (object.hidden) continue;
    const Eigen::Affine3d& T = object.T_scene_object;
    Object placed;
    placed.mesh = object.mesh;
    placed.posed = object.posed;
    placed.shape = ShapeOf(object);
    placed.T_scene_object = T;
    placed.center = (T * placed.shape->center.cast<double>()).cast<float>();
    placed.radius_m = placed.shape->radius_m * static_cast<float>(T.linear().norm());
    const double volume = std::abs(T.linear().determinant());
    if (volume > 0) {
      const Eigen::Matrix3f of_area = (volume * T.linear().inverse().transpose()).cast<float>();
      for (const Surfel& surfel : placed.shape->surfels)
        surfels_.Add({(T * surfel.center.cast<double>()).cast<float>(), of_area * surfel.facing});
    }
    placed.surfels = surfels_.Close();
    objects_.push_back(placed);
  }
  moved_.reset();
  if (std::ranges::equal(before, objects_, {}, &Object::mesh, &Object::mesh)) {
    moved_.emplace();
    for (std::size_t k = 0; k < objects_.size(); ++k) {
      if (before[k].posed == objects_[k].posed &&
          before[k].T_scene_object.matrix() == objects_[k].T_scene_object.matrix())
        continue;
      for (const Object& object : {before[k], objects_[k]})
        moved_->push_back({object.center, object.radius_m});
    }
  }
  std::erase_if(shapes_, [&](const auto& known) {
    return std::ranges::find(objects_, known.first, &Object::mesh) == objects_.end();
  });
}

void LightMapper::PlaceLamps(const LightMapInput& in) {
  const std::vector<LampSample> samples = SampleLamps(in.light->lights);
  std::vector<LampSample> now;
  for (const Lamp& lamp : lamps_) now.push_back(lamp.sample);
  light_ = *in.light;
  ++lamps_revision_;
  if (samples == now) return;
  // Lamps that stayed where they were keep what they see.
  std::vector<Lamp> lamps;
  for (const LampSample& sample : samples) {
    const auto same = std::find_if(lamps_.begin(), lamps_.end(), [&](const Lamp& lamp) {
      return lamp.sample.vector == sample.vector && lamp.sample.kind == sample.kind;
    });
    if (same != lamps_.end()) {
      lamps.push_back(std::move(*same));
      lamps_.erase(same);
    } else {
      lamps.emplace_back();
    }
    lamps.back().sample = sample;
  }
  lamps_ = std::move(lamps);
}

void LightMapper::DrawRoomMaps(std::size_t most) {
  if (room_shape_.indices.empty()) return;
  const ShadowCaster caster{.mesh = {room_shape_.positions, room_shape_.indices},
                            .center = room_shape_.center,
                            .radius_m = room_shape_.radius_m};
  for (Lamp& lamp : lamps_) {
    // The sun shines through walls: where its windows are is not known.
    if (lamp.room_drawn || lamp.sample.kind == LampSample::Kind::kDirectional) continue;
    if (most-- == 0) return;
    lamp.room.Draw(lamp.sample, std::span(&caster, 1), rasteriser_);
    lamp.room_drawn = true;
    ++room_maps_revision_;
  }
}

void LightMapper::PlaceActor(const LightMapInput& in) {
  actor_shape_ = nullptr;
  for (Lamp& lamp : lamps_) lamp.actor.Clear();
  if (in.actor_depth_m.empty() || objects_.empty()) return;
  const ShadowShape& shape = actor_.Run(rays_, AsMat(in.actor_depth_m), in.T_scene_color);
  if (shape.indices.empty()) return;
  actor_shape_ = &shape;
  const ShadowCaster caster{
      .mesh = {shape.positions, shape.indices}, .center = shape.center, .radius_m = shape.radius_m};
  const auto matters = [&](const LampSample& lamp, const std::vector<Tile>& tiles) {
    return std::any_of(tiles.begin(), tiles.end(), [&](const Tile& tile) {
      return IsBehind(lamp, shape.center, shape.radius_m, tile.center, tile.radius_m);
    });
  };
  for (Lamp& lamp : lamps_) {
    if (matters(lamp.sample, room_) || matters(lamp.sample, cg_))
      lamp.actor.Draw(lamp.sample, std::span(&caster, 1), rasteriser_);
  }
}

bool LightMapper::MayBeShaded(const Eigen::Vector3f& center, float radius_m) {
  shaded_.assign(lamps_.size(), 0);
  hiding_.assign(objects_.size(), 0);
  bool any = false;
  for (std::size_t k = 0; k < objects_.size(); ++k) {
    const Object& object = objects_[k];
    for (std::size_t i = 0; i < lamps_.size(); ++i) {
      if (shaded_[i] == 0 && IsBehind(lamps_[i].sample, object.center, object.radius_m, center, radius_m) &&
          lamps_[i].cg.MayHide(center, radius_m))
        shaded_[i] = 1;
      any = any || shaded_[i] != 0;
    }
    hiding_[k] = (center - object.center).norm() - radius_m < kHidingRadii * object.radius_m;
    any = any || hiding_[k] != 0;
  }
  return any;
}

float LightMapper::HiddenAmbient(const Point& at) const {
  float hidden = 0;
  for (std::size_t k = 0; k < objects_.size(); ++k) {
    if (hiding_[k] != 0) hidden += surfels_.Hidden(objects_[k].surfels, at.position, at.normal);
  }
  return std::min(hidden, 1.0f);
}

template <typename Depth>
std::optional<LightMapper::Point> LightMapper::PointAt(const Depth& depth, int x, int y) const {
  const auto at = [&](int u, int v) -> Eigen::Vector3f {
    const float z = depth(u, v);
    const cv::Vec2f& ray = rays_(v, u);
    return {z * ray[0], z * ray[1], z};
  };
  const float z = depth(x, y);
  const cv::Vec2f& ray = rays_(y, x);
  if (!(z > 0) || ray[0] != ray[0]) return std::nullopt;
  const Eigen::Vector3f p = at(x, y);
  // From the neighbour on either side, or both, that lies on the same surface.
  const auto slope = [&](int du, int dv) -> Eigen::Vector3f {
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    for (int reach = kReach; reach > 0 && sum.isZero(); reach /= 2) {
      for (const int sign : {-1, 1}) {
        const int u = x + sign * reach * du, v = y + sign * reach * dv;
        if (u < 0 || v < 0 || u >= half_.width || v >= half_.height) continue;
        const float other = depth(u, v);
        if (!(other > 0) || std::abs(other - z) > kStep * z || rays_(v, u)[0] != rays_(v, u)[0]) continue;
        sum += static_cast<float>(sign) * (at(u, v) - p);
      }
    }
    return sum;
  };
  Eigen::Vector3f normal = slope(1, 0).cross(slope(0, 1));
  if (!(normal.squaredNorm() > 0)) normal = -p;
  if (normal.dot(p) > 0) normal = -normal;
  return Point{R_ * p + t_, (R_ * normal).normalized()};
}

template <typename Depth>
void LightMapper::FindPoints(const Depth& depth, const cv::Rect& box, int step) {
  found_.clear();
  for (int y = box.y; y < box.br().y; y += step) {
    for (int x = box.x; x < box.br().x; x += step) {
      if (const auto at = PointAt(depth, x, y)) found_.push_back({x, y, *at});
    }
  }
}

void LightMapper::Raise(float by_m) {
  points_.count = 0;
  for (const Found& found : found_) points_.Add(found.at.position + by_m * found.at.normal);
}

cv::Vec3f LightMapper::FactorOf(const Tile& tile, std::size_t spot, const float* actor_lit) const {
  const std::size_t lamps = lamps_.size();
  Eigen::Array3f seen = tile.spots[spot].seen.array(), kept = tile.spots[spot].ambient.array();
  for (std::size_t i = 0; i < lamps; ++i) {
    const float lit = actor_lit != nullptr ? actor_lit[i] : 1.0f;
    const Eigen::Array3f strength = lit * lamps_[i].sample.strength.array();
    seen += tile.seen[spot * lamps + i] * strength;
    kept += tile.kept[spot * lamps + i] * strength;
  }
  cv::Vec3f factor;
  for (int c = 0; c < 3; ++c) factor[c] = seen[c] > 0 ? std::min(1.0f, kept[c] / seen[c]) : 1.0f;
  return factor;
}

void LightMapper::Fill(const Tile& tile, const std::vector<cv::Vec3f>& factor, Beside beside,
                       cv::Mat3f& factors) {
  const Spot* spots = tile.spots.data();
  const cv::Rect& box = tile.box;
  if (spots->size == 1) {
    for (std::size_t k = 0; k < factor.size(); ++k) factors(spots[k].y, spots[k].x) = factor[k];
    return;
  }
  // Every second pixel is a spot's; those between are means.
  constexpr int kCells = kTile / 2 + 1;
  cv::Vec3f cells[kCells][kCells];
  float known[kCells][kCells] = {};
  if (beside == Beside::kLit) {
    for (int v = 0; 2 * v < box.height; ++v) {
      for (int u = 0; 2 * u < box.width; ++u) cells[v][u] = cv::Vec3f::all(known[v][u] = 1);
    }
  }
  for (std::size_t k = 0; k < factor.size(); ++k) {
    const int u = (spots[k].x - box.x) / 2, v = (spots[k].y - box.y) / 2;
    cells[v][u] = factor[k];
    known[v][u] = 1;
  }
  for (int y = 0; y < box.height; ++y) {
    for (int x = 0; x < box.width; ++x) {
      cv::Vec3f sum(0, 0, 0);
      float count = 0;
      for (const int v : {y / 2, (y + 1) / 2}) {
        for (const int u : {x / 2, (x + 1) / 2}) {
          sum += known[v][u] * cells[v][u];
          count += known[v][u];
        }
      }
      if (count > 0) factors(box.y + y, box.x + x) = sum / count;
    }
  }
}

void LightMapper::DropUnseen(Tile& tile) const {
  const std::size_t lamps = lamps_.size();
  std::size_t left = 0;
  for (std::size_t k = 0; k < tile.spots.size(); ++k) {
    const cv::Vec3f factor = FactorOf(tile, k, nullptr);
    if (std::min({factor[0], factor[1], factor[2]}) > kUnseen) continue;
    tile.spots[left] = tile.spots[k];
    std::copy_n(tile.seen.data() + k * lamps, lamps, tile.seen.data() + left * lamps);
    std::copy_n(tile.kept.data() + k * lamps, lamps, tile.kept.data() + left * lamps);
    ++left;
  }
  tile.spots.resize(left);
  tile.seen.resize(left * lamps);
  tile.kept.resize(left * lamps);
}

void LightMapper::Close(Tile tile, std::vector<Tile>& to, Beside beside, cv::Mat3f& factors) {
  if (tile.spots.empty()) return;
  Eigen::AlignedBox3f box;
  factor_.clear();
  for (std::size_t k = 0; k < tile.spots.size(); ++k) {
    Spot& spot = tile.spots[k];
    spot.factor = FactorOf(tile, k, nullptr);
    factor_.push_back(spot.factor);
    box.extend(spot.position);
  }
  Fill(tile, factor_, beside, factors);
  tile.center = box.center();
  tile.radius_m = 0.5f * box.diagonal().norm();
  to.push_back(std::move(tile));
}

bool LightMapper::Shade(std::vector<Tile>& tiles, Beside beside, cv::Mat3f& factors) {
  bool any = false;
  for (Tile& tile : tiles) {
    shaded_.assign(lamps_.size(), 0);
    bool reached = false;
    for (std::size_t i = 0; actor_shape_ != nullptr && i < lamps_.size(); ++i) {
      shaded_[i] = lamps_[i].actor.MayHide(tile.center, tile.radius_m);
      reached = reached || shaded_[i] != 0;
    }
    if (!reached && !tile.dimmed) continue;
    // The actor's shape is coarse: of four neighbours in a square the others are shaded as the first.
    std::array<int, kTile * kTile / 4> point_of;
    point_of.fill(-1);
    const auto block = [&](const Spot& spot) -> int& {
      const int number = (spot.y - tile.box.y) / 2 * (kTile / 2) + (spot.x - tile.box.x) / 2;
      return point_of[static_cast<std::size_t>(number)];
    };
    points_.count = 0;
    for (const Spot& spot : tile.spots) {
      if (block(spot) >= 0) continue;
      block(spot) = static_cast<int>(points_.count);
      points_.Add(spot.position);
    }
    ShareOf(&Lamp::actor, kOffActor_m, &shaded_, share_);
    const bool before = std::exchange(tile.dimmed, std::ranges::any_of(share_, IsDim));
    if (!before && !tile.dimmed) continue;
    any = true;
    factor_.clear();
    for (std::size_t k = 0; k < tile.spots.size(); ++k) {
      const float* share = share_.data() + static_cast<std::size_t>(block(tile.spots[k])) * lamps_.size();
      const bool shaded = std::any_of(share, share + lamps_.size(), IsDim);
      factor_.push_back(shaded ? FactorOf(tile, k, share) : tile.spots[k].factor);
    }
    Fill(tile, factor_, beside, factors);
  }
  return any;
}

void LightMapper::ShareOf(ShadowMap Lamp::*map, float bias_m, const Lamps* matter,
                          std::vector<float>& share) {
  share.assign(points_.count * lamps_.size(), 1.0f);
  for (std::size_t i = 0; i < lamps_.size(); ++i) {
    if ((matter != nullptr && (*matter)[i] == 0) || (lamps_[i].*map).empty()) continue;
    (lamps_[i].*map).Lit(points_, bias_m, lit_);
    for (std::size_t k = 0; k < points_.count; ++k) share[k * lamps_.size() + i] = lit_[k];
  }
}

template <typename Depth>
LightMapper::Sphere LightMapper::SphereOf(const Depth& depth, const cv::Rect& tile) const {
  Eigen::AlignedBox3f box;
  for (int y = tile.y; y < tile.br().y; y += 3) {
    for (int x = tile.x; x < tile.br().x; x += 3) {
      const float z = depth(x, y);
      const cv::Vec2f& ray = rays_(y, x);
      if (z > 0 && ray[0] == ray[0]) box.extend(R_ * Eigen::Vector3f(z * ray[0], z * ray[1], z) + t_);
    }
  }
  if (box.isEmpty()) return {};
  return {box.center(), 0.55f * box.diagonal().norm()};
}

template <typename Depth>
std::optional<LightMapper::Tile> LightMapper::TileAt(const Depth& depth, int x0, int y0) {
  Tile tile;
  tile.box = cv::Rect(x0, y0, kTile, kTile) & cv::Rect({}, half_);
  const Sphere points = SphereOf(depth, tile.box);
  if (points.radius_m < 0 || !MayBeShaded(points.center, points.radius_m)) return std::nullopt;
  return tile;
}

// Whether what has moved may change anything there.
bool LightMapper::MovedReach(const Sphere& points) const {
  if (points.radius_m < 0) return false;
  return std::any_of(moved_->begin(), moved_->end(), [&](const Sphere& moved) {
    if ((points.center - moved.center).norm() - points.radius_m < kHidingRadii * moved.radius_m) return true;
    return std::any_of(lamps_.begin(), lamps_.end(), [&](const Lamp& lamp) {
      return IsBehind(lamp.sample, moved.center, moved.radius_m, points.center, points.radius_m);
    });
  });
}

void LightMapper::LightRoom(const LightMapInput& in, Renew renew) {
  const auto depth = [&](int x, int y) { return in.room_depth_m(2 * y, 2 * x); };
  std::swap(room_, room_before_);
  room_.clear();
  room_touched_.setTo(0);
  if (renew == Renew::kAll) {
    room_tiles_.clear();
    room_coarse_.setTo(0);
    map_.room.setTo(cv::Scalar::all(1));
  }
  if (in.room_revision == 0) return;
  const std::size_t lamps = lamps_.size();
  std::size_t number = 0;
  auto kept = room_before_.begin();
  int refined = 0;
  for (int y0 = 0; y0 < half_.height; y0 += kTile) {
    for (int x0 = 0; x0 < half_.width; x0 += kTile, ++number) {
      const cv::Rect box = cv::Rect(x0, y0, kTile, kTile) & cv::Rect({}, half_);
      std::uint8_t& coarse = room_coarse_(y0 / kTile, x0 / kTile);
      if (renew == Renew::kAll) {
        room_tiles_.push_back(SphereOf(depth, box));
      } else {
        const auto old = kept;
        const bool was = kept != room_before_.end() && kept->box == box;
        if (was) ++kept;
        const bool again = renew == Renew::kMoved ? MovedReach(room_tiles_[number])
                                                  : coarse != 0 && refined < kRefinedAFrame;
        if (!again) {
          if (was) room_.push_back(std::move(*old));
          continue;
        }
        ++refined;
        map_.room(box).setTo(cv::Scalar::all(1));
      }
      coarse = 0;
      const Sphere& points = room_tiles_[number];
      if (points.radius_m < 0 || !MayBeShaded(points.center, points.radius_m)) continue;
      coarse = step_ > 1 ? 255 : 0;
      Tile tile;
      tile.box = box;
      FindPoints(depth, box, step_);
      Raise(kOffCg_m);
      ShareOf(&Lamp::cg, 0, &shaded_, share_);
      // What moves is seen for a moment only: ambient light is hidden in blocks.
      std::array<std::optional<float>, kTile * kTile / 16> hides;
      std::size_t left = 0;
      for (std::size_t k = 0; k < found_.size(); ++k) {
        const auto& [x, y, at] = found_[k];
        const float* share = share_.data() + k * lamps;
        auto& block = hides[static_cast<std::size_t>((y - y0) / 4 * (kTile / 4) + (x - x0) / 4)];
        if (step_ == 1 || !block) block = HiddenAmbient({at.position + kOffCg_m * at.normal, at.normal});
        const bool shaded = std::any_of(share, share + lamps, IsDim);
        if (!shaded && *block < kLeastHidden) continue;
        const Eigen::Vector3f ambient = light_.ambient.At(at.normal);
        tile.spots.push_back(
            {x, y, step_, at.position, ambient, (1 - (1 - kGivenBack) * *block) * ambient, {}});
        std::copy_n(share, lamps, share_.data() + left * lamps);
        found_[left++] = found_[k];
      }
      found_.resize(left);
      Raise(kOffRoom_m);
      ShareOf(&Lamp::room, kOffRoom_m, nullptr, room_share_);
      for (std::size_t k = 0; k < left; ++k) {
        const Point& at = found_[k].at;
        for (std::size_t i = 0; i < lamps; ++i) {
          const LampSample::Incident incident = lamps_[i].sample.At(at.position);
          const float facing = std::max(0.0f, at.normal.dot(incident.toward));
          const float received = incident.share * facing * room_share_[k * lamps + i];
          tile.seen.push_back(received);
          tile.kept.push_back(received * share_[k * lamps + i]);
        }
      }
      DropUnseen(tile);
      Close(std::move(tile), room_, Beside::kLit, map_.room);
    }
  }
  for (const Tile& tile : room_) Touch(tile.box, room_touched_);
}

void LightMapper::LightActor(const LightMapInput& in) {
  if (!map_.actor_bounds.empty()) map_.actor(map_.actor_bounds).setTo(cv::Scalar::all(1));
  map_.actor_bounds = {};
  if (actor_shape_ == nullptr) return;
  const auto depth = [&](int x, int y) { return in.actor_depth_m.row(y)[x]; };
  for (int y0 = 0; y0 < half_.height; y0 += kTile) {
    for (int x0 = 0; x0 < half_.width; x0 += kTile) {
      const auto tile = TileAt(depth, x0, y0);
      if (!tile) continue;
      map_.actor_bounds |= tile->box;
      Touch(tile->box, map_.touched);
      // His depth comes from a coarser grid than that; what hides ambient light from him changes slowly.
      std::array<std::optional<float>, kTile * kTile / 16> hidden;
      FindPoints(depth, tile->box, 2);
      Raise(0);
      ShareOf(&Lamp::cg, kOffCg_m, &shaded_, share_);
      for (std::size_t k = 0; k < found_.size(); ++k) {
        const auto& [x, y, at] = found_[k];
        const Eigen::Vector3f ambient = light_.ambient.At(at.normal);
        auto& hides = hidden[static_cast<std::size_t>((y - y0) / 4 * (kTile / 4) + (x - x0) / 4)];
        if (!hides) hides = HiddenAmbient(at);
        Eigen::Vector3f seen = ambient;
        Eigen::Vector3f kept = (1 - (1 - kGivenBack) * *hides) * ambient;
        for (std::size_t i = 0; i < lamps_.size(); ++i) {
          const LampSample::Incident incident = lamps_[i].sample.At(at.position);
          const float received = incident.share * at.normal.dot(incident.toward);
          if (!(received > 0)) continue;
          seen += received * lamps_[i].sample.strength;
          kept += received * share_[k * lamps_.size() + i] * lamps_[i].sample.strength;
        }
        cv::Vec3f s;
        for (int c = 0; c < 3; ++c) s[c] = seen[c] > 0 ? kept[c] / seen[c] : 1.0f;
        for (int v = y; v < std::min(y + 2, tile->box.br().y); ++v)
          for (int u = x; u < std::min(x + 2, tile->box.br().x); ++u) map_.actor(v, u) = s;
      }
    }
  }
}

void LightMapper::LightCg(const LightMapInput& in) {
  const CgLayer& cg = *in.cg;
  cg_.clear();
  map_.cg_bounds = {cg.bounds.x / 2, cg.bounds.y / 2, HalfUp(cg.bounds.width), HalfUp(cg.bounds.height)};
  map_.cg(map_.cg_bounds).setTo(cv::Scalar::all(1));
  // The first pixel of four that shows something.
  const auto depth = [&](int x, int y) {
    const int column = 2 * x - cg.bounds.x, row = 2 * y - cg.bounds.y;
    for (const int v : {row, row + 1}) {
      for (const int u : {column, column + 1}) {
        if (u < 0 || v < 0 || u >= cg.bounds.width || v >= cg.bounds.height) continue;
        if (cg.depth_m(v, u) > 0) return cg.depth_m(v, u);
      }
    }
    return 0.0f;
  };
  const cv::Rect& box = map_.cg_bounds;
  for (int y0 = box.y; y0 < box.br().y; y0 += kTile) {
    for (int x0 = box.x; x0 < box.br().x; x0 += kTile) {
      Tile tile;
      tile.box = cv::Rect(x0, y0, kTile, kTile) & box;
      FindPoints(depth, tile.box, step_);
      Raise(kOffCg_m);
      ShareOf(&Lamp::cg, kOffCg_m, nullptr, share_);
      Raise(kOffRoom_m);
      ShareOf(&Lamp::room, kOffRoom_m, nullptr, room_share_);
      for (std::size_t k = 0; k < found_.size(); ++k) {
        const auto& [x, y, at] = found_[k];
        const Eigen::Vector3f ambient = light_.ambient.At(at.normal);
        Eigen::Vector3f shaded_as = ambient;
        for (std::size_t i = 0; i < lamps_.size(); ++i) {
          const LampSample::Incident incident = lamps_[i].sample.At(at.position);
          const float received = incident.share * std::max(0.0f, at.normal.dot(incident.toward));
          shaded_as += received * lamps_[i].sample.strength;
          tile.seen.push_back(0);
          tile.kept.push_back(received * share_[k * lamps_.size() + i] * room_share_[k * lamps_.size() + i]);
        }
        tile.spots.push_back({x, y, step_, at.position + kOffRoom_m * at.normal, shaded_as, ambient, {}});
      }
      Close(std::move(tile), cg_, Beside::kUnknown, map_.cg);
    }
  }
}

const LightMap& LightMapper::Run(const LightMapInput& in) {
  MIX_CHECK(in.scene != nullptr && in.light != nullptr && in.cg != nullptr);
  MIX_CHECK(in.room_revision == 0 || in.room_depth_m.size() == cv::Size(color_.width, color_.height));
  MIX_CHECK(in.actor_depth_m.empty() ||
            (in.actor_depth_m.width() == half_.width && in.actor_depth_m.height() == half_.height));
  const bool first = lamps_revision_ == 0;
  if (first || !SameLight(light_, *in.light)) PlaceLamps(in);
  const bool moved = !SameObjects(*in.scene);
  if (moved) PlaceObjects(*in.scene);
  DrawRoomMaps(first ? lamps_.size() : kRoomMapsAFrame);
  if (moved || made_.lamps != lamps_revision_) {
    std::vector<ShadowCaster> casters;
    for (const Object& object : objects_) {
      casters.push_back({{object.shape->positions, object.shape->indices},
                         object.T_scene_object,
                         object.center,
                         object.radius_m});
    }
    for (Lamp& lamp : lamps_) lamp.cg.Draw(lamp.sample, casters, rasteriser_);
  }
  R_ = in.T_scene_color.linear().cast<float>();
  t_ = in.T_scene_color.translation().cast<float>();
  const Made now = {in.room_revision,    lamps_revision_, objects_revision_,
                    room_maps_revision_, in.cg->drawing,  in.T_scene_color};
  const bool stands = made_.objects == now.objects && made_.lamps == now.lamps &&
                      made_.T_scene_color.matrix() == now.T_scene_color.matrix();
  const int step = stands || first ? 1 : 2;
  const bool anew = !stands || made_.room_maps != now.room_maps || step != step_;
  step_ = step;
  const bool elsewhere = made_.lamps != now.lamps || made_.room_maps != now.room_maps ||
                         made_.room != now.room || made_.T_scene_color.matrix() != now.T_scene_color.matrix();
  if (elsewhere || (moved && !moved_)) {
    LightRoom(in, Renew::kAll);
  } else if (moved) {
    LightRoom(in, Renew::kMoved);
  } else if (cv::countNonZero(room_coarse_) > 0) {
    LightRoom(in, Renew::kCoarse);
  }
  if (anew || made_.drawing != now.drawing) {
    LightCg(in);
    ++map_.cg_revision;
  }
  made_ = now;
  PlaceActor(in);
  Shade(room_, Beside::kLit, map_.room);
  if (Shade(cg_, Beside::kUnknown, map_.cg)) ++map_.cg_revision;
  room_touched_.copyTo(map_.touched);
  LightActor(in);
  return map_;
}

}  // namespace mixstage
