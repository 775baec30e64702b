// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/range_curve.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>

#include "proto/base/median.h"

namespace mixstage {
namespace {

constexpr double kKnotStep_m = 0.5;
constexpr double kExpectedSpline_m = 0.05;  // prior of a coefficient: decides only what no board does
// Boards' distances scale with a focal length that is known to some 1e-4: what grows like that is not the
// sensor's error.
constexpr double kExpectedScale = 3e-4;

// Values of all basis functions at a range.
class Basis {
 public:
  virtual ~Basis() = default;
  [[nodiscard]] virtual int size() const = 0;
  virtual void At(double range_m, Eigen::VectorXd& values) const = 0;
  [[nodiscard]] virtual double expected_m() const = 0;  // sigma of a coefficient before any board is seen
};

// Uniform cubic B-spline from the knot below from_m to the knot above to_m.
class Spline : public Basis {
 public:
  Spline(double from_m, double to_m) : from_m_(from_m), to_m_(to_m) {
    const double spans = std::max(1.0, std::ceil((to_m - from_m) / kKnotStep_m));
    step_m_ = (to_m - from_m) / spans;
    count_ = static_cast<int>(spans) + 3;
  }
  [[nodiscard]] int size() const override { return count_; }
  [[nodiscard]] double expected_m() const override { return kExpectedSpline_m; }
  void At(double range_m, Eigen::VectorXd& values) const override {
    values.setZero(count_);
    const double x = (std::clamp(range_m, from_m_, to_m_) - from_m_) / step_m_;
    const int i = std::min(static_cast<int>(x), count_ - 4);
    const double t = x - i;
    values.segment<4>(i) << (1 - t) * (1 - t) * (1 - t) / 6, (3 * t * t * t - 6 * t * t + 4) / 6,
        (-3 * t * t * t + 3 * t * t + 3 * t + 1) / 6, t * t * t / 6;
  }

 private:
  double from_m_, to_m_, step_m_ = kKnotStep_m;
  int count_ = 0;
};

class Harmonics : public Basis {
 public:
  // A harmonic is expected to be as large as the error that boards show: beyond them the curve rests on that.
  Harmonics(double wrap_m, double expected_m) : wrap_m_(wrap_m), expected_m_(expected_m) {}
  [[nodiscard]] int size() const override { return 5; }
  [[nodiscard]] double expected_m() const override { return expected_m_; }
  void At(double range_m, Eigen::VectorXd& values) const override {
    const double phase = 2 * std::numbers::pi * range_m / wrap_m_;
    values.resize(5);
    values << 1, std::sin(phase), std::cos(phase), std::sin(4 * phase), std::cos(4 * phase);
  }

 private:
  double wrap_m_, expected_m_;
};

// Sigma of a sample by its amplitude: measured in bins of equally many samples.
class NoiseByAmplitude {
 public:
  NoiseByAmplitude(const std::vector<RangeSample>& samples, const std::vector<double>& residuals) {
    std::vector<std::size_t> order(samples.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
    std::sort(order.begin(), order.end(),
              [&](std::size_t a, std::size_t b) { return samples[a].amplitude < samples[b].amplitude; });
    const std::size_t bins = std::clamp<std::size_t>(samples.size() / 300, 1, 24);
    for (std::size_t b = 0; b < bins; ++b) {
      const std::size_t first = b * order.size() / bins;
      const std::size_t end = (b + 1) * order.size() / bins;
      std::vector<double> sizes;
      for (std::size_t i = first; i < end; ++i) sizes.push_back(std::abs(residuals[order[i]]));
      std::nth_element(sizes.begin(), sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2),
                       sizes.end());
      sigma_by_amplitude_[samples[order[end - 1]].amplitude] =
          std::max(1.4826 * sizes[sizes.size() / 2], 1e-4);
    }
  }
  [[nodiscard]] double At(double amplitude) const {
    const auto above = sigma_by_amplitude_.lower_bound(amplitude);
    return above == sigma_by_amplitude_.end() ? sigma_by_amplitude_.rbegin()->second : above->second;
  }

