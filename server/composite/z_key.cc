// SPDX-License-Identifier: Apache-2.0
#include "server/composite/z_key.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "proto/base/check.h"
#include "server/composite/srgb.h"

namespace mixstage {
namespace {

constexpr float kOpaque = 0.999f;
constexpr float kMmPerM = 1000.f;

std::uint16_t Millimetres(float depth_m) {
  return static_cast<std::uint16_t>(std::clamp(depth_m * kMmPerM + 0.5f, 0.f, 65535.f));
}

cv::Vec3b SrgbYcbcr(float r, float g, float b) {
  const SrgbTables& srgb = SrgbTables::Get();
  const Ycbcr8 c = RgbToYcbcr({srgb.ToSrgb(r), srgb.ToSrgb(g), srgb.ToSrgb(b)});
  return {c.y, c.cb, c.cr};
}

}  // namespace

void ZKey::Run(const ZKeyInput& in, YuvImage& composite, cv::Mat1w& depth_mm, cv::Mat1b& cg_alpha) {
  MIX_CHECK(in.color != nullptr && !in.color->empty());
  const YuvImage& color = *in.color;
  const int w = color.width();
  const int h = color.height();
  const bool actor = !in.alpha.empty();
  MIX_CHECK(!actor || (in.alpha.width() == w && in.alpha.height() == h && in.actor_depth_m.width() == (w + 1) / 2 &&
                       in.actor_depth_m.height() == (h + 1) / 2));
  MIX_CHECK(in.room == nullptr || in.room->depth_m.size() == cv::Size(w, h));

  composite.Create(w, h, color.layout);
  color.y.copyTo(composite.y);
  color.cb.copyTo(composite.cb);
  color.cr.copyTo(composite.cr);

  // Depth of what is real: the room's, and the actor's where he covers more than half of a pixel.
  depth_mm.create(h, w);
  if (in.room != nullptr) {
    PrepareRoom(*in.room);
    room_mm_.copyTo(depth_mm);
  } else {
    depth_mm.setTo(0);
  }
  if (actor) {
    ContinueActor(in.actor_depth_m);
    for (int y = 0; y < h; ++y) {
      const std::uint8_t* alpha = in.alpha.row(y);
      const float* z = actor_z_[y / 2];
      std::uint16_t* out = depth_mm[y];
      for (int x = 0; x < w; ++x) {
        if (alpha[x] >= 128) out[x] = Millimetres(z[x / 2]);
      }
    }
  }

  cg_alpha.create(h, w);
  cg_alpha.setTo(0);
  if (in.cg == nullptr || in.cg->bounds.empty()) return;
  MIX_CHECK((in.cg->bounds & cv::Rect(0, 0, w, h)) == in.cg->bounds);
  PrepareLayer(*in.cg);
  if (in.room != nullptr) {
    if (room_of_layer_ != in.room->revision) {
      room_in_front_.create(in.cg->bounds.size());
      const cv::Mat1f room = in.room->depth_m(in.cg->bounds);
      const cv::Mat1f sigma = in.room->sigma_m(in.cg->bounds);
      for (int y = 0; y < room.rows; ++y) {
        for (int x = 0; x < room.cols; ++x) {
          const bool hides = room(y, x) > 0 && room(y, x) + kRoomSigmas * sigma(y, x) < in.cg->depth_m(y, x);
          room_in_front_(y, x) = hides ? 255 : 0;
        }
      }
      room_of_layer_ = in.room->revision;
    }
  } else {
    room_in_front_.release();
    room_of_layer_ = 0;
  }
  mixed_.create(in.cg->bounds.size());
  for (int y = 0; y < in.cg->bounds.height; ++y) DrawRow(in, y, composite, depth_mm, cg_alpha);
  MixChroma(in, cg_alpha, composite);
}

// Coverage reaches a pixel or two beyond the half-size mask that the depth was made for: there the depth of the
// neighbour holds.
void ZKey::ContinueActor(ImageView<const float> actor_depth_m) {
  const cv::Mat1f z(actor_depth_m.height(), actor_depth_m.width(), const_cast<float*>(actor_depth_m.data()),
                    static_cast<std::size_t>(actor_depth_m.stride()) * sizeof(float));
  cv::dilate(z, actor_around_, cv::Mat());
  actor_around_.copyTo(actor_z_);
  z.copyTo(actor_z_, z > 0);
}

void ZKey::PrepareRoom(const RoomDepth& room) {
  if (room_revision_ == room.revision) return;
  room_revision_ = room.revision;
  room.depth_m.convertTo(room_mm_, CV_16U, kMmPerM);
}

void ZKey::PrepareLayer(const CgLayer& cg) {
  if (layer_drawing_ == cg.drawing && layer_ycbcr_.size() == cg.color.size()) return;
  layer_drawing_ = cg.drawing;
  room_of_layer_ = 0;
  layer_ycbcr_.create(cg.color.size());
  for (int y = 0; y < cg.color.rows; ++y) {
    for (int x = 0; x < cg.color.cols; ++x) {
      const cv::Vec4f& c = cg.color(y, x);
      const float k = c[3] > 0 ? 1 / c[3] : 0;
      layer_ycbcr_(y, x) = SrgbYcbcr(k * c[0], k * c[1], k * c[2]);
    }
  }
}

void ZKey::DrawRow(const ZKeyInput& in, int row, YuvImage& composite, cv::Mat1w& depth_mm, cv::Mat1b& cg_alpha) {
  const cv::Rect& bounds = in.cg->bounds;
  const int y = bounds.y + row;
  const int chroma_y = y >> ChromaShiftY(in.color->layout);
  const int shift_x = ChromaShiftX(in.color->layout);
  const SrgbTables& srgb = SrgbTables::Get();
  for (int i = 0; i < bounds.width; ++i) {
    const cv::Vec4f& cg = in.cg->color(row, i);
    if (cg[3] <= 0 || (!room_in_front_.empty() && room_in_front_(row, i) != 0)) continue;
    const int x = bounds.x + i;
    const float z = in.cg->depth_m(row, i);
    float seen = cg[3];
    if (!in.alpha.empty() && in.alpha.at(x, y) > 0) {
      // 0, not known, is in front too.
      if (actor_z_(y / 2, x / 2) < z) seen *= 1 - static_cast<float>(in.alpha.at(x, y)) * (1 / 255.f);
    }
    const auto visible = static_cast<std::uint8_t>(seen * 255.f + 0.5f);
    if (visible == 0) continue;
    cg_alpha(y, x) = visible;
    // The nearest surface that is seen at least by half of the pixel.
    if (visible >= 128) depth_mm(y, x) = Millimetres(z);
    cv::Vec3b& mixed = mixed_(row, i);
    if (seen >= kOpaque) {
      mixed = layer_ycbcr_(row, i);
    } else {
      const Rgb8 real = YcbcrToRgb(in.color->y(y, x), in.color->cb(chroma_y, x >> shift_x),
                                   in.color->cr(chroma_y, x >> shift_x));
      const float k = seen / cg[3];
      mixed = SrgbYcbcr(srgb.ToLinear(real.r) * (1 - seen) + k * cg[0], srgb.ToLinear(real.g) * (1 - seen) + k * cg[1],
                        srgb.ToLinear(real.b) * (1 - seen) + k * cg[2]);
    }
    composite.y(y, x) = mixed[0];
  }
}

// A chroma sample is the mean over its luma pixels: CG's own where CG is seen, the camera's sample elsewhere.
void ZKey::MixChroma(const ZKeyInput& in, const cv::Mat1b& cg_alpha, YuvImage& composite) const {
  const cv::Rect& bounds = in.cg->bounds;
  const int bw = 1 << ChromaShiftX(composite.layout);
  const int bh = 1 << ChromaShiftY(composite.layout);
  const int w = composite.width();
  const int h = composite.height();
  for (int cy = bounds.y / bh; cy * bh < bounds.y + bounds.height; ++cy) {
    for (int cx = bounds.x / bw; cx * bw < bounds.x + bounds.width; ++cx) {
      int cb = 0;
      int cr = 0;
      int pixels = 0;
      int mixed = 0;
      for (int y = cy * bh; y < std::min((cy + 1) * bh, h); ++y) {
        for (int x = cx * bw; x < std::min((cx + 1) * bw, w); ++x) {
          ++pixels;
          // mixed_ holds a value of this frame only where CG is seen.
          const bool is_mixed = cg_alpha(y, x) != 0;
          cb += is_mixed ? mixed_(y - bounds.y, x - bounds.x)[1] : in.color->cb(cy, cx);
          cr += is_mixed ? mixed_(y - bounds.y, x - bounds.x)[2] : in.color->cr(cy, cx);
          mixed += is_mixed;
        }
      }
      if (mixed == 0) continue;
      composite.cb(cy, cx) = static_cast<std::uint8_t>((cb + pixels / 2) / pixels);
      composite.cr(cy, cx) = static_cast<std::uint8_t>((cr + pixels / 2) / pixels);
    }
  }
}

}  // namespace mixstage
