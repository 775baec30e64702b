// SPDX-License-Identifier: Apache-2.0
//
// The scanned room drawn into the colour camera's view: D_M and the background's colour from any pose
// (MixIn3D 2.3, 2.4; algorithms 13: visibility first, every visible pixel is then textured once).
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "proto/base/result.h"
#include "proto/geometry/rig.h"
#include "server/environment/environment_folder.h"
#include "server/environment/room_prediction.h"
#include "server/raster/render_device.h"
#include "server/render/fragment_rows.h"
#include "server/render/texture_mips.h"

namespace mixstage {

class RoomView {
 public:
  // A pose is at rest while no pixel moves further than this, whatever lies half a metre away or beyond.
  static constexpr double kRest_px = 0.02;

  // color, vignetting of `rig`; room is valid (checked). Fails (kInvalidConfig) where the camera is not
  // valid.
  static Result<RoomView> Create(const Rig& rig, const RoomModel& room, const RenderDevice& device = {});
  // The same room, shared, through another camera's color and vignetting.
  [[nodiscard]] Result<RoomView> Beside(const Rig& rig, const RenderDevice& device = {}) const;

  // What the camera would see from there. Draws anew only where the pose has moved. The pictures of a redraw
  // are new memory: who holds earlier ones keeps them. One thread at a time.
  const RoomPrediction& Look(const RigidTransform& T_world_color);

  // Of the last Look: [h x w] sRGB, B G R; 0 where never observed. Shaded on demand.
  [[nodiscard]] cv::Mat3b Picture();

 private:
  // A surface in an output pixel.
  struct Fragment {
    std::int32_t triangle = 0, column = 0;
    float ray_x = 0, ray_y = 0;
    float share = 0;  // of the pixel
  };
  // A part of the room, drawn where the camera may see it.
  struct Chunk {
    std::uint32_t first_vertex = 0, vertices = 0;
    std::uint32_t first_index = 0, triangles = 0;
    Eigen::Vector3d center = Eigen::Vector3d::Zero();  // of a sphere around it
    double radius_m = 0;
  };
  // What is drawn: chunk after chunk, each with vertices of its own; indices count from its first vertex.
  struct Room {
    explicit Room(const RoomModel& model);
    std::vector<Chunk> chunks;
    std::vector<Eigen::Vector3f> positions;
    std::vector<Eigen::Vector2f> uvs;
    std::vector<std::uint32_t> indices;
    std::vector<std::uint32_t> chunk_of;  // one a triangle
    TextureMips texture;
  };
  // Pictures of the whole picture's size or of half of it.
  struct Shading {
    cv::Mat2f rays;  // (x/z, y/z) of the pixel centres
    cv::Mat1f gain;  // vignetting
    float pixel_rad = 0;
  };

  RoomView(const Rig& rig, std::shared_ptr<const Room> room, std::unique_ptr<Rasteriser> rasteriser);
  static Result<RoomView> Of(const Rig& rig, std::shared_ptr<const Room> room, const RenderDevice& device);
  static Shading ShadingOf(const Rig& rig, const PinholeCamera& camera);
  [[nodiscard]] bool MaySee(const Chunk& chunk, const RigidTransform& T_color_world) const;
  void Redraw(const RigidTransform& T_world_color);
  [[nodiscard]] float DepthAround(int u, int v) const;
  void FillThinGaps(const cv::Mat1f& half_depth_m);
  void CollectFull(int v);
  void CollectHalf(int v);
  // rgba of the collected fragments: linear light times share, the share.
  void Shade(const Shading& shading, int v, std::vector<cv::Vec4f>& row);

  PinholeCamera color_;
  double view_angle_rad_ = 0;  // between the axis and the farthest pixel's ray
  std::shared_ptr<const Room> room_;
  std::unique_ptr<Rasteriser> rasteriser_;
  Shading full_, half_;
  RigidTransform T_world_color_ = RigidTransform::Identity();
  RoomPrediction prediction_, before_;         // the one before: its memory serves again when nobody holds it
  const VisibilityBuffer* visible_ = nullptr;  // of the last redraw
  // Scratch of a row and of a redraw.
  std::vector<Eigen::Array4f> corners_;  // of every vertex: x, y, z in the camera's frame, u
  std::vector<Fragment> fragments_;
  std::vector<const TextureMips*> textures_;
  FragmentRows rows_;
  std::vector<float> rgba_;
  std::vector<cv::Vec4f> row_;
};

}  // namespace mixstage
