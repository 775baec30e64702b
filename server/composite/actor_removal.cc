// SPDX-License-Identifier: Apache-2.0
#include "server/composite/actor_removal.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "proto/base/check.h"
#include "proto/base/image_mat.h"
#include "server/segmentation/labels.h"

namespace mixstage {
namespace {

// Half-size pixels: a matte's foot and the soft edge of a shadow reach beyond what is labelled.
constexpr int kBeyond = 4;
constexpr int kBorder = 4;

// Two pictures of one surface: their codes differ by little, light need not be linear.
void Blend(const cv::Mat1b& room, const cv::Mat1b& mask, int shift_x, int shift_y, const cv::Rect& box,
           float gain, float offset, cv::Mat1b& to) {
  const cv::Rect part = cv::Rect(box.x >> shift_x, box.y >> shift_y, (box.width + shift_x) >> shift_x,
                                 (box.height + shift_y) >> shift_y) &
                        cv::Rect({}, to.size());
  for (int y = part.y; y < part.br().y; ++y) {
    const std::uint8_t* weights = mask[std::min((y << shift_y) / 2, mask.rows - 1)];
    for (int x = part.x; x < part.br().x; ++x) {
      const int weight = weights[std::min((x << shift_x) / 2, mask.cols - 1)];
      if (weight == 0) continue;
      const float own = to(y, x);
      const float predicted = std::clamp(gain * static_cast<float>(room(y, x)) + offset, 0.0f, 255.0f);
      to(y, x) = static_cast<std::uint8_t>(
          own + static_cast<float>(weight) * (1 / 255.0f) * (predicted - own) + 0.5f);
    }
  }
}

}  // namespace

// Shadow that does not meet him is another's, or noise: there the live picture is better.
void ActorRemoval::KeepHis(ImageView<const std::uint8_t> alpha) {
  cv::resize(mask_, small_, {(mask_.cols + 1) / 2, (mask_.rows + 1) / 2}, 0, 0, cv::INTER_AREA);
  cv::threshold(small_, small_, 0, 255, cv::THRESH_BINARY);
  const int parts = cv::connectedComponents(small_, parts_, 8);
  std::vector<std::uint8_t> his(static_cast<std::size_t>(parts), 0);
  for (int y = 0; y < small_.rows; ++y) {
    const std::uint8_t* row = alpha.row(std::min(4 * y + 1, alpha.height() - 1));
    for (int x = 0; x < small_.cols; ++x) {
      if (row[std::min(4 * x + 1, alpha.width() - 1)] >= 128) his[static_cast<std::size_t>(parts_(y, x))] = 1;
    }
  }
  his[0] = 0;
  for (int y = 0; y < mask_.rows; ++y) {
    const int* part = parts_[std::min(y / 2, parts_.rows - 1)];
    for (int x = 0; x < mask_.cols; ++x) {
      if (his[static_cast<std::size_t>(part[std::min(x / 2, parts_.cols - 1)])] == 0) mask_(y, x) = 0;
    }
  }
}

void ActorRemoval::Run(const YuvImage& color, const YuvImage& room, ImageView<const std::uint8_t> alpha,
                       ImageView<const std::uint8_t> label, const Tone& tone, YuvImage& empty) {
  const int w = color.width(), h = color.height();
  MIX_CHECK(room.width() == w && room.height() == h && room.layout == color.layout);
  MIX_CHECK(alpha.width() == w && alpha.height() == h && SameSize(alpha, label));
  empty.Create(w, h, color.layout);
  color.y.copyTo(empty.y);
  color.cb.copyTo(empty.cb);
  color.cr.copyTo(empty.cr);
  cv::compare(AsMat(label), kLabelShadow, scratch_, cv::CMP_EQ);
  cv::bitwise_or(scratch_, AsMat(alpha), scratch_);
  // At half size any of four: neither a mean nor a sample.
  mask_.create((h + 1) / 2, (w + 1) / 2);
  for (int y = 0; y < mask_.rows; ++y) {
    const std::uint8_t* above = scratch_[2 * y];
    const std::uint8_t* below = scratch_[std::min(2 * y + 1, h - 1)];
    std::uint8_t* to = mask_[y];
    for (int x = 0; x < w / 2; ++x)
      to[x] = (above[2 * x] | above[2 * x + 1] | below[2 * x] | below[2 * x + 1]) != 0 ? 255 : 0;
    if (w % 2 != 0) to[w / 2] = (above[w - 1] | below[w - 1]) != 0 ? 255 : 0;
  }
  KeepHis(alpha);
  cv::Rect box = cv::boundingRect(mask_);
  if (box.empty()) return;
  constexpr int kDilated = kBeyond + kBorder;
  constexpr int kReach = kDilated + kBorder;
  box = cv::Rect(box.x - kReach, box.y - kReach, box.width + 2 * kReach, box.height + 2 * kReach) &
        cv::Rect({}, mask_.size());
  cv::Mat1b part = mask_(box);
  cv::dilate(part, scratch_, cv::getStructuringElement(cv::MORPH_RECT, {2 * kDilated + 1, 2 * kDilated + 1}),
             {-1, -1}, 1, cv::BORDER_CONSTANT, cv::Scalar::all(0));
  // Whole where he is and kBeyond around, nothing from reach on.
  cv::blur(scratch_, scratch_, {2 * kBorder + 1, 2 * kBorder + 1}, {-1, -1}, cv::BORDER_REPLICATE);
  scratch_.copyTo(part);
  const cv::Rect full = cv::Rect(2 * box.x, 2 * box.y, 2 * box.width, 2 * box.height) & cv::Rect(0, 0, w, h);
  const int shift_x = ChromaShiftX(color.layout), shift_y = ChromaShiftY(color.layout);
  Blend(room.y, mask_, 0, 0, full, tone.gain, tone.offset, empty.y);
  const float center = 128 * (1 - tone.gain);
  Blend(room.cb, mask_, shift_x, shift_y, full, tone.gain, center, empty.cb);
  Blend(room.cr, mask_, shift_x, shift_y, full, tone.gain, center, empty.cr);
}

}  // namespace mixstage
