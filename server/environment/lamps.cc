// SPDX-License-Identifier: Apache-2.0
#include "server/environment/lamps.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

namespace mixstage {
namespace {

constexpr std::size_t kMostLamps = 32;

float ToLinear(std::uint8_t code) {
  const float s = static_cast<float>(code) / 255;
  return s <= 0.04045f ? s / 12.92f : std::pow((s + 0.055f) / 1.055f, 2.4f);
}

struct Region {
  std::vector<Eigen::Vector3d> points;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero(), normal = Eigen::Vector3d::UnitZ();
};

// Plane of the points, robust against those at the rim that hang on another surface.
void FitRegion(Region& region, const Eigen::Vector3d& center) {
  std::vector<Eigen::Vector3d> kept = region.points;
  for (int pass = 0; pass < 3; ++pass) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& p : kept) mean += p / static_cast<double>(kept.size());
    Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
    for (const Eigen::Vector3d& p : kept) scatter += (p - mean) * (p - mean).transpose();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(scatter);
    region.mean = mean;
    region.normal = eigen.eigenvectors().col(0);
    std::vector<double> off;
    for (const Eigen::Vector3d& p : region.points) off.push_back(std::abs(region.normal.dot(p - mean)));
    std::vector<double> sorted = off;
    std::sort(sorted.begin(), sorted.end());
    const double limit = std::max(0.01, 3 * sorted[sorted.size() / 2]);
    kept.clear();
    for (std::size_t k = 0; k < off.size(); ++k)
      if (off[k] <= limit) kept.push_back(region.points[k]);
    if (kept.size() < 8) break;
  }
  if (region.normal.dot(center - region.mean) < 0) region.normal = -region.normal;
}

RoomLamp Rectangle(const Region& region) {
  const Eigen::Vector3d u = region.normal.unitOrthogonal(), v = region.normal.cross(u);
  std::vector<cv::Point2f> flat;
  for (const Eigen::Vector3d& p : region.points)
    flat.emplace_back(static_cast<float>(u.dot(p - region.mean)), static_cast<float>(v.dot(p - region.mean)));
  const cv::RotatedRect box = cv::minAreaRect(flat);
  const double angle = box.angle * std::numbers::pi / 180;
  const Eigen::Vector3d along = std::cos(angle) * u + std::sin(angle) * v;
  const Eigen::Vector3d across = -std::sin(angle) * u + std::cos(angle) * v;
  RoomLamp lamp;
  lamp.center = region.mean + static_cast<double>(box.center.x) * u + static_cast<double>(box.center.y) * v;
  lamp.edge_u = static_cast<double>(box.size.width) * along;
  lamp.edge_v = static_cast<double>(box.size.height) * across;  // edge_u x edge_v is the normal
  return lamp;
}

double Gap(const Region& a, const Region& b) {
  double least = 1e9;
  for (std::size_t i = 0; i < a.points.size(); i += 1 + a.points.size() / 200)
    for (std::size_t j = 0; j < b.points.size(); j += 1 + b.points.size() / 200)
      least = std::min(least, (a.points[i] - b.points[j]).squaredNorm());
  return std::sqrt(least);
}

std::vector<Region> ClippedRegions(const cv::Mat4b& color, const DenseSurface& dense,
                                   const PanoramaGrid& grid, const LampConfig& config) {
  cv::Mat1b clipped(color.size());
  for (int y = 0; y < color.rows; ++y) {
    for (int x = 0; x < color.cols; ++x) {
      const cv::Vec4b c = color(y, x);
      clipped(y, x) =
          c[3] > 0 && std::min({c[0], c[1], c[2]}) >= config.clipped && dense.inverse_range(y, x) > 0;
    }
  }
  cv::Mat1i labels;
  const int count = cv::connectedComponents(clipped, labels, 8, CV_32S);
  std::vector<Region> all(static_cast<std::size_t>(count));
  std::vector<double> area(all.size(), 0);
  const double step2 = grid.step_rad() * grid.step_rad();
  const Eigen::Vector3d center = grid.panorama().center;
  for (int y = 0; y < color.rows; ++y) {
    for (int x = 0; x < color.cols; ++x) {
      const auto k = static_cast<std::size_t>(labels(y, x));
      if (k == 0) continue;
      const Eigen::Vector3d ray = grid.Ray(x, y).cast<double>();
      const double range = 1.0 / static_cast<double>(dense.inverse_range(y, x));
      all[k].points.push_back(center + ray * range);
      area[k] += step2 * std::hypot(ray.x(), ray.y()) * range * range;
    }
  }
  std::vector<Region> kept;
  for (std::size_t k = 1; k < all.size(); ++k) {
    if (area[k] < config.least_area_m2 || all[k].points.size() < 12) continue;
    FitRegion(all[k], center);
    kept.push_back(std::move(all[k]));
  }
  std::sort(kept.begin(), kept.end(),
            [](const Region& a, const Region& b) { return a.points.size() > b.points.size(); });
  if (kept.size() > 4 * kMostLamps) kept.resize(4 * kMostLamps);
  for (std::size_t a = 0; a < kept.size(); ++a) {
    for (std::size_t b = a + 1; b < kept.size();) {
      const bool coplanar = kept[a].normal.dot(kept[b].normal) > 0.9 &&
                            std::abs(kept[a].normal.dot(kept[b].mean - kept[a].mean)) < config.gap_m;
      if (!coplanar || Gap(kept[a], kept[b]) > config.gap_m) {
        ++b;
        continue;
      }
      kept[a].points.insert(kept[a].points.end(), kept[b].points.begin(), kept[b].points.end());
      FitRegion(kept[a], center);
      kept.erase(kept.begin() + static_cast<std::ptrdiff_t>(b));
      b = a + 1;
    }
  }
  if (kept.size() > kMostLamps) kept.resize(kMostLamps);
  return kept;
}

