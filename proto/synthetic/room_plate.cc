// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/room_plate.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "proto/synthetic/texture.h"

namespace mixstage {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr int kWindowRays = 4, kSoftboxRays = 3, kBounceRays = 4;

// Light that varies slowly over a surface, at every second pixel; noisy until it is filtered.
struct LightSample {
  Vector3f point = Vector3f::Zero(), normal = Vector3f::Zero();
  float window = 0, softbox = 0;            // share of the lamp that is seen, 0..1
  float window_unit = 0, softbox_unit = 0;  // unoccluded irradiance of a light of radiance 1
  Vector3f rest = Vector3f::Zero();         // irradiance
  Room::Found found;
};

class PlateRenderer {
 public:
  PlateRenderer(const Room& room, const RoomLight& light, const PlateLens& lens,
                const RigidTransform& T_world_camera, PlateRays rays)
      : room_(room),
        light_(light),
        lens_(lens),
        T_world_camera_(T_world_camera),
        samples_per_pixel_(static_cast<int>(rays)) {
    plate_.width = lens.width;
    plate_.height = lens.height;
    plate_.padded_width = (plate_.width + kTile - 1) / kTile * kTile;
    plate_.padded_height = (plate_.height + kTile - 1) / kTile * kTile;
    plate_.origin = T_world_camera.translation();
    grid_width_ = plate_.padded_width / 2 + 1;
    grid_height_ = plate_.padded_height / 2 + 1;
  }

  RoomPlate Run() {
    MakeRays();
    SampleLight();
    FilterLight();
    ShadePixels();
    MakeNodes();
    return std::move(plate_);
  }

 private:
  template <typename Row>
  static void ForRows(int rows, Row row) {
    cv::parallel_for_(cv::Range(0, rows), [&](const cv::Range& range) {
      for (int v = range.start; v < range.end; ++v) row(v);
    });
  }

  void MakeRays() {
    for (int c = 0; c < 3; ++c) plate_.ray[c].create(plate_.padded_height, plate_.padded_width);
    plate_.vignette.create(plate_.padded_height, plate_.padded_width);
    const Eigen::Matrix3d R = T_world_camera_.linear();
    ForRows(plate_.padded_height, [&](int v) {
      Vector3d last = Vector3d::UnitZ();
      for (int u = 0; u < plate_.padded_width; ++u) {
        if (const auto ray = lens_.ray(Vector2d(u, v))) last = *ray;
        const Vector3d ray = R * last;
        for (int c = 0; c < 3; ++c) plate_.ray[c](v, u) = static_cast<float>(ray[c]);
        plate_.vignette(v, u) = static_cast<float>(lens_.gain(Vector2d(u, v)));
      }
    });
  }

  void SampleLight() {
    samples_.resize(static_cast<std::size_t>(grid_width_) * static_cast<std::size_t>(grid_height_));
    ForRows(grid_height_, [&](int j) {
      for (int i = 0; i < grid_width_; ++i) {
        const Ray ray{plate_.origin, plate_.RayAt(2 * i, 2 * j).normalized()};
        const Room::Found found = room_.Trace(ray);
        LightSample& s = At(i, j);
        const Vector3d p = ray.origin + found.range_m * ray.direction;
        s.point = p.cast<float>();
        s.normal = found.normal.cast<float>();
        s.found = found;
        if (found.surface == Surface::kPane) continue;
        const std::uint32_t seed = Mix(static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(j));
        s.window_unit = UnitIrradiance(light_.window(), p, found.normal);
        s.softbox_unit = UnitIrradiance(light_.softbox(), p, found.normal);
        auto rays = [&](int most) { return samples_per_pixel_ == 1 ? 1 : most; };
        s.window = light_.Visibility(light_.window(), p, found.normal, rays(kWindowRays), seed);
        s.softbox = light_.Visibility(light_.softbox(), p, found.normal, rays(kSoftboxRays), Mix(seed, 1));
        if (HasRest(i, j)) {
          s.rest = light_.Bounced(p, found.normal, rays(kBounceRays), Mix(seed, 2)) +
                   light_.Lamp(p, found.normal, Mix(seed, 3));
        }
      }
    });
  }

  // Bounced light is the smoothest and the dearest: every second sample has it.
  static bool HasRest(int i, int j) { return i % 2 == 0 && j % 2 == 0; }

