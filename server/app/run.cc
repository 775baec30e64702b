// SPDX-License-Identifier: Apache-2.0
#include "server/app/run.h"

#include <pthread.h>
#include <signal.h>

#include <atomic>
#include <cstdio>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "proto/base/log.h"
#include "server/app/learn_take.h"
#include "server/app/open_avatar.h"
#include "server/app/open_environment.h"
#include "server/app/regions_file.h"
#include "server/pipeline/director.h"
#include "server/pipeline/live_show.h"
#include "server/scene/model_process.h"
#include "server/scene/scene_file.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;

// The page lies beside an installed server in share/, or in the build tree.
fs::path FindPage(const StudioConfig& config) {
  if (!config.page.empty()) return config.page;
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error).parent_path();
  for (const fs::path& place : {program / "page", program / "../share/mixstage/page"}) {
    if (fs::exists(place / "index.html", error)) return place.lexically_normal();
  }
  return {};
}

GatewayConfig GatewayOf(const StudioConfig& config) {
  GatewayConfig gateway;
  gateway.listen = config.listen;
  gateway.page_folder = FindPage(config);
  gateway.token_file = config.tokens;
  gateway.audit_file = config.audit;
  gateway.tls = config.tls;
  gateway.origins = config.origins;
  gateway.hosts = config.hosts;
  return gateway;
}

// A rig.json, or a take: then its rig, or what is assumed where it has none.
Result<LoadedRig> OpenRig(const fs::path& place) {
  if (!fs::is_directory(place)) return LoadRig(place);
  auto take = OpenTake(place);
  if (!take) return tl::unexpected(take.error());
  auto rig = RigOfTake(*take, {});
  if (rig && take->depth.empty()) rig->rig.depth.reset();
  return rig;
}

// scene.yaml, or an empty scene where it is not there yet but its folder is: edits fill it, `save` writes it.
Result<Scene> OpenScene(const fs::path& file, const Rig& rig) {
  std::error_code error;
  if (!fs::exists(file, error) && fs::is_directory(fs::absolute(file).parent_path(), error)) {
    spdlog::info("scene {}: not there yet, starts empty", file.string());
    Scene empty;
    empty.frame = rig.ptu ? SceneFrame::kWorld : SceneFrame::kCamera;
    return empty;
  }
  auto scene = LoadScene(file, [](const fs::path& model) { return LoadModelApart(model); });
  if (!scene) return tl::unexpected(scene.error());
  for (const std::string& warning : scene->warnings) spdlog::warn("scene {}", warning);
  return std::move(scene->scene);
}

Result<Studio> OpenStudio(const StudioConfig& config) {
  if (config.rig.empty() && config.environment.empty()) {
    return Fail(ErrorCode::kInvalidConfig,
                "no rig: give --rig rig.json or --environment DIR, or \"rig:\" or \"environment:\" in the "
                "configuration");
  }
  if (!config.environment.empty() && !config.clean_plate.empty()) {
    return Fail(ErrorCode::kInvalidConfig,
                "an environment and a clean plate: the room can come from one alone");
  }
  StudioSetup setup;
  if (!config.rig.empty()) {
    auto rig = OpenRig(config.rig);
    if (!rig) return tl::unexpected(rig.error());
    for (const std::string& warning : rig->warnings) spdlog::warn("rig {}: {}", config.rig.string(), warning);
    setup.rig = std::move(rig->rig);
  }
  if (!config.environment.empty()) {
    auto opened = OpenEnvironment(config.environment);
    if (!opened) return tl::unexpected(opened.error());
    for (const std::string& warning : opened->warnings) spdlog::warn("environment {}", warning);
    setup.rig = RigIn(opened->environment, config.rig.empty() ? nullptr : &setup.rig);
    setup.scanned = std::move(opened->room);
    spdlog::info("room state=\"{}\"", opened->how);
  }
  if (!config.regions.empty()) {
    auto regions = LoadRegions(config.regions);
    if (!regions) return tl::unexpected(regions.error());
    setup.regions = std::move(*regions);
  }
  setup.learn_frames = config.learn_frames;
  auto device = ChooseBackend(config.renderer);
  if (!device) return tl::unexpected(device.error());
  setup.device = std::move(*device);
  if (!config.scene.empty()) {
    auto scene = OpenScene(config.scene, setup.rig);
    if (!scene) return tl::unexpected(scene.error());
    auto avatar = OpenAvatar(*scene, config.scene);
    if (!avatar) return tl::unexpected(avatar.error());
    for (const std::string& warning : avatar->warnings) spdlog::warn("avatar {}", warning);
    setup.avatar = std::move(avatar->setup);
    setup.scene = std::move(*scene);
  }
  auto studio = Studio::Create(std::move(setup));
  if (!studio) return studio;
  if (!config.clean_plate.empty()) {
    auto plate = OpenTake(config.clean_plate);
    if (!plate) return tl::unexpected(plate.error());
    std::vector<std::string> warnings = plate->warnings;
    auto room = LearnFromCleanPlate(*plate, *studio, warnings);
    for (const std::string& warning : warnings) spdlog::warn("clean_plate {}", warning);
    if (!room) return tl::unexpected(room.error());
    studio->SetRoom(room->model, room->state);
    spdlog::info("room state=\"{}\"", room->how);
  }
  return studio;
}

