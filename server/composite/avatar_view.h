// SPDX-License-Identifier: Apache-2.0
//
// The actor as another camera sees him in another place (piVE 5): his coloured depth surface reprojected into
// the target's view, put into the target's picture where nothing there is nearer. Eq 9, Z_ba = Z_a f_b / f_a,
// is what this comes to where the cameras differ by a shift along the axis and by their focal lengths.
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "proto/base/image_view.h"
#include "proto/base/result.h"
#include "proto/codec/yuv_image.h"
#include "proto/geometry/camera_model.h"
#include "proto/geometry/frames.h"
#include "server/composite/z_key.h"
#include "server/raster/render_device.h"

namespace mixstage {

struct AvatarInput {
  const YuvImage* color = nullptr;      // of the actor's camera, any chroma layout
  ImageView<const std::uint8_t> alpha;  // [h x w] coverage of the actor
  // [h x w] R, G, B: his own colour, known where 0 < alpha < 255 (Key::foreground); null: not known, the
  // colours beside stand in.
  const cv::Mat3b* foreground = nullptr;
  ImageView<const float> actor_depth_m;  // [Half(h) x Half(w)] z of the actor, 0 = not known (ActorSurface)
  RigidTransform T_view_color = RigidTransform::Identity();  // the actor's camera to the target's
};

// What the target's camera sees without him.
struct Backdrop {
  const YuvImage* picture = nullptr;  // [h x w] of the view
  const RoomDepth* depth = nullptr;   // null: nothing of it is nearer than he
};

// The picture with him in it and what goes with it, as the target's camera would have taken and keyed it.
struct AvatarPicture {
  YuvImage picture;         // layout of the backdrop
  cv::Mat1b alpha;          // [h x w] coverage of the actor where he is seen
  cv::Mat3b foreground;     // [h x w] R, G, B: his own colour, known where 0 < alpha < 255
  cv::Mat1f actor_depth_m;  // [Half(h) x Half(w)] z of him, also where the room hides him; 0 = not he
};

class AvatarView {
 public:
  // Fails (kInvalidConfig, the field named) where a camera is not valid.
  static Result<AvatarView> Create(const PinholeCamera& color, const PinholeCamera& view,
                                   const RenderDevice& device = {});

  // Where his depth is not known he is not drawn. The backdrop's picture is left as it is where he is not.
  // Sizes that differ from the cameras' are a caller's bug (checked). Allocates while sizes still grow; one
  // thread at a time.
  void Run(const AvatarInput& in, const Backdrop& backdrop, AvatarPicture& out);

 private:
  // A lens as the inner loop needs it.
  struct Lens {
    float fx, fy, cx, cy, k1, k2, k3, k4, k5, k6, p1, p2;
  };
  AvatarView(const PinholeCamera& color, const PinholeCamera& view, std::unique_ptr<Rasteriser> rasteriser);
  // False: there is nobody.
  bool FindBox(const AvatarInput& in);
  void ContinueDepth(ImageView<const float> depth_m);
  void BuildMesh();
  // His own colours, continued over the matte's soft edge, at a size that the view can show.
  void TakeOwnColors(const cv::Mat3b& foreground);
  void ContinueColors(std::uint8_t own);
  void PrepareTexture(const AvatarInput& in);
  void DrawRow(const Backdrop& backdrop, int y, AvatarPicture& out);
  void MixChroma(AvatarPicture& out) const;

  PinholeCamera color_, view_;
  Lens lens_;
  cv::Mat2f half_rays_;  // [Half(h) x Half(w)] of the actor's camera, (x/z, y/z)
  cv::Mat2f view_rays_;  // [h x w] of the view
  std::unique_ptr<Rasteriser> rasteriser_;
  // Of the frame.
  cv::Rect box_;               // of the actor in his own picture, even, px
  cv::Mat1f depth_, scratch_;  // [Half] inside box_: continued beyond his outline
  cv::Mat1i vertex_;
  std::vector<Eigen::Vector3f> positions_;  // his camera's frame
  std::vector<std::uint32_t> indices_;
  int halvings_ = 0;               // of the texture
  cv::Mat4f sums_;                 // [Half(box_)]
  cv::Mat1b alpha_, y_, cb_, cr_;  // [box_, halved]
  Eigen::Matrix3f R_color_view_ = Eigen::Matrix3f::Identity();
  Eigen::Vector3f t_color_view_ = Eigen::Vector3f::Zero();
  const VisibilityBuffer* visible_ = nullptr;
  cv::Rect drawn_;                            // of the view: where he may be
  std::vector<float> texture_s_, texture_t_;  // [w] of a row: where in the texture
  cv::Mat1b seen_cb_, seen_cr_;               // [h x w] inside drawn_: chroma of what the picture shows there
};

}  // namespace mixstage
