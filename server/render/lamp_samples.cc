// SPDX-License-Identifier: Apache-2.0
#include "server/render/lamp_samples.h"

#include <algorithm>
#include <cmath>

namespace mixstage {
namespace {

// Cells are no smaller: their shadows nearly run into each other, and each costs about a core-millisecond.
constexpr double kFinest_m = 0.25;
constexpr double kCoarser = 1.2;

int Cells(double side_m, double cell_m) {
  return std::max(1, static_cast<int>(std::lround(side_m / cell_m)));
}

}  // namespace

LampSample::Incident LampSample::At(const Eigen::Vector3f& p) const {
  if (kind == Kind::kDirectional) return {vector, 1.0f};
  const Eigen::Vector3f to_light = vector - p;
  const float d2 = std::max(to_light.squaredNorm(), 1e-6f);
  const Eigen::Vector3f toward = to_light / std::sqrt(d2);
  if (kind == Kind::kPoint) return {toward, 1.0f / d2};
  // The disc of the same area on its axis: E / pi = radiance area / (pi d^2 + area); no pole at the lamp
  // itself.
  const float cosine = std::max(0.0f, -normal.dot(toward));
  return {toward, cosine / (static_cast<float>(M_PI) * d2 + area)};
}

LampSample LampSample::In(const Eigen::Isometry3d& T) const {
  LampSample out = *this;
  out.normal = (T.linear() * normal.cast<double>()).cast<float>();
  out.vector = kind == Kind::kDirectional
                   ? Eigen::Vector3f((T.linear() * vector.cast<double>()).cast<float>())
                   : Eigen::Vector3f((T * vector.cast<double>()).cast<float>());
  return out;
}

std::vector<LampSample> SampleLamps(const std::vector<Light>& lights) {
  float brightest = 0;
  const auto power = [](const Light& light) {
    const auto& area = std::get<AreaLight>(light.shape);
    return static_cast<float>(area.edge_u.cross(area.edge_v).norm()) * light.Strength().maxCoeff();
  };
  for (const Light& light : lights) {
    if (std::holds_alternative<AreaLight>(light.shape)) brightest = std::max(brightest, power(light));
  }
  std::vector<LampSample> samples;
  for (double cell_m = kFinest_m;; cell_m *= kCoarser) {
    samples.clear();
    std::size_t lamps = 0;
    for (const Light& light : lights) {
      LampSample sample;
      sample.strength = light.Strength();
      if (!(sample.strength.maxCoeff() > 0)) continue;
      ++lamps;
      if (const auto* sun = std::get_if<DirectionalLight>(&light.shape)) {
        sample.kind = LampSample::Kind::kDirectional;
        sample.vector = sun->toward_light.cast<float>();
        samples.push_back(sample);
      } else if (const auto* point = std::get_if<PointLight>(&light.shape)) {
        sample.kind = LampSample::Kind::kPoint;
        sample.vector = point->position.cast<float>();
        samples.push_back(sample);
      } else {
        const auto& area = std::get<AreaLight>(light.shape);
        const Eigen::Vector3d across = area.edge_u.cross(area.edge_v);
        const double own_m = cell_m * std::sqrt(static_cast<double>(brightest / power(light)));
        const int columns = Cells(area.edge_u.norm(), own_m);
        const int rows = Cells(area.edge_v.norm(), own_m);
        sample.kind = LampSample::Kind::kArea;
        sample.normal = across.normalized().cast<float>();
        sample.area = static_cast<float>(across.norm() / (columns * rows));
        sample.strength *= sample.area;
        for (int j = 0; j < rows; ++j) {
          for (int i = 0; i < columns; ++i) {
            sample.vector = (area.center + ((i + 0.5) / columns - 0.5) * area.edge_u +
                             ((j + 0.5) / rows - 0.5) * area.edge_v)
                                .cast<float>();
            samples.push_back(sample);
          }
        }
      }
    }
    if (samples.size() <= std::max(kMostLampSamples, lamps)) return samples;
  }
}

}  // namespace mixstage