 private:
  std::map<double, double> sigma_by_amplitude_;  // the bin's largest amplitude
};

// Weighted least squares with Huber's weights: coefficients of the basis, then of darkness and of scale.
struct Fit {
  Eigen::VectorXd coefficients;
  Eigen::MatrixXd covariance;
  std::vector<double> residuals;
};

// 0 at the median amplitude, 1 at a tenth of it.
double Darkness(double amplitude, double median_amplitude) {
  return std::log10(median_amplitude / amplitude);
}

// Mean of what lies within five sigma of the median.
double TrimmedMean(const std::vector<double>& values) {
  const double middle = Median(std::vector(values));
  std::vector<double> sizes;
  for (double v : values) sizes.push_back(std::abs(v - middle));
  const double limit = 5 * 1.4826 * Median(sizes);
  double sum = 0;
  double count = 0;
  for (double v : values) {
    if (std::abs(v - middle) > limit) continue;
    sum += v;
    ++count;
  }
  return sum / std::max(count, 1.0);
}

// Rms over groups (steps of range, or views) of the mean of values.
template <typename Group>
double RmsOfMeans(const std::vector<RangeSample>& samples, const std::vector<double>& values, Group group) {
  std::map<std::size_t, std::vector<double>> groups;
  for (std::size_t i = 0; i < samples.size(); ++i) groups[group(samples[i])].push_back(values[i]);
  double squares = 0;
  double used = 0;
  for (const auto& [key, list] : groups) {
    if (list.size() < 50) continue;
    const double mean = TrimmedMean(list);
    squares += mean * mean;
    ++used;
  }
  return used == 0 ? 0 : std::sqrt(squares / used);
}

// A board's pose is wrong by a little in every view, and all its pixels with it: a view tells no more than
// one measurement of that sigma, however many pixels it has.
double SigmaOfViews(const std::vector<RangeSample>& samples, const std::vector<double>& residuals) {
  const double rms = RmsOfMeans(samples, residuals, [](const RangeSample& s) { return s.view; });
  return std::max(rms, 2e-4);
}

Fit Solve(const std::vector<RangeSample>& samples, const Basis& basis, double median_amplitude) {
  Fit fit;
  const int n = basis.size() + 2;
  fit.residuals.resize(samples.size());
  for (std::size_t i = 0; i < samples.size(); ++i)
    fit.residuals[i] = samples[i].measured_m - samples[i].range_m;
  Eigen::VectorXd values;
  Eigen::VectorXd row(n);
  constexpr int kRounds = 6;
  for (int round = 0; round < kRounds; ++round) {
    // The first round knows no curve yet: its residuals still hold the error itself, which is small.
    const NoiseByAmplitude noise(samples, fit.residuals);
    std::vector<double> weights(samples.size());
    std::map<std::size_t, double> of_view;
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const double sigma = noise.At(samples[i].amplitude);
      const double size = std::abs(fit.residuals[i]) / sigma;
      weights[i] = size > 6 ? 0 : std::min(1.0, 1.5 / size) / (sigma * sigma);  // 6: a hand, the stand
      of_view[samples[i].view] += weights[i];
    }
    const double view_sigma = SigmaOfViews(samples, fit.residuals);
    for (auto& [view, sum] : of_view) sum = 1 / (1 + sum * view_sigma * view_sigma);
    Eigen::MatrixXd A = Eigen::MatrixXd::Identity(n, n) / (basis.expected_m() * basis.expected_m());
    A(n - 1, n - 1) = 1 / (kExpectedScale * kExpectedScale);
    Eigen::VectorXd b = Eigen::VectorXd::Zero(n);
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const RangeSample& s = samples[i];
      const double weight = weights[i] * of_view[s.view];
      if (weight == 0) continue;
      basis.At(s.range_m, values);
      row << values, Darkness(s.amplitude, median_amplitude), s.range_m;
      A.selfadjointView<Eigen::Lower>().rankUpdate(row, weight);
      b += weight * (s.measured_m - s.range_m) * row;
    }
    const Eigen::LLT<Eigen::MatrixXd, Eigen::Lower> llt(A);
    fit.coefficients = llt.solve(b);
    fit.covariance = llt.solve(Eigen::MatrixXd::Identity(n, n));
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const RangeSample& s = samples[i];
      basis.At(s.range_m, values);
      row << values, Darkness(s.amplitude, median_amplitude), s.range_m;
      fit.residuals[i] = s.measured_m - s.range_m - row.dot(fit.coefficients);
    }
  }
  return fit;
}

// Largest size of a curve between two ranges.
double LargestSize(const Basis& basis, const Fit& fit, double from_m, double to_m) {
  double largest = 0;
  Eigen::VectorXd values;
  for (double r = from_m; r <= to_m; r += 0.05) {
    basis.At(r, values);
    largest = std::max(largest, std::abs(values.dot(fit.coefficients.head(basis.size()))));
  }
  return largest;
}

