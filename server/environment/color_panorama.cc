// SPDX-License-Identifier: Apache-2.0
#include "server/environment/color_panorama.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "proto/base/check.h"
#include "proto/base/srgb.h"
#include "proto/geometry/half_camera.h"
#include "server/raster/rasteriser.h"

namespace mixstage {
namespace {

constexpr int kOcclusionShrink = 2;
constexpr int kCoarse = 4;           // the coarse band's pixels are this much larger
constexpr double kCoarseBlur = 2.5;  // of those pixels

// The colour camera in single precision.
struct Lens {
  explicit Lens(const PinholeCamera& c) : camera(c), fold_r2(static_cast<float>(c.FoldRadiusSquared())) {}

  // False behind the camera, beyond the lens's fold or outside the picture (less a pixel's half: bilinear).
  bool Project(const Eigen::Vector3f& p, float& u, float& v) const {
    if (p.z() <= 1e-3f) return false;
    const float x = p.x() / p.z(), y = p.y() / p.z(), r2 = x * x + y * y;
    if (r2 >= fold_r2) return false;
    const auto f = [](double value) { return static_cast<float>(value); };
    const float radial = (1 + r2 * (f(camera.k1) + r2 * (f(camera.k2) + r2 * f(camera.k3)))) /
                         (1 + r2 * (f(camera.k4) + r2 * (f(camera.k5) + r2 * f(camera.k6))));
    const float p1 = f(camera.p1), p2 = f(camera.p2);
    u = f(camera.fx) * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + f(camera.cx);
    v = f(camera.fy) * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + f(camera.cy);
    return u >= 0 && v >= 0 && u <= static_cast<float>(camera.width - 1) &&
           v <= static_cast<float>(camera.height - 1);
  }