  // Mean over neighbours on the same surface: +-3 samples for shadows, which keep their edges, +-6 for the
  // rest.
  void FilterLight() {
    std::vector<LightSample> filtered(samples_);
    ForRows(grid_height_, [&](int j) {
      for (int i = 0; i < grid_width_; ++i) {
        LightSample& out = filtered[static_cast<std::size_t>(j * grid_width_ + i)];
        const LightSample& center = At(i, j);
        LightSample sum;
        float weight = 0;
        ForNeighbours(i, j, 3, 1, [&](const LightSample& s, int, int) {
          const float w = Likeness(s, center.point, center.normal);
          sum.window += w * s.window;
          sum.softbox += w * s.softbox;
          weight += w;
        });
        out.window = sum.window / weight;
        out.softbox = sum.softbox / weight;
        float rest_weight = 0;
        ForNeighbours(i - i % 2, j - j % 2, 6, 2, [&](const LightSample& s, int, int) {
          const float w = Likeness(s, center.point, center.normal);
          sum.rest += w * s.rest;
          rest_weight += w;
        });
        const std::uint32_t seed = Mix(static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(j));
        out.rest = rest_weight > 0 ? Vector3f(sum.rest / rest_weight)
                                   : RestOf(center.point.cast<double>(), center.normal.cast<double>(), seed);
      }
    });
    samples_.swap(filtered);
  }

  Vector3f RestOf(const Vector3d& p, const Vector3d& normal, std::uint32_t seed) const {
    return light_.Bounced(p, normal, 3, seed) + light_.Lamp(p, normal, seed);
  }

  template <typename Visit>
  void ForNeighbours(int i, int j, int reach, int step, Visit visit) const {
    for (int y = j - reach; y <= j + reach; y += step) {
      for (int x = i - reach; x <= i + reach; x += step) {
        if (x >= 0 && y >= 0 && x < grid_width_ && y < grid_height_) visit(At(x, y), x, y);
      }
    }
  }

  // 1 on the same plane, 0 on another surface.
  float Likeness(const LightSample& s, const Vector3f& p, const Vector3f& normal) const {
    const float same = s.normal.dot(normal);
    if (same < 0.85f) return 0;
    const Vector3f d = s.point - p;
    const float off = std::abs(d.dot(normal)) + std::abs(d.dot(s.normal));
    const float reach = 0.012f + 0.25f * d.norm() * std::sqrt(std::max(0.f, 1 - same));
    return off < reach ? same - 0.8f : 0.f;
  }

  // The light of a surface point near pixel (u, v) from the samples around it.
  LightSample LightAt(double u, double v, const Vector3d& p, const Vector3d& normal) const {
    const Vector3f pf = p.cast<float>();
    const Vector3f nf = normal.cast<float>();
    const int x = static_cast<int>(std::floor(0.5 * u));
    const int y = static_cast<int>(std::floor(0.5 * v));
    LightSample sum;
    float weight = 0;
    for (int reach = 0; reach <= 2 && weight < 1e-4f; ++reach) {
      for (int j = std::max(0, y - reach); j <= std::min(grid_height_ - 1, y + 1 + reach); ++j) {
        for (int i = std::max(0, x - reach); i <= std::min(grid_width_ - 1, x + 1 + reach); ++i) {
          const LightSample& s = At(i, j);
          const double near = (1.02 + reach - std::abs(0.5 * u - i)) * (1.02 + reach - std::abs(0.5 * v - j));
          Add(s, Likeness(s, pf, nf) * std::max(static_cast<float>(near), 1e-3f), sum, weight);
        }
      }
    }
    if (weight < 1e-4f) {  // a surface too small for the grid
      const std::uint32_t seed = Mix(static_cast<std::uint32_t>(4 * u), static_cast<std::uint32_t>(4 * v));
      sum.window = light_.Visibility(light_.window(), p, normal, 3, seed);
      sum.softbox = light_.Visibility(light_.softbox(), p, normal, 3, seed);
      sum.rest = RestOf(p, normal, seed);
      weight = 1;
    }
    Divide(sum, weight);
    // On a curved surface what a lamp could give changes from pixel to pixel.
    sum.window_unit = UnitIrradiance(light_.window(), p, normal);
    sum.softbox_unit = UnitIrradiance(light_.softbox(), p, normal);
    return sum;
  }

