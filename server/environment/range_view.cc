// SPDX-License-Identifier: Apache-2.0
#include "server/environment/range_view.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

#include "proto/base/check.h"
#include "proto/base/median.h"

namespace mixstage {
namespace {

constexpr double kToSigma = 1.4826;  // of a median of absolute values
constexpr float kNotOneSurface = 4;  // sigmas between neighbours, or between frames

// What a count says, modulo the wrap; 0 = nothing. Corrected ranges come later: the error belongs to the
// unwrapped reported range.
float Reported(std::uint16_t count, const RangeCamera& camera) {
  const auto metres = static_cast<float>(count * camera.unit_m);
  return camera.wrap_m > 0 && metres >= camera.wrap_m ? 0.f : metres;
}

float Modular(float difference, float wrap_m) {
  return wrap_m > 0 ? difference - wrap_m * std::round(difference / wrap_m) : difference;
}

// Pairs of a class's place x (amplitude or range) and its sigma; few samples do not make a class.
struct NoiseClass {
  double x = 0, sigma = 0, count = 0;
};

std::vector<NoiseClass> Classes(std::vector<std::pair<double, double>>& x_and_deviation, double to_sigma) {
  constexpr std::size_t kLeast = 64, kMost = 40;
  std::sort(x_and_deviation.begin(), x_and_deviation.end());
  std::vector<NoiseClass> classes;
  const std::size_t each = std::max(kLeast, x_and_deviation.size() / kMost);
  for (std::size_t first = 0; first + each <= x_and_deviation.size(); first += each) {
    std::vector<double> deviations;
    double x = 0;
    for (std::size_t i = first; i < first + each; ++i) {
      deviations.push_back(x_and_deviation[i].second);
      x += x_and_deviation[i].first;
    }
    classes.push_back(
        {x / static_cast<double>(each), Median(deviations) * to_sigma, static_cast<double>(each)});
  }
  return classes;
}

// Least squares of y = c0 + c1 x with relative errors, neither negative.
std::pair<double, double> FitLine(const std::vector<std::array<double, 2>>& points) {
  double sw = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (const auto& [x, y] : points) {
    const double w = 1 / (y * y);
    sw += w, sx += w * x, sy += w * y, sxx += w * x * x, sxy += w * x * y;
  }
  const double det = sw * sxx - sx * sx;
  if (det > 1e-12 * sw * sxx) {
    const double c1 = (sw * sxy - sx * sy) / det;
    const double c0 = (sy - c1 * sx) / sw;
    if (c0 >= 0 && c1 >= 0) return {c0, c1};
    if (c0 < 0) return {0, sxy / sxx};
  }
  return {sw > 0 ? sy / sw : 0, 0};
}

}  // namespace

RangeCamera RangeCamera::Of(const Rig& rig) {
  MIX_CHECK(rig.depth.has_value());
  RangeCamera camera;
  // Registered depth is in the colour camera's pixels: its own lens is not used.
  const PinholeCamera& lens = rig.registered ? rig.color : rig.depth->camera;
  const cv::Mat2f table = UnprojectionTable(lens);
  camera.ray.create(table.rows, table.cols);
  for (int y = 0; y < table.rows; ++y) {
    for (int x = 0; x < table.cols; ++x) {
      const cv::Vec2f n = table(y, x);
      const float length = std::sqrt(n[0] * n[0] + n[1] * n[1] + 1);
      camera.ray(y, x) = {n[0] / length, n[1] / length, 1 / length};
    }
  }
  camera.pitch_rad = static_cast<float>(1 / lens.fx);
  if (!rig.registered) camera.T_color_depth = rig.T_color_depth;
  camera.measures = rig.depth->measures;
  camera.unit_m = rig.depth->unit_m;
  if (rig.depth->unambiguous_range_m) camera.wrap_m = static_cast<float>(*rig.depth->unambiguous_range_m);
  camera.range_error = rig.depth->range_error;
  return camera;
}

RangeNoise RangeNoise::Measure(const std::vector<RangeFrames>& views, const RangeCamera& camera) {
  RangeNoise noise;
  bool pairs = false, amplitude = !views.empty();
  for (const RangeFrames& v : views) {
    pairs |= v.counts.size() >= 2;
    amplitude &= v.amplitudes.size() == v.counts.size();
  }
  noise.by_amplitude = amplitude;
  if (camera.wrap_m > 0) noise.most_m = camera.wrap_m / std::sqrt(12.0);
  std::size_t pixels = 0;
  for (const RangeFrames& v : views) pixels += v.counts.empty() ? 0 : v.counts[0].total();
  const int step = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(pixels) / 200'000)));
  std::vector<std::pair<double, double>> samples;
  for (const RangeFrames& v : views) {
    const std::size_t last = pairs ? v.counts.size() - 1 : v.counts.size();
    for (std::size_t k = 0; k < last; ++k) {
      const cv::Mat1w& a = v.counts[k];
      for (int y = 0; y < a.rows; y += step) {
        for (int x = 1; x + 1 < a.cols; x += step) {
          const float r = Reported(a(y, x), camera);
          float deviation = 0;
          if (pairs) {
            const float other = Reported(v.counts[k + 1](y, x), camera);
            if (r == 0 || other == 0) continue;
            deviation = Modular(other - r, camera.wrap_m);
          } else {
            const float left = Reported(a(y, x - 1), camera), right = Reported(a(y, x + 1), camera);
            if (r == 0 || left == 0 || right == 0) continue;
            deviation = Modular(left - r, camera.wrap_m) + Modular(right - r, camera.wrap_m);
          }
          double place = r;
          if (amplitude) {
            place = v.amplitudes[k](y, x);
            if (pairs) place = 0.5 * (place + v.amplitudes[k + 1](y, x));
            if (place < 1) continue;
          }
          samples.emplace_back(place, std::abs(deviation));
        }
      }
    }
  }
  std::vector<std::array<double, 2>> points;
  // A difference of two frames has twice, a second difference six times the variance of one value.
  for (const NoiseClass& c : Classes(samples, kToSigma / std::sqrt(pairs ? 2.0 : 6.0))) {
    const double sigma = std::max(c.sigma, camera.unit_m / std::sqrt(12.0));
    if (sigma > noise.most_m / 4) continue;  // the wrap bounds such deviations: they measure nothing
    if (amplitude) {
      points.push_back({c.x, sigma * sigma * c.x * c.x});
    } else {
      points.push_back({c.x * c.x, sigma});
    }
  }
  if (points.empty()) points.push_back({1, 0.01});
  std::tie(noise.c0, noise.c1) = FitLine(points);
  return noise;
}

float RangeNoise::Sigma(float amplitude, float range_m) const {
  double sigma = 0;
  if (by_amplitude) {
    sigma = amplitude > 0 ? std::sqrt(c0 + c1 * amplitude) / amplitude : most_m;
  } else {
    sigma = c0 + c1 * range_m * range_m;
  }
  return static_cast<float>(std::clamp(sigma, 1e-4, most_m));
}

double TypicalReturn(const std::vector<RangeFrames>& views, const RangeCamera& camera) {
  std::vector<double> returns;
  for (const RangeFrames& v : views) {
    if (v.amplitudes.empty()) continue;
    for (int y = 0; y < v.counts[0].rows; y += 3) {
      for (int x = 0; x < v.counts[0].cols; x += 3) {
        const float r = Reported(v.counts[0](y, x), camera);
        if (r > 0 && v.amplitudes[0](y, x) > 0) returns.push_back(r * r * v.amplitudes[0](y, x));
      }
    }
  }
  return returns.empty() ? 0 : Median(returns);
}

void ResolveWraps(cv::Mat1f& range_m, const cv::Mat1f& sigma_m, const cv::Mat1f& amplitude, float wrap_m,
                  double typical_return) {
  const int w = range_m.cols, h = range_m.rows;
  // Union of pixels into surfaces; turns: whole wraps of a pixel against its root.
  std::vector<int> parent(range_m.total()), turns(range_m.total(), 0);
  std::iota(parent.begin(), parent.end(), 0);
  auto root_of = [&](int i) {
    int root = i, sum = 0;
    while (parent[static_cast<std::size_t>(root)] != root) {
      sum += turns[static_cast<std::size_t>(root)];
      root = parent[static_cast<std::size_t>(root)];
    }
    while (parent[static_cast<std::size_t>(i)] != root && i != root) {  // compress
      const auto at = static_cast<std::size_t>(i);
      const int next = parent[at], own = turns[at];
      parent[at] = root;
      turns[at] = sum;
      sum -= own;
      i = next;
    }
    return root;
  };
  auto join = [&](int a, int b, int turns_b_a) {  // range_b + turns_b_a wraps continues range_a
    const int ra = root_of(a), rb = root_of(b);
    if (ra == rb) return;
    const int ta = a == ra ? 0 : turns[static_cast<std::size_t>(a)];
    const int tb = b == rb ? 0 : turns[static_cast<std::size_t>(b)];
    parent[static_cast<std::size_t>(rb)] = ra;
    turns[static_cast<std::size_t>(rb)] = ta + turns_b_a - tb;
  };
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x) {
      if (range_m(y, x) == 0) continue;
      for (const auto& [dx, dy] : {std::pair{1, 0}, std::pair{0, 1}}) {
        const int u = x + dx, v = y + dy;
        if (u >= w || v >= h || range_m(v, u) == 0) continue;
        const float difference = range_m(v, u) - range_m(y, x);
        const float step = Modular(difference, wrap_m);
        const float noise = std::hypot(sigma_m(v, u), sigma_m(y, x));
        // Where noise alone could be half a wrap, neighbours prove nothing.
        if (noise * kNotOneSurface > wrap_m / 4) continue;
        if (std::abs(step) < std::max(0.1f, kNotOneSurface * noise)) {
          join(y * w + x, v * w + u, -static_cast<int>(std::lround((difference - step) / wrap_m)));
        }
      }
    }
  }
  struct Surface {
    int least_turns = std::numeric_limits<int>::max();
    int pixels = 0;
    std::array<double, 3> misfit{};  // of 0, 1, 2 more wraps: sum of |log(A r^2 / typical)|
  };
  std::vector<Surface> surfaces(range_m.total());
  for (int i = 0; i < w * h; ++i) {
    if (range_m(i / w, i % w) == 0) continue;
    const int root = root_of(i);
    Surface& s = surfaces[static_cast<std::size_t>(root)];
    s.least_turns = std::min(s.least_turns, i == root ? 0 : turns[static_cast<std::size_t>(i)]);
    ++s.pixels;
  }
  const bool weigh = !amplitude.empty() && typical_return > 0;
  for (int i = 0; weigh && i < w * h; ++i) {
    const float r = range_m(i / w, i % w), A = amplitude(i / w, i % w);
    if (r == 0 || A <= 0) continue;
    const int root = root_of(i);
    Surface& s = surfaces[static_cast<std::size_t>(root)];
    const int own = (i == root ? 0 : turns[static_cast<std::size_t>(i)]) - s.least_turns;
    for (std::size_t n = 0; n < s.misfit.size(); ++n) {
      const double true_range = r + static_cast<double>(own + static_cast<int>(n)) * wrap_m;
      s.misfit[n] += std::abs(std::log(A * true_range * true_range / typical_return));
    }
  }
  // A dark surface returns a fifth, a bright one facing us five times of what is typical; a wrap must explain
  // more.
  constexpr double kPrior = 1.7;  // log units for each wrap
  for (int i = 0; i < w * h; ++i) {
    float& r = range_m(i / w, i % w);
    if (r == 0) continue;
    const int root = root_of(i);
    const Surface& s = surfaces[static_cast<std::size_t>(root)];
    int more = 0;
    for (std::size_t n = 1; weigh && n < s.misfit.size(); ++n) {
      const auto cost = [&](std::size_t k) {
        return s.misfit[k] / s.pixels + kPrior * static_cast<double>(k);
      };
      if (cost(n) < cost(static_cast<std::size_t>(more))) more = static_cast<int>(n);
    }
    constexpr int kTell =
        30;  // pixels: of a smaller dark thing light and noise do not tell whether it is far
    if (more > 0 && s.pixels < kTell) {
      r = 0;
      continue;
    }
    const int all = (i == root ? 0 : turns[static_cast<std::size_t>(i)]) - s.least_turns + more;
    r += static_cast<float>(all) * wrap_m;
  }
}

