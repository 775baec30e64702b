// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/depth_evidence.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "proto/base/check.h"
#include "server/segmentation/box_mean.h"
#include "server/segmentation/depth_evidence_rows.h"

namespace mixstage {
namespace {

constexpr bool HasDepth(float z) { return z > 0; }

// Depth's own grid (5-6 colour pixels for a 176x144 sensor), in quarter pixels.
constexpr float kGridReach = 2.0f;

}  // namespace

void DepthEvidence::Run(ImageView<const float> depth_m, float age_s, const BackgroundModel& model,
                        const DepthEvidenceConfig& config) {
  MIX_CHECK(model.has_depth() && depth_m.width() == model.width && depth_m.height() == model.height);
  QuarterDepth(depth_m, &depth_m_);
  const cv::Size size = depth_m_.size();
  for (cv::Mat1f* plane : {&weighted_, &weight_, &log_odds_, &inside_}) plane->create(size);
  for (cv::Mat1b* plane : {&front_, &room_}) plane->create(size);

  for (int y = 0; y < size.height; ++y) {
    WeighDepthRow({depth_m_.ptr<float>(y), model.room_depth_m.ptr<float>(y), model.sigma_m.ptr<float>(y),
                   model.depth_weight.ptr<float>(y), model.log_peak_depth.ptr<float>(y)},
                  size.width, config, weight_.ptr<float>(y), weighted_.ptr<float>(y));
  }
  MeanOf3x3(&weighted_);
  MeanOf3x3(&weight_);

  float sum_m = 0;
  float count = 0;
  for (int y = 0; y < size.height; ++y) {
    const float* D = depth_m_.ptr<float>(y);
    const std::uint8_t* front = front_.ptr<std::uint8_t>(y);
    DecideDepthRow(weight_.ptr<float>(y), weighted_.ptr<float>(y), size.width, log_odds_.ptr<float>(y),
                   front_.ptr<std::uint8_t>(y), room_.ptr<std::uint8_t>(y));
    for (int x = 0; x < size.width; x += 4) {
      if (front[x] != 0 && HasDepth(D[x])) sum_m += D[x], ++count;
    }
  }
  // How far the outline may have moved since depth was measured. A lens sees about its own width at its
  // distance.
  const float distance_m = count > 0 ? std::max(sum_m / count, 0.3f) : 3.0f;
  const float moved = static_cast<float>(size.width) * config.actor_speed_m_s * age_s / distance_m;
  const int reach = static_cast<int>(std::lround(std::min(kGridReach + moved, 24.0f)));
  const cv::Size window(2 * reach + 1, 2 * reach + 1);
  cv::blur(front_, front_, window, {-1, -1}, cv::BORDER_REPLICATE);
  cv::blur(room_, room_, window, {-1, -1}, cv::BORDER_REPLICATE);
  for (int y = 0; y < size.height; ++y) {
    TrustDepthRow(front_.ptr<std::uint8_t>(y), room_.ptr<std::uint8_t>(y), size.width, config.edge_weight,
                  log_odds_.ptr<float>(y), inside_.ptr<float>(y));
  }
}

void DepthKey(ImageView<const float> room_depth_m, ImageView<const float> sensor_depth_m,
              ImageView<const float> sigma_m, ImageView<std::uint8_t> mask) {
  MIX_CHECK(SameSize(room_depth_m, sensor_depth_m) && SameSize(room_depth_m, sigma_m) &&
            SameSize(room_depth_m, mask));
  for (int v = 0; v < mask.height(); ++v) {
    const float* D_M = room_depth_m.row(v);
    const float* D = sensor_depth_m.row(v);
    const float* sigma = sigma_m.row(v);
    for (int u = 0; u < mask.width(); ++u) {
      const bool foreground = HasDepth(D[u]) && HasDepth(D_M[u]) && D_M[u] - D[u] > sigma[u];  // Eq. (1)
      mask.at(u, v) = foreground ? 255 : 0;
    }
  }
}

}  // namespace mixstage
