// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>

#include "proto/base/image_view.h"
#include "proto/base/result.h"
#include "proto/geometry/rig.h"
#include "server/raster/render_device.h"

namespace mixstage {

struct DepthWarpConfig {
  double max_depth_m = 20;  // what is measured farther is unknown
  double near_m = 0.1;      // nothing nearer to the colour camera is drawn
  // A step of the surface is an edge from this many standard deviations of the sensor's own noise, which is
  // measured in every picture.
  double edge_sigmas = 4.5;
};

// The depth picture in the colour camera's view, MixIn3D 2.2: the depth grid as a mesh, drawn with a z-buffer
// into the distorted colour picture. Where the paper's mesh hangs rubber sheets between actor and wall, this
// one is torn; where its parallax fails (the strip beside a silhouette that the depth camera does not see,
// the half cell around it where the silhouette may run), depth is unknown instead of the background's.
//
// Where the rig says that depth is registered, counts only become metres; a depth picture of another size but
// the same shape is sampled at the nearest pixel.
//
// A picture's result depends on that picture alone. One owner; any thread. Allocates in Create and, until the
// most torn picture was seen, in Run.
class DepthWarp {
 public:
  // Fails (kInvalidConfig, the field named): no depth camera in the rig, a camera that is not valid, a depth
  // camera so coarse that its pixels are more than 40 colour pixels wide, numbers of the config out of range.
  // device: what the mesh is drawn with (a registered picture needs no drawing); the pictures are the same.
  static Result<DepthWarp> Create(const Rig& rig, const DepthWarpConfig& config,
                                  const RenderDevice& device = {});
  DepthWarp(DepthWarp&&) noexcept;
  DepthWarp& operator=(DepthWarp&&) noexcept;
  ~DepthWarp();

  // raw        [depth h x w]  counts of the depth sensor; 0 = no measurement
  // amplitude  [depth h x w]  returned light, or empty: tells the noise of each pixel; 0 = nothing came back
  // depth_m    [color h x w]  out: z along the colour camera's axis, metres; 0 = unknown
  // Fails (kBadInput, both sizes said) when a picture's size is not the rig's; depth_m is then not touched.
  Status Run(ImageView<const std::uint16_t> raw, ImageView<const std::uint16_t> amplitude,
             ImageView<float> depth_m);

 private:
  class Way;
  class MeshWay;
  class RegisteredWay;
  explicit DepthWarp(std::unique_ptr<Way> way);
  std::unique_ptr<Way> way_;
};

}  // namespace mixstage
