// SPDX-License-Identifier: Apache-2.0
//
// What the scene's reflectors mirror (MixIn3D 3.3; algorithms 10). Behind a real surface the camera shows the
// room's and the actor's reflection already, so only what virtual objects change is added:
//   F a_m (C_m - L)
// F Fresnel's share, C_m the mirrored object, a_m its coverage, L what was mirrored there before. A patch has
// nothing of its own in the picture: it gets F times all of it, CG over actor over room. The actor's unseen
// back is closed as for his shadow (shadow_shapes) and shows what his front shows before it.
// One bounce: in a mirror other patches are matt. Half size, as mirrored pictures are blurred and weak.
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "proto/base/image_view.h"
#include "proto/codec/yuv_image.h"
#include "server/render/cg_renderer.h"
#include "server/render/light_map.h"
#include "server/render/mirror.h"
#include "server/render/mirrored_room.h"
#include "server/render/shadow_shapes.h"

namespace mixstage {

// One reflector in the colour camera's picture. Linear light, R G B, times Fresnel's share.
struct MirrorPicture {
  cv::Rect window;    // of the half-size picture: pixel (x, y) covers 2x2 from (2 x, 2 y) on
  cv::Mat3f added;    // [window] by virtual objects; may be negative
  cv::Mat3f before;   // [window] what is mirrored without them
  cv::Rect changed;   // of the window: added is zero outside
  cv::Mat1b surface;  // [2 window, at most the picture] 255 where the room's own surface mirrors; empty: a
                      // patch
  std::uint8_t patch = 0;  // CgLayer::object_id of the patch; 0: a surface of the room
};

struct ReflectionPictures {
  std::vector<MirrorPicture> mirrors;  // those in view
  std::uint64_t revision = 0;          // rises whenever one of them changes
};

struct ReflectionInput {
  const Scene* scene = nullptr;  // with its patches (PatchObjects) after the first_patch objects
  std::size_t first_patch = 0;
  RigidTransform T_scene_color = RigidTransform::Identity();
  const Illumination* light = nullptr;
  const CgLayer* cg = nullptr;  // drawn of scene from there by light
  const LightMap* light_map = nullptr;
  std::uint64_t room_revision = 0;         // differs between any two rooms; 0 = its depth is not known
  cv::Mat1f room_depth_m, room_sigma_m;    // [h x w] z, 0 = not known; its noise
  const YuvImage* color = nullptr;         // the camera's picture
  ImageView<const float> actor_depth_m{};  // [Half(h) x Half(w)] z of the actor, 0 = not he; may be empty
};

// One thread at a time.
class Reflections {
 public:
  // meshes: those of the scene's own renderer.
  Reflections(const PinholeCamera& color, const RenderDevice& device, std::shared_ptr<PreparedMeshes> meshes);

  // The room of a world scene; world frame. room is valid (checked); sigma_m its noise.
  void SetRoom(const RoomModel& room, float sigma_m);

  // Nothing is drawn while nothing changes. Valid until the next call. A mirror that the device cannot draw
  // is left out, and said once.
  const ReflectionPictures& Run(const ReflectionInput& in);

 private:
  struct Mirror {
    Reflector reflector;
    std::optional<CgRenderer> renderer;
    std::optional<MirrorView> view;  // nothing: not in view
    cv::Rect window;                 // of the colour camera's half-size picture
    cv::Rect mirrored_window;        // the same pixels of the mirrored camera's
    // [window] Fresnel's share, 0 where the plane is not; cosine to its normal; z of it.
    cv::Mat1f fresnel, cosine, plane_m;
    cv::Mat3f room;         // [window] what is mirrored of the room, sharp
    cv::Mat1f room_m;       // its z, 0 = far away
    cv::Mat3f spread_room;  // as the surface's roughness spreads it
    std::uint64_t drawing = 0, factors = 0;
    bool with_actor = false;
    MirrorPicture picture;
  };

  void Rebuild(const std::vector<Reflector>& reflectors);
  void Place(Mirror& mirror, const ReflectionInput& in);
  // Full-size pixels of the mirror's window where the room's surface is the plane.
  void FindSurface(Mirror& mirror, const ReflectionInput& in) const;
  [[nodiscard]] cv::Rect SeenPart(const Reflector& reflector, const ReflectionInput& in) const;
  void DrawRoom(Mirror& mirror, const ReflectionInput& in);
  [[nodiscard]] Eigen::AlignedBox3d BoxOfTheActor(const ReflectionInput& in) const;
  // Whether any of the box may be seen in those pixels of the mirrored camera.
  [[nodiscard]] bool MaySee(const Mirror& mirror, const Eigen::AlignedBox3d& box,
                            const cv::Rect& pixels) const;
  // False: nobody is there.
  bool ShapeTheActor(const ReflectionInput& in);
  void DrawActor(const Mirror& mirror, const ReflectionInput& in, cv::Mat3f& radiance, cv::Mat1f& depth_m);
  void Compose(Mirror& mirror, const ReflectionInput& in, const CgLayer& layer, bool with_actor);
  [[nodiscard]] cv::Mat1f Away(const Mirror& mirror, const cv::Mat1f& depth_m) const;
  void SpreadBy(const Mirror& mirror, const cv::Rect& part, const cv::Mat1f& away, bool goes_on,
                cv::Mat3f& picture) const;

  PinholeCamera color_, mirrored_;
  RenderDevice device_;
  std::shared_ptr<PreparedMeshes> meshes_;
  cv::Mat2f rays_;           // [h x w] (x/z, y/z) of the pixel centres
  cv::Mat2f even_rays_;      // [Half(h) x Half(w)] of its even pixels
  cv::Mat2f half_rays_;      // [same] of the middles of 2x2 pixels
  cv::Mat2f mirrored_rays_;  // [same] the mirrored camera's
  std::optional<MirroredRoom> room_;
  std::unique_ptr<Rasteriser> actor_rasteriser_;
  ActorShape actor_{3};
  const ShadowShape* actor_shape_ = nullptr;
  std::vector<std::unique_ptr<Mirror>> mirrors_;
  RigidTransform T_scene_color_ = RigidTransform::Identity();
  std::uint64_t room_revision_ = 0;
  AmbientLight ambient_;
  bool placed_ = false, reported_ = false;
  ReflectionPictures pictures_;
};

}  // namespace mixstage
