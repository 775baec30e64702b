// SPDX-License-Identifier: Apache-2.0
#include "server/environment/lamps.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "proto/base/srgb.h"
#include "proto/base/text.h"

namespace mixstage {
namespace {

constexpr std::size_t kMostLamps = 32;

struct Region {
  std::vector<Eigen::Vector3d> points;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero(), normal = Eigen::Vector3d::UnitZ();
  double measured = 0;  // of its points: range came back from there
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

// Lamps hang under ceilings and windows stand in walls: a region that nearly faces as a plane of the room
// beside it does is taken to face alike. Its points' directions are exact, their ranges hang on whatever is
// around: they are laid on the plane that most of them are near.
void LayFlat(const std::vector<GrownPlane>& planes, const Eigen::Vector3d& center, Region& region) {
  constexpr double kAlike = 0.9, kBeside_m = 0.4;
  double best = kAlike;
  for (const GrownPlane& plane : planes) {
    const Eigen::Vector3d n = -plane.m.normalized();
    const double beside = n.dot(region.mean - center) + 1 / plane.m.norm();
    if (std::abs(beside) > kBeside_m || n.dot(region.normal) < best) continue;
    best = n.dot(region.normal);
    region.normal = n;
  }
  std::vector<double> away;
  for (const Eigen::Vector3d& p : region.points) away.push_back(region.normal.dot(p - center));
  const auto middle = away.begin() + static_cast<std::ptrdiff_t>(away.size() / 2);
  std::nth_element(away.begin(), middle, away.end());
  std::vector<Eigen::Vector3d> flat;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : region.points) {
    const double along = region.normal.dot(p - center);
    const double times = std::abs(along) > 1e-6 ? *middle / along : 0;
    if (!(times > 0.5 && times < 2)) continue;
    flat.push_back(center + times * (p - center));
    sum += flat.back();
  }
  if (flat.empty()) return;
  region.mean = sum / static_cast<double>(flat.size());
  region.points = std::move(flat);
}

// Around its points but for the outermost hundredth on each side.
RoomLamp Rectangle(const Region& region) {
  constexpr double kOutermost = 0.01;
  const Eigen::Vector3d u = region.normal.unitOrthogonal(), v = region.normal.cross(u);
  std::vector<cv::Point2f> flat;
  for (const Eigen::Vector3d& p : region.points)
    flat.emplace_back(static_cast<float>(u.dot(p - region.mean)), static_cast<float>(v.dot(p - region.mean)));
  const double angle = cv::minAreaRect(flat).angle * std::numbers::pi / 180;
  const Eigen::Vector3d along = std::cos(angle) * u + std::sin(angle) * v;
  const Eigen::Vector3d across = -std::sin(angle) * u + std::cos(angle) * v;
  auto extent = [&](const Eigen::Vector3d& axis) {
    std::vector<double> at;
    for (const Eigen::Vector3d& p : region.points) at.push_back(axis.dot(p - region.mean));
    std::sort(at.begin(), at.end());
    const auto skip = static_cast<std::size_t>(kOutermost * static_cast<double>(at.size()));
    return std::array<double, 2>{at[skip], at[at.size() - 1 - skip]};
  };
  const auto [along_from, along_to] = extent(along);
  const auto [across_from, across_to] = extent(across);
  RoomLamp lamp;
  lamp.center = region.mean + (along_from + along_to) / 2 * along + (across_from + across_to) / 2 * across;
  lamp.edge_u = (along_to - along_from) * along;
  lamp.edge_v = (across_to - across_from) * across;  // edge_u x edge_v is the normal
  return lamp;
}

// Little comes back from a lamp, and less from a far one: where it hangs is then what is around it. Lamps of
// one kind hang at one height: a lamp that is of another's size at that height is hung there, if range came
// back from more of the other.
void HangAlike(const std::vector<double>& measured, const Eigen::Vector3d& center,
               std::vector<RoomLamp>& lamps) {
  constexpr double kFacing = 0.99, kSize = 0.12, kApart_m = 0.2;
  const std::vector<RoomLamp> found = lamps;
  auto facing = [](const RoomLamp& l) { return l.edge_u.cross(l.edge_v).normalized(); };
  auto sides = [](const RoomLamp& l) { return std::minmax({l.edge_u.norm(), l.edge_v.norm()}); };
  for (std::size_t b = 0; b < found.size(); ++b) {
    std::size_t like = b;
    for (std::size_t a = 0; a < found.size(); ++a) {
      const Eigen::Vector3d n = facing(found[a]);
      const double of_a = n.dot(found[a].center - center), of_b = n.dot(found[b].center - center);
      if (measured[a] <= measured[like] || facing(found[b]).dot(n) < kFacing ||
          std::abs(of_a - of_b) > kApart_m || std::abs(of_b) < kApart_m)
        continue;
      const double times = of_a / of_b;
      const auto [short_a, long_a] = sides(found[a]);
      const auto [short_b, long_b] = sides(found[b]);
      if (std::abs(times * short_b / short_a - 1) > kSize || std::abs(times * long_b / long_a - 1) > kSize)
        continue;
      like = a;
      lamps[b].center = center + times * (found[b].center - center);
      lamps[b].edge_u = times * found[b].edge_u;
      lamps[b].edge_v = times * found[b].edge_v;
    }
  }
}

double Gap(const Region& a, const Region& b) {
  double least = 1e9;
  for (std::size_t i = 0; i < a.points.size(); i += 1 + a.points.size() / 200)
    for (std::size_t j = 0; j < b.points.size(); j += 1 + b.points.size() / 200)
      least = std::min(least, (a.points[i] - b.points[j]).squaredNorm());
  return std::sqrt(least);
}

std::vector<Region> ClippedRegions(const cv::Mat4b& color, const DenseSurface& dense,
                                   const SurfaceNodes& nodes, const PanoramaGrid& grid,
                                   const LampConfig& config) {
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
      const int node = dense.node(y, x);
      all[k].measured += node >= 0 && nodes.inverse_range[static_cast<std::size_t>(node)] > 0 ? 1 : 0;
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
      kept[a].measured += kept[b].measured;
      FitRegion(kept[a], center);
      kept.erase(kept.begin() + static_cast<std::ptrdiff_t>(b));
      b = a + 1;
    }
  }
  if (kept.size() > kMostLamps) kept.resize(kMostLamps);
  return kept;
}

