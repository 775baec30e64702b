// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "proto/geometry/rig.h"
#include "proto/take/take.h"
#include "server/composite/z_key.h"
#include "server/depth/depth_motion.h"
#include "server/depth/depth_warp.h"
#include "server/environment/environment_folder.h"
#include "server/physics/actor_collider.h"
#include "server/physics/physics.h"
#include "server/physics/reactions.h"
#include "server/pipeline/avatar_stage.h"
#include "server/pipeline/frame.h"
#include "server/pipeline/room_learner.h"
#include "server/pipeline/stage_times.h"
#include "server/raster/render_device.h"
#include "server/render/cg_renderer.h"
#include "server/render/light_map.h"
#include "server/render/reflections.h"
#include "server/render/room_radiance.h"
#include "server/render/room_view.h"
#include "server/scene/animations.h"
#include "server/scene/edit_change.h"
#include "server/scene/scene.h"
#include "server/segmentation/actor_surface.h"
#include "server/segmentation/camera_nudge.h"
#include "server/segmentation/clock_offset.h"
#include "server/segmentation/key.h"
#include "server/segmentation/left_behind.h"
#include "server/segmentation/predicted_background.h"
#include "server/segmentation/refined_background.h"
#include "server/segmentation/room_regions.h"

namespace mixstage {

// A scanned room to key against (MixIn3D 2.3): nothing has to be learnt any more.
struct ScannedRoom {
  RoomModel model;  // valid (checked)
  PredictionDoubt doubt{};
  // What objects fall on: the surface as the scan left it, and its planes. May be empty: then the floor
  // alone.
  std::vector<Eigen::Vector3f> surface_positions{};
  std::vector<std::uint32_t> surface_indices{};
  std::vector<RoomPlane> planes{};
  std::vector<RoomLamp> lamps{};
};

// What Scene::avatar names, opened: at most one of them; none = the show's own room.
struct AvatarSetup {
  std::optional<ScannedRoom> room{};
  std::optional<AvatarVideo> video{};
  std::optional<std::int64_t>
      start_us{};  // of the show, CapturedFrame::capture_us; nothing = its first frame
};

struct StudioSetup {
  Rig rig;
  std::optional<Scene> scene;
  AvatarSetup avatar{};           // with a scene that has one
  std::vector<PoseSample> poses;  // --poses: T_world_color by the take's time; empty = none
  RoomRegions regions{};          // garbage and hold-out
  std::optional<ScannedRoom> scanned{};
  int learn_frames = 30;  // L of piVE eq (1)
  RenderDevice device;    // what depth, room and CG are drawn with
};

// What the frame stages share from one frame to the next: each stage's own worker with its buffers. Owned by
// the thread that runs the frame stages (`frame` live; the only one in `process`); made on another and handed
// over, as a GPU's context is entered and left within a stage.
class Studio {
 public:
  // Fails (kInvalidConfig, kBadInput) when rig and scene do not go together; says what to change.
  static Result<Studio> Create(StudioSetup setup);

  // Runs every frame stage, in the order of the table in frame_stages.cc.
  void Run(Frame& frame, StageTimes& times);