void RemoveMixedPixels(cv::Mat1f& range_m, const cv::Mat1f& sigma_m) {
  const cv::Mat1f r = range_m.clone();
  constexpr float kRampShare = 0.5f;  // a slanted surface goes on as it came
  for (int y = 0; y < r.rows; ++y) {
    for (int x = 0; x < r.cols; ++x) {
      if (r(y, x) == 0) continue;
      for (const auto& [dx, dy] : {std::pair{1, 0}, std::pair{0, 1}, std::pair{1, 1}, std::pair{1, -1}}) {
        if (x - dx < 0 || x + dx >= r.cols || y - std::abs(dy) < 0 || y + std::abs(dy) >= r.rows) continue;
        const float a = r(y - dy, x - dx), p = r(y, x), b = r(y + dy, x + dx);
        if (a == 0 || b == 0 || (p - a) * (b - p) <= 0) continue;
        const float in = std::abs(p - a), out = std::abs(b - p);
        const float noise_in = std::hypot(sigma_m(y, x), sigma_m(y - dy, x - dx));
        const float noise_out = std::hypot(sigma_m(y, x), sigma_m(y + dy, x + dx));
        if (in < kNotOneSurface * noise_in || out < kNotOneSurface * noise_out) continue;
        auto step = [&, dx = dx, dy = dy](int k) {  // from (k) to (k + 1) along the line
          const int x0 = x + k * dx, y0 = y + k * dy, x1 = x0 + dx, y1 = y0 + dy;
          const cv::Rect all(0, 0, r.cols, r.rows);
          if (!all.contains({x0, y0}) || !all.contains({x1, y1})) return std::max(in, out);
          if (r(y0, x0) == 0 || r(y1, x1) == 0) return 0.f;
          return std::abs(r(y1, x1) - r(y0, x0));
        };
        if (step(-2) < kRampShare * in && step(1) < kRampShare * out) {
          range_m(y, x) = 0;
          break;
        }
      }
    }
  }
}