// The room's surface as what it sends back: parts of the panorama. Lamps are none of it.
struct Reflector {
  Eigen::Vector3d center, normal;
  double area = 0;
  Eigen::Array3d radiance = Eigen::Array3d::Zero();  // B G R, linear
};

struct Reflectors {
  std::vector<Reflector> parts;
  Eigen::Array3d mean = Eigen::Array3d::Zero();  // radiance, by solid angle

  // Irradiance / pi at x on a surface of normal n. Where nothing was seen the room goes on like its mean.
  [[nodiscard]] Eigen::Array3d Onto(const Eigen::Vector3d& x, const Eigen::Vector3d& n) const {
    Eigen::Array3d sum = Eigen::Array3d::Zero();
    double share = 0;
    for (const Reflector& r : parts) {
      const Eigen::Vector3d to = r.center - x;
      const double at_surface = n.dot(to), at_part = -r.normal.dot(to), d2 = to.squaredNorm();
      if (at_surface <= 0 || at_part <= 0) continue;
      const double factor =
          at_surface * at_part * r.area / (d2 * (std::numbers::pi * d2 + r.area));  // as a disc
      sum += factor * r.radiance;
      share += factor;
    }
    return share > 1 ? Eigen::Array3d(sum / share) : Eigen::Array3d(sum + (1 - share) * mean);
  }
};

Eigen::Array3d LinearOf(const cv::Vec4b& c) {
  const SrgbTables& srgb = SrgbTables::Get();
  return Eigen::Array3f(srgb.ToLinear(c[0]), srgb.ToLinear(c[1]), srgb.ToLinear(c[2])).cast<double>();
}