Result<std::unique_ptr<TakeRecorder>> StartRecording(const StudioConfig& config) {
  if (config.record.empty()) return nullptr;
  TakeWriterConfig take{.folder = config.record};
  if (fs::is_directory(config.rig)) {
    take.rig_file = RigFileOf(config.rig);
  } else if (!config.rig.empty()) {
    take.rig_file = config.rig;
  }
  auto recorder = std::make_unique<TakeRecorder>(take);
  if (auto ok = recorder->Start(); !ok) return Within("--record", ok.error());
  return recorder;
}

}  // namespace

Status CheckDelivery(const StudioConfig& config) { return Gateway::Check(GatewayOf(config)); }

Status CheckShow(const StudioConfig& config) {
  if (auto ok = CheckDelivery(config); !ok) return ok;
  auto studio = OpenStudio(config);
  if (!studio) return tl::unexpected(studio.error());
  auto broadcast = Broadcast::Create({config.color, config.depth}, studio->view(), config.name, nullptr);
  if (!broadcast) return tl::unexpected(broadcast.error());
  return {};
}

Status RunShow(const StudioConfig& config) {
  // Signals are waited for below; blocked before any other thread starts, so that all inherit the mask.
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  signal(SIGPIPE, SIG_IGN);
  if (auto ok = CheckDelivery(config); !ok) return ok;  // before minutes of learning a clean plate
  cv::setNumThreads(1);                                 // the stages are spread over threads of ours already

  auto studio = OpenStudio(config);
  if (!studio) return tl::unexpected(studio.error());
  auto link = LcmLink::Create(config.lcm_url);
  if (!link) return tl::unexpected(link.error());
  auto tested = (*link)->SelfTest();
  if (!tested) return tl::unexpected(tested.error());
  for (const std::string& warning : *tested) spdlog::warn("lcm {}", warning);

  // The gateway asks for metrics from its own thread, and outlives the show.
  std::atomic<const LiveShow*> show_for_metrics = nullptr;
  GatewayConfig gateway_config = GatewayOf(config);
  if (gateway_config.page_folder.empty())
    spdlog::warn("page not found: build it, or set \"page:\"; /watch works");
  if (studio->scene())
    gateway_config.edits = std::make_shared<EditQueue>(kMaxWaitingEdits, WhenFull::kDropOldest);
  Gateway gateway(gateway_config, [&] {
    const LiveShow* show = show_for_metrics.load();
    return show != nullptr ? show->MetricsText() : std::string();
  });
  if (auto ok = gateway.Start(); !ok) return ok;
  auto broadcast = Broadcast::Create({config.color, config.depth}, studio->view(), config.name, &gateway);
  if (!broadcast) return tl::unexpected(broadcast.error());
  auto meshes = MeshBroadcast::Create(studio->view(), gateway);
  if (!meshes) return tl::unexpected(meshes.error());
  gateway.SetHello({.name = config.name, .server_us = 0, .streams = {}});
  auto recorder = StartRecording(config);
  if (!recorder) return tl::unexpected(recorder.error());
  std::optional<OscSender> osc;
  if (config.osc != "none") {
    auto sender = OscSender::Create(config.osc);
    if (!sender) return tl::unexpected(sender.error());
    osc.emplace(std::move(*sender));
  }
  std::optional<Director> director;
  if (studio->scene()) {
    director.emplace(
        Director::Setup{.scene = *studio->scene(),
                        .default_light = studio->DefaultLights(),
                        .file = config.scene,
                        .color = studio->view(),
                        .edits = gateway_config.edits,
                        .load = [](const fs::path& model,
                                   const std::stop_token& stop) { return LoadModelApart(model, {}, stop); }},
        gateway);
  }
  {
    LiveShow show({.link = std::move(*link),
                   .studio = std::move(*studio),
                   .broadcast = std::move(*broadcast),
                   .meshes = std::move(*meshes),
                   .recorder = std::move(*recorder),
                   .osc = std::move(osc),
                   .director = director ? &*director : nullptr},
                  gateway);
    if (config.parity) show.SetAgentParity(*config.parity);
    show_for_metrics = &show;
    std::puts(gateway.url().c_str());
    std::fflush(stdout);
    spdlog::info("show name={} url={} lcm={} renderer=\"{}\"", config.name, gateway.url(), config.lcm_url,
                 show.renderer());
    int received = 0;
    sigwait(&signals, &received);
    spdlog::info("show end signal={}", received);
    show_for_metrics = nullptr;
    gateway.Stop();
  }
  return {};
}

}  // namespace mixstage