  // The four samples around (u, v) lie on one flat face: its light is between theirs.
  bool OnOneFace(int x, int y) const {
    const LightSample& a = At(x, y);
    const bool flat = a.found.solid < 0
                          ? a.found.surface != Surface::kPane
                          : room_.solids()[static_cast<std::size_t>(a.found.solid)].kind == Solid::Kind::kBox;
    if (!flat) return false;
    for (const LightSample* s : {&At(x + 1, y), &At(x, y + 1), &At(x + 1, y + 1)}) {
      if (s->found.solid != a.found.solid || s->found.surface != a.found.surface ||
          std::abs((s->point - a.point).dot(a.normal)) > 1e-3f || s->normal.dot(a.normal) < 0.999f) {
        return false;
      }
    }
    return true;
  }
  LightSample LightBetween(double u, double v, int x, int y) const {
    const auto fu = static_cast<float>(0.5 * u - x);
    const auto fv = static_cast<float>(0.5 * v - y);
    LightSample sum;
    float weight = 0;
    Add(At(x, y), (1 - fu) * (1 - fv), sum, weight);
    Add(At(x + 1, y), fu * (1 - fv), sum, weight);
    Add(At(x, y + 1), (1 - fu) * fv, sum, weight);
    Add(At(x + 1, y + 1), fu * fv, sum, weight);
    return sum;
  }

  static void Add(const LightSample& s, float w, LightSample& sum, float& weight) {
    sum.window += w * s.window;
    sum.softbox += w * s.softbox;
    sum.window_unit += w * s.window_unit;
    sum.softbox_unit += w * s.softbox_unit;
    sum.rest += w * s.rest;
    weight += w;
  }
  static void Divide(LightSample& sum, float weight) {
    sum.window /= weight;
    sum.softbox /= weight;
    sum.rest /= weight;
  }

  // What a glossy surface mirrors. The window is as bright there as it lights.
  Vector3f Mirrored(const Ray& ray, const Room::Found& found, const Vector3d& p, float gloss,
                    std::uint32_t seed) const {
    const double cosine = std::clamp(-ray.direction.dot(found.normal), 0.0, 1.0);
    const auto fresnel = static_cast<float>(0.035 + 0.965 * std::pow(1 - cosine, 5.0));
    const float strength = gloss * std::min(fresnel, 0.30f);
    if (strength < 0.004f) return Vector3f::Zero();
    Vector3d out = ray.direction + 2 * cosine * found.normal;
    const double rough = 0.10 * (1.15 - gloss);
    for (int c = 0; c < 3; ++c) out[c] += rough * (Unit(static_cast<int>(seed >> 1), c) - 0.5);
    out.normalize();
    if (out.dot(found.normal) <= 0.01) return Vector3f::Zero();
    const Ray mirrored{p + 1e-4 * found.normal, out};
    const Room::Found there = room_.Trace(mirrored);
    const Vector3d q = mirrored.origin + there.range_m * mirrored.direction;
    Vector3f seen;
    if (there.surface == Surface::kPane || there.surface == Surface::kLampShade) {
      seen = 1.7f * room_.MaterialAt(there, q).emission;
    } else if (there.surface == Surface::kSoftbox) {
      seen = light_.softbox().radiance;
    } else {
      seen = light_.Seen(mirrored, seed);
    }
    return strength * seen;
  }

  void ShadePixels() {
    for (int c = 0; c < 3; ++c) {
      for (cv::Mat1f* layer : {&plate_.window[c], &plate_.softbox[c], &plate_.rest[c]}) {
        layer->create(plate_.padded_height, plate_.padded_width);
      }
    }
    ForRows(plate_.padded_height, [&](int v) {
      for (int u = 0; u < plate_.padded_width; ++u) ShadePixel(u, v);
    });
  }