Reflectors ReflectorsOf(const cv::Mat4b& color, const DenseSurface& dense, const SurfaceNodes& nodes,
                        const PanoramaGrid& grid, const LampConfig& config) {
  constexpr double kParts = 2500, kLeastCosine = 0.1;
  Reflectors out;
  const int side = std::max(2, static_cast<int>(std::sqrt(static_cast<double>(color.total()) / kParts)));
  const Eigen::Vector3d center = grid.panorama().center;
  double angle = 0;
  for (int v = 0; v + side <= color.rows; v += side) {
    for (int u = 0; u + side <= color.cols; u += side) {
      const int y = v + side / 2, x = u + side / 2;
      const int node = dense.node(y, x);
      if (node < 0) continue;
      Reflector part;
      int count = 0;
      for (int j = v; j < v + side; ++j) {
        for (int i = u; i < u + side; ++i) {
          const cv::Vec4b c = color(j, i);
          if (c[3] == 0 || dense.node(j, i) < 0 || std::min({c[0], c[1], c[2]}) >= config.clipped) continue;
          part.radiance += LinearOf(c);
          ++count;
        }
      }
      if (count == 0) continue;
      part.radiance /= count;
      const Eigen::Vector3d ray = grid.Ray(x, y).cast<double>();
      const double range = 1.0 / static_cast<double>(dense.inverse_range(y, x));
      const double solid = count * grid.step_rad() * grid.step_rad() * std::hypot(ray.x(), ray.y());
      part.center = center + range * ray;
      part.normal = -nodes.plane[static_cast<std::size_t>(node)].cast<double>().normalized();
      part.area = solid * range * range / std::max(kLeastCosine, -part.normal.dot(ray));
      out.mean += solid * part.radiance;
      angle += solid;
      out.parts.push_back(part);
    }
  }
  if (angle > 0) out.mean /= angle;
  return out;
}

// Nothing that the scan saw stands between x and p; what it did not look at counts as free.
bool SeesEachOther(const Eigen::Vector3d& x, const Eigen::Vector3d& p, const DenseSurface& dense,
                   const PanoramaGrid& grid) {
  constexpr int kSteps = 24;
  constexpr double kEnds_m = 0.15, kBehind_m = 0.06, kBehindOfRange = 0.02;
  const double length = (p - x).norm();
  for (int k = 0; k < kSteps; ++k) {
    const double t = (k + 0.5) / kSteps;
    if (t * length < kEnds_m || (1 - t) * length < kEnds_m) continue;
    const Eigen::Vector3d q = x + t * (p - x) - grid.panorama().center;
    const auto pixel = grid.panorama().Pixel(q);
    if (!pixel) continue;
    const int u = static_cast<int>(std::lround(pixel->x())), v = static_cast<int>(std::lround(pixel->y()));
    if (u < 0 || v < 0 || u >= dense.inverse_range.cols || v >= dense.inverse_range.rows) continue;
    const float inverse = dense.inverse_range(v, u);
    if (inverse <= 0) continue;
    const double range = 1.0 / static_cast<double>(inverse);
    if (q.norm() > range + kBehind_m + kBehindOfRange * range) return false;
  }
  return true;
}

struct Shade {
  std::size_t plane;
  std::vector<double> factors;  // of each lamp
  Eigen::Array3d around;        // irradiance / pi that other surfaces send, B G R
  Eigen::Array3d radiance;      // B G R, linear
};

struct LampPrior {
  Eigen::VectorXd log_radiance;  // empty: all lamps are alike, whatever they are
  double deviation = 1.0;        // of the logarithm
};

