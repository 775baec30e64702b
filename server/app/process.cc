// SPDX-License-Identifier: Apache-2.0
#include "server/app/process.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <opencv2/core/version.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "proto/base/clock.h"
#include "proto/base/log.h"
#include "proto/base/version.h"
#include "server/app/learn_take.h"
#include "server/app/open_avatar.h"
#include "server/app/open_environment.h"
#include "server/app/regions_file.h"
#include "server/composite/relight.h"
#include "server/ingest/take_ingest.h"
#include "server/pipeline/broadcast.h"
#include "server/pipeline/frame_stages.h"
#include "server/scene/model_process.h"
#include "server/scene/scene_file.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr std::array<std::pair<std::string_view, Export>, 11> kExportNames = {
    {{"composite", Export::kComposite},
     {"depth", Export::kDepth},
     {"alpha", Export::kAlpha},
     {"label", Export::kLabel},
     {"cg_alpha", Export::kCgAlpha},
     {"lightmap", Export::kLightMap},
     {"predicted", Export::kPredicted},
     {"mesh", Export::kMesh},
     {"pose", Export::kPose},
     {"events", Export::kEvents},
     {"report", Export::kReport}}};
constexpr int kWarmUpFrames = 10;  // not counted in core-ms per frame
constexpr std::size_t kMaxWarnings = 100;

