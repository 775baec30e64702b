// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/color_view.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "proto/base/check.h"

namespace mixstage {
namespace {

constexpr int kMargin_px = 2;
constexpr float kStep_m = 0.03f;  // a jump in depth that is an outline, also within the body

// Standard deviation of the noise: gain x 24 / 1024 counts of the 8-bit picture, in the dark and falling with
// light.
constexpr int kLumaGain = 66, kLumaSlope = 1, kChromaGain = 34;

}  // namespace

ColorView::ColorView(const RoomPlate& plate, const PinholeCamera& camera, const RigidTransform& T_world_color)
    : ColorView(plate) {
  camera_ = camera;
  T_world_color_ = T_world_color;
}

ColorView::ColorView(const RoomPlate& plate) {
  width_ = plate.width;
  height_ = plate.height;
  padded_width_ = plate.padded_width;
  padded_height_ = plate.padded_height;
  origin_ = plate.origin.cast<float>();
  tiles_x_ = padded_width_ / kTile;
  tiles_y_ = padded_height_ / kTile;
  const auto tiles = static_cast<std::size_t>(tiles_x_ * tiles_y_);
  bins_.resize(tiles);
  shadows_.assign(tiles, TileShadow::kNone);
  touched_.assign(tiles, 0);
  touched_before_.assign(tiles, 0);
  body_z_.resize(tiles * kTile * kTile);
  buffers_ = std::make_unique<Buffers>();
  MakeTiles(plate);
  MakeNodes(plate);
  MakeStaticPicture();
}

void ColorView::MakeTiles(const RoomPlate& plate) {
  tile_data_.resize(static_cast<std::size_t>(tiles_x_ * tiles_y_));
  for (int v = 0; v < padded_height_; ++v) {
    for (int u = 0; u < padded_width_; ++u) {
      TileData& tile = tile_data_[TileIndex(u / kTile, v / kTile)];
      const int at = v % kTile * kTile + u % kTile;
      const cv::Mat1f* layers[3] = {plate.window, plate.softbox, plate.rest};
      for (int c = 0; c < 3; ++c) {
        for (int k = 0; k < 3; ++k) {
          const float counts = std::min(layers[k][c](v, u) * kLayerScale + 0.5f, 65535.f);
          tile.layer[k][c][at] = static_cast<std::uint16_t>(counts);
        }
        tile.ray[c][at] = plate.ray[c](v, u);
      }
      tile.vignette[at] = plate.vignette(v, u);
    }
  }
}

void ColorView::MakeStaticPicture() {
  y_.create(padded_height_, padded_width_);
  cb_.create(padded_height_ / 2, padded_width_ / 2);
  cr_.create(cb_.size());
  for (int j = 0; j < tiles_y_; ++j) {
    for (int i = 0; i < tiles_x_; ++i) {
      const float* const none[3] = {};
      ComposeTileAt(i, j, none, none, nullptr);
    }
  }
  static_y_ = y_.clone();
  static_cb_ = cb_.clone();
  static_cr_ = cr_.clone();
}

void ColorView::Render(const Figure* figure, const BodyLight& light, std::uint32_t frame,
                       const NoiseTape& tape, SensorNoise noise, YuvImage& out) {
  touched_before_.swap(touched_);
  std::fill(touched_.begin(), touched_.end(), std::uint8_t{0});
  if (figure != nullptr) DrawFigure(*figure, light);
  for (int j = 0; j < tiles_y_; ++j) {
    for (int i = 0; i < tiles_x_; ++i) {
      if (touched_before_[TileIndex(i, j)] && !touched_[TileIndex(i, j)]) RestoreTile(i, j);
    }
  }
  out.Create(width_, height_, ChromaLayout::k420);
  const int luma_gain = noise == SensorNoise::kReal ? kLumaGain : 0;
  const int luma_slope = noise == SensorNoise::kReal ? kLumaSlope : 0;
  const int chroma_gain = noise == SensorNoise::kReal ? kChromaGain : 0;
  auto row_of = [&](const cv::Mat1s& base, int row, std::uint32_t stream, int gain, int slope,
                    cv::Mat1b& plane) {
    const auto key = static_cast<std::uint32_t>(row) * 3 + stream;
    AddNoise(base.ptr<std::int16_t>(row), tape.Counts(frame, key), plane.cols, gain, slope, plane.ptr(row));
  };
  for (int row = 0; row < out.y.rows; ++row) row_of(y_, row, 0, luma_gain, luma_slope, out.y);
  for (int row = 0; row < out.cb.rows; ++row) {
    row_of(cb_, row, 1, chroma_gain, 0, out.cb);
    row_of(cr_, row, 2, chroma_gain, 0, out.cr);
  }
}

void ColorView::DrawFigure(const Figure& figure, const BodyLight& light) {
  MIX_CHECK(camera_.has_value());
  ViewFigure(figure, *camera_, T_world_color_, kMargin_px, view_);
  CastersOf(figure, casters_);
  BinParts();
  FindShadows(light);
  for (int j = 0; j < tiles_y_; ++j) {
    for (int i = 0; i < tiles_x_; ++i) {
      const Bin& bin = bins_[TileIndex(i, j)];
      if (bin.count > 0)
        RasterBody(view_.parts.data(), bin.parts, bin.count, i * kTile, j * kTile, TileOf(i, j));
    }
  }
  for (int j = 0; j < tiles_y_; ++j) {
    for (int i = 0; i < tiles_x_; ++i) {
      const bool body = bins_[TileIndex(i, j)].count > 0;
      const TileShadow shadow = shadows_[TileIndex(i, j)];
      if (!body && shadow == TileShadow::kNone) continue;
      touched_[TileIndex(i, j)] = 1;
      if (shadow == TileShadow::kFine) FineShares(i, j, light);
      if (shadow == TileShadow::kCoarse) CoarseShares(i, j);
      if (body) DrawBody(i, j, light);
      Buffers& b = *buffers_;
      const float* const share[3] = {b.share[0], b.share[1], b.share[2]};
      const float* const color[3] = {b.color[0], b.color[1], b.color[2]};
      const float* const none[3] = {};
      ComposeTileAt(i, j, shadow == TileShadow::kNone ? none : share, body ? color : none,
                    body ? b.coverage : nullptr);
    }
  }
}

void ColorView::BinParts() {
  for (Bin& bin : bins_) bin.count = 0;
  for (int k = 0; k < view_.count; ++k) {
    const PartView& part = view_.parts[static_cast<std::size_t>(k)];
    if (part.u0 > part.u1) continue;
    for (int j = part.v0 / kTile; j <= part.v1 / kTile; ++j) {
      for (int i = part.u0 / kTile; i <= part.u1 / kTile; ++i) {
        Bin& bin = bins_[TileIndex(i, j)];
        bin.parts[bin.count++] = static_cast<std::uint8_t>(k);
      }
    }
  }
}

BodyTile ColorView::TileOf(int i, int j) {
  const TileData& data = tile_data_[TileIndex(i, j)];
  BodyTile tile{};
  for (int c = 0; c < 3; ++c) {
    tile.ray[c] = data.ray[c];
    tile.normal[c] = buffers_->normal[c];
    tile.albedo[c] = buffers_->albedo[c];
    tile.color[c] = buffers_->color[c];
  }
  tile.vignette = data.vignette;
  tile.z = body_z_.data() + TileIndex(i, j) * kTile * kTile;
  tile.coverage = buffers_->coverage;
  return tile;
}

float ColorView::BodyDepth(int u, int v) const {
  if (u < 0 || v < 0 || u >= padded_width_ || v >= padded_height_) return kNoDepth;
  const std::size_t tile = TileIndex(u / kTile, v / kTile);
  if (bins_[tile].count == 0) return kNoDepth;
  return body_z_[tile * kTile * kTile + static_cast<std::size_t>(v % kTile * kTile + u % kTile)];
}

// Which pixels of a tile have a neighbour that is much nearer or farther.
void ColorView::FindEdges(int i, int j, std::uint8_t* edges) const {
  constexpr int kSide = kTile + 2;
  float z[kSide * kSide];
  const float* own = body_z_.data() + TileIndex(i, j) * kTile * kTile;
  for (int row = 0; row < kTile; ++row) {
    std::memcpy(z + (row + 1) * kSide + 1, own + row * kTile, kTile * sizeof(float));
    z[(row + 1) * kSide] = BodyDepth(i * kTile - 1, j * kTile + row);
    z[(row + 1) * kSide + kTile + 1] = BodyDepth((i + 1) * kTile, j * kTile + row);
  }
  for (int col = 0; col < kTile; ++col) {
    z[col + 1] = BodyDepth(i * kTile + col, j * kTile - 1);
    z[(kTile + 1) * kSide + col + 1] = BodyDepth(i * kTile + col, (j + 1) * kTile);
  }
  for (int row = 0; row < kTile; ++row) {
    const float* at = z + (row + 1) * kSide + 1;
    for (int col = 0; col < kTile; ++col) {
      const float across = std::max(std::abs(at[col - 1] - at[col]), std::abs(at[col + 1] - at[col]));
      const float down = std::max(std::abs(at[col - kSide] - at[col]), std::abs(at[col + kSide] - at[col]));
      edges[row * kTile + col] = std::max(across, down) > kStep_m;
    }
  }
}

void ColorView::DrawBody(int i, int j, const BodyLight& light) {
  const Bin& bin = bins_[TileIndex(i, j)];
  BodyTile tile = TileOf(i, j);
  GatherBody(view_.parts.data(), bin.parts, bin.count, i * kTile, j * kTile, tile);
  // Supersampling puts mean depths in; edges are found in the sharp ones, so it writes to a copy.
  std::copy(tile.z, tile.z + kTile * kTile, buffers_->z);
  tile.z = buffers_->z;
  std::uint8_t edges[kTile * kTile];
  FindEdges(i, j, edges);
  for (int row = 0; row < kTile; ++row) {
    for (int col = 0; col < kTile; ++col) {
      if (edges[row * kTile + col] == 0) continue;
      const int u = i * kTile + col;
      const int v = j * kTile + row;
      float ray[3];
      float ray_u[3];
      float ray_v[3];
      const int right = std::min(col + 1, kTile - 1);
      const int below = std::min(row + 1, kTile - 1);
      for (int c = 0; c < 3; ++c) {
        const float* plane = tile.ray[c];
        ray[c] = plane[row * kTile + col];
        ray_u[c] = plane[row * kTile + right] - plane[row * kTile + right - 1];
        ray_v[c] = plane[below * kTile + col] - plane[(below - 1) * kTile + col];
      }
      SupersampleBody(view_.parts.data(), bin.parts, bin.count, u, v, row * kTile + col, ray, ray_u, ray_v,
                      tile);
    }
  }
  ShadeBody(light, casters_.casters.data(), casters_.count, origin_, tile);
}

void ColorView::ComposeTileAt(int i, int j, const float* const share[3], const float* const color[3],
                              const float* coverage) {
  const TileData& data = tile_data_[TileIndex(i, j)];
  ComposeTile tile{};
  for (int c = 0; c < 3; ++c) {
    tile.layer[c] = data.layer[c][0];
    tile.share[c] = share[c];
    tile.color[c] = color[c];
  }
  tile.coverage = coverage;
  constexpr int kHalf = kTile / 2;
  tile.y = y_.ptr<std::int16_t>(j * kTile) + i * kTile;
  tile.cb = cb_.ptr<std::int16_t>(j * kHalf) + i * kHalf;
  tile.cr = cr_.ptr<std::int16_t>(j * kHalf) + i * kHalf;
  tile.y_stride = static_cast<std::ptrdiff_t>(y_.step1());
  tile.chroma_stride = static_cast<std::ptrdiff_t>(cb_.step1());
  Compose(tile);
}

void ColorView::RestoreTile(int i, int j) {
  const cv::Rect luma(i * kTile, j * kTile, kTile, kTile);
  const cv::Rect chroma(i * kTile / 2, j * kTile / 2, kTile / 2, kTile / 2);
  static_y_(luma).copyTo(y_(luma));
  static_cb_(chroma).copyTo(cb_(chroma));
  static_cr_(chroma).copyTo(cr_(chroma));
}

}  // namespace mixstage