  PinholeCamera camera;
  float fold_r2;
};

struct Vignetting {
  Vignetting(const PinholeCamera& c, double a_, double b_)
      : cx(c.cx), cy(c.cy), half2((c.width * c.width + c.height * c.height) / 4.0), a(a_), b(b_) {}
  [[nodiscard]] double R2(double u, double v) const {
    return ((u - cx) * (u - cx) + (v - cy) * (v - cy)) / half2;
  }
  [[nodiscard]] double Gain(double u, double v) const {
    const double r2 = R2(u, v);
    return std::max(0.05, 1 + r2 * (a + r2 * b));
  }
  double cx, cy, half2, a, b;
};

struct ViewGeometry {
  Eigen::Matrix3f R;  // camera from world
  Eigen::Vector3f t;
  explicit ViewGeometry(const RigidTransform& T_world_color, const Eigen::Vector3d& center)
      : R(T_world_color.linear().transpose().cast<float>()),
        // About the panorama's centre: single precision keeps the digits.
        t((T_world_color.linear().transpose() * (center - T_world_color.translation())).cast<float>()) {}
};

bool Hidden(const ViewOcclusion& occlusion, float u, float v, float z) {
  const int x =
      std::clamp(static_cast<int>(std::lround(u / kOcclusionShrink)), 0, occlusion.depth_m.cols - 1);
  const int y =
      std::clamp(static_cast<int>(std::lround(v / kOcclusionShrink)), 0, occlusion.depth_m.rows - 1);
  const float there = occlusion.depth_m(y, x);
  return there > 0 && z > 1.02f * there + 0.05f;
}

// A view's weight at a place: full in the middle, none at the border.
float Feather(const PinholeCamera& c, float u, float v) {
  const float x = 1 - std::abs(2 * u / static_cast<float>(c.width - 1) - 1);
  const float y = 1 - std::abs(2 * v / static_cast<float>(c.height - 1) - 1);
  return x * y + 1e-5f;
}

template <typename V, typename M>
V Bilinear(const M& picture, float u, float v) {
  const int x = std::clamp(static_cast<int>(u), 0, std::max(0, picture.cols - 2));
  const int y = std::clamp(static_cast<int>(v), 0, std::max(0, picture.rows - 2));
  const float fx = std::clamp(u - static_cast<float>(x), 0.f, 1.f),
              fy = std::clamp(v - static_cast<float>(y), 0.f, 1.f);
  const auto* top = picture.template ptr<cv::Vec3w>(y) + x;
  const auto* bottom = picture.template ptr<cv::Vec3w>(std::min(y + 1, picture.rows - 1)) + x;
  V value;
  for (int c = 0; c < 3; ++c) {
    const float a =
        static_cast<float>(top[0][c]) + fx * (static_cast<float>(top[1][c]) - static_cast<float>(top[0][c]));
    const float b = static_cast<float>(bottom[0][c]) +
                    fx * (static_cast<float>(bottom[1][c]) - static_cast<float>(bottom[0][c]));
    value[c] = a + fy * (b - a);
  }
  return value;
}

constexpr float kCodeScale = 240;  // 16-bit codes of a level: 255 levels and room above

// The picture with exposure and vignetting taken out, sRGB levels times kCodeScale. What is clipped stays
// white.
cv::Mat3w Corrected(const cv::Mat3b& bgr, const Vignetting& vignetting, double exposure) {
  constexpr int kSteps = 8192;  // of sqrt(linear) up to 1.25
  static const std::vector<std::uint16_t> to_code = [] {
    std::vector<std::uint16_t> table(kSteps + 1);
    for (int i = 0; i <= kSteps; ++i) {
      const float root = 1.118f * static_cast<float>(i) / kSteps;
      table[static_cast<std::size_t>(i)] = static_cast<std::uint16_t>(
          std::lround(std::min(65535.f, 255 * kCodeScale * SrgbOfLinear(root * root))));
    }
    return table;
  }();
  cv::Mat3w out(bgr.size());
  cv::parallel_for_({0, bgr.rows}, [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      for (int x = 0; x < bgr.cols; ++x) {
        const auto gain = static_cast<float>(1 / (vignetting.Gain(x, y) * exposure));
        const cv::Vec3b in = bgr(y, x);
        for (int c = 0; c < 3; ++c) {
          float linear = SrgbTables::Get().ToLinear(in[c]) * gain;
          if (in[c] >= 254) linear = std::max(linear, 1.f);
          const float root = std::sqrt(linear) * (kSteps / 1.118f);
          out(y, x)[c] = to_code[static_cast<std::size_t>(std::min(root + 0.5f, static_cast<float>(kSteps)))];
        }
      }
    }
  });
  return out;
}

// Views that may see a tile, by its middle and a margin.
std::vector<std::size_t> ViewsOfTile(const PanoramaGrid& grid, const cv::Mat1f& inverse_range,
                                     const cv::Rect& tile, const std::vector<ViewGeometry>& geometry,
                                     const PinholeCamera& camera) {
  std::vector<std::size_t> seeing;
  const double half_diagonal = std::hypot(camera.width, camera.height) / 2;
  const double reach = std::atan(1.15 * half_diagonal / std::min(camera.fx, camera.fy));
  for (std::size_t i = 0; i < geometry.size(); ++i) {
    double nearest = 10;
    for (int ky = 0; ky <= 2; ++ky) {
      for (int kx = 0; kx <= 2; ++kx) {
        const int x = tile.x + kx * (tile.width - 1) / 2, y = tile.y + ky * (tile.height - 1) / 2;
        const float value = inverse_range(y, x);
        const Eigen::Vector3f p =
            geometry[i].R * (grid.Ray(x, y) / (value > 0 ? value : 0.25f)) + geometry[i].t;
        nearest = std::min(nearest, static_cast<double>(std::atan2(std::hypot(p.x(), p.y()), p.z())));
      }
    }
    if (nearest < reach) seeing.push_back(i);
  }
  return seeing;
}

}  // namespace