  // Fixes the empty set for good; without it the studio learns it from the frames it sees. Not with a scanned
  // room.
  void SetRoom(std::shared_ptr<const BackgroundModel> room, RoomState state);
  // The scene from the next frame on; of the frame (world, camera) of the one before, and only where there
  // was one (checked).
  void SetScene(std::shared_ptr<const Scene> scene);
  // With a scanned room: adds what this frame says about the sensors' noise; so do the first frames of Run.
  void LearnNoise(const CapturedFrame& captured);
  // With a scanned room: adds what this frame shows of it where the camera stands; so does Run, now and then.
  // False where the camera moved since the frame before: nothing was added.
  bool LearnStanding(const CapturedFrame& captured);
  // What is known about the empty set now; null while it is being learnt.
  [[nodiscard]] const std::shared_ptr<const BackgroundModel>& room() const { return room_; }
  // The same while the camera stands; null where every frame has its own.
  [[nodiscard]] std::shared_ptr<const BackgroundModel> standing_room() const;
  // The scanned room in the last frame's view; null without one.
  [[nodiscard]] RoomView* room_view() { return room_view_ ? &*room_view_ : nullptr; }
  // Null = no CG.
  [[nodiscard]] const std::shared_ptr<const Scene>& scene() const { return scene_; }
  // Objects that physics has moved since the last call, where they are now.
  [[nodiscard]] std::vector<MovedObject> TakeMoved();
  // The next second looks for a thing left behind at this pixel (LeftBehind); what comes of it is there once.
  // It is the room's when a scene lists it.
  void LookForThing(double u, double v) { left_behind_.Look(u, v); }
  [[nodiscard]] std::optional<Result<std::shared_ptr<const AdoptedThing>>> TakeThing() {
    return std::exchange(thing_, std::nullopt);
  }
  // What a scene without lights is drawn by.
  [[nodiscard]] DefaultLight DefaultLights() const;
  // D of a captured frame: for learning from a clean plate. Empty when the frame has no usable depth.
  cv::Mat1f WarpDepth(const CapturedFrame& captured);

  [[nodiscard]] const Rig& rig() const { return rig_; }
  // The camera of the composite: the rig's colour camera, or the target's that an avatar is seen by.
  [[nodiscard]] const PinholeCamera& view() const { return avatar_ ? avatar_->view() : rig_.color; }
  // What stands in that camera's view, for edits; null: not known.
  [[nodiscard]] const std::shared_ptr<const BackgroundModel>& view_room() const {
    return avatar_ ? avatar_->room() : room_;
  }
  // Where a frame's view is in the scene's frame; without a scene that is the world.
  [[nodiscard]] RigidTransform TSceneColor(const Frame& frame) const;
  // The back end in force, for people; any thread.
  [[nodiscard]] const std::string& renderer() const { return renderer_name_; }
  [[nodiscard]] RoomState room_state() const { return room_state_; }
  // By how much depth's clock differs from colour's, as the show tells; nothing until enough has moved.
  [[nodiscard]] const std::optional<ClockOffset::Estimate>& depth_clock() const {
    return clock_offset_.estimate();
  }
  // What is added to depth's times because of it.
  [[nodiscard]] std::int64_t depth_clock_applied_us() const { return depth_clock_us_; }
  // By how much, in pixels, a camera that should stand was nudged since the last call; 0 = it was not. The
  // learnt room was moved along.
  [[nodiscard]] double TakeNudge_px() { return std::exchange(nudge_px_, 0.0); }
  // Depth pictures that could not be warped (their size is not the rig's).
  [[nodiscard]] std::int64_t unusable_depths() const { return unusable_depths_; }

 private:
  friend struct FrameStages;
  explicit Studio(StudioSetup setup);
  void UseRoom(std::shared_ptr<const BackgroundModel> room, RoomState state);
  void LayThings();
  [[nodiscard]] const RoomPrediction& WithThings(const RoomPrediction& prediction,
                                                 const RigidTransform& T_world_color);
  [[nodiscard]] RigidTransform PoseOf(const CapturedFrame& captured);
  // Reflectors of posed_ that name a surface of the scanned room get its plane and polygon.
  Status PlaceReflectors();
  // elsewhere: AvatarSetup::room, or null.
  Status OpenAvatar(AvatarSetup setup, const ScannedRoom* elsewhere);
  // When its depth was measured, by the clock of colour and never after it; it must have one.
  [[nodiscard]] std::int64_t DepthTime(const CapturedFrame& captured) const;
  void JudgeClock(const Frame& frame);
  void JudgeNudge();
  void PredictRoom(const RoomPrediction& prediction, const RigidTransform& T_world_color);
  void UseDepth(const RoomPrediction& prediction);
  void StartPhysics(const RigidTransform& T_scene_color, const RigidTransform& T_scene_world);
  void ShowRoomToPhysics(const RigidTransform& T_scene_color, const RigidTransform& T_scene_world);
  [[nodiscard]] std::shared_ptr<BackgroundModel> UnusedModel();
  [[nodiscard]] const RoomRadiance* RoomRadianceOrNull() const {
    return room_radiance_ ? &*room_radiance_ : nullptr;
  }