double HeldOutRms(const std::vector<RangeSample>& samples, const Basis& basis, double median_amplitude) {
  std::vector<RangeSample> learn;
  std::vector<RangeSample> rest;
  for (const RangeSample& s : samples) (s.view % 5 == 4 ? rest : learn).push_back(s);
  if (learn.size() < 300 || rest.size() < 100) return 0;
  const Fit fit = Solve(learn, basis, median_amplitude);
  Eigen::VectorXd values;
  std::vector<double> residuals;
  for (const RangeSample& s : rest) {
    basis.At(s.range_m, values);
    residuals.push_back(s.measured_m - s.range_m - values.dot(fit.coefficients.head(basis.size())) -
                        fit.coefficients(basis.size()) * Darkness(s.amplitude, median_amplitude) -
                        fit.coefficients(basis.size() + 1) * s.range_m);
  }
  return RmsOfMeans(rest, residuals, [](const RangeSample& s) { return s.view; });
}

}  // namespace

Result<RangeCurve> FitRangeCurve(const std::vector<RangeSample>& samples,
                                 std::optional<double> unambiguous_range_m) {
  if (samples.size() < 500)
    return Fail(ErrorCode::kQualityGate,
                "only " + std::to_string(samples.size()) + " range pixels lie on boards");
  std::vector<double> ranges;
  std::vector<double> amplitudes;
  for (const RangeSample& s : samples) {
    ranges.push_back(s.range_m);
    amplitudes.push_back(s.amplitude);
  }
  std::sort(ranges.begin(), ranges.end());
  RangeCurve curve;
  curve.samples = samples.size();
  curve.from_m = ranges[ranges.size() / 200];
  curve.to_m = ranges[ranges.size() - 1 - ranges.size() / 200];
  if (curve.to_m - curve.from_m < 0.3)
    return Fail(ErrorCode::kQualityGate, "all boards stand at nearly the same distance from the ToF camera");
  const double median_amplitude = Median(std::vector(amplitudes));

  const Spline spline(curve.from_m, curve.to_m);
  const Fit by_spline = Solve(samples, spline, median_amplitude);
  // A step of 0.1 m is as fine as boards are; what is left in its mean is the curve's own failure.
  auto step = [](const RangeSample& s) { return static_cast<std::size_t>(s.range_m * 10); };
  std::vector<double> raw;
  for (const RangeSample& s : samples) raw.push_back(s.measured_m - s.range_m);
  curve.before_rms_m = RmsOfMeans(samples, raw, step);
  curve.after_rms_m = RmsOfMeans(samples, by_spline.residuals, step);
  std::optional<Harmonics> harmonics;
  Fit by_harmonics;
  if (unambiguous_range_m) {
    harmonics.emplace(*unambiguous_range_m, std::max(curve.before_rms_m, 0.001));
    by_harmonics = Solve(samples, *harmonics, median_amplitude);
    const double left = RmsOfMeans(samples, by_harmonics.residuals, step);
    // Harmonics that cancel each other only where boards stood explain nothing.
    const double seen = LargestSize(spline, by_spline, curve.from_m, curve.to_m);
    const bool sane = LargestSize(*harmonics, by_harmonics, 0, *unambiguous_range_m) <= 3 * seen + 0.01;
    curve.harmonics = sane && left <= std::max(1.3 * curve.after_rms_m, 0.0005);
    if (curve.harmonics) curve.after_rms_m = left;
  }
  const Basis& basis = curve.harmonics ? static_cast<const Basis&>(*harmonics) : spline;
  const Fit& fit = curve.harmonics ? by_harmonics : by_spline;
  curve.held_out_rms_m = HeldOutRms(samples, basis, median_amplitude);
  std::vector<double> sizes;
  for (double r : fit.residuals) sizes.push_back(std::abs(r));
  curve.noise_m = 1.4826 * Median(sizes);
  const int n = basis.size();
  curve.dark_minus_bright_m = fit.coefficients(n);
  curve.dark_minus_bright_std_m = std::sqrt(fit.covariance(n, n));
  Eigen::VectorXd values;
  constexpr double kStep_m = 0.05;
  const double last = curve.harmonics ? *unambiguous_range_m : curve.to_m;
  const double first = curve.harmonics ? kStep_m : curve.from_m;
  for (int i = 0; first + i * kStep_m <= last; ++i) {
    const double r = first + i * kStep_m;
    basis.At(r, values);
    curve.error.range_m.push_back(r);
    curve.error.error_m.push_back(values.dot(fit.coefficients.head(n)));
    curve.error.std_m.push_back(std::sqrt(values.dot(fit.covariance.topLeftCorner(n, n) * values)));
  }
  return curve;
}

}  // namespace mixstage