Result<std::vector<cv::Mat1f>> DrawDepths(const SurfaceMesh& mesh, const PinholeCamera& camera,
                                          const std::vector<PosedPicture>& views) {
  auto rasteriser = CreateRasteriser(RasterBackend::kCpu, camera, {});
  if (!rasteriser) return tl::unexpected(rasteriser.error());
  std::vector<cv::Mat1f> depths;
  for (const PosedPicture& view : views) {
    (*rasteriser)->Begin({});
    (*rasteriser)
        ->DrawDepth({mesh.positions, mesh.indices}, Eigen::Affine3d(view.T_world_color.inverse().matrix()),
                    Faces::kBoth);
    const VisibilityBuffer& buffer = (*rasteriser)->Finish();
    cv::Mat1f depth_m(camera.height, camera.width);
    for (int y = 0; y < depth_m.rows; ++y)
      std::copy_n(buffer.depth_m.ptr<float>(y), depth_m.cols, depth_m[y]);
    depths.push_back(depth_m);
  }
  return depths;
}

Result<std::vector<ViewOcclusion>> FindOcclusions(const SurfaceMesh& mesh, const PinholeCamera& camera,
                                                  const std::vector<PosedPicture>& views) {
  auto depths = DrawDepths(mesh, HalfCamera(camera), views);
  if (!depths) return tl::unexpected(depths.error());
  std::vector<ViewOcclusion> occlusions;
  const cv::Mat kernel = cv::getStructuringElement(cv::MORPH_RECT, {3, 3});
  for (cv::Mat1f& depth_m : *depths) {
    for (float& z : depth_m)
      if (z <= 0) z = 1e6f;
    cv::erode(depth_m, depth_m, kernel);
    occlusions.push_back({depth_m});
  }
  return occlusions;
}

