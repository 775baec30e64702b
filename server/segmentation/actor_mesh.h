// SPDX-License-Identifier: Apache-2.0
//
// The actor as a surface in the scene: piVE 3's video avatar, MixIn3D 2.4's last paragraph. A grid over his
// matte, cut off along the matte's outline to a fraction of a pixel and torn where one part of him hides
// another.
#pragma once

#include <array>
#include <cstdint>
#include <opencv2/core.hpp>

#include "proto/base/image_view.h"
#include "proto/base/result.h"
#include "proto/geometry/camera_model.h"
#include "proto/geometry/frames.h"
#include "server/segmentation/picture_mesh.h"

namespace mixstage {

struct ActorMesherConfig {
  int max_vertices = 17'000;  // 100 .. 1,000,000: the grid is as fine as this allows, but 2 px at least
  float step_m = 0.08f;       // > 0: of two neighbours so far apart in depth one hides the other
};

class ActorMesher {
 public:
  // Fails with kInvalidConfig where a value is out of its range or the camera is not valid.
  static Result<ActorMesher> Create(const ActorMesherConfig& config, const PinholeCamera& color);

  // alpha          [h x w] coverage of the actor, 0..255
  // actor_depth_m  [Half(h) x Half(w)] z of the actor in the colour camera, 0 = not known (ActorSurface)
  // T_scene_color  where the colour camera is
  // The mesh ends where alpha passes one half and where his depth is not known; it is empty where there is no
  // actor. No triangle spans a step of more than twice step_m, but surfaces steeper than 80 degrees from
  // facing the camera. Vertices are unprojected through the camera's own lens; the crop has even corners and
  // a margin. A pure function of its arguments. Stays until the next Run; allocates while sizes still grow;
  // one thread at a time. Sizes that differ from the camera's are a caller's bug (checked).
  const PictureMesh& Run(ImageView<const std::uint8_t> alpha, ImageView<const float> actor_depth_m,
                         const RigidTransform& T_scene_color);

  // Of the last Run: pixels between neighbours of the grid.
  [[nodiscard]] int spacing_px() const { return spacing_; }

 private:
  // Ways to a neighbour.
  enum Way : std::uint8_t { kRight = 0, kDown, kLeft, kUp };
  static constexpr std::uint32_t kNone = ~0u;
  // A crossing of the grid's lines. Vertices are made when a triangle first asks for them: the node's own,
  // and on each of its four edges where its surface ends before the neighbour.
  struct Node {
    float z = 0;  // 0: outside
    std::uint32_t vertex = kNone;
    std::array<std::uint32_t, 4> ends{kNone, kNone, kNone, kNone};
  };
  struct Extent {
    cv::Rect box;  // of alpha >= 1/2
    int pixels = 0;
  };

  ActorMesher(const ActorMesherConfig& config, const PinholeCamera& color);
  [[nodiscard]] Extent FindActor(ImageView<const std::uint8_t> alpha) const;
  void Build(const cv::Rect& box);
  void LayGrid(const cv::Rect& box);
  void PlaceNodes();
  void AddCell(int column, int row);
  void AddRing(const std::array<Node*, 4>& nodes, const std::array<cv::Point, 4>& places,
               const std::array<bool, 4>& joined);
  void AddTriangle(std::uint32_t a, std::uint32_t b, std::uint32_t c);

  [[nodiscard]] float DepthAt(int x, int y) const;
  [[nodiscard]] float SharpDepthAt(int x, int y) const;
  [[nodiscard]] float StepLimit(float z, int distance_px) const;
  [[nodiscard]] bool Joined(const Node& a, const Node& b, int distance_px) const;
  std::uint32_t VertexOf(Node& node, cv::Point place);
  std::uint32_t EndOf(Node& node, cv::Point place, Way way, const Node& neighbor, int distance_px);
  std::uint32_t AddVertex(float x, float y, float z);

  ActorMesherConfig config_;
  int width_ = 0, height_ = 0;
  float metres_per_px_ = 0;  // at 1 m
  cv::Mat2f rays_;           // UnprojectionTable
  int spacing_ = 2;
  std::vector<int> columns_, rows_;  // the grid's lines, px
  std::vector<Node> nodes_;          // [rows x columns]
  // Of the current Run.
  ImageView<const std::uint8_t> alpha_;
  ImageView<const float> depth_m_;
  Eigen::Matrix<float, 3, 4> T_scene_color_;
  PictureMesh mesh_;
};

}  // namespace mixstage