// Logarithms of the lamps' radiances: log radiance = log albedo + log(around + sum of factor x L), the albedo
// of a plane unknown. Surfaces' patterns are outliers of both signs: Cauchy weights. around is known in the
// picture's own units, so that the lamps come out in them.
Eigen::VectorXd SolveRadiance(const std::vector<Shade>& shades, std::size_t planes, std::size_t lamps,
                              const std::function<double(const Eigen::Array3d&)>& channel,
                              const LampPrior& prior) {
  constexpr double kUsualAlbedo = 0.5, kAlbedoDeviation = 0.7;
  constexpr double kIndependent =
      40;  // samples of a plane that tell something new: its pattern and our model err alike
  constexpr double kLeastScale = 0.02;
  const auto n = static_cast<Eigen::Index>(planes + lamps), first = static_cast<Eigen::Index>(planes);
  Eigen::VectorXd at(n);
  at.head(first).setConstant(std::log(kUsualAlbedo));
  at.tail(n - first).setConstant(std::log(5.0));
  if (prior.log_radiance.size() > 0) at.tail(n - first) = prior.log_radiance;
  std::vector<int> count(planes, 0);
  for (const Shade& s : shades) ++count[s.plane];
  std::vector<double> off(shades.size());
  Eigen::VectorXd J(n);
  for (int iteration = 0; iteration < 40; ++iteration) {
    for (int pass = 0; pass < 2; ++pass) {
      double scale = 0;
      if (pass == 1) {
        std::vector<double> sizes(off.size());
        std::transform(off.begin(), off.end(), sizes.begin(), [](double r) { return std::abs(r); });
        const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
        std::nth_element(sizes.begin(), middle, sizes.end());
        scale = std::max(kLeastScale, 1.48 * *middle);
      }
      Eigen::MatrixXd A = Eigen::MatrixXd::Zero(n, n);
      Eigen::VectorXd b = Eigen::VectorXd::Zero(n);
      for (std::size_t i = 0; i < shades.size(); ++i) {
        const Shade& s = shades[i];
        double light = channel(s.around);
        for (std::size_t l = 0; l < lamps; ++l)
          light += s.factors[l] * std::exp(at[first + static_cast<Eigen::Index>(l)]);
        light = std::max(light, 1e-6);
        const auto p = static_cast<Eigen::Index>(s.plane);
        if (pass == 0) {
          off[i] = std::log(channel(s.radiance)) - at[p] - std::log(light);
          continue;
        }
        J.setZero();
        J[p] = 1;
        for (std::size_t l = 0; l < lamps; ++l) {
          const auto k = first + static_cast<Eigen::Index>(l);
          J[k] = s.factors[l] * std::exp(at[k]) / light;
        }
        const double w = std::min(1.0, kIndependent / count[s.plane]) / (scale * scale + off[i] * off[i]);
        A += w * J * J.transpose();
        b += w * off[i] * J;
      }
      if (pass == 0) continue;
      for (Eigen::Index p = 0; p < first; ++p) {
        A(p, p) += 1 / (kAlbedoDeviation * kAlbedoDeviation);
        b[p] += (std::log(kUsualAlbedo) - at[p]) / (kAlbedoDeviation * kAlbedoDeviation);
      }
      const double alike = at.tail(n - first).mean();
      for (Eigen::Index k = first; k < n; ++k) {
        const double toward = prior.log_radiance.size() > 0 ? prior.log_radiance[k - first] : alike;
        A(k, k) += 1 / (prior.deviation * prior.deviation);
        b[k] += (toward - at[k]) / (prior.deviation * prior.deviation);
      }
      at += A.ldlt().solve(b).cwiseMax(-0.7).cwiseMin(0.7);
      for (Eigen::Index p = 0; p < first; ++p) at[p] = std::min(at[p], 0.0);  // albedo <= 1
      for (Eigen::Index k = first; k < n; ++k)
        at[k] = std::clamp(at[k], 0.0, std::log(1e4));  // clipped: >= 1
    }
  }
  return at.tail(n - first);
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
  std::vector<double> measured;  // share of a lamp
  for (Region& region : ClippedRegions(color, dense, nodes, grid, config)) {
    measured.push_back(region.measured / static_cast<double>(region.points.size()));
    LayFlat(planes, grid.panorama().center, region);
    lamps.push_back(Rectangle(region));
    lamps.back().name.append("lamp_").append(std::to_string(lamps.size()));
  }
  if (lamps.empty()) return lamps;
  HangAlike(measured, grid.panorama().center, lamps);
  constexpr std::size_t kMostPlanes = 8;
  constexpr double kSamples = 4000;
  constexpr int kBright = 240, kDark = 4;
  const Eigen::Vector3d center = grid.panorama().center;
  const Reflectors reflectors = ReflectorsOf(color, dense, nodes, grid, config);
  std::vector<Shade> shades, hidden;  // those that all lamps shine on, and the others
  const int step = std::max(2, static_cast<int>(std::sqrt(static_cast<double>(color.total()) / kSamples)));
  for (int y = step / 2; y < color.rows; y += step) {
    for (int x = step / 2; x < color.cols; x += step) {
      const int node = dense.node(y, x);
      if (node < 0) continue;
      const int plane = nodes.room_plane[static_cast<std::size_t>(node)];
      const cv::Vec4b c = color(y, x);
      if (plane < 0 || plane >= static_cast<int>(kMostPlanes) || c[3] == 0 ||
          std::max({c[0], c[1], c[2]}) >= kBright || std::min({c[0], c[1], c[2]}) <= kDark)
        continue;
      Shade shade;
      shade.plane = static_cast<std::size_t>(plane);
      const Eigen::Vector3d p =
          center + grid.Ray(x, y).cast<double>() / static_cast<double>(dense.inverse_range(y, x));
      const Eigen::Vector3d n = -planes[shade.plane].m.normalized();
      bool lit = true;
      for (const RoomLamp& lamp : lamps) {
        shade.factors.push_back(FormFactor(lamp, p, n));
        for (const double k : {-0.35, 0.0, 0.35})
          lit = lit && (shade.factors.back() == 0 ||
                        SeesEachOther(p, lamp.center + k * (lamp.edge_u + lamp.edge_v), dense, grid));
      }
      shade.around = reflectors.Onto(p, n);
      shade.radiance = LinearOf(c);
      (lit ? shades : hidden).push_back(std::move(shade));
    }
  }
  if (shades.size() < hidden.size() / 4) shades.insert(shades.end(), hidden.begin(), hidden.end());
  if (shades.empty()) {
    for (RoomLamp& lamp : lamps) lamp.color.setOnes();
    return lamps;
  }
  const std::size_t of_planes = std::min(planes.size(), kMostPlanes);
  const Eigen::VectorXd all =
      SolveRadiance(shades, of_planes, lamps.size(), [](const Eigen::Array3d& v) { return v.mean(); }, {});
  constexpr double kColorDeviation = 0.3;  // a camera is balanced to its room: lamps are white, more or less
  std::array<Eigen::VectorXd, 3> radiance;
  for (Eigen::Index k = 0; k < 3; ++k)
    radiance[static_cast<std::size_t>(k)] =
        SolveRadiance(shades, of_planes, lamps.size(), [k](const Eigen::Array3d& v) { return v[k]; },
                      {all, kColorDeviation});
  // What shines no brighter than it was clipped at is a bright thing: nothing around needs its light.
  constexpr double kOwnLight = 1.1;
  std::vector<RoomLamp> shining;
  for (std::size_t l = 0; l < lamps.size(); ++l) {
    const auto i = static_cast<Eigen::Index>(l);
    const Eigen::Vector3d rgb(std::exp(radiance[2][i]), std::exp(radiance[1][i]), std::exp(radiance[0][i]));
    if (rgb.maxCoeff() < kOwnLight) continue;
    shining.push_back(lamps[l]);
    shining.back().name = Text("lamp_%zu", shining.size());
    shining.back().intensity = rgb.maxCoeff();
    shining.back().color = rgb / rgb.maxCoeff();
  }
  return shining;
}

}  // namespace mixstage