  void ShadePixel(int u, int v) {
    constexpr double kGrid[4][2] = {{-0.375, -0.125}, {0.125, -0.375}, {0.375, 0.125}, {-0.125, 0.375}};
    Vector3f window = Vector3f::Zero();
    Vector3f softbox = Vector3f::Zero();
    Vector3f rest = Vector3f::Zero();
    const int n = samples_per_pixel_;
    for (int k = 0; k < n; ++k) {
      const double us = n == 1 ? u : std::max(0.0, u + kGrid[k][0]);
      const double vs = n == 1 ? v : std::max(0.0, v + kGrid[k][1]);
      const int x = static_cast<int>(0.5 * us);
      const int y = static_cast<int>(0.5 * vs);
      const bool one_face = OnOneFace(x, y);
      Ray ray{plate_.origin, plate_.RayAt(us, vs)};
      Room::Found found;
      Vector3d p;
      if (one_face) {
        found = At(x, y).found;
        const Vector3d on_face = At(x, y).point.cast<double>() - ray.origin;
        p = ray.origin + found.normal.dot(on_face) / found.normal.dot(ray.direction) * ray.direction;
      } else {
        ray.direction.normalize();
        found = room_.Trace(ray);
        p = ray.origin + found.range_m * ray.direction;
      }
      const RoomMaterial material = room_.MaterialAt(found, p);
      rest += material.emission;
      if (found.surface == Surface::kPane) continue;
      const LightSample l = one_face ? LightBetween(us, vs, x, y) : LightAt(us, vs, p, found.normal);
      window += l.window * l.window_unit * material.albedo.cwiseProduct(light_.window().radiance);
      softbox += l.softbox * l.softbox_unit * material.albedo.cwiseProduct(light_.softbox().radiance);
      rest += material.albedo.cwiseProduct(l.rest);
      if (material.gloss > 0 && k == (u + 2 * v) % n) {  // one mirror ray a pixel
        const std::uint32_t seed = Mix(static_cast<std::uint32_t>(u), static_cast<std::uint32_t>(v));
        ray.direction.normalize();
        rest += n * Mirrored(ray, found, p, material.gloss, seed);
      }
    }
    const float gain = plate_.vignette(v, u) / static_cast<float>(n);
    for (int c = 0; c < 3; ++c) {
      plate_.window[c](v, u) = gain * window[c];
      plate_.softbox[c](v, u) = gain * softbox[c];
      plate_.rest[c](v, u) = gain * rest[c];
    }
  }

  void MakeNodes() {
    const int w = plate_.padded_width / kNodeStep + 1;
    const int h = plate_.padded_height / kNodeStep + 1;
    for (int c = 0; c < 3; ++c) {
      plate_.node_point[c].create(h, w);
      plate_.node_normal[c].create(h, w);
    }
    for (int j = 0; j < h; ++j) {
      for (int i = 0; i < w; ++i) {
        const LightSample& s = At(i * kNodeStep / 2, j * kNodeStep / 2);
        for (int c = 0; c < 3; ++c) {
          plate_.node_point[c](j, i) = s.point[c];
          plate_.node_normal[c](j, i) = s.normal[c];
        }
      }
    }
  }

  LightSample& At(int i, int j) { return samples_[static_cast<std::size_t>(j * grid_width_ + i)]; }
  const LightSample& At(int i, int j) const {
    return samples_[static_cast<std::size_t>(j * grid_width_ + i)];
  }

  const Room& room_;
  const RoomLight& light_;
  const PlateLens& lens_;
  const RigidTransform T_world_camera_;
  const int samples_per_pixel_;
  RoomPlate plate_;
  int grid_width_ = 0, grid_height_ = 0;
  std::vector<LightSample> samples_;
};

}  // namespace

Vector3d RoomPlate::RayAt(double u, double v) const {
  const int x = std::clamp(static_cast<int>(std::floor(u)), 0, padded_width - 2);
  const int y = std::clamp(static_cast<int>(std::floor(v)), 0, padded_height - 2);
  const double fu = u - x;
  const double fv = v - y;
  Vector3d at;
  for (int c = 0; c < 3; ++c) {
    const cv::Mat1f& plane = ray[c];
    const double low = plane(y, x) + fu * (plane(y, x + 1) - plane(y, x));
    const double high = plane(y + 1, x) + fu * (plane(y + 1, x + 1) - plane(y + 1, x));
    at[c] = low + fv * (high - low);
  }
  return at;
}

RoomPlate RenderRoomPlate(const Room& room, const RoomLight& light, const PlateLens& lens,
                          const RigidTransform& T_world_camera, PlateRays rays) {
  return PlateRenderer(room, light, lens, T_world_camera, rays).Run();
}

}  // namespace mixstage
