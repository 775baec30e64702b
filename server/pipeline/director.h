// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <deque>
#include <filesystem>
#include <functional>
#include <future>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "proto/geometry/camera_model.h"
#include "proto/geometry/frames.h"
#include "server/delivery/gateway.h"
#include "server/pipeline/room_depth_probe.h"
#include "server/scene/model_file.h"
#include "server/scene/scene_editor.h"

namespace mixstage {

// The thread `director`: owns the scene while a show edits it (SPEC.md 4.5). Edits come from the gateway's
// queue; what changed goes to all viewers, a refusal to its author, and the scene itself, immutable, to the
// frame thread, which takes the newest at the start of a frame. Models are read beside it: while a large one
// is on its way others go on editing.
class Director {
 public:
  struct Setup {
    Scene scene;                 // with ids
    DefaultLight default_light;  // Studio::DefaultLights
    std::filesystem::path file;  // scene.yaml; models lie beside it. It need not exist yet
    PinholeCamera color;
    std::shared_ptr<EditQueue> edits;  // the gateway's
    // Reads a model; gives up when asked to stop.
    std::function<Result<LoadedModel>(const std::filesystem::path& file, const std::stop_token& stop)> load;
  };
  // Starts at once. `gateway` outlives it.
  Director(Setup setup, Gateway& gateway);
  ~Director();  // stops; an import that runs is given up
  Director(const Director&) = delete;
  Director& operator=(const Director&) = delete;

  // ---- The frame thread ----
  // The scene, where it changed since the last call; else null.
  [[nodiscard]] std::shared_ptr<const Scene> TakeScene();
  // Where physics has brought objects, for viewers, further edits and `save`.
  void SeeMoved(std::vector<MovedObject> moved);
  // What the camera sees of the empty set, and where it stands, for edits that follow.
  void SeeRoom(std::shared_ptr<const BackgroundModel> room, const RigidTransform& T_world_color);
  // Where somebody has pointed at a thing left behind; told once. What was found there comes back.
  [[nodiscard]] std::optional<PicturePoint> TakeLook();
  void SeeThing(Result<std::shared_ptr<const AdoptedThing>> thing);

 private:
  // An `add` whose model is being read, or waits for its turn.
  struct WaitingAdd {
    ReceivedEdit edit;
    std::string file;
  };
  struct KnownModel {
    std::filesystem::file_time_type time{};
    std::uintmax_t bytes = 0;
    std::weak_ptr<const Mesh> mesh;  // held by the scenes that show it
    UpAxis up = UpAxis::kY;
  };

  void Run(const std::stop_token& stop);
  void Do(const ReceivedEdit& edit);
  void Apply(const ReceivedEdit& edit, const AddedModel* model,
             const std::shared_ptr<const AdoptedThing>& thing = nullptr);
  void Add(const ReceivedEdit& edit);
  void StartAdopting(const ReceivedEdit& edit);
  void FinishAdopting();
  void Save(const ReceivedEdit& edit);
  void StartImport(const std::stop_token& stop);
  void FinishImport();
  void ListModels();
  void LookAtRoom();
  void FollowPhysics();
  void Publish();
  void Refuse(const ReceivedEdit& edit, std::string reason);
  [[nodiscard]] std::optional<AddedModel> Known(const std::string& file);
  void Remember(const std::string& file, const AddedModel& model);

  const std::filesystem::path file_, folder_;
  const std::shared_ptr<EditQueue> edits_;
  const decltype(Setup::load) load_;
  Gateway& gateway_;
  SceneEditor editor_;
  RoomDepthProbe probe_;

  std::vector<std::string> models_;
  std::int64_t models_listed_us_ = 0;
  std::map<std::string, KnownModel> known_;
  std::deque<WaitingAdd> waiting_;  // the front's model is being read while importing_ is valid
  std::future<Result<LoadedModel>> importing_;
  std::optional<ReceivedEdit> adopting_;  // waits for what the frames show
  bool changed_ = true;                   // since the last scene that was published
  std::int64_t published_us_ = 0, followed_us_ = 0;

  std::mutex mutex_;  // guards what follows
  std::shared_ptr<const Scene> scene_for_frames_;
  std::shared_ptr<const BackgroundModel> room_;
  RigidTransform T_world_color_ = RigidTransform::Identity();
  std::vector<MovedObject> moved_;
  std::optional<PicturePoint> look_;
  std::optional<Result<std::shared_ptr<const AdoptedThing>>> thing_;

  std::jthread thread_;  // last: it uses all of the above
};

}  // namespace mixstage
