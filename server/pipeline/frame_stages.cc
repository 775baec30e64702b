// SPDX-License-Identifier: Apache-2.0
//
// One frame, top to bottom; each stage reads what stages above it wrote. The name is also the name in
// reports, metrics and on the page.
#include "server/pipeline/frame_stages.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "proto/base/check.h"
#include "proto/base/log.h"
#include "server/composite/lay_reflections.h"
#include "server/composite/relight.h"
#include "server/segmentation/room_mesh.h"

namespace mixstage {

// The stages that the frame thread runs. Static members of a friend: the studio's workers are theirs and
// nobody else's.
struct FrameStages {
  static void PlaceCamera(Studio& s, Frame& f);
  static void WarpDepth(Studio& s, Frame& f);
  static void MoveDepth(Studio& s, Frame& f);
  static void PredictRoom(Studio& s, Frame& f);
  static void LearnRoom(Studio& s, Frame& f);
  static void KeyActor(Studio& s, Frame& f);
  static void ShapeActor(Studio& s, Frame& f);
  static void PlaceAvatar(Studio& s, Frame& f);
  static void StepPhysics(Studio& s, Frame& f);
  static void RenderScene(Studio& s, Frame& f);
  static void ShadeLightMap(Studio& s, Frame& f);
  static void Reflect(Studio& s, Frame& f);
  static void CompositeZ(Studio& s, Frame& f);
};

namespace {

struct Stage {
  StageInfo info;
  void (*run)(Studio&, Frame&);  // null: another thread's own loop runs it
};

constexpr std::array kStages = {
    Stage{{"decode", 2.0, "ingest", "JPEG to planes, pairing    MixIn3D 3.1"}, nullptr},
    Stage{{"place_camera", 0.5, "frame", "T_world_color              MixIn3D 2.3, 2.5"},
          &FrameStages::PlaceCamera},
    Stage{{"warp_depth", 1.0, "frame", "D in the colour camera     MixIn3D 2.2"}, &FrameStages::WarpDepth},
    Stage{{"predict_room", 0.5, "frame", "D_M and colour of the scan  MixIn3D 2.3"},
          &FrameStages::PredictRoom},
    Stage{{"move_depth", 1.5, "frame", "D at the picture's instant  MixIn3D 3.1"}, &FrameStages::MoveDepth},
    Stage{{"learn_room", 0.5, "frame", "D_M, I_m, I_sigma          piVE eq 1-2"}, &FrameStages::LearnRoom},
    Stage{{"key_actor", 3.0, "frame", "actor, shadow              MixIn3D eq 1, piVE eq 3-8"},
          &FrameStages::KeyActor},
    Stage{{"actor_surface", 2.0, "frame", "the actor's depth          MixIn3D 2.4"},
          &FrameStages::ShapeActor},
    Stage{{"place_avatar", 6.0, "frame", "the actor elsewhere        piVE 5"}, &FrameStages::PlaceAvatar},
    Stage{{"step_physics", 1.0, "frame", "T_scene_object             MixIn3D 3.1, piVE 4"},
          &FrameStages::StepPhysics},
    Stage{{"render_scene", 8.0, "frame", "virtual colour, depth      piVE 4"}, &FrameStages::RenderScene},
    Stage{{"light_map", 6.0, "frame", "shadows, s in 0..1         MixIn3D 3.2"}, &FrameStages::ShadeLightMap},
    Stage{{"reflect", 3.0, "frame", "mirrored CG, room, actor   MixIn3D 3.3"}, &FrameStages::Reflect},
    Stage{{"z_key", 6.0, "frame", "composed colour, depth     MixIn3D 3.1, piVE 5"},
          &FrameStages::CompositeZ},
    Stage{{"encode_color", 4.0, "encode", "H.264"}, nullptr},
    Stage{{"encode_depth", 5.0, "encode", "H.264 High 10, inverse depth"}, nullptr},
    Stage{{"actor_mesh", 2.0, "mesh", "the actor's surface        piVE 3"}, nullptr},
    Stage{{"encode_mesh", 6.0, "mesh", "Draco, JPEG"}, nullptr},
};

constexpr auto kInfos = [] {
  std::array<StageInfo, kStages.size()> infos;
  for (std::size_t i = 0; i < infos.size(); ++i) infos[i] = kStages[i].info;
  return infos;
}();

// A head at rest does not move because its encoder trembles: CG that swims by a tenth of a pixel is seen.
constexpr double kRestDeg = 0.03;
// A room that was predicted anew is one to show to others when the camera has stood for so many frames.
constexpr int kStandingFrames = 15;
// Between the clocks of depth and colour: a walking actor moves by 3 mm.
constexpr double kClockIsGood_s = 0.002;
// A camera that stands looks at the room so often to see it more sharply than the scan did.
constexpr std::int64_t kRefineUs = 400'000;

}  // namespace

std::span<const StageInfo> AllStages() { return kInfos; }

Studio::Studio(StudioSetup setup)
    : rig_(std::move(setup.rig)),
      poses_(std::move(setup.poses)),
      device_(std::move(setup.device)),
      renderer_name_(device_.Name()) {
  if (setup.scene) {
    scene_ = std::make_shared<const Scene>(std::move(*setup.scene));
    posed_ = *scene_;
    reactions_.SetScene(*scene_, posed_);
  }
}

RigidTransform Studio::TSceneColor(const Frame& frame) const {
  return scene_ && scene_->frame == SceneFrame::kCamera ? RigidTransform::Identity() : frame.T_world_view;
}

Result<Studio> Studio::Create(StudioSetup setup) {
  const int learn_frames = setup.learn_frames;
  AvatarSetup avatar_setup = std::move(setup.avatar);
  RoomRegions regions = std::move(setup.regions);
  std::optional<ScannedRoom> scanned = std::move(setup.scanned);
  Studio studio(std::move(setup));
  const Rig& rig = studio.rig_;
  if (auto ok = rig.color.Validate(); !ok) return Within("rig: cameras.color", ok.error());
  if (rig.depth) {
    auto warp = DepthWarp::Create(rig, {}, studio.device_);
    if (!warp) return Within("rig", warp.error());
    studio.depth_warp_.emplace(std::move(*warp));
  }
  const bool avatar = studio.scene_ && studio.scene_->avatar;  // then the target's camera has a pose
  if (studio.scene_ && studio.scene_->frame == SceneFrame::kWorld && studio.poses_.empty() && !rig.ptu &&
      !avatar) {
    return Fail(ErrorCode::kInvalidConfig,
                "the scene is in the world's frame, but nothing says where the camera is: give a rig with "
                "\"ptu\", or "
                "--poses, or write the scene with frame: camera");
  }
  if (scanned) {
    if (studio.poses_.empty() && !rig.ptu) {
      return Fail(
          ErrorCode::kInvalidConfig,
          "the environment is in the world's frame, but nothing says where the camera is: its rig has no "
          "\"ptu\"; give --poses");
    }
    if (studio.scene_) studio.room_radiance_.emplace(scanned->model, scanned->lamps);
    auto view = RoomView::Create(rig, scanned->model, studio.device_);
    if (!view) return tl::unexpected(view.error());
    studio.room_view_.emplace(std::move(*view));
    studio.doubt_ = scanned->doubt;
    studio.surface_positions_ = std::move(scanned->surface_positions);
    studio.surface_indices_ = std::move(scanned->surface_indices);
    studio.planes_ = std::move(scanned->planes);
    studio.room_state_ = RoomState::kKnown;
  }
  if (!studio.room_view_) {
    auto learner = RoomLearner::Create(learn_frames, rig.color.width, rig.color.height);
    if (!learner) return tl::unexpected(learner.error());
    studio.learner_.emplace(std::move(*learner));
  }
  if (!regions.regions.empty()) {
    if (regions.frame == RegionFrame::kWorld && studio.poses_.empty() && !rig.ptu) {
      return Fail(
          ErrorCode::kInvalidConfig,
          "the regions are in the world's frame, but nothing says where the camera is: give a rig with "
          "\"ptu\", or --poses, or write them with frame: camera");
    }
    studio.regions_.emplace(rig.color, std::move(regions));
  }
  auto key = Key::Create({});
  if (!key) return tl::unexpected(key.error());
  studio.key_.emplace(std::move(*key));
  auto surface = ActorSurface::Create({});
  if (!surface) return tl::unexpected(surface.error());
  studio.actor_surface_.emplace(std::move(*surface));
  const RoomModel* room = scanned ? &scanned->model : nullptr;  // that casts shadows
  std::optional<ScannedRoom> elsewhere = std::move(avatar_setup.room);
  if (avatar) {
    if (elsewhere || avatar_setup.video) {
      room = elsewhere ? &elsewhere->model : nullptr;
      studio.room_radiance_.reset();
      if (elsewhere) studio.room_radiance_.emplace(elsewhere->model, elsewhere->lamps);
    }
    if (auto ok = studio.OpenAvatar(std::move(avatar_setup), elsewhere ? &*elsewhere : nullptr); !ok)
      return tl::unexpected(ok.error());
  }
  if (auto ok = studio.PlaceReflectors(); !ok) return tl::unexpected(ok.error());
  if (studio.scene_) {
    auto renderer = CgRenderer::Create({}, studio.view(), studio.device_, studio.meshes_);
    if (!renderer) return tl::unexpected(renderer.error());
    studio.renderer_.emplace(std::move(*renderer));
    studio.light_mapper_.emplace(studio.view());
    if (!studio.scene_->reflectors.empty()) {
      studio.patches_ = PatchObjects(*studio.scene_);
      studio.reflections_ = std::make_unique<Reflections>(studio.view(), studio.device_, studio.meshes_);
      if (room != nullptr)
        studio.reflections_->SetRoom(
            *room, elsewhere ? elsewhere->doubt.depth_sigma_m : studio.doubt_.depth_sigma_m);
    }
    if (room != nullptr && studio.scene_->frame == SceneFrame::kWorld) studio.light_mapper_->SetRoom(*room);
    studio.illumination_ = IlluminationOf(*studio.scene_, studio.RoomRadianceOrNull());
    // A scanned room is known now: its surface is prepared before the show, not at the first drop.
    if ((studio.room_view_ || avatar) && studio.scene_->frame == SceneFrame::kWorld) {
      studio.StartPhysics(RigidTransform::Identity(), RigidTransform::Identity());
    }
  }
  return studio;
}

Status Studio::PlaceReflectors() {
  for (Reflector& reflector : posed_.reflectors) {
    if (reflector.surface.empty()) continue;
    const auto plane = std::ranges::find(planes_, reflector.surface, &RoomPlane::name);
    if (plane == planes_.end()) {
      std::string names;
      for (const RoomPlane& known : planes_) names += (names.empty() ? "" : ", ") + known.name;
      return Fail(ErrorCode::kInvalidConfig, "scene: reflector " + reflector.name + ": surface: \"" +
                                                 reflector.surface +
                                                 "\" is no plane of the scanned room, which has " +
                                                 (names.empty() ? "none: give --environment" : names));
    }
    reflector.plane << plane->normal, plane->d;
    reflector.polygon = plane->polygon;
  }
  return {};
}

DefaultLight Studio::DefaultLights() const {
  const SceneFrame frame = scene_ ? scene_->frame : SceneFrame::kWorld;
  if (frame == SceneFrame::kWorld && room_radiance_ && !room_radiance_->lamps().empty())
    return {room_radiance_->lamps(), std::nullopt};
  UsualLight usual = UsualLightOf(frame);
  usual.key.id = 1;
  return {{std::move(usual.key)}, usual.ambient};
}

Status Studio::OpenAvatar(AvatarSetup setup, const ScannedRoom* elsewhere) {
  const Avatar& avatar = *scene_->avatar;
  MIX_CHECK(avatar.room.empty() == (elsewhere == nullptr) && avatar.video.empty() == !setup.video);
  const AvatarHome home{&rig_, room_view_ ? &*room_view_ : nullptr, doubt_.depth_sigma_m,
                        !poses_.empty() || rig_.ptu.has_value(), device_};
  std::unique_ptr<AvatarTarget> target;
  PinholeCamera view = rig_.color;
  if (elsewhere != nullptr || setup.video) {
    // The scene's world is the target's: its surface is what objects fall on.
    surface_positions_.clear();
    surface_indices_.clear();
    planes_.clear();
  }
  if (elsewhere != nullptr) {
    Rig lens = rig_;
    std::optional<RigidTransform> pose;
    if (avatar.camera) {
      auto given = TTargetView(*avatar.camera);
      if (!given) return Within("avatar.camera.look_at", given.error());
      pose = *given;
      lens.color = LensOf(*avatar.camera, rig_.color);
    }
    auto room = RoomView::Create(lens, elsewhere->model, device_);
    if (!room) return Within("avatar.room", room.error());
    target = std::make_unique<RoomTarget>(std::move(*room), elsewhere->doubt.depth_sigma_m, pose);
    view = lens.color;
    surface_positions_ = elsewhere->surface_positions;
    surface_indices_ = elsewhere->surface_indices;
    planes_ = elsewhere->planes;
  } else if (setup.video) {
    view = setup.video->rig.color;
    auto video = VideoTarget::Create(std::move(*setup.video), device_);
    if (!video) return Within("avatar.video", video.error());
    target = std::move(*video);
  }
  auto stage = AvatarStage::Create(avatar, home, std::move(target), view);
  if (!stage) return tl::unexpected(stage.error());
  avatar_.emplace(std::move(*stage));
  start_us_ = setup.start_us;
  return {};
}

void Studio::Run(Frame& frame, StageTimes& times) {
  for (const Stage& stage : kStages) {
    if (stage.run == nullptr) continue;
    const StageTimer timer(times, stage.info.name);
    stage.run(*this, frame);
  }
}

void Studio::SetRoom(std::shared_ptr<const BackgroundModel> room, RoomState state) {
  MIX_CHECK(!room_view_);
  UseRoom(std::move(room), state);
  learner_.reset();
}

void Studio::UseRoom(std::shared_ptr<const BackgroundModel> room, RoomState state) {
  learnt_room_ = std::move(room);
  room_state_ = state;
  LayThings();
}

// The learnt room with what was adopted into it since.
void Studio::LayThings() {
  room_ = learnt_room_;
  if (scene_ && !scene_->adopted.empty()) {
    auto model = std::make_shared<BackgroundModel>(*learnt_room_);
    for (const auto& thing : scene_->adopted) LayThing(*thing, model.get());
    room_ = std::move(model);
  }
  room_is_new_ = true;
  room_depth_.reset();
  if (!room_->has_depth()) return;
  RoomDepth depth;
  depth.revision = ++room_revision_;
  // Quarter-size pixels are samples at the centres of 4x4 blocks. Nearest: between a near and a far surface
  // there is nothing, and an interpolated depth would stand in the air there.
  const cv::Size size(rig_.color.width, rig_.color.height);
  const cv::Size blocks(4 * room_->room_depth_m.cols, 4 * room_->room_depth_m.rows);
  cv::Mat1f full;
  cv::resize(room_->room_depth_m, full, blocks, 0, 0, cv::INTER_NEAREST);
  depth.depth_m = full(cv::Rect({0, 0}, size)).clone();
  cv::resize(room_->sigma_m, full, blocks, 0, 0, cv::INTER_NEAREST);
  depth.sigma_m = full(cv::Rect({0, 0}, size)).clone();
  room_depth_ = std::move(depth);
}

void Studio::SetScene(std::shared_ptr<const Scene> scene) {
  MIX_CHECK(scene != nullptr && scene_ != nullptr && scene->frame == scene_->frame);
  MIX_CHECK(scene->avatar.has_value() == scene_->avatar.has_value());
  const bool same_things = scene->adopted == scene_->adopted;
  scene_ = std::move(scene);
  if (!same_things && room_view_) predicted_ = 0;
  if (!same_things && learnt_room_) LayThings();
  posed_ = *scene_;
  MIX_CHECK(PlaceReflectors().has_value());  // no edit changes them
  reactions_.SetScene(*scene_, posed_);
  if (physics_) physics_->SetScene(*scene_);
  illumination_ = IlluminationOf(posed_, RoomRadianceOrNull());
}

std::vector<MovedObject> Studio::TakeMoved() {
  std::vector<MovedObject> moved;
  if (!std::exchange(moved_, false)) return moved;
  for (std::size_t i = 0; i < posed_.objects.size(); ++i) {
    const SceneObject& object = posed_.objects[i];
    if (object.T_scene_object.matrix() != scene_->objects[i].T_scene_object.matrix())
      moved.push_back({object.id, object.put, object.T_scene_object});
  }
  return moved;
}

void Studio::StartPhysics(const RigidTransform& T_scene_color, const RigidTransform& T_scene_world) {
  physics_ = std::make_unique<Physics>(scene_->frame);
  actor_collider_ = std::make_unique<ActorCollider>(view());
  ShowRoomToPhysics(T_scene_color, T_scene_world);
  physics_->SetScene(*scene_);
}

// A scan is the room; without one what the empty set's depth shows from here.
void Studio::ShowRoomToPhysics(const RigidTransform& T_scene_color, const RigidTransform& T_scene_world) {
  room_is_new_ = false;
  if (!room_view_ && !avatar_) {
    if (!room_ || !room_->has_depth()) return physics_->SetRoom({}, {});
    const PictureMesh mesh = MakeRoomMesh(*room_, rig_.color, T_scene_color, {.max_triangles = 8'000});
    // The floor is better known than a depth camera measures it.
    std::vector<float> sigmas;
    for (const float sigma : room_->sigma_m) {
      if (sigma > 0) sigmas.push_back(sigma);
    }
    std::ranges::sort(sigmas);
    const double sigma_m = sigmas.empty() ? 0 : static_cast<double>(sigmas[sigmas.size() / 2]);
    return physics_->SetRoom(mesh.positions, mesh.indices, {}, std::clamp(3 * sigma_m, 0.005, 0.08));
  }
  std::vector<Eigen::Vector3f> positions;
  positions.reserve(surface_positions_.size());
  for (const Eigen::Vector3f& p : surface_positions_)
    positions.push_back((T_scene_world * p.cast<double>()).cast<float>());
  std::vector<NamedPlane> planes;
  for (const RoomPlane& plane : planes_) {
    NamedPlane named{plane.name, T_scene_world.linear() * plane.normal, 0, {}};
    named.d = plane.d - named.normal.dot(T_scene_world.translation());
    for (const Eigen::Vector3d& corner : plane.polygon) named.extent.extend(T_scene_world * corner);
    planes.push_back(std::move(named));
  }
  physics_->SetRoom(positions, surface_indices_, std::move(planes));
}

cv::Mat1f Studio::WarpDepth(const CapturedFrame& captured) {
  if (!depth_warp_ || !captured.depth) return {};
  if (warped_ == captured.depth) return D_;
  warped_ = captured.depth;
  // D of the frame before may still be read: a new picture gets new memory only then.
  if (D_.u == nullptr || D_.u->refcount > 1) D_ = cv::Mat1f(rig_.color.height, rig_.color.width);
  if (!depth_warp_->Run(View(captured.depth->counts), View(captured.depth->amplitude), View(D_))) {
    ++unusable_depths_;
    D_.release();
  }
  return D_;
}

RigidTransform Studio::PoseOf(const CapturedFrame& captured) {
  // The first that exists: --poses, (tracking,) head angles with rig.ptu, identity.
  if (!poses_.empty()) {
    const auto after = std::upper_bound(poses_.begin(), poses_.end(), captured.take_t_s,
                                        [](double t, const PoseSample& p) { return t < p.t_s; });
    const auto before = after == poses_.begin() ? after : after - 1;
    const bool later_is_nearer =
        after != poses_.end() && after->t_s - captured.take_t_s < captured.take_t_s - before->t_s;
    return (later_is_nearer ? after : before)->T_world_color;
  }
  if (!rig_.ptu) return RigidTransform::Identity();
  const HeadAngles now = captured.head.value_or(held_angles_.value_or(HeadAngles{}));
  if (!held_angles_ || std::abs(now.pan_deg - held_angles_->pan_deg) > kRestDeg ||
      std::abs(now.tilt_deg - held_angles_->tilt_deg) > kRestDeg) {
    held_angles_ = now;
  }
  return rig_.ptu->TWorldColor(held_angles_->pan_deg, held_angles_->tilt_deg);
}

void Studio::LearnNoise(const CapturedFrame& captured) {
  if (!room_view_ || noise_.complete()) return;
  const RoomPrediction& prediction = room_view_->Look(PoseOf(captured));
  HalfRgb(captured.color, &half_);
  const cv::Mat1f D = WarpDepth(captured);
  noise_.Add(prediction, half_, View(D));
}

std::shared_ptr<BackgroundModel> Studio::UnusedModel() {
  for (const std::shared_ptr<BackgroundModel>& model : models_) {
    if (model.use_count() == 1) return model;
  }
  return models_.emplace_back(std::make_shared<BackgroundModel>());
}

void Studio::PredictRoom(const RoomPrediction& prediction, const RigidTransform& T_world_color) {
  ++standing_frames_;
  if (prediction.drawing != predicted_ || noise_.frames() != predicted_frames_) {
    standing_frames_ = 0;
    predicted_ = prediction.drawing;
    predicted_frames_ = noise_.frames();
    refine_at_ = RefinedBackground::kFewestSamples;
    room_.reset();
    refined_.Begin(nullptr);
    std::shared_ptr<BackgroundModel> model = UnusedModel();
    const RoomPrediction& shown = WithThings(prediction, T_world_color);
    PredictBackground(shown, noise_, doubt_, model.get());
    room_ = std::move(model);
    refined_.Begin(room_);
    UseDepth(shown);
  } else if (refined_.samples() >= refine_at_) {
    std::shared_ptr<BackgroundModel> model = UnusedModel();
    refined_.Refine(model.get());
    room_ = std::move(model);
    refine_at_ = refined_.complete() ? std::numeric_limits<int>::max()
                                     : std::min(2 * refine_at_, RefinedBackground::kMostSamples);
  }
}

const RoomPrediction& Studio::WithThings(const RoomPrediction& prediction,
                                         const RigidTransform& T_world_color) {
  if (!scene_ || scene_->adopted.empty()) return prediction;
  if (rays_.empty()) rays_ = UnprojectionTable(rig_.color);
  RoomPrediction& shown = prediction_with_things_;
  shown = prediction;
  for (cv::Mat1b* plane : {&shown.r, &shown.g, &shown.b, &shown.seen}) *plane = plane->clone();
  shown.depth_m = shown.depth_m.clone();
  for (const auto& thing : scene_->adopted) LayThing(*thing, rig_.color, rays_, T_world_color, &shown);
  return shown;
}

void Studio::UseDepth(const RoomPrediction& prediction) {
  if (!room_depth_) {
    room_depth_.emplace();
    room_depth_->sigma_m = cv::Mat1f(prediction.depth_m.size(), std::max(doubt_.depth_sigma_m, 1e-3f));
  }
  room_depth_->revision = ++room_revision_;
  room_depth_->depth_m = prediction.depth_m;
}

bool Studio::LearnStanding(const CapturedFrame& captured) {
  if (!room_view_) return false;
  Frame frame;
  frame.captured = std::shared_ptr<const CapturedFrame>(std::shared_ptr<void>(), &captured);
  frame.T_world_color = PoseOf(captured);
  const bool first = predicted_ == 0;
  const RoomPrediction& prediction = room_view_->Look(frame.T_world_color);
  const bool moved = prediction.drawing != predicted_;
  PredictRoom(prediction, frame.T_world_color);
  if (moved && !first) return false;
  HalfRgb(captured.color, &half_);
  frame.D = WarpDepth(captured);
  if (captured.depth)
    frame.depth_age_s = static_cast<double>(captured.capture_us - DepthTime(captured)) * 1e-6;
  refine_due_us_ = captured.capture_us;
  FrameStages::KeyActor(*this, frame);
  return true;
}

std::int64_t Studio::DepthTime(const CapturedFrame& captured) const {
  return std::min(captured.depth->capture_us + depth_clock_us_, captured.capture_us);
}

void Studio::JudgeClock(const Frame& frame) {
  const CapturedFrame& captured = *frame.captured;
  if (frame.T_world_color.matrix() != clock_pose_.matrix()) clock_offset_.Forget();
  clock_pose_ = frame.T_world_color;
  const bool usable = captured.depth && warped_ == captured.depth;
  clock_offset_.See(key_->half_mask(), captured.capture_us,
                    usable ? View(std::as_const(D_)) : ImageView<const float>(),
                    usable ? captured.depth->capture_us : 0, *room_);
  const auto& found = clock_offset_.estimate();
  if (!found) return;
  const double off_s = found->offset_s - static_cast<double>(depth_clock_us_) * 1e-6;
  if (std::abs(off_s) <= std::max(kClockIsGood_s, 2 * found->sigma_s)) return;
  depth_clock_us_ = std::llround(found->offset_s * 1e6);
  clock_offset_.Restart();
  spdlog::warn("depth clock off_ms={:.1f} sigma_ms={:.1f}: its times are moved by that",
               1e3 * found->offset_s, 1e3 * found->sigma_s);
}

// A scanned room is seen from wherever the head says; a learnt one from one place alone.
void Studio::JudgeNudge() {
  if (!learnt_room_ || room_state_ != RoomState::kKnown) return;
  const auto shift_px = camera_nudge_.See(half_, *learnt_room_);
  if (!shift_px) return;
  nudge_px_ = std::hypot(shift_px->x, shift_px->y);
  spdlog::warn("camera nudged_px={:.1f}: the empty set is moved along; learn it anew when it is empty",
               nudge_px_);
  learnt_room_ = std::make_shared<const BackgroundModel>(MovedAlong(*learnt_room_, *shift_px));
  LayThings();
}

std::shared_ptr<const BackgroundModel> Studio::standing_room() const {
  if (avatar_) return avatar_->room();
  return room_view_ && standing_frames_ < kStandingFrames ? nullptr : room_;
}

void FrameStages::PlaceCamera(Studio& s, Frame& f) {
  f.T_world_color = f.T_world_view = s.PoseOf(*f.captured);
}

void FrameStages::PredictRoom(Studio& s, Frame& f) {
  if (!s.room_view_) return;
  const RoomPrediction& prediction = s.room_view_->Look(f.T_world_color);
  if (!s.noise_.complete()) s.LearnNoise(*f.captured);
  s.PredictRoom(prediction, f.T_world_color);
}

void FrameStages::WarpDepth(Studio& s, Frame& f) { f.D = s.WarpDepth(*f.captured); }

void FrameStages::MoveDepth(Studio& s, Frame& f) {
  const CapturedFrame& captured = *f.captured;
  f.depth_age_s = 0;
  if (!s.depth_warp_) return;
  s.depth_motion_.See(captured.color.y, captured.capture_us);
  if (f.D.empty()) return;
  StandingRoom room;
  if (s.room_ && s.room_->has_depth()) room = {View(s.room_->room_depth_m), View(s.room_->sigma_m)};
  f.depth_age_s = s.depth_motion_.Run(View(std::as_const(f.D)), s.DepthTime(captured), room, &s.moved_D_);
  f.D = s.moved_D_;
}

void FrameStages::LearnRoom(Studio& s, Frame& f) {
  HalfRgb(f.captured->color, &s.half_);
  if (!s.learner_) return;
  const bool new_depth = f.captured->depth != s.learnt_depth_;
  s.learnt_depth_ = f.captured->depth;
  const cv::Mat1f none;
  auto room =
      s.learner_->Observe(s.half_, View(std::as_const(new_depth ? f.D : none)), f.captured->capture_us);
  if (room) s.UseRoom(std::move(room), s.learner_->state());
  if (s.room_state_ == RoomState::kKnown) s.learner_.reset();
}

void FrameStages::KeyActor(Studio& s, Frame& f) {
  f.keyed = s.room_ != nullptr;
  const cv::Size size(f.captured->color.width(), f.captured->color.height());
  f.label.create(size);
  f.alpha.create(size);
  if (!f.keyed) {
    f.label.setTo(kLabelUnknown);
    f.alpha.setTo(0);
    return;
  }
  if (s.regions_) s.regions_->Run(f.T_world_color, *s.room_, View(std::as_const(f.D)));
  s.key_->Run(*s.room_, View(f.captured->color.y), s.half_, View(std::as_const(f.D)),
              static_cast<float>(f.depth_age_s), View(f.label), View(f.alpha),
              s.regions_ ? &*s.regions_ : nullptr);
  s.JudgeClock(f);
  s.JudgeNudge();
  const bool new_depth = f.captured->depth != nullptr && f.captured->depth != s.looked_at_;
  s.looked_at_ = f.captured->depth;
  if (auto thing = s.left_behind_.See(
          {.T_world_color = f.T_world_color,
           .picture = &s.half_,
           .tone = s.key_->tone(),
           .half_mask = &s.key_->half_mask(),
           .new_depth_m = new_depth ? View(std::as_const(s.D_)) : ImageView<const float>()},
          *s.room_))
    s.thing_ = std::move(thing);
  if (s.room_view_ && !s.refined_.complete() && f.captured->capture_us >= s.refine_due_us_) {
    s.refine_due_us_ = f.captured->capture_us + kRefineUs;
    s.refined_.Add(s.half_, s.key_->tone(), s.key_->half_mask(), View(std::as_const(f.label)));
  }
}

void FrameStages::ShapeActor(Studio& s, Frame& f) {
  if (!f.keyed) {
    f.actor_depth_m = cv::Mat1f::zeros(Half(f.alpha.rows), Half(f.alpha.cols));
    return;
  }
  DepthInstant instant;
  if (const DepthPicture* depth = f.captured->depth.get()) {
    instant.measured_us = depth->capture_us;
    instant.age_s = static_cast<double>(f.captured->capture_us - s.DepthTime(*f.captured)) * 1e-6;
  }
  s.actor_surface_->Run(s.key_->half_mask(), View(std::as_const(f.D)), *s.room_, instant);
  f.actor_depth_m = s.actor_surface_->depth_m();
  if (s.regions_) s.regions_->LayDepth(*s.room_, &f.actor_depth_m);
}

void FrameStages::PlaceAvatar(Studio& s, Frame& f) {
  if (!s.avatar_) return;
  const std::int64_t t_us = f.captured->capture_us;
  if (!s.start_us_) s.start_us_ = t_us;
  s.avatar_->Run(*s.scene_->avatar, std::max<std::int64_t>(0, t_us - *s.start_us_),
                 {.view = s.room_view(),
                  .depth = s.room_depth_ ? &*s.room_depth_ : nullptr,
                  .tone = s.key_->tone(),
                  .foreground = f.keyed ? &s.key_->foreground() : nullptr,
                  .room = s.standing_frames_ < kStandingFrames ? nullptr : s.room_},
                 f);
}

void FrameStages::StepPhysics(Studio& s, Frame& f) {
  f.events.clear();
  if (!s.scene_ || s.room_state_ == RoomState::kLearning) return;
  const RigidTransform T_scene_color = s.TSceneColor(f);
  const RigidTransform T_scene_world = T_scene_color * f.T_world_view.inverse();
  if (!s.physics_) {
    if (std::ranges::none_of(s.scene_->objects, &SceneObject::drop)) return;
    s.StartPhysics(T_scene_color, T_scene_world);
  } else if (s.room_is_new_ && !s.room_view_ && !s.avatar_) {
    s.ShowRoomToPhysics(T_scene_color, T_scene_world);
  }
  const std::int64_t t_us = f.captured->capture_us;
  const std::vector<Eigen::AlignedBox3d> reach = s.physics_->ActorReach();
  s.physics_->StepTo(
      t_us, s.actor_collider_->Run(View(std::as_const(f.actor_depth_m)), T_scene_color, reach, t_us));
  s.moved_ |= s.physics_->WritePoses(s.posed_);
  f.events = s.physics_->TakeEvents();
  if (s.reactions_.Step(t_us, f.events, {*s.physics_, s.animations_, s.posed_}))
    s.illumination_ = IlluminationOf(s.posed_, s.RoomRadianceOrNull());
  for (const PhysicsEvent& event : f.events) {
    if (event.kind == PhysicsEventKind::kProblem) spdlog::warn("physics {}", event.text);
  }
}

void FrameStages::RenderScene(Studio& s, Frame& f) {
  f.cg = nullptr;
  if (!s.scene_) return;
  s.animations_.Pose(f.captured->capture_us, s.posed_);
  const RigidTransform T_camera_scene = s.TSceneColor(f).inverse();
  const Scene* drawn = &s.posed_;
  if (!s.patches_.empty()) {
    s.drawn_ = s.posed_;
    s.drawn_.objects.insert(s.drawn_.objects.end(), s.patches_.begin(), s.patches_.end());
    drawn = &s.drawn_;
  }
  f.cg = &s.renderer_->Run(*drawn, T_camera_scene, s.illumination_);
}

void FrameStages::ShadeLightMap(Studio& s, Frame& f) {
  f.light_map = nullptr;
  if (f.cg == nullptr) return;
  const RoomDepth* own = s.room_depth_ ? &*s.room_depth_ : nullptr;
  const RoomDepth* room = s.avatar_ ? s.avatar_->depth() : own;
  f.light_map = &s.light_mapper_->Run({.scene = &s.posed_,
                                       .T_scene_color = s.TSceneColor(f),
                                       .light = &s.illumination_,
                                       .cg = f.cg,
                                       .room_revision = room != nullptr ? room->revision : 0,
                                       .room_depth_m = room != nullptr ? room->depth_m : cv::Mat1f(),
                                       .actor_depth_m = View(std::as_const(f.actor_depth_m))});
  RelightPicture(*f.light_map, View(std::as_const(f.alpha)), f.Real(), s.lit_color_);
  if (s.lit_layer_.drawing != f.light_map->cg_revision) RelightLayer(*f.light_map, *f.cg, s.lit_layer_);
  f.cg = &s.lit_layer_;
}

void FrameStages::Reflect(Studio& s, Frame& f) {
  if (f.cg == nullptr || s.reflections_ == nullptr) return;
  const RoomDepth* own = s.room_depth_ ? &*s.room_depth_ : nullptr;
  const RoomDepth* room = s.avatar_ ? s.avatar_->depth() : own;
  const ReflectionPictures& pictures =
      s.reflections_->Run({.scene = s.patches_.empty() ? &s.posed_ : &s.drawn_,
                           .first_patch = s.posed_.objects.size(),
                           .T_scene_color = s.TSceneColor(f),
                           .light = &s.illumination_,
                           .cg = f.cg,
                           .light_map = f.light_map,
                           .room_revision = room != nullptr ? room->revision : 0,
                           .room_depth_m = room != nullptr ? room->depth_m : cv::Mat1f(),
                           .room_sigma_m = room != nullptr ? room->sigma_m : cv::Mat1f(),
                           .color = &f.Real(),
                           .actor_depth_m = View(std::as_const(f.actor_depth_m))});
  ReflectInPicture(pictures, *f.light_map, View(std::as_const(f.alpha)), s.lit_color_);
  if (s.patches_.empty()) return;
  if (s.reflected_ != pictures.revision || s.reflected_layer_ != f.cg->drawing) {
    s.reflected_ = pictures.revision;
    s.reflected_layer_ = f.cg->drawing;
    ReflectInLayer(pictures, *f.cg, s.reflecting_layer_);
    ++s.reflecting_layer_.drawing;
  }
  f.cg = &s.reflecting_layer_;
}

void FrameStages::CompositeZ(Studio& s, Frame& f) {
  const RoomDepth* own = s.room_depth_ ? &*s.room_depth_ : nullptr;
  const cv::Mat3b* own_color = f.keyed ? &s.key_->foreground() : nullptr;
  if (s.avatar_) own_color = &s.avatar_->foreground();
  s.z_key_.Run({.color = f.light_map != nullptr ? &s.lit_color_ : &f.Real(),
                .alpha = View(std::as_const(f.alpha)),
                .actor_depth_m = View(std::as_const(f.actor_depth_m)),
                .foreground = own_color,
                .room = s.avatar_ ? s.avatar_->depth() : own,
                .cg = f.cg},
               f.composite, f.depth_mm, f.cg_alpha);
}

}  // namespace mixstage