Photometry SolvePhotometry(const std::vector<PosedPicture>& views,
                           const std::vector<ViewOcclusion>& occlusions, const Rig& rig,
                           const PanoramaGrid& grid, const cv::Mat1f& inverse_range) {
  MIX_CHECK(occlusions.size() == views.size());
  Photometry result;
  result.vignetting_a = rig.vignetting_a;
  result.vignetting_b = rig.vignetting_b;
  result.exposure.assign(views.size(), 1.0);
  const Lens lens(rig.color);
  std::vector<ViewGeometry> geometry;
  std::vector<cv::Mat3b> smooth;  // a point is a few pixels: misplacement by one does no harm
  for (const PosedPicture& v : views) {
    geometry.emplace_back(v.T_world_color, grid.panorama().center);
    cv::Mat3b blurred;
    cv::blur(v.bgr, blurred, {5, 5});
    smooth.push_back(blurred);
  }
  struct Sight {
    std::size_t view;
    double r2, log_light;
  };
  std::vector<std::vector<Sight>> points;
  const int step =
      std::max(2, static_cast<int>(std::sqrt(static_cast<double>(inverse_range.total()) / 20'000)));
  const Vignetting shape(rig.color, 0, 0);
  for (int y = step / 2; y < grid.height(); y += step) {
    for (int x = step / 2; x < grid.width(); x += step) {
      if (inverse_range(y, x) <= 0) continue;
      std::vector<Sight> sights;
      for (std::size_t i = 0; i < views.size(); ++i) {
        const Eigen::Vector3f p = geometry[i].R * (grid.Ray(x, y) / inverse_range(y, x)) + geometry[i].t;
        float u = 0, v = 0;
        if (!lens.Project(p, u, v) || Hidden(occlusions[i], u, v, p.z())) continue;
        const cv::Point at(static_cast<int>(u + 0.5f), static_cast<int>(v + 0.5f));
        const cv::Vec3b code = smooth[i](at);
        const cv::Vec3b sharp = views[i].bgr(at);
        // Edges are misplaced, white is clipped, black is noise.
        if (std::max({code[0], code[1], code[2]}) > 245 || code[1] < 12 || std::abs(code[1] - sharp[1]) > 12)
          continue;
        sights.push_back(
            {i, shape.R2(u, v), std::log(static_cast<double>(SrgbTables::Get().ToLinear(code[1])))});
      }
      if (sights.size() >= 2) points.push_back(std::move(sights));
    }
  }
  const auto n = static_cast<Eigen::Index>(views.size());
  Eigen::VectorXd x = Eigen::VectorXd::Zero(n + 2);  // log exposures, a, b
  x[n] = result.vignetting_a;
  x[n + 1] = result.vignetting_b;
  double scale = 0.1;  // of the robust weights
  for (int iteration = 0; iteration < 8; ++iteration) {
    Eigen::MatrixXd A = Eigen::MatrixXd::Zero(n + 2, n + 2);
    Eigen::VectorXd b = Eigen::VectorXd::Zero(n + 2);
    std::vector<double> deviations;
    for (const auto& sights : points) {
      // The point's own radiance is eliminated: deviations from the mean of its sights.
      const auto m = static_cast<Eigen::Index>(sights.size());
      Eigen::VectorXd residual(m);
      Eigen::MatrixXd lens_part(m, 2);
      for (Eigen::Index k = 0; k < m; ++k) {
        const Sight& s = sights[static_cast<std::size_t>(k)];
        const double gain = std::max(0.05, 1 + s.r2 * (x[n] + s.r2 * x[n + 1]));
        residual[k] = s.log_light - std::log(gain) - x[static_cast<Eigen::Index>(s.view)];
        lens_part(k, 0) = s.r2 / gain;
        lens_part(k, 1) = s.r2 * s.r2 / gain;
      }
      residual.array() -= residual.mean();
      const Eigen::RowVector2d lens_mean = lens_part.colwise().mean();
      for (Eigen::Index k = 0; k < m; ++k) {
        const double weight = 1 / (1 + residual[k] * residual[k] / (scale * scale));
        deviations.push_back(std::abs(residual[k]));
        std::vector<std::pair<Eigen::Index, double>> row;
        for (Eigen::Index l = 0; l < m; ++l)
          row.emplace_back(static_cast<Eigen::Index>(sights[static_cast<std::size_t>(l)].view),
                           (l == k ? 1.0 : 0.0) - 1.0 / static_cast<double>(m));
        row.emplace_back(n, lens_part(k, 0) - lens_mean[0]);
        row.emplace_back(n + 1, lens_part(k, 1) - lens_mean[1]);
        for (const auto& [i, vi] : row) {
          b[i] += weight * vi * residual[k];
          for (const auto& [j, vj] : row) A(i, j) += weight * vi * vj;
        }
      }
    }
    if (deviations.size() < 10 * views.size()) return result;
    // The mean of the exposures is 1; what no overlap determines stays.
    for (Eigen::Index i = 0; i < n; ++i)
      for (Eigen::Index j = 0; j < n; ++j)
        A(i, j) += static_cast<double>(deviations.size()) / static_cast<double>(n * n);
    b.head(n).array() -=
        x.head(n).sum() * static_cast<double>(deviations.size()) / static_cast<double>(n * n);
    A.diagonal().array() += 1e-3;
    x += A.ldlt().solve(b);
    const auto middle = deviations.begin() + static_cast<std::ptrdiff_t>(deviations.size() / 2);
    std::nth_element(deviations.begin(), middle, deviations.end());
    scale = std::max(0.004, 3 * 1.4826 * *middle);
    result.samples = static_cast<int>(deviations.size());
    // At mid grey one level is 1.8 % of the light.
    result.rms_levels = 1.4826 * *middle / 0.018;
  }
  x.head(n).array() -= x.head(n).mean();
  // Shine and dust make a per cent or two; a camera whose exposure stands still has none to solve for.
  constexpr double kStandsStill = 0.03;
  if (std::sqrt(x.head(n).squaredNorm() / static_cast<double>(n)) < kStandsStill) x.head(n).setZero();
  for (Eigen::Index i = 0; i < n; ++i) result.exposure[static_cast<std::size_t>(i)] = std::exp(x[i]);
  // A gain that is not one is none.
  if (1 + x[n] + x[n + 1] > 0.2 && std::abs(x[n]) < 1 && std::abs(x[n + 1]) < 1) {
    result.vignetting_a = x[n];
    result.vignetting_b = x[n + 1];
  }
  return result;
}

cv::Mat4b BlendColor(const std::vector<PosedPicture>& views, const std::vector<ViewOcclusion>& occlusions,
                     const PinholeCamera& camera, const Photometry& photometry, const PanoramaGrid& grid,
                     const cv::Mat1f& inverse_range) {
  MIX_CHECK(occlusions.size() == views.size() && photometry.exposure.size() == views.size());
  const Lens lens(camera);
  const Vignetting vignetting(camera, photometry.vignetting_a, photometry.vignetting_b);
  std::vector<ViewGeometry> geometry;
  std::vector<cv::Mat3w> fine(views.size()), coarse(views.size());
  for (std::size_t i = 0; i < views.size(); ++i) {
    geometry.emplace_back(views[i].T_world_color, grid.panorama().center);
    fine[i] = Corrected(views[i].bgr, vignetting, photometry.exposure[i]);
    cv::resize(fine[i], coarse[i], {}, 1.0 / kCoarse, 1.0 / kCoarse, cv::INTER_AREA);
    cv::GaussianBlur(coarse[i], coarse[i], {}, kCoarseBlur);
  }
  cv::Mat4b out(grid.height(), grid.width(), cv::Vec4b(0, 0, 0, 0));
  constexpr int kTile = 32;
  const int tiles_x = (grid.width() + kTile - 1) / kTile, tiles_y = (grid.height() + kTile - 1) / kTile;
  cv::parallel_for_({0, tiles_x * tiles_y}, [&](const cv::Range& tiles) {
    for (int t = tiles.start; t < tiles.end; ++t) {
      const cv::Rect tile = cv::Rect(t % tiles_x * kTile, t / tiles_x * kTile, kTile, kTile) &
                            cv::Rect(0, 0, grid.width(), grid.height());
      const std::vector<std::size_t> seeing = ViewsOfTile(grid, inverse_range, tile, geometry, camera);
      for (int y = tile.y; y < tile.br().y; ++y) {
        for (int x = tile.x; x < tile.br().x; ++x) {
          if (inverse_range(y, x) <= 0) continue;
          const Eigen::Vector3f at = grid.Ray(x, y) / inverse_range(y, x);
          cv::Vec3f coarse_sum(0, 0, 0), detail_sum(0, 0, 0);
          float coarse_weight = 0, detail_weight = 0;
          // Where every view has something before the point, the best of them is better than nothing.
          for (int pass = 0; pass < 2 && coarse_weight == 0; ++pass) {
            for (const std::size_t i : seeing) {
              const Eigen::Vector3f p = geometry[i].R * at + geometry[i].t;
              float u = 0, v = 0;
              if (!lens.Project(p, u, v) || (pass == 0 && Hidden(occlusions[i], u, v, p.z()))) continue;
              const float w = Feather(camera, u, v);
              const auto low =
                  Bilinear<cv::Vec3f>(coarse[i], (u + 0.5f) / kCoarse - 0.5f, (v + 0.5f) / kCoarse - 0.5f);
              const auto full = Bilinear<cv::Vec3f>(fine[i], u, v);
              coarse_sum += w * low;
              coarse_weight += w;
              const float sharp = w * w * w * w * w * w;
              detail_sum += sharp * (full - low);
              detail_weight += sharp;
            }
          }
          if (coarse_weight == 0) continue;
          const cv::Vec3f value = coarse_sum / coarse_weight + detail_sum / detail_weight;
          for (int c = 0; c < 3; ++c) out(y, x)[c] = cv::saturate_cast<std::uint8_t>(value[c] / kCodeScale);
          out(y, x)[3] = 255;
        }
      }
    }
  });
  return out;
}

}  // namespace mixstage
