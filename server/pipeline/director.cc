// SPDX-License-Identifier: Apache-2.0
#include "server/pipeline/director.h"

#include <pthread.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <span>
#include <system_error>
#include <utility>

#include "proto/base/clock.h"
#include "proto/base/log.h"
#include "server/scene/scene_write.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::milliseconds kTurn(50);
constexpr std::int64_t kPublishSpacingUs = 50'000;  // a drag is seen by others at 20 Hz, its end at once
constexpr std::int64_t kFollowSpacingUs = 100'000;
constexpr std::int64_t kListSpacingUs = 2'000'000;
constexpr std::size_t kMostWaitingAdds = 16;

bool IsModel(const fs::path& file) {
  std::string extension = file.extension().string();
  std::ranges::transform(extension, extension.begin(),
                         [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension == ".glb" || extension == ".gltf" || extension == ".obj" || extension == ".ply";
}

// Of a drag that came in faster than it can be seen only the newest counts.
bool IsOvertaken(const ReceivedEdit& edit, std::span<const ReceivedEdit> later) {
  // Turns add up, and a light's fields may be others: only moves replace each other.
  const auto* move = std::get_if<MoveObject>(&edit.edit.op);
  if (!edit.edit.live || move == nullptr) return false;
  return std::ranges::any_of(later, [&](const ReceivedEdit& other) {
    const auto* newer = std::get_if<MoveObject>(&other.edit.op);
    return other.viewer == edit.viewer && other.edit.live && newer != nullptr &&
           newer->object == move->object;
  });
}

}  // namespace

Director::Director(Setup setup, Gateway& gateway)
    : file_(std::move(setup.file)),
      folder_(file_.has_parent_path() ? file_.parent_path() : fs::path(".")),
      edits_(std::move(setup.edits)),
      load_(std::move(setup.load)),
      gateway_(gateway),
      editor_(setup.scene, std::move(setup.default_light)),
      probe_(setup.color) {
  for (const SceneObject& object : editor_.scene()->objects) {
    Remember(object.file, {object.mesh, object.usual_up});
  }
  ListModels();
  thread_ = std::jthread([this](const std::stop_token& stop) { Run(stop); });
}

Director::~Director() {
  thread_.request_stop();
  thread_.join();
}

std::shared_ptr<const Scene> Director::TakeScene() {
  const std::lock_guard lock(mutex_);
  return std::exchange(scene_for_frames_, nullptr);
}

void Director::SeeRoom(std::shared_ptr<const BackgroundModel> room, const RigidTransform& T_world_color) {
  const std::lock_guard lock(mutex_);
  room_ = std::move(room);
  T_world_color_ = T_world_color;
}

void Director::SeeMoved(std::vector<MovedObject> moved) {
  const std::lock_guard lock(mutex_);
  moved_ = std::move(moved);
}

// Only where something moves: once at rest nothing is said any more.
void Director::FollowPhysics() {
  std::vector<MovedObject> moved;
  {
    const std::lock_guard lock(mutex_);
    moved.swap(moved_);
  }
  followed_us_ = MonotonicMicros();
  if (moved.empty()) return;
  editor_.Follow(moved);
  changed_ = true;
}

void Director::Run(const std::stop_token& stop) {
  pthread_setname_np(pthread_self(), "director");
  while (!stop.stop_requested()) {
    std::vector<ReceivedEdit> edits;
    for (auto edit = edits_->PopFor(kTurn); edit; edit = edits_->TryPop()) {
      edits.push_back(std::move(*edit));
      if (edits.size() >= kMaxWaitingEdits) break;
    }
    if (!edits.empty() || MonotonicMicros() - followed_us_ >= kFollowSpacingUs) FollowPhysics();
    const std::uint64_t revision = editor_.scene()->revision;
    if (!edits.empty()) LookAtRoom();
    for (std::size_t i = 0; i < edits.size(); ++i) {
      if (!IsOvertaken(edits[i], std::span(edits).subspan(i + 1))) Do(edits[i]);
    }
    FinishImport();
    StartImport(stop);
    FinishAdopting();
    if (editor_.scene()->revision != revision) {
      changed_ = true;
      const std::lock_guard lock(mutex_);
      scene_for_frames_ = editor_.scene();
    }
    ListModels();
    Publish();
  }
}

void Director::Do(const ReceivedEdit& received) {
  if (std::holds_alternative<SaveScene>(received.edit.op)) return Save(received);
  if (std::holds_alternative<AddObject>(received.edit.op)) return Add(received);
  if (std::holds_alternative<AdoptThing>(received.edit.op)) return StartAdopting(received);
  Apply(received, nullptr);
}

void Director::Apply(const ReceivedEdit& received, const AddedModel* model,
                     const std::shared_ptr<const AdoptedThing>& thing) {
  const EditSource source{received.viewer, received.name};
  if (auto done = editor_.Apply(received.edit, source, probe_, model, thing); !done) {
    Refuse(received, done.error().message);
  }
}

void Director::Save(const ReceivedEdit& received) {
  if (auto written = WriteScene(*editor_.scene(), file_); !written) {
    spdlog::warn("scene save=failed by={} reason=\"{}\"", received.name, written.error().message);
    return Refuse(received, written.error().message);
  }
  spdlog::info("scene save={} by={}", file_.string(), received.name);
  editor_.MarkSaved();
  changed_ = true;
}

void Director::Add(const ReceivedEdit& received) {
  const std::string& file = std::get<AddObject>(received.edit.op).file;
  models_listed_us_ = 0;  // asked for: a file that has just been put there counts
  ListModels();
  if (std::ranges::find(models_, file) == models_.end()) {
    return Refuse(received,
                  file.substr(0, 120) + " is none of the models beside " + file_.filename().string() + ".");
  }
  if (const auto known = Known(file)) return Apply(received, &*known);
  if (waiting_.size() >= kMostWaitingAdds)
    return Refuse(received, "16 models are being read already: try again.");
  waiting_.push_back({received, file});
}

void Director::StartAdopting(const ReceivedEdit& received) {
  if (editor_.scene()->avatar)
    return Refuse(received, "The picture shows another place: things cannot be pointed at in his room.");
  if (adopting_) return Refuse(received, "Another thing is being looked at: try again in a second.");
  adopting_ = received;
  const std::lock_guard lock(mutex_);
  look_ = std::get<AdoptThing>(received.edit.op).at;
}

void Director::FinishAdopting() {
  std::optional<Result<std::shared_ptr<const AdoptedThing>>> thing;
  {
    const std::lock_guard lock(mutex_);
    thing.swap(thing_);
  }
  if (!thing || !adopting_) return;
  const ReceivedEdit edit = *std::exchange(adopting_, std::nullopt);
  if (!*thing) return Refuse(edit, thing->error().message);
  Apply(edit, nullptr, **thing);
}

std::optional<PicturePoint> Director::TakeLook() {
  const std::lock_guard lock(mutex_);
  return std::exchange(look_, std::nullopt);
}

void Director::SeeThing(Result<std::shared_ptr<const AdoptedThing>> thing) {
  const std::lock_guard lock(mutex_);
  thing_ = std::move(thing);
}

void Director::StartImport(const std::stop_token& stop) {
  if (waiting_.empty() || importing_.valid()) return;
  importing_ = std::async(std::launch::async, [load = load_, path = folder_ / waiting_.front().file, stop] {
    return load(path, stop);
  });
}

void Director::FinishImport() {
  if (!importing_.valid() || importing_.wait_for(std::chrono::seconds(0)) != std::future_status::ready)
    return;
  Result<LoadedModel> model = importing_.get();
  const WaitingAdd add = std::move(waiting_.front());
  waiting_.pop_front();
  if (!model) {
    spdlog::warn("scene add={} by={} reason=\"{}\"", add.file, add.edit.name, model.error().message);
    // Where the folder lies is nobody's business on the other side of the network.
    std::string reason = model.error().message;
    const std::string folder = (folder_ / "").string();
    if (reason.starts_with(folder)) reason.erase(0, folder.size());
    return Refuse(add.edit, reason);
  }
  for (const std::string& warning : model->warnings) spdlog::warn("scene add={} {}", add.file, warning);
  const AddedModel added{std::make_shared<const Mesh>(std::move(model->mesh)), model->up};
  Remember(add.file, added);
  LookAtRoom();
  Apply(add.edit, &added);
  // Others who wait for the same file need not read it again.
  for (auto next = waiting_.begin(); next != waiting_.end();) {
    if (next->file != add.file) {
      ++next;
      continue;
    }
    Apply(next->edit, &added);
    next = waiting_.erase(next);
  }
}

std::optional<AddedModel> Director::Known(const std::string& file) {
  const auto found = known_.find(file);
  if (found == known_.end()) return std::nullopt;
  std::error_code error;
  const bool same = fs::last_write_time(folder_ / file, error) == found->second.time && !error &&
                    fs::file_size(folder_ / file, error) == found->second.bytes && !error;
  const std::shared_ptr<const Mesh> mesh = found->second.mesh.lock();
  if (!same || mesh == nullptr) return std::nullopt;
  return AddedModel{mesh, found->second.up};
}

void Director::Remember(const std::string& file, const AddedModel& model) {
  std::erase_if(known_, [](const auto& entry) { return entry.second.mesh.expired(); });
  std::error_code error;
  const auto time = fs::last_write_time(folder_ / file, error);
  const auto bytes = error ? 0 : fs::file_size(folder_ / file, error);
  if (!error) known_[file] = {time, bytes, model.mesh, model.up};
}

void Director::ListModels() {
  const std::int64_t now_us = MonotonicMicros();
  if (models_listed_us_ != 0 && now_us - models_listed_us_ < kListSpacingUs) return;
  models_listed_us_ = now_us;
  std::vector<std::string> models;
  std::error_code error;
  for (fs::directory_iterator entry(folder_, error), end; !error && entry != end; entry.increment(error)) {
    std::error_code unknown;
    const std::string name = entry->path().filename().string();
    if (!name.starts_with(".") && IsModel(entry->path()) && entry->is_regular_file(unknown))
      models.push_back(name);
  }
  std::ranges::sort(models);
  if (models.size() > kMaxSceneModels) models.resize(kMaxSceneModels);
  if (models == models_) return;
  models_ = std::move(models);
  changed_ = true;
}

void Director::LookAtRoom() {
  std::shared_ptr<const BackgroundModel> room;
  RigidTransform T_scene_color = RigidTransform::Identity();
  const SceneFrame frame = editor_.scene()->frame;
  {
    const std::lock_guard lock(mutex_);
    room = room_;
    if (frame == SceneFrame::kWorld) T_scene_color = T_world_color_;
  }
  probe_.Look(std::move(room), T_scene_color, UpOf(frame));
}

void Director::Publish() {
  if (!changed_ || MonotonicMicros() - published_us_ < kPublishSpacingUs) return;
  changed_ = false;
  published_us_ = MonotonicMicros();
  WatchScene message = editor_.Message();
  message.models = models_;
  gateway_.PublishScene(ToJson(message));
}

void Director::Refuse(const ReceivedEdit& received, std::string reason) {
  gateway_.SendTo(received.viewer, ToJson(WatchRefused{received.edit.id, reason.substr(0, 1000)}));
}

}  // namespace mixstage
