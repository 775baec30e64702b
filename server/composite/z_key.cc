// SPDX-License-Identifier: Apache-2.0
#include "server/composite/z_key.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <opencv2/imgproc.hpp>

#include "proto/base/check.h"
#include "proto/base/image_mat.h"
#include "server/composite/mix.h"

namespace mixstage {
namespace {

constexpr float kOpaque = 0.999f;
constexpr float kMmPerM = 1000.f;
enum Seen : std::uint8_t { kUnseen = 0, kMixed = 1, kWhole = 255 };

std::uint16_t Millimetres(float depth_m) {
  return static_cast<std::uint16_t>(std::clamp(depth_m * kMmPerM + 0.5f, 0.f, 65535.f));
}

std::uint64_t Eight(const std::uint8_t* from) {
  std::uint64_t bytes = 0;
  std::memcpy(&bytes, from, sizeof(bytes));
  return bytes;
}

// First column in [x, end) that is not 0; end if none.
int SkipZeros(const std::uint8_t* row, int x, int end) {
  while (x + 8 <= end && Eight(row + x) == 0) x += 8;
  while (x < end && row[x] == 0) ++x;
  return x;
}

// One past the last column in [begin, x) that is not 0; begin if none.
int SkipZerosBack(const std::uint8_t* row, int begin, int x) {
  while (x - 8 >= begin && Eight(row + x - 8) == 0) x -= 8;
  while (x > begin && row[x - 1] == 0) --x;
  return x;
}

void CopyBytes(const std::uint8_t* from, int count, std::uint8_t* to) {
  std::memcpy(to, from, static_cast<std::size_t>(count));
}
void CopyRow(const cv::Mat1b& from, int y, cv::Mat1b& to) { CopyBytes(from[y], from.cols, to[y]); }

}  // namespace

void ZKey::Run(const ZKeyInput& in, YuvImage& composite, cv::Mat1w& depth_mm, cv::Mat1b& cg_alpha) {
  MIX_CHECK(in.color != nullptr && !in.color->empty());
  const YuvImage& color = *in.color;
  const int w = color.width();
  const int h = color.height();
  const bool actor = !in.alpha.empty();
  MIX_CHECK(!actor || (in.alpha.width() == w && in.alpha.height() == h &&
                       in.actor_depth_m.width() == (w + 1) / 2 && in.actor_depth_m.height() == (h + 1) / 2));
  MIX_CHECK(in.foreground == nullptr || in.foreground->size() == cv::Size(w, h));
  MIX_CHECK(in.room == nullptr || in.room->depth_m.size() == cv::Size(w, h));
  const bool cg = in.cg != nullptr && !in.cg->bounds.empty();
  MIX_CHECK(!cg || ((in.cg->bounds & cv::Rect(0, 0, w, h)) == in.cg->bounds && in.cg->bounds.x % 2 == 0 &&
                    in.cg->bounds.y % 2 == 0));

  composite.Create(w, h, color.layout);
  depth_mm.create(h, w);
  cg_alpha.create(h, w);
  if (in.room != nullptr) PrepareRoom(*in.room);
  if (actor) PrepareActor(in);
  if (cg) {
    PrepareLayer(*in.cg);
    FindStretches(*in.cg, in.room);
    for (cv::Mat1b* plane : {&seen_, &mixed_cb_, &mixed_cr_}) plane->create(in.cg->bounds.size());
  }

  // A row of everything at a time, while it is in the cache; chroma follows its last luma row.
  const auto row_bytes = static_cast<std::size_t>(w) * sizeof(std::uint16_t);
  const int block_rows = 1 << ChromaShiftY(color.layout);
  for (int y = 0; y < h; ++y) {
    CopyRow(color.y, y, composite.y);
    // Depth of what is real: the room's, and the actor's where he covers more than half of a pixel.
    if (in.room != nullptr) {
      std::memcpy(depth_mm[y], room_mm_[y], row_bytes);
    } else {
      std::memset(depth_mm[y], 0, row_bytes);
    }
    if (actor) DrawActorDepth(in.alpha.row(y), y, depth_mm[y]);
    std::memset(cg_alpha[y], 0, static_cast<std::size_t>(w));
    const int row = cg ? y - in.cg->bounds.y : -1;
    const bool has_cg = row >= 0 && row < in.cg->bounds.height;
    if (has_cg) DrawRow(in, row, composite, depth_mm, cg_alpha);
    if ((y + 1) % block_rows != 0 && y + 1 != h) continue;
    const int chroma_y = y / block_rows;
    CopyRow(color.cb, chroma_y, composite.cb);
    CopyRow(color.cr, chroma_y, composite.cr);
    if (has_cg) MixChromaRow(in, chroma_y, composite);
  }
}

void ZKey::PrepareRoom(const RoomDepth& room) {
  if (room_revision_ == room.revision) return;
  room_revision_ = room.revision;
  room.depth_m.convertTo(room_mm_, CV_16U, kMmPerM);
}

void ZKey::PrepareLayer(const CgLayer& cg) {
  if (layer_drawing_ == cg.drawing && layer_y_.size() == cg.color.size()) return;
  layer_drawing_ = cg.drawing;
  stretches_known_ = false;
  for (cv::Mat1b* plane : {&layer_y_, &layer_cb_, &layer_cr_}) plane->create(cg.color.size());
  layer_mm_.create(cg.color.size());
  const SrgbTables& srgb = SrgbTables::Get();
  for (int y = 0; y < cg.color.rows; ++y) {
    for (int x = 0; x < cg.color.cols; ++x) {
      const cv::Vec4f& c = cg.color(y, x);
      if (c[3] < kOpaque) continue;  // mixed with the picture of each frame
      const float k = 1 / c[3];
      const Ycbcr8 ycbcr = LinearToYcbcr(srgb, k * c[0], k * c[1], k * c[2]);
      layer_y_(y, x) = ycbcr.y;
      layer_cb_(y, x) = ycbcr.cb;
      layer_cr_(y, x) = ycbcr.cr;
      layer_mm_(y, x) = Millimetres(cg.depth_m(y, x));
    }
  }
}

void ZKey::FindStretches(const CgLayer& cg, const RoomDepth* room) {
  const std::uint64_t revision = room != nullptr ? room->revision : 0;
  if (stretches_known_ && room_of_stretches_ == revision) return;
  stretches_known_ = true;
  room_of_stretches_ = revision;
  stretches_.clear();
  row_begin_.clear();
  for (int y = 0; y < cg.color.rows; ++y) {
    row_begin_.push_back(stretches_.size());
    bool open = false;
    for (int x = 0; x < cg.color.cols; ++x) {
      const float coverage = cg.color(y, x)[3];
      bool seen = coverage > 0, on_surface = false;
      if (seen && room != nullptr) {
        const float z = room->depth_m(cg.bounds.y + y, cg.bounds.x + x);
        const float noise = kRoomSigmas * room->sigma_m(cg.bounds.y + y, cg.bounds.x + x);
        seen = !(z > 0 && z + noise < cg.depth_m(y, x));
        on_surface = z > 0 && z - noise <= cg.depth_m(y, x);
      }
      const bool opaque = coverage >= kOpaque;
      if (seen && (!open || stretches_.back().opaque != opaque || stretches_.back().on_surface != on_surface))
        stretches_.push_back({x, x, opaque, on_surface});
      open = seen;
      if (seen) stretches_.back().end = x + 1;
    }
  }
  row_begin_.push_back(stretches_.size());
}

// Coverage reaches a pixel or two beyond the half-size mask that the depth was made for: there the depth of
// the neighbour holds.
void ZKey::PrepareActor(const ZKeyInput& in) {
  const int w = in.alpha.width();
  const int h = in.alpha.height();
  actor_spans_.resize(static_cast<std::size_t>(h));
  int left = w, right = 0, top = h, bottom = 0;
  for (int y = 0; y < h; ++y) {
    Span& span = actor_spans_[static_cast<std::size_t>(y)];
    const int begin = SkipZeros(in.alpha.row(y), 0, w);
    span = begin < w ? Span{begin, SkipZerosBack(in.alpha.row(y), begin, w)} : Span{};
    if (begin == w) continue;
    left = std::min(left, span.begin);
    right = std::max(right, span.end);
    top = std::min(top, y);
    bottom = y + 1;
  }
  actor_z_.create(in.actor_depth_m.height(), in.actor_depth_m.width());
  actor_mm_.create(actor_z_.size());
  if (right == 0) return;
  const cv::Rect box(left / 2, top / 2, (right + 1) / 2 - left / 2, (bottom + 1) / 2 - top / 2);
  const cv::Mat1f z = AsMat(in.actor_depth_m);
  cv::Mat1f around = actor_z_(box);
  cv::dilate(z(box), around, cv::Mat());  // reads beyond the box where the picture goes on
  for (int y = box.y; y < box.br().y; ++y) {
    const float* own = z[y];
    float* to = actor_z_[y];
    std::uint16_t* mm = actor_mm_[y];
    for (int x = box.x; x < box.br().x; ++x) {
      to[x] = own[x] > 0 ? own[x] : to[x];
      mm[x] = Millimetres(to[x]);
    }
  }
}

void ZKey::DrawActorDepth(const std::uint8_t* alpha, int y, std::uint16_t* depth_mm) const {
  const Span span = actor_spans_[static_cast<std::size_t>(y)];
  const std::uint16_t* mm = actor_mm_[y / 2];
  const auto one = [&](int x) {
    if (alpha[x] >= 128) depth_mm[x] = mm[x / 2];
  };
  constexpr std::uint64_t kTopBits = 0x8080808080808080;
  int x = span.begin;
  if (x % 2 != 0) one(x++);
  for (; x + 8 <= span.end; x += 8) {
    const std::uint64_t covered = Eight(alpha + x) & kTopBits;
    if (covered == 0) continue;
    if (covered == kTopBits) {
      for (int i = 0; i < 8; i += 2) depth_mm[x + i] = depth_mm[x + i + 1] = mm[(x + i) / 2];
    } else {
      for (int i = 0; i < 8; ++i) one(x + i);
    }
  }
  for (; x < span.end; ++x) one(x);
}

void ZKey::DrawRow(const ZKeyInput& in, int row, YuvImage& composite, cv::Mat1w& depth_mm,
                   cv::Mat1b& cg_alpha) {
  const cv::Rect& bounds = in.cg->bounds;
  const int y = bounds.y + row;
  const int shift_x = ChromaShiftX(in.color->layout);
  const SrgbTables& srgb = SrgbTables::Get();
  const Span actor = in.alpha.empty() ? Span{} : actor_spans_[static_cast<std::size_t>(y)];
  const std::uint8_t* alpha = in.alpha.empty() ? nullptr : in.alpha.row(y);
  const cv::Vec3b* own = in.foreground != nullptr ? (*in.foreground)[y] : nullptr;
  const float* actor_z = in.alpha.empty() ? nullptr : actor_z_[y / 2];
  const std::uint8_t* real_y = in.color->y[y];
  const std::uint8_t* real_cb = in.color->cb[y >> ChromaShiftY(in.color->layout)];
  const std::uint8_t* real_cr = in.color->cr[y >> ChromaShiftY(in.color->layout)];
  const cv::Vec4f* layer = in.cg->color[row];
  const float* layer_z = in.cg->depth_m[row];
  // Pictures' rows from the layer's first column on.
  std::uint8_t* out_y = composite.y[y] + bounds.x;
  std::uint8_t* out_alpha = cg_alpha[y] + bounds.x;
  std::uint16_t* out_mm = depth_mm[y] + bounds.x;
  std::uint8_t* seen = seen_[row];
  std::memset(seen, kUnseen, static_cast<std::size_t>(bounds.width));

  const auto copy = [&](int begin, int end) {
    const auto count = static_cast<std::size_t>(end - begin);
    std::memcpy(out_y + begin, layer_y_[row] + begin, count);
    std::memcpy(out_mm + begin, layer_mm_[row] + begin, count * sizeof(std::uint16_t));
    std::memset(out_alpha + begin, 255, count);
    std::memset(seen + begin, kWhole, count);
  };
  // actor_part: his share of the pixel where he stands before CG, with his own colour.
  const auto mix = [&](int i, float coverage, float actor_part) {
    const auto visible = static_cast<std::uint8_t>(coverage * 255.f + 0.5f);
    if (visible == 0) return;
    const cv::Vec4f& cg = layer[i];
    const int x = bounds.x + i;
    const Rgb8 real = FixedYcbcrToRgb(real_y[x], real_cb[x >> shift_x], real_cr[x >> shift_x]);
    const float k = coverage / cg[3];
    const float rest = 1 - coverage - actor_part;
    std::array<float, 3> light = {srgb.ToLinear(real.r) * rest + k * cg[0],
                                  srgb.ToLinear(real.g) * rest + k * cg[1],
                                  srgb.ToLinear(real.b) * rest + k * cg[2]};
    if (actor_part > 0) {
      for (std::size_t c = 0; c < 3; ++c) light[c] += actor_part * srgb.ToLinear(own[x][static_cast<int>(c)]);
    }
    const Ycbcr8 mixed = LinearToYcbcr(srgb, light[0], light[1], light[2]);
    out_y[i] = mixed.y;
    mixed_cb_[row][i] = mixed.cb;
    mixed_cr_[row][i] = mixed.cr;
    out_alpha[i] = visible;
    seen[i] = kMixed;
    // The nearest surface that is seen at least by half of the pixel.
    if (visible >= 128) out_mm[i] = Millimetres(layer_z[i]);
  };

  for (std::size_t s = row_begin_[static_cast<std::size_t>(row)];
       s < row_begin_[static_cast<std::size_t>(row) + 1]; ++s) {
    const Stretch& stretch = stretches_[s];
    for (int i = stretch.begin; i < stretch.end;) {
      // Where the actor is not.
      int end = stretch.end;
      const int x = bounds.x + i;
      if (x < actor.end)
        end = std::min(end, SkipZeros(alpha, std::max(x, actor.begin), actor.end) - bounds.x);
      if (stretch.opaque) {
        if (end > i) copy(i, end);
      } else {
        for (int j = i; j < end; ++j) mix(j, layer[j][3], 0);
      }
      // Where he is. 0, not known, is in front too.
      for (i = end; i < stretch.end && bounds.x + i < actor.end && alpha[bounds.x + i] != 0; ++i) {
        const std::uint8_t covered = alpha[bounds.x + i];
        const bool in_front = stretch.on_surface || actor_z[(bounds.x + i) / 2] < layer_z[i];
        if (in_front && covered == 255) continue;
        const float a = in_front ? static_cast<float>(covered) * (1 / 255.f) : 0.f;
        const float coverage = layer[i][3] * (1 - a);
        if (coverage >= kOpaque) {
          copy(i, i + 1);
        } else {
          mix(i, coverage, own != nullptr ? layer[i][3] * a : 0.f);
        }
      }
    }
  }
}

// A chroma sample is the mean over its luma pixels: CG's own where CG is seen, the camera's sample elsewhere.
void ZKey::MixChromaRow(const ZKeyInput& in, int chroma_y, YuvImage& composite) const {
  const cv::Rect& bounds = in.cg->bounds;
  const int shift_x = ChromaShiftX(composite.layout);
  const int bw = 1 << shift_x;
  const int top = (chroma_y << ChromaShiftY(composite.layout)) - bounds.y;
  const int bottom = std::min(top + (1 << ChromaShiftY(composite.layout)), bounds.height) - 1;
  // One row or two; a single one is read twice, which leaves the mean what it is.
  const std::array<const std::uint8_t*, 2> seen = {seen_[top], seen_[bottom]};
  const auto mix_plane = [&](const cv::Mat1b& real, const cv::Mat1b& layer, const cv::Mat1b& mixed,
                             cv::Mat1b& to) {
    const std::uint8_t* own = real[chroma_y] + (bounds.x >> shift_x);
    std::uint8_t* out = to[chroma_y] + (bounds.x >> shift_x);
    const std::array<const std::uint8_t*, 2> whole = {layer[top], layer[bottom]};
    const std::array<const std::uint8_t*, 2> part = {mixed[top], mixed[bottom]};
    for (int i = 0; i < bounds.width; i += bw) {
      if (i % 8 == 0 && i + 8 <= bounds.width) {
        const std::uint64_t a = Eight(seen[0] + i), b = Eight(seen[1] + i);
        if ((a | b) == 0) {
          i += 8 - bw;
          continue;
        }
        if ((a & b) == ~std::uint64_t{0} && bw == 2) {
          for (int k = i; k < i + 8; k += 2) {
            const int sum = whole[0][k] + whole[0][k + 1] + whole[1][k] + whole[1][k + 1];
            out[k / 2] = static_cast<std::uint8_t>((sum + 2) / 4);
          }
          i += 8 - bw;
          continue;
        }
      }
      const int right = std::min(i + bw, bounds.width) - 1;
      int sum = 0;
      for (std::size_t r = 0; r < 2; ++r) {
        for (const int x : {i, right}) {
          sum += seen[r][x] == kWhole ? whole[r][x] : seen[r][x] == kMixed ? part[r][x] : own[i >> shift_x];
        }
      }
      out[i >> shift_x] = static_cast<std::uint8_t>((sum + 2) / 4);
    }
  };
  mix_plane(in.color->cb, layer_cb_, mixed_cb_, composite.cb);
  mix_plane(in.color->cr, layer_cr_, mixed_cr_, composite.cr);
}

}  // namespace mixstage