std::array<double, 3> Numbers(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

Json ToJson(const PhysicsEvent& event, double take_t_s) {
  Json json = {{"event", PhysicsEventName(event.kind)}, {"timestamp", take_t_s}, {"object", event.name}};
  if (event.kind == PhysicsEventKind::kProblem || event.kind == PhysicsEventKind::kMessage) {
    json["text"] = event.text;
    return json;
  }
  if (event.kind == PhysicsEventKind::kTouch) json["with"] = event.with;
  json["point"] = Numbers(event.point);
  if (event.kind == PhysicsEventKind::kTouch) {
    json["normal"] = Numbers(event.normal);
    json["impulse_ns"] = event.impulse_ns;
  }
  return json;
}

// Writes one frame's exports. PNG compression is light: the files are many and read by tools.
class Exporter {
 public:
  static Result<Exporter> Create(const fs::path& out, const std::set<Export>& exports) {
    std::error_code error;
    fs::create_directories(out, error);
    for (const auto& [name, kind] : kExportNames) {
      if (!exports.contains(kind) || kind == Export::kPose || kind == Export::kEvents ||
          kind == Export::kReport)
        continue;
      if (kind == Export::kPredicted) {
        fs::create_directories(out / "predicted_color", error);
        if (!error) fs::create_directories(out / "predicted_depth", error);
        continue;
      }
      fs::create_directories(out / name, error);
    }
    if (error) return Fail(ErrorCode::kUnavailable, out.string() + ": cannot be made: " + error.message());
    return Exporter(out, exports);
  }

  // room: as the frame's camera sees it; null without an environment.
  Status Write(const Frame& frame, RoomView* room) {
    const std::string file = frame.captured->stem + ".png";
    if (exports_.contains(Export::kComposite)) {
      if (auto ok = Save("composite", file, ToBgr(frame.composite)); !ok) return ok;
    }
    if (exports_.contains(Export::kDepth)) {
      if (auto ok = Save("depth", file, frame.depth_mm); !ok) return ok;
    }
    if (exports_.contains(Export::kAlpha)) {
      if (auto ok = Save("alpha", file, frame.alpha); !ok) return ok;
    }
    if (exports_.contains(Export::kLabel)) {
      if (auto ok = Save("label", file, frame.label); !ok) return ok;
    }
    if (exports_.contains(Export::kCgAlpha)) {
      if (auto ok = Save("cg_alpha", file, frame.cg_alpha); !ok) return ok;
    }
    if (exports_.contains(Export::kLightMap)) {
      const cv::Mat3b map =
          frame.light_map != nullptr
              ? LightMapPicture(*frame.light_map, View(std::as_const(frame.alpha)), frame.alpha.size())
              : cv::Mat3b(frame.alpha.size(), cv::Vec3b::all(255));
      if (auto ok = Save("lightmap", file, map); !ok) return ok;
    }
    if (room != nullptr && exports_.contains(Export::kPredicted)) {
      cv::Mat1w depth_mm;
      room->Look(frame.T_world_color).depth_m.convertTo(depth_mm, CV_16U, 1000);
      if (auto ok = Save("predicted_depth", file, depth_mm); !ok) return ok;
      if (auto ok = Save("predicted_color", file, room->Picture()); !ok) return ok;
    }
    if (exports_.contains(Export::kPose))
      poses_ << TumLine(frame.captured->take_t_s, frame.T_world_color) << "\n";
    if (exports_.contains(Export::kEvents)) {
      for (const PhysicsEvent& event : frame.events)
        events_
            << ToJson(event, frame.captured->take_t_s).dump(-1, ' ', false, Json::error_handler_t::replace)
            << "\n";
    }
    return {};
  }
  Status Finish(const std::string& report) {
    if (exports_.contains(Export::kPose)) {
      if (auto ok = SaveText("pose.txt", "# timestamp tx ty tz qx qy qz qw (T_world_color)\n" + poses_.str());
          !ok)
        return ok;
    }
    if (exports_.contains(Export::kEvents)) {
      if (auto ok = SaveText("events.jsonl", events_.str()); !ok) return ok;
    }
    return SaveText("report.json", report);
  }

 private:
  Exporter(fs::path out, std::set<Export> exports) : out_(std::move(out)), exports_(std::move(exports)) {}

  Status Save(const char* folder, const std::string& name, const cv::Mat& picture) const {
    const fs::path file = out_ / folder / name;
    bool written = false;
    try {
      written = cv::imwrite(file.string(), picture, {cv::IMWRITE_PNG_COMPRESSION, 1});
    } catch (const cv::Exception&) {
    }
    if (!written)
      return Fail(ErrorCode::kUnavailable, file.string() + ": cannot be written (is the disk full?)");
    return {};
  }
  Status SaveText(const char* name, const std::string& text) const {
    std::ofstream file(out_ / name);
    if (!(file << text) || !file.flush()) {
      return Fail(ErrorCode::kUnavailable,
                  (out_ / name).string() + ": cannot be written (is the disk full?)");
    }
    return {};
  }

  fs::path out_;
  std::set<Export> exports_;
  std::ostringstream poses_, events_;
};

Json ToJson(const Distribution& d) {
  return {{"p50", d.p50}, {"p95", d.p95}, {"max", d.max}, {"mean", d.mean}};
}

// What the run adds up for report.json.
struct Totals {
  int frames = 0;
  std::int64_t frames_cpu_us = 0, frames_wall_us = 0;  // of the frames after the warm-up
  int counted = 0;
  std::int64_t export_cpu_us = 0;
  std::map<std::string, std::int64_t> drops;
  std::vector<std::string> warnings;
  Json depth_clock;  // null: not enough moved
};

std::string Report(const Totals& t, const StageTimes& times, const std::string& room,
                   const std::string& renderer) {
  Json report;
  report["frames"] = t.frames;
  Json& stages = report["stages"] = Json::object();
  const auto summary = times.Summary();
  for (const StageInfo& stage : AllStages()) {
    const auto found = summary.find(std::string(stage.name));
    if (found == summary.end()) continue;
    stages[found->first] = {{"wall_ms", ToJson(found->second.wall_ms)},
                            {"cpu_ms", ToJson(found->second.cpu_ms)},
                            {"budget_ms", stage.budget_ms},
                            {"source", stage.source}};
  }
  Json& total = report["total"];
  const bool measured = t.counted > 0;
  total["core_ms_per_frame"] =
      measured ? Json(static_cast<double>(t.frames_cpu_us) * 1e-3 / t.counted) : Json(nullptr);
  total["fps"] =
      measured ? Json(t.counted * 1e6 / static_cast<double>(std::max<std::int64_t>(1, t.frames_wall_us)))
               : Json(nullptr);
  total["export_core_ms_per_frame"] =
      t.frames > 0 ? Json(static_cast<double>(t.export_cpu_us) * 1e-3 / t.frames) : Json(nullptr);
  report["drops"] = Json(t.drops);
  report["depth_clock"] = t.depth_clock;
  report["room"] = room;
  report["warnings"] = Json(t.warnings);
  report["versions"] = {{"mixstage", kVersion}, {"opencv", CV_VERSION}, {"renderer", renderer}};
  return report.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

void ShowProgress(int done, int all) {
  if (isatty(STDERR_FILENO) == 0) return;
  std::fprintf(stderr, "\r%d of %d frames", done, all);
  if (done == all) std::fprintf(stderr, "\n");
}

Result<LearntRoom> Learn(const ProcessOptions& options, const Take& take, Studio& studio,
                         std::vector<std::string>& warnings) {
  fs::path plate_folder;
  if (options.clean_plate == CleanPlate::kGiven) plate_folder = options.clean_plate_folder;
  if (options.clean_plate == CleanPlate::kDefault && take.clean_plate) plate_folder = *take.clean_plate;
  if (plate_folder.empty()) return LearnFromTake(take, StudioSetup{}.learn_frames, studio, warnings);
  auto plate = OpenTake(plate_folder);
  if (!plate) return tl::unexpected(plate.error());
  warnings.insert(warnings.end(), plate->warnings.begin(), plate->warnings.end());
  return LearnFromCleanPlate(*plate, studio, warnings);
}

}  // namespace

Result<std::set<Export>> ParseExports(const std::string& list) {
  std::set<Export> exports;
  std::istringstream names(list);
  std::string name;
  while (std::getline(names, name, ',')) {
    const auto* found = std::find_if(kExportNames.begin(), kExportNames.end(),
                                     [&](const auto& e) { return e.first == name; });
    if (found == kExportNames.end()) {
      std::string known;
      for (const auto& e : kExportNames) known += (known.empty() ? "" : ", ") + std::string(e.first);
      return Fail(ErrorCode::kInvalidConfig, "--export " + name + " is none of " + known);
    }
    exports.insert(found->second);
  }
  return exports;
}

Result<std::string> RunProcess(const ProcessOptions& options) {
  cv::setNumThreads(1);  // one frame after another, the same bytes whatever the machine
  auto take = OpenTake(options.take);
  if (!take) return tl::unexpected(take.error());
  Totals totals;
  totals.warnings = take->warnings;
  auto warn = [&](const std::vector<std::string>& more) {
    totals.warnings.insert(totals.warnings.end(), more.begin(), more.end());
  };
  StudioSetup setup;
  std::string room_is;
  if (!options.environment || options.rig) {
    auto rig = RigOfTake(*take, {.rig_file = options.rig, .depth_unit_m = options.depth_unit_m});
    if (!rig) return tl::unexpected(rig.error());
    warn(rig->warnings);
    setup.rig = rig->rig;
  }
  if (options.environment) {
    auto opened = OpenEnvironment(*options.environment);
    if (!opened) return tl::unexpected(opened.error());
    warn(opened->warnings);
    setup.rig = RigIn(opened->environment, options.rig ? &setup.rig : nullptr);
    setup.scanned = std::move(opened->room);
    room_is = opened->how;
  }
  auto device = ChooseBackend(options.renderer);
  if (!device) return tl::unexpected(device.error());
  setup.device = std::move(*device);
  if (take->depth.empty() && setup.rig.depth) {
    setup.rig.depth.reset();
    totals.warnings.push_back("the take has no depth: the key works by colour alone");
  }
  if (options.scene) {
    auto scene = LoadScene(*options.scene, [](const fs::path& file) { return LoadModelApart(file); });
    if (!scene) return tl::unexpected(scene.error());
    totals.warnings.insert(totals.warnings.end(), scene->warnings.begin(), scene->warnings.end());
    auto avatar = OpenAvatar(scene->scene, *options.scene);
    if (!avatar) return tl::unexpected(avatar.error());
    warn(avatar->warnings);
    setup.avatar = std::move(avatar->setup);
    setup.avatar.start_us = std::llround(take->color.front().t_s * 1e6);
    setup.scene = std::move(scene->scene);
  }
  if (options.poses) {
    auto poses = ReadPoses(*options.poses);
    if (!poses) return tl::unexpected(poses.error());
    setup.poses = std::move(*poses);
  }
  if (options.regions) {
    auto regions = LoadRegions(*options.regions);
    if (!regions) return tl::unexpected(regions.error());
    setup.regions = std::move(*regions);
  }
  auto studio = Studio::Create(std::move(setup));
  if (!studio) return tl::unexpected(studio.error());
  if (options.exports.contains(Export::kPredicted) && !options.environment) {
    return Fail(ErrorCode::kInvalidConfig, "--export predicted needs a scanned room: give --environment");
  }
  auto exporter = Exporter::Create(options.out, options.exports);
  if (!exporter) return tl::unexpected(exporter.error());
  if (options.environment) {
    LearnPredictionFromTake(*take, *studio, totals.warnings);
  } else {
    auto room = Learn(options, *take, *studio, totals.warnings);
    if (!room) return tl::unexpected(room.error());
    studio->SetRoom(room->model, room->state);
    room_is = room->how;
  }
  spdlog::info("process renderer=\"{}\"", studio->renderer());
  spdlog::info("room state=\"{}\"", room_is);
  for (const std::string& warning : totals.warnings) spdlog::warn("process {}", warning);
  std::optional<Broadcast> broadcast;
  if (options.encode) {
    auto created = Broadcast::Create({}, studio->view(), "process", nullptr);
    if (!created) return tl::unexpected(created.error());
    broadcast = std::move(*created);
  }

  TakeIngest ingest(*take, studio->rig());
  const int end = options.end_frame < 0 ? ingest.frames() : std::min(options.end_frame, ingest.frames());
  if (options.first_frame >= end) {
    return Fail(ErrorCode::kInvalidConfig,
                "--frames: the take has only " + std::to_string(ingest.frames()) + " frames");
  }
  std::optional<MeshExporter> meshes;
  if (options.exports.contains(Export::kMesh)) {
    auto created = MeshExporter::Create(studio->view(), options.mesh_format);
    if (!created) return tl::unexpected(created.error());
    meshes.emplace(std::move(*created));
  }
  StageTimes times(0);
  Frame frame;
  for (int i = options.first_frame; i < end; ++i) {
    const std::int64_t cpu_us = ProcessCpuMicros();
    const std::int64_t wall_us = MonotonicMicros();
    std::string warning;
    {
      const StageTimer timer(times, "decode");
      auto captured = ingest.Load(i, warning);
      if (captured) {
        frame.captured = std::move(*captured);
      } else {
        warning = captured.error().message;
        frame.captured = nullptr;
      }
    }
    if (!warning.empty()) {
      ++totals.drops[frame.captured ? "unreadable_depth" : "unreadable_color"];
      if (totals.warnings.size() < kMaxWarnings) totals.warnings.push_back(warning);
      spdlog::warn("process {}", warning);
    }
    if (frame.captured) {
      studio->Run(frame, times);
      if (broadcast) {
        if (auto ok = broadcast->Send(frame, times); !ok) return tl::unexpected(ok.error());
      }
      ++totals.frames;
      if (i - options.first_frame >= kWarmUpFrames) {
        totals.frames_cpu_us += ProcessCpuMicros() - cpu_us;
        totals.frames_wall_us += MonotonicMicros() - wall_us;
        ++totals.counted;
      }
      const std::int64_t export_cpu_us = ProcessCpuMicros();
      if (auto ok = exporter->Write(frame, studio->room_view()); !ok) return tl::unexpected(ok.error());
      if (meshes) {
        if (auto ok = meshes->Write(frame, options.out / "mesh", times); !ok)
          return tl::unexpected(ok.error());
      }
      totals.export_cpu_us += ProcessCpuMicros() - export_cpu_us;
    }
    if (options.progress == Progress::kShow)
      ShowProgress(i + 1 - options.first_frame, end - options.first_frame);
  }
  if (studio->unusable_depths() > 0) totals.drops["depth_size_not_rig"] = studio->unusable_depths();
  if (totals.frames == 0)
    return Fail(ErrorCode::kBadInput, options.take.string() + ": no colour picture could be used");
  if (const auto& clock = studio->depth_clock()) {
    totals.depth_clock = {{"offset_ms", 1e3 * clock->offset_s},
                          {"sigma_ms", 1e3 * clock->sigma_s},
                          {"applied_ms", 1e-3 * static_cast<double>(studio->depth_clock_applied_us())}};
  }
  const std::string report = Report(totals, times, room_is, studio->renderer());
  if (auto ok = exporter->Finish(report); !ok) return tl::unexpected(ok.error());
  return report;
}

}  // namespace mixstage
