// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/depth_packer.h"

#include <algorithm>
#include <cmath>

namespace mixstage {
namespace {

constexpr int kSampleStep = 8;
constexpr std::size_t kFewestSamples = 64;

// DepthToCode() of a row, written without branches so that the compiler makes vectors of it.
template <typename Pixel>
void PackLumaRow(const Pixel* depth, int width, float inverse_unit, const DepthRange& range,
                 std::uint16_t* codes) {
  const float inverse_far = 1 / range.far_m;
  const float codes_per_inverse_m = 1022 / (1 / range.near_m - inverse_far);
  const float scale = inverse_unit * codes_per_inverse_m;
  const float offset = 1.5f - inverse_far * codes_per_inverse_m;  // codes start at 1; 0.5 rounds
  for (int x = 0; x < width; ++x) {
    const auto z = static_cast<float>(depth[x]);
    float code = scale / z + offset;
    code = code < 1.0f ? 1.0f : code;
    code = code < 1023.0f ? code : 1023.0f;  // also where z is NaN
    const int known = static_cast<int>(code);
    codes[x] = static_cast<std::uint16_t>(z > 0 ? known : kUnknownDepthCode);
  }
}

// The last column or row of an odd size stands for the one that is missing.
void PackCoverage(ImageView<const std::uint8_t> alpha, cv::Mat1w* plane) {
  for (int y = 0; y < plane->rows; ++y) {
    const std::uint8_t* upper = alpha.row(2 * y);
    const std::uint8_t* lower = alpha.row(std::min(2 * y + 1, alpha.height() - 1));
    std::uint16_t* codes = plane->ptr<std::uint16_t>(y);
    const int whole = alpha.width() / 2;
    // The sum of four alphas is 4 x their mean: the code itself.
    for (int x = 0; x < whole; ++x) {
      codes[x] =
          static_cast<std::uint16_t>(upper[2 * x] + upper[2 * x + 1] + lower[2 * x] + lower[2 * x + 1]);
    }
    if (whole < plane->cols)
      codes[whole] = static_cast<std::uint16_t>(2 * (upper[2 * whole] + lower[2 * whole]));
  }
}

void PackLabel(ImageView<const std::uint8_t> label, cv::Mat1w* plane) {
  for (int y = 0; y < plane->rows; ++y) {
    const std::uint8_t* labels = label.row(2 * y);
    std::uint16_t* codes = plane->ptr<std::uint16_t>(y);
    for (int x = 0; x < plane->cols; ++x)
      codes[x] = static_cast<std::uint16_t>(LabelPixelToCode(labels[2 * x]));
  }
}

template <typename Pixel>
void Pack(ImageView<const Pixel> depth, float inverse_unit, ImageView<const std::uint8_t> alpha,
          ImageView<const std::uint8_t> label, const DepthRange& range, Yuv10Image* planes) {
  MIX_CHECK(0 < range.near_m && range.near_m < range.far_m);
  MIX_CHECK((alpha.empty() || SameSize(alpha, depth)) && (label.empty() || SameSize(label, depth)));
  const int chroma_width = (depth.width() + 1) / 2, chroma_height = (depth.height() + 1) / 2;
  planes->y.create(depth.height(), depth.width());
  planes->cb.create(chroma_height, chroma_width);
  planes->cr.create(chroma_height, chroma_width);
  for (int y = 0; y < depth.height(); ++y) {
    PackLumaRow(depth.row(y), depth.width(), inverse_unit, range, planes->y.ptr<std::uint16_t>(y));
  }
  if (alpha.empty()) {
    planes->cb.setTo(AlphaToCode(0));
  } else {
    PackCoverage(alpha, &planes->cb);
  }
  if (label.empty()) {
    planes->cr.setTo(LabelToCode(WatchLabel::kScene));
  } else {
    PackLabel(label, &planes->cr);
  }
}

}  // namespace

void PackDepth(ImageView<const float> depth_m, ImageView<const std::uint8_t> alpha,
               ImageView<const std::uint8_t> label, const DepthRange& range, Yuv10Image* planes) {
  Pack(depth_m, 1.0f, alpha, label, range, planes);
}

void PackDepth(ImageView<const std::uint16_t> depth_mm, ImageView<const std::uint8_t> alpha,
               ImageView<const std::uint8_t> label, const DepthRange& range, Yuv10Image* planes) {
  Pack(depth_mm, 1000.0f, alpha, label, range, planes);
}

Result<DepthRangeFit> DepthRangeFit::Create(const DepthRangeConfig& config) {
  const auto refuse = [](const char* what) {
    return Fail(ErrorCode::kInvalidConfig, std::string("depth range: ") + what);
  };
  if (!(config.outlier_share >= 0 && config.outlier_share <= 0.1))
    return refuse("outlier_share must be within 0..0.1");
  if (!(config.margin >= 0 && config.margin <= 1)) return refuse("margin must be within 0..1");
  if (!(config.nearest_m > 0 && config.farthest_m > 2 * config.nearest_m &&
        std::isfinite(config.farthest_m))) {
    return refuse("nearest_m must be positive and farthest_m at least twice as far");
  }
  DepthRangeFit fit(config);
  fit.range_ = {std::max(fit.range_.near_m, config.nearest_m), std::min(fit.range_.far_m, config.farthest_m)};
  if (fit.range_.near_m >= fit.range_.far_m) fit.range_ = {config.nearest_m, config.farthest_m};
  return fit;
}

void DepthRangeFit::Update(ImageView<const float> depth_m) { UpdateFrom(depth_m, 1.0f); }
void DepthRangeFit::Update(ImageView<const std::uint16_t> depth_mm) { UpdateFrom(depth_mm, 0.001f); }

template <typename Pixel>
void DepthRangeFit::UpdateFrom(ImageView<const Pixel> depth, float unit_m) {
  sample_.clear();
  for (int y = kSampleStep / 2; y < depth.height(); y += kSampleStep) {
    const Pixel* row = depth.row(y);
    for (int x = kSampleStep / 2; x < depth.width(); x += kSampleStep) {
      const float z = static_cast<float>(row[x]) * unit_m;
      if (z > 0 && std::isfinite(z)) sample_.push_back(z);
    }
  }
  if (sample_.size() < kFewestSamples) return;
  const auto percentile = [this](double share) {
    const auto at =
        sample_.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(sample_.size() - 1));
    std::nth_element(sample_.begin(), at, sample_.end());
    return *at;
  };
  const auto limit = [this](float z) { return std::clamp(z, config_.nearest_m, config_.farthest_m); };
  const auto margin = static_cast<float>(1 + config_.margin);
  const float nearest = limit(percentile(config_.outlier_share));
  const float farthest = limit(percentile(1 - config_.outlier_share));
  DepthRange wanted{limit(nearest / margin), limit(farthest * margin)};
  // A flat scene still gets a range that a person can walk in.
  if (wanted.far_m < 1.5f * wanted.near_m) {
    wanted.near_m = std::max(config_.nearest_m, wanted.far_m / 1.5f);
    wanted.far_m = std::min(config_.farthest_m, 1.5f * wanted.near_m);
  }
  const auto inverse_span = [](const DepthRange& range) { return 1 / range.near_m - 1 / range.far_m; };
  const bool holds = range_.near_m <= nearest && farthest <= range_.far_m;
  const bool wastes = inverse_span(wanted) < inverse_span(range_) * 2 / 3;
  if (!fitted_ || !holds || wastes) range_ = wanted;
  fitted_ = true;
}

}  // namespace mixstage
