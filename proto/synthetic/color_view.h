// SPDX-License-Identifier: Apache-2.0
//
// The colour camera's pictures: the room's plate, and per frame only what the figure and his shadow change.
// Also the fisheye's, in which the figure is never drawn.
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "proto/codec/yuv_image.h"
#include "proto/synthetic/figure_view.h"
#include "proto/synthetic/noise_tape.h"
#include "proto/synthetic/room_plate.h"

namespace mixstage {

enum class SensorNoise { kNone = 1, kReal };

class ColorView {
 public:
  // Through the colour camera. The plate's pictures are shared, not changed.
  ColorView(const RoomPlate& plate, const PinholeCamera& camera, const RigidTransform& T_world_color);
  // Through any other lens: the empty set alone.
  explicit ColorView(const RoomPlate& plate);

  // figure: null = the empty set; must be null where there is no colour camera (checked). Allocates nothing
  // once `out` has its size. One thread at a time.
  void Render(const Figure* figure, const BodyLight& light, std::uint32_t frame, const NoiseTape& tape,
              SensorNoise noise, YuvImage& out);

  // [h x w] share of the empty room's light (luminance) that the figure leaves at each pixel, 0..1; what he
  // hides is not considered.
  [[nodiscard]] cv::Mat1f LightLeft(const Figure& figure, const BodyLight& light);

 private:
  static constexpr int kNodes = kTile / kNodeStep + 1;  // a side
  static constexpr int kNodesPadded = (kNodes * kNodes + 15) / 16 * 16;
  static constexpr int kCoarse = 4;  // nodes per coarse node

  enum class TileShadow : std::uint8_t { kNone = 1, kCoarse, kFine };

  void MakeTiles(const RoomPlate& plate);
  void MakeStaticPicture();
  void MakeNodes(const RoomPlate& plate);
  // Shares at node (i, j) as they are drawn: shadows too weak to see fade out. Returns what the pixel loses,
  // 0..1.
  float Fade(int i, int j, float share[3]) const;
  void DrawFigure(const Figure& figure, const BodyLight& light);
  void BinParts();
  void FindShadows(const BodyLight& light);
  void FineShares(int i, int j, const BodyLight& light);
  void CoarseShares(int i, int j);
  void DrawBody(int i, int j, const BodyLight& light);
  // Writes the tile into the current picture.
  void ComposeTileAt(int i, int j, const float* const share[3], const float* const color[3],
                     const float* coverage);
  void RestoreTile(int i, int j);
  [[nodiscard]] BodyTile TileOf(int i, int j);
  [[nodiscard]] float BodyDepth(int u, int v) const;
  void FindEdges(int i, int j, std::uint8_t* edges) const;
  [[nodiscard]] std::size_t TileIndex(int i, int j) const {
    return static_cast<std::size_t>(j * tiles_x_ + i);
  }

  // Everything of a tile lies together: a picture's rows are pages apart.
  struct TileData {
    alignas(64) std::uint16_t layer[3][3][kTile * kTile];  // window, soft box, rest; r, g, b; x kLayerScale
    alignas(64) float ray[3][kTile * kTile], vignette[kTile * kTile];
  };

  int width_ = 0, height_ = 0, padded_width_ = 0, padded_height_ = 0;  // px
  Eigen::Vector3f origin_ = Eigen::Vector3f::Zero();                   // the camera's centre, world
  std::vector<TileData> tile_data_;
  cv::Mat1f node_point_[3], node_normal_[3];  // as RoomPlate's
  std::optional<PinholeCamera> camera_;
  RigidTransform T_world_color_;
  int tiles_x_ = 0, tiles_y_ = 0;
  cv::Mat1s static_y_, static_cb_, static_cr_;  // [padded] the empty set, value x 64
  cv::Mat1s y_, cb_, cr_;                       // [padded] this frame before its noise

  // Every fourth node, for shadows' overview: points and what is left of the lamps.
  int coarse_width_ = 0, coarse_height_ = 0;
  std::vector<float> coarse_point_[3], coarse_normal_[3], coarse_share_[3], coarse_lost_;
  cv::Mat1f part_of_light_[3];  // [nodes] of window, soft box, rest; sum 1

  FigureView view_;
  Casters casters_;
  struct Bin {
    int count = 0;
    std::uint8_t parts[Figure::kMaxParts];
  };
  std::vector<Bin> bins_;
  std::vector<TileShadow> shadows_;
  std::vector<std::uint8_t> touched_, touched_before_;  // by tile: differs from the empty set
  std::vector<float> body_z_;                           // tile after tile; valid in tiles with parts
  struct Buffers {
    alignas(64) float normal[3][kTile * kTile], albedo[3][kTile * kTile], color[3][kTile * kTile];
    alignas(64) float z[kTile * kTile], coverage[kTile * kTile];
    alignas(64) float share[3][kNodes * kShareStride];
    alignas(64) float node_point[3][kNodesPadded], node_normal[3][kNodesPadded], node_share[3][kNodesPadded];
  };
  std::unique_ptr<Buffers> buffers_;
};

}  // namespace mixstage