  Rig rig_;
  std::shared_ptr<const Scene> scene_;  // null = no CG
  std::vector<PoseSample> poses_;
  RenderDevice device_;
  std::string renderer_name_;

  // pose
  std::optional<HeadAngles> held_angles_;
  // warp_depth: depth comes at less than half the rate of colour, D is kept while its picture is the newest
  std::optional<DepthWarp> depth_warp_;
  std::shared_ptr<const DepthPicture> warped_;
  cv::Mat1f D_;
  std::int64_t unusable_depths_ = 0;
  // move_depth
  DepthMotion depth_motion_;
  cv::Mat1f moved_D_;
  // predict_room: D_M and colour of a scanned room; the models are used again when nobody holds them any more
  std::optional<RoomView> room_view_;
  PredictionDoubt doubt_;
  PredictionNoise noise_;
  std::vector<std::shared_ptr<BackgroundModel>> models_;
  std::uint64_t predicted_ = 0;  // drawing that room_ was made from
  int predicted_frames_ = 0;     // of noise_ at that time
  int standing_frames_ = 0;      // since the room was predicted anew
  RefinedBackground refined_;
  int refine_at_ = 0;  // samples of refined_ from which room_ is made anew
  std::int64_t refine_due_us_ = 0;
  RoomPrediction prediction_with_things_;
  cv::Mat2f rays_;  // of the colour camera, once something was adopted
  // learn_room, key_actor, actor_surface
  HalfPicture half_;
  std::optional<RoomLearner> learner_;
  std::shared_ptr<const DepthPicture> learnt_depth_;
  std::shared_ptr<const BackgroundModel> learnt_room_;  // without what was adopted; null with a scanned room
  std::shared_ptr<const BackgroundModel> room_;
  RoomState room_state_ = RoomState::kLearning;
  std::optional<RoomDepth> room_depth_;
  std::uint64_t room_revision_ = 0;
  std::optional<RegionMask> regions_;
  std::optional<Key> key_;
  std::optional<ActorSurface> actor_surface_;
  LeftBehind left_behind_;
  std::shared_ptr<const DepthPicture> looked_at_;
  std::optional<Result<std::shared_ptr<const AdoptedThing>>> thing_;
  CameraNudge camera_nudge_;
  double nudge_px_ = 0;
  ClockOffset clock_offset_;
  RigidTransform clock_pose_ = RigidTransform::Identity();
  std::int64_t depth_clock_us_ = 0;
  // place_avatar: empty = the actor stays where he is
  std::optional<AvatarStage> avatar_;
  std::optional<std::int64_t> start_us_;
  // step_physics: null until something falls, where there is no scanned world
  std::unique_ptr<Physics> physics_;
  std::unique_ptr<ActorCollider> actor_collider_;
  Scene posed_;  // scene_, its objects where physics and animations have them
  Reactions reactions_;
  Animations animations_;
  bool room_is_new_ = true;  // physics has not heard of it yet
  bool moved_ = false;
  std::vector<Eigen::Vector3f> surface_positions_;
  std::vector<std::uint32_t> surface_indices_;
  std::vector<RoomPlane> planes_;
  // render_scene, z_key
  std::shared_ptr<PreparedMeshes> meshes_ = std::make_shared<PreparedMeshes>();
  std::optional<CgRenderer> renderer_;
  std::optional<RoomRadiance> room_radiance_;  // of the scanned room
  Illumination illumination_;
  ZKey z_key_;
  // light_map
  std::optional<LightMapper> light_mapper_;
  CgLayer lit_layer_;
  YuvImage lit_color_;
  // reflect: null without reflectors, which no edit adds or takes
  std::unique_ptr<Reflections> reflections_;
  std::vector<SceneObject> patches_;
  Scene drawn_;  // posed_ and the patches; unused without patches
  CgLayer reflecting_layer_;
  std::uint64_t reflected_layer_ = 0, reflected_ = 0;  // that reflecting_layer_ was made of
};

}  // namespace mixstage