// Non-negative least squares of a few unknowns by coordinate descent on the normal equations.
Eigen::VectorXd SolveNonNegative(const Eigen::MatrixXd& A, const Eigen::VectorXd& b) {
  Eigen::VectorXd x = Eigen::VectorXd::Zero(b.size());
  for (int pass = 0; pass < 300; ++pass)
    for (Eigen::Index i = 0; i < b.size(); ++i)
      if (A(i, i) > 0) x[i] = std::max(0.0, x[i] + (b[i] - A.row(i).dot(x)) / A(i, i));
  return x;
}

struct Shade {
  std::size_t plane;
  std::vector<double> factors;     // of each lamp
  std::array<double, 3> radiance;  // B G R, linear
};

// Radiance of every lamp and channel, for the mean albedo of one half. Alternates between the planes' albedos
// and ambient light, and the lamps.
std::array<Eigen::VectorXd, 3> SolveRadiance(const std::vector<Shade>& shades, std::size_t planes,
                                             std::size_t lamps) {
  std::array<Eigen::VectorXd, 3> radiance;
  for (std::size_t c = 0; c < 3; ++c) {
    Eigen::VectorXd L = Eigen::VectorXd::Ones(static_cast<Eigen::Index>(lamps));
    std::vector<double> albedo(planes, 0.5), ambient(planes, 0);
    for (int iteration = 0; iteration < 30; ++iteration) {
      // Each plane: radiance = albedo s + ambient with s = sum of F L.
      std::vector<std::array<double, 5>> sums(planes, std::array<double, 5>{});
      for (const Shade& sh : shades) {
        double s = 0;
        for (std::size_t l = 0; l < lamps; ++l) s += sh.factors[l] * L[static_cast<Eigen::Index>(l)];
        auto& t = sums[sh.plane];
        t[0] += 1, t[1] += s, t[2] += s * s, t[3] += sh.radiance[c], t[4] += s * sh.radiance[c];
      }
      for (std::size_t p = 0; p < planes; ++p) {
        const auto& t = sums[p];
        const double det = t[0] * t[2] - t[1] * t[1];
        if (t[0] < 20 || det < 1e-12 * t[0] * t[2]) continue;
        albedo[p] = std::clamp((t[0] * t[4] - t[1] * t[3]) / det, 1e-4, 1e4);
        ambient[p] = std::max(0.0, (t[3] - albedo[p] * t[1]) / t[0]);
      }
      Eigen::MatrixXd A = Eigen::MatrixXd::Identity(L.size(), L.size()) * 1e-9;
      Eigen::VectorXd b = Eigen::VectorXd::Zero(L.size());
      for (const Shade& sh : shades) {
        for (std::size_t l = 0; l < lamps; ++l) {
          const double f = albedo[sh.plane] * sh.factors[l];
          b[static_cast<Eigen::Index>(l)] += f * (sh.radiance[c] - ambient[sh.plane]);
          for (std::size_t k = 0; k < lamps; ++k)
            A(static_cast<Eigen::Index>(l), static_cast<Eigen::Index>(k)) +=
                f * albedo[sh.plane] * sh.factors[k];
        }
      }
      // Two lamps whose light falls alike on every wall are told apart by nothing: they are held at what is
      // common to all of them.
      const double common = L.mean(), hold = 0.05 * A.diagonal().mean();
      A.diagonal().array() += hold;
      b.array() += hold * common;
      L = SolveNonNegative(A, b);
      // Only albedo x radiance is known: the mean albedo, by samples, is one half.
      double mean = 0, count = 0;
      for (std::size_t p = 0; p < planes; ++p) {
        mean += sums[p][0] * albedo[p];
        count += sums[p][0];
      }
      const double scale = count > 0 ? mean / count / 0.5 : 1;
      if (scale > 0) L *= scale;
    }
    radiance[c] = L;
  }
  return radiance;
}

}  // namespace

