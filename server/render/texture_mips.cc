// SPDX-License-Identifier: Apache-2.0
#include "server/render/texture_mips.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "proto/base/check.h"
#include "proto/base/srgb.h"
#include "server/render/texture_address.h"

namespace mixstage {
namespace {

cv::Mat4w ToLinear(const cv::Mat4b& rgba) {
  std::array<std::uint16_t, 256> linear{};
  for (int i = 0; i < 256; ++i)
    linear[static_cast<std::size_t>(i)] =
        static_cast<std::uint16_t>(std::lround(65535.0f * LinearOfSrgb(static_cast<float>(i) / 255)));
  cv::Mat4w out(rgba.size());
  for (int y = 0; y < rgba.rows; ++y) {
    for (int x = 0; x < rgba.cols; ++x) {
      const cv::Vec4b& p = rgba(y, x);
      out(y, x) = {linear[p[0]], linear[p[1]], linear[p[2]], static_cast<std::uint16_t>(p[3] * 257)};
    }
  }
  return out;
}

// Shares of the source pixels in one pixel of the halved side: two pixels, or three where the side is odd
// (box filter of exactly source / target pixels, so that the mean stays).
struct Shares {
  int first = 0, count = 0;
  std::array<float, 3> weight{};
};
std::vector<Shares> HalvingShares(int source, int target) {
  std::vector<Shares> shares(static_cast<std::size_t>(target));
  const double step = static_cast<double>(source) / target;
  for (int i = 0; i < target; ++i) {
    Shares& s = shares[static_cast<std::size_t>(i)];
    const double begin = i * step;
    const double end = (i + 1) * step;
    s.first = static_cast<int>(begin);
    for (int k = s.first; k < source && k < end && s.count < 3; ++k) {
      const double overlap = std::min<double>(k + 1, end) - std::max<double>(k, begin);
      s.weight[static_cast<std::size_t>(s.count++)] = static_cast<float>(overlap / step);
    }
  }
  return shares;
}

// Colours are weighted by their alpha: what is not there lends nothing to its neighbours.
cv::Mat4w Halve(const cv::Mat4w& source) {
  cv::Mat4w out(std::max(1, source.rows / 2), std::max(1, source.cols / 2));
  const std::vector<Shares> columns = HalvingShares(source.cols, out.cols);
  const std::vector<Shares> rows = HalvingShares(source.rows, out.rows);
  for (int y = 0; y < out.rows; ++y) {
    const Shares& row = rows[static_cast<std::size_t>(y)];
    for (int x = 0; x < out.cols; ++x) {
      const Shares& column = columns[static_cast<std::size_t>(x)];
      Eigen::Array3f weighted = Eigen::Array3f::Zero();
      Eigen::Array3f plain = Eigen::Array3f::Zero();
      float alpha = 0;
      for (int j = 0; j < row.count; ++j) {
        const auto* line = source.ptr<cv::Vec4w>(row.first + j) + column.first;
        for (int i = 0; i < column.count; ++i) {
          const float w =
              row.weight[static_cast<std::size_t>(j)] * column.weight[static_cast<std::size_t>(i)];
          const Eigen::Array3f rgb(line[i][0], line[i][1], line[i][2]);
          plain += w * rgb;
          weighted += w * line[i][3] * rgb;
          alpha += w * line[i][3];
        }
      }
      const Eigen::Array3f rgb = alpha > 0 ? Eigen::Array3f(weighted / alpha) : plain;
      auto round = [](float v) { return static_cast<std::uint16_t>(std::clamp(v + 0.5f, 0.0f, 65535.0f)); };
      out(y, x) = {round(rgb.x()), round(rgb.y()), round(rgb.z()), round(alpha)};
    }
  }
  return out;
}

Eigen::Array4f Texel(const std::uint16_t* t) {
  return {static_cast<float>(t[0]), static_cast<float>(t[1]), static_cast<float>(t[2]),
          static_cast<float>(t[3])};
}

Eigen::Array4f Bilinear(const TextureMips::Level& level, float s, float t) {
  const TexelPlace x = PlaceOf(s, level.width);
  const TexelPlace y = PlaceOf(t, level.height);
  const std::uint16_t* upper = level.texel(x.first, y.first);
  const std::uint16_t* lower = level.texel(x.first, y.first + 1);
  const Eigen::Array4f top = Texel(upper) + x.share_of_next * (Texel(upper + 4) - Texel(upper));
  const Eigen::Array4f bottom = Texel(lower) + x.share_of_next * (Texel(lower + 4) - Texel(lower));
  return top + y.share_of_next * (bottom - top);
}

// Writes the image with its border. The border texel beside texel 0 (or the last): the other end, or the same
// again.
void WriteWithBorder(const cv::Mat4w& image, TextureWrap wrap_u, TextureWrap wrap_v, cv::Vec4w* out) {
  auto source = [](int i, int size, TextureWrap wrap) {
    if (i >= 0 && i < size) return i;
    const int edge = i < 0 ? 0 : size - 1;
    return wrap == TextureWrap::kRepeat ? size - 1 - edge : edge;
  };
  for (int y = -1; y <= image.rows; ++y) {
    for (int x = -1; x <= image.cols; ++x) {
      *out++ = image(source(y, image.rows, wrap_v), source(x, image.cols, wrap_u));
    }
  }
}

}  // namespace

TextureMips::TextureMips(const Texture& texture, int largest_side)
    : wrap_u_(texture.wrap_u), wrap_v_(texture.wrap_v) {
  MIX_CHECK(!texture.rgba.empty());
  cv::Mat4w image = ToLinear(texture.rgba);
  while (std::max(image.rows, image.cols) > largest_side) image = Halve(image);
  std::vector<cv::Mat4w> images = {image};
  while (images.back().rows > 1 || images.back().cols > 1) images.push_back(Halve(images.back()));
  MIX_CHECK(images.size() <= kMostLevels);
  int texels = 0;
  for (const cv::Mat4w& level : images) texels += (level.rows + 2) * (level.cols + 2);
  texels_.create(1, texels);
  int first = 0;
  for (std::size_t i = 0; i < images.size(); ++i) {
    const cv::Mat4w& level = images[i];
    const int stride = level.cols + 2;
    WriteWithBorder(level, wrap_u_, wrap_v_, &texels_(0, first));
    levels_.push_back({texels_.ptr<std::uint16_t>(0, first), level.cols, level.rows, stride});
    table_.width[i] = static_cast<float>(level.cols);
    table_.height[i] = static_cast<float>(level.rows);
    table_.first[i] = first;
    table_.stride[i] = stride;
    first += stride * (level.rows + 2);
  }
}

Eigen::Array4f TextureMips::Sample(float u, float v, float texels) const {
  const float s = WrapCoordinate(u, wrap_u_);
  const float t = WrapCoordinate(v, wrap_v_);
  const LevelPair pair = LevelsFor(texels, static_cast<int>(levels_.size()));
  const auto fine = static_cast<std::size_t>(pair.fine);
  Eigen::Array4f color = Bilinear(levels_[fine], s, t);
  if (pair.share_of_coarse > 0) {
    color += pair.share_of_coarse * (Bilinear(levels_[fine + 1], s, t) - color);
  }
  return color / 65535.0f;
}

void SampleTexturesScalar(std::span<const TextureMips* const> textures, const FragmentRows& rows,
                          float* rgba) {
  MIX_CHECK(textures.size() <= rows.capacity());
  using enum FragmentRows::Row;
  for (std::size_t i = 0; i < textures.size(); ++i) {
    Eigen::Map<Eigen::Array4f> out(rgba + 4 * i);
    out.setOnes();
    if (textures[i] == nullptr) continue;
    const float taps = rows.row(kTaps)[i];
    out.setZero();
    for (float k = 0; k < taps; ++k) {
      const float along = (k + 0.5f) / taps - 0.5f;
      out += textures[i]->Sample(rows.row(kU)[i] + along * rows.row(kStepU)[i],
                                 rows.row(kV)[i] + along * rows.row(kStepV)[i], rows.row(kTexelsPerTap)[i]);
    }
    out /= taps;
  }
}

}  // namespace mixstage
