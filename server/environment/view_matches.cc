// SPDX-License-Identifier: Apache-2.0
#include "server/environment/view_matches.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "server/raster/rasteriser.h"

namespace mixstage {
namespace {

constexpr int kHalf = 7;      // patch of 15 x 15
constexpr int kCell_px = 40;  // at most one patch in each cell of a picture
constexpr float kSearch_px = 3.5f;
constexpr float kLeastAgreement = 0.85f;  // normalised correlation

// A picture with its gradients and the depth of the surface under it.
struct Level {
  cv::Mat1f grey, dx, dy, depth_m;
};

float Sample(const cv::Mat1f& m, float u, float v) {
  const int x = static_cast<int>(u), y = static_cast<int>(v);
  const float fx = u - static_cast<float>(x), fy = v - static_cast<float>(y);
  const float* top = m.ptr<float>(y) + x;
  const float* bottom = m.ptr<float>(y + 1) + x;
  const float a = top[0] + fx * (top[1] - top[0]), b = bottom[0] + fx * (bottom[1] - bottom[0]);
  return a + fy * (b - a);
}

PinholeCamera Shrunk(const PinholeCamera& camera, int shrink) {
  PinholeCamera small = camera;
  small.width = camera.width / shrink;
  small.height = camera.height / shrink;
  small.fx /= shrink;
  small.fy /= shrink;
  small.cx = (camera.cx + 0.5) / shrink - 0.5;
  small.cy = (camera.cy + 0.5) / shrink - 0.5;
  return small;
}

// The textured places of a picture that lie on one surface: where depth steps nearby, nothing can be carried
// over.
std::vector<cv::Point> Places(const Level& level) {
  cv::Mat1f corner;
  cv::cornerMinEigenVal(level.grey, corner, 5, 3);
  cv::Mat1f least, most;
  const cv::Mat kernel = cv::getStructuringElement(cv::MORPH_RECT, {2 * kHalf + 1, 2 * kHalf + 1});
  cv::erode(level.depth_m, least, kernel);
  cv::dilate(level.depth_m, most, kernel);
  std::vector<cv::Point> places;
  std::vector<float> strengths;
  for (int cy = kHalf + 2; cy + kHalf + 2 < level.grey.rows; cy += kCell_px) {
    for (int cx = kHalf + 2; cx + kHalf + 2 < level.grey.cols; cx += kCell_px) {
      float best = 0;
      cv::Point at;
      for (int y = cy; y < std::min(cy + kCell_px, level.grey.rows - kHalf - 2); ++y) {
        for (int x = cx; x < std::min(cx + kCell_px, level.grey.cols - kHalf - 2); ++x) {
          if (corner(y, x) <= best || least(y, x) <= 0 || most(y, x) > 1.1f * least(y, x)) continue;
          best = corner(y, x);
          at = {x, y};
        }
      }
      if (best <= 0) continue;
      places.push_back(at);
      strengths.push_back(best);
    }
  }
  if (places.empty()) return places;
  // What stands out of the picture's own noise and grain: a twentieth of its strong corners.
  std::vector<float> sorted = strengths;
  std::sort(sorted.begin(), sorted.end());
  const float threshold = 0.02f * sorted[sorted.size() * 9 / 10];
  std::vector<cv::Point> kept;
  for (std::size_t k = 0; k < places.size(); ++k)
    if (strengths[k] > threshold) kept.push_back(places[k]);
  return kept;
}

}  // namespace

Result<std::vector<ViewMatch>> MatchViews(const SurfaceMesh& mesh, const PinholeCamera& camera,
                                          const std::vector<PosedPicture>& views, int shrink) {
  const PinholeCamera small = Shrunk(camera, shrink);
  if (small.width < 8 * kHalf || small.height < 8 * kHalf) return std::vector<ViewMatch>();
  auto rasteriser = CreateRasteriser(RasterBackend::kCpu, small, {});
  if (!rasteriser) return tl::unexpected(rasteriser.error());
  std::vector<Level> levels(views.size());
  for (std::size_t i = 0; i < views.size(); ++i) {
    (*rasteriser)->Begin({});
    (*rasteriser)
        ->DrawDepth({mesh.positions, mesh.indices},
                    Eigen::Affine3d(views[i].T_world_color.inverse().matrix()), Faces::kBoth);
    (*rasteriser)->Finish().depth_m(cv::Rect(0, 0, small.width, small.height)).copyTo(levels[i].depth_m);
  }
  cv::parallel_for_({0, static_cast<int>(views.size())}, [&](const cv::Range& range) {
    for (int k = range.start; k < range.end; ++k) {
      Level& level = levels[static_cast<std::size_t>(k)];
      cv::Mat grey;
      cv::cvtColor(views[static_cast<std::size_t>(k)].bgr, grey, cv::COLOR_BGR2GRAY);
      if (shrink > 1) cv::resize(grey, grey, {small.width, small.height}, 0, 0, cv::INTER_AREA);
      grey.convertTo(level.grey, CV_32F);
      cv::GaussianBlur(level.grey, level.grey, {}, 0.8);
      cv::Sobel(level.grey, level.dx, CV_32F, 1, 0, 1, 0.5);
      cv::Sobel(level.grey, level.dy, CV_32F, 0, 1, 1, 0.5);
    }
  });
  std::vector<std::vector<ViewMatch>> found(views.size());
  cv::parallel_for_({0, static_cast<int>(views.size())}, [&](const cv::Range& range) {
    constexpr int kPixels = (2 * kHalf + 1) * (2 * kHalf + 1);
    std::array<float, kPixels> own{}, u{}, v{};
    for (int from = range.start; from < range.end; ++from) {
      const auto i = static_cast<std::size_t>(from);
      for (const cv::Point& place : Places(levels[i])) {
        const double z = levels[i].depth_m(place);
        const auto center = small.Unproject({place.x, place.y});
        if (!center) continue;
        std::array<Eigen::Vector3d, kPixels> p_world;
        bool whole = true;
        float own_mean = 0;
        for (int k = 0; k < kPixels; ++k) {
          const int dx = k % (2 * kHalf + 1) - kHalf, dy = k / (2 * kHalf + 1) - kHalf;
          const auto n = small.Unproject({place.x + dx, place.y + dy});
          whole &= n.has_value();
          if (!n) break;
          p_world[static_cast<std::size_t>(k)] =
              views[i].T_world_color * Eigen::Vector3d(n->x() * z, n->y() * z, z);
          own[static_cast<std::size_t>(k)] = levels[i].grey(place.y + dy, place.x + dx);
          own_mean += own[static_cast<std::size_t>(k)] / kPixels;
        }
        if (!whole) continue;
        float own_norm = 0;
        for (float& value : own) {
          value -= own_mean;
          own_norm += value * value;
        }
        for (std::size_t j = 0; j < views.size(); ++j) {
          if (j == i) continue;
          const Level& other = levels[j];
          const RigidTransform T_other_world = views[j].T_world_color.inverse();
          const Eigen::Vector3d p_other = T_other_world * p_world[kPixels / 2];
          const auto start = small.Project(p_other);
          constexpr double kBorder = kHalf * 2 + 6;
          if (!start || start->x() < kBorder || start->y() < kBorder || start->x() > small.width - kBorder ||
              start->y() > small.height - kBorder)
            continue;
          const float there = other.depth_m(static_cast<int>(start->y()), static_cast<int>(start->x()));
          if (there > 0 && std::abs(p_other.z() - there) > 0.05 * there + 0.05) continue;
          bool inside = true;
          for (std::size_t k = 0; k < kPixels && inside; ++k) {
            const auto pixel = small.Project(T_other_world * p_world[k]);
            inside = pixel && pixel->x() > 6 && pixel->y() > 6 && pixel->x() < small.width - 8 &&
                     pixel->y() < small.height - 8;
            if (!inside) break;
            u[k] = static_cast<float>(pixel->x());
            v[k] = static_cast<float>(pixel->y());
          }
          if (!inside) continue;
          float du = 0, dv = 0, agreement = 0;
          bool good = false;
          for (int iteration = 0; iteration < 8; ++iteration) {
            std::array<float, kPixels> value, gx, gy;
            float mean = 0, mean_x = 0, mean_y = 0;
            for (std::size_t k = 0; k < kPixels; ++k) {
              value[k] = Sample(other.grey, u[k] + du, v[k] + dv);
              gx[k] = Sample(other.dx, u[k] + du, v[k] + dv);
              gy[k] = Sample(other.dy, u[k] + du, v[k] + dv);
              mean += value[k] / kPixels;
              mean_x += gx[k] / kPixels;
              mean_y += gy[k] / kPixels;
            }
            float norm = 0, cross = 0;
            for (std::size_t k = 0; k < kPixels; ++k) {
              value[k] -= mean;
              norm += value[k] * value[k];
              cross += value[k] * own[k];
            }
            if (norm < 1e-3f || own_norm < 1e-3f) break;
            agreement = cross / std::sqrt(norm * own_norm);
            const float gain = cross / norm;
            Eigen::Matrix2f A = Eigen::Matrix2f::Zero();
            Eigen::Vector2f b = Eigen::Vector2f::Zero();
            for (std::size_t k = 0; k < kPixels; ++k) {
              const Eigen::Vector2f g(gain * (gx[k] - mean_x), gain * (gy[k] - mean_y));
              A += g * g.transpose();
              b += g * (own[k] - gain * value[k]);
            }
            if (A.determinant() < 1e-6f * A.trace() * A.trace()) break;
            const Eigen::Vector2f step = A.inverse() * b;
            du += step.x();
            dv += step.y();
            if (!(std::abs(du) < kSearch_px && std::abs(dv) < kSearch_px)) break;
            if (step.norm() < 0.01f) {
              good = agreement > kLeastAgreement;
              break;
            }
          }
          if (!good) continue;
          const auto at_to = small.Unproject({start->x() + du, start->y() + dv});
          if (!at_to) continue;
          found[i].push_back({from, static_cast<int>(j), Eigen::Vector3d(center->x() * z, center->y() * z, z),
                              *at_to, Eigen::Vector2d(du, dv) * shrink});
        }
      }
    }
  });
  std::vector<ViewMatch> all;
  for (const auto& f : found) all.insert(all.end(), f.begin(), f.end());
  return all;
}

}  // namespace mixstage