double FormFactor(const RoomLamp& lamp, const Eigen::Vector3d& x, const Eigen::Vector3d& n) {
  const Eigen::Vector3d normal = lamp.edge_u.cross(lamp.edge_v);
  const double area = normal.norm();
  if (area <= 0) return 0;
  auto steps = [](double length) { return std::clamp(static_cast<int>(std::ceil(length / 0.25)), 1, 8); };
  const int nu = steps(lamp.edge_u.norm()), nv = steps(lamp.edge_v.norm());
  double sum = 0;
  for (int j = 0; j < nv; ++j) {
    for (int i = 0; i < nu; ++i) {
      const Eigen::Vector3d p =
          lamp.center + ((i + 0.5) / nu - 0.5) * lamp.edge_u + ((j + 0.5) / nv - 0.5) * lamp.edge_v;
      const Eigen::Vector3d to = p - x;
      const double r2 = to.squaredNorm();
      const double at_surface = n.dot(to), at_lamp = -normal.dot(to) / area;
      if (at_surface > 0 && at_lamp > 0 && r2 > 1e-4)
        sum += at_surface * at_lamp / (std::numbers::pi * r2 * r2);
    }
  }
  return sum * area / (nu * nv);
}

std::vector<RoomLamp> FindLamps(const cv::Mat4b& color, const DenseSurface& dense, const SurfaceNodes& nodes,
                                const std::vector<GrownPlane>& planes, const PanoramaGrid& grid,
                                const LampConfig& config) {
  std::vector<RoomLamp> lamps;
  for (const Region& region : ClippedRegions(color, dense, grid, config)) {
    lamps.push_back(Rectangle(region));
    lamps.back().name.append("lamp_").append(std::to_string(lamps.size()));
  }
  if (lamps.empty()) return lamps;
  std::vector<Shade> shades;
  constexpr std::size_t kMostPlanes = 8;
  const Eigen::Vector3d center = grid.panorama().center;
  const int step = std::max(4, static_cast<int>(std::sqrt(static_cast<double>(color.total()) / 20'000)));
  for (int y = step / 2; y < color.rows; y += step) {
    for (int x = step / 2; x < color.cols; x += step) {
      const int node = dense.node(y, x);
      if (node < 0) continue;
      const int plane = nodes.room_plane[static_cast<std::size_t>(node)];
      const cv::Vec4b c = color(y, x);
      if (plane < 0 || plane >= static_cast<int>(kMostPlanes) || c[3] == 0 ||
          std::max({c[0], c[1], c[2]}) >= 240)
        continue;
      Shade shade;
      shade.plane = static_cast<std::size_t>(plane);
      const Eigen::Vector3d p =
          center + grid.Ray(x, y).cast<double>() / static_cast<double>(dense.inverse_range(y, x));
      const Eigen::Vector3d n = -planes[shade.plane].m.normalized();
      for (const RoomLamp& lamp : lamps) shade.factors.push_back(FormFactor(lamp, p, n));
      for (std::size_t k = 0; k < 3; ++k)
        shade.radiance[k] = static_cast<double>(ToLinear(c[static_cast<int>(k)]));
      shades.push_back(std::move(shade));
    }
  }
  const auto radiance = SolveRadiance(shades, std::min(planes.size(), kMostPlanes), lamps.size());
  for (std::size_t l = 0; l < lamps.size(); ++l) {
    const auto i = static_cast<Eigen::Index>(l);
    Eigen::Vector3d rgb(radiance[2][i], radiance[1][i], radiance[0][i]);
    // It was clipped: at least the picture's white.
    if (!(rgb.maxCoeff() >= 1)) rgb = Eigen::Vector3d::Ones();
    rgb = rgb.cwiseMax(0.02 * rgb.maxCoeff());
    lamps[l].intensity = rgb.maxCoeff();
    lamps[l].color = rgb / rgb.maxCoeff();
  }
  return lamps;
}

}  // namespace mixstage