RangeView MakeRangeView(const RangeFrames& frames, const RangeCamera& camera, const RangeNoise& noise,
                        double typical_return) {
  MIX_CHECK(!frames.counts.empty());
  const int w = camera.ray.cols, h = camera.ray.rows;
  const std::size_t n = frames.counts.size();
  RangeView view;
  view.range_m = cv::Mat1f::zeros(h, w);
  view.sigma_m = cv::Mat1f::zeros(h, w);
  cv::Mat1f amplitude;
  if (noise.by_amplitude) amplitude = cv::Mat1f::zeros(h, w);
  std::vector<float> r(n), A(n);
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x) {
      if (!std::isfinite(camera.ray(y, x)[2])) continue;
      std::size_t have = 0;
      float A_sum = 0;
      for (std::size_t k = 0; k < n; ++k) {
        const float value = Reported(frames.counts[k](y, x), camera);
        if (value == 0) continue;
        r[have] = value;
        A[have] = noise.by_amplitude ? static_cast<float>(frames.amplitudes[k](y, x)) : 1.f;
        A_sum += A[have++];
      }
      if (have == 0) continue;
      // About the frame nearest to all others the sum of the phasors, the most likely phase where each
      // component has the same noise; a frame that contradicts it is left out.
      std::size_t middle = 0;
      float least = std::numeric_limits<float>::max();
      for (std::size_t k = 0; k < have; ++k) {
        float apart = 0;
        for (std::size_t j = 0; j < have; ++j) apart += std::abs(Modular(r[j] - r[k], camera.wrap_m));
        if (apart < least) {
          least = apart;
          middle = k;
        }
      }
      const float sigma = noise.Sigma(A_sum / static_cast<float>(have), r[middle]);
      float sum = 0, weight = 0;
      std::size_t inliers = 0;
      for (std::size_t k = 0; k < have; ++k) {
        const float off = Modular(r[k] - r[middle], camera.wrap_m);
        if (std::abs(off) > std::sqrt(2.f) * kNotOneSurface * sigma) continue;
        const float weight_k = std::max(A[k], 1e-3f);
        sum += weight_k * off;
        weight += weight_k;
        ++inliers;
      }
      float mean = r[middle] + sum / weight;
      // A phase whose own noise is a third of a radian says nothing: black surfaces, window panes.
      if (camera.wrap_m > 0 && sigma > camera.wrap_m / (6 * std::numbers::pi_v<float>)) continue;
      if (2 * inliers <= have) {
        ++view.moved_px;
        continue;
      }
      if (camera.wrap_m > 0) mean -= camera.wrap_m * std::floor(mean / camera.wrap_m);
      view.range_m(y, x) = std::max(mean, 1e-3f);
      view.sigma_m(y, x) = sigma / std::sqrt(static_cast<float>(inliers));
      if (noise.by_amplitude) amplitude(y, x) = A_sum / static_cast<float>(have);
    }
  }
  if (camera.wrap_m > 0) ResolveWraps(view.range_m, view.sigma_m, amplitude, camera.wrap_m, typical_return);
  const bool is_z = camera.measures == DepthMeasure::kZ;
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x) {
      float& range = view.range_m(y, x);
      if (range == 0) continue;
      range = std::max(0.f, static_cast<float>(camera.range_error.TrueRange(range)));
      if (!is_z) continue;
      range /= camera.ray(y, x)[2];
      view.sigma_m(y, x) /= camera.ray(y, x)[2];
    }
  }
  RemoveMixedPixels(view.range_m, view.sigma_m);
  return view;
}

}  // namespace mixstage
