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
  if (config.rig.empty()) {
    return Fail(ErrorCode::kInvalidConfig, "no rig: give --rig rig.json, or \"rig:\" in the configuration");
  }
  auto rig = OpenRig(config.rig);
  if (!rig) return tl::unexpected(rig.error());
  for (const std::string& warning : rig->warnings) spdlog::warn("rig {}: {}", config.rig.string(), warning);
  StudioSetup setup;
  setup.rig = rig->rig;
  setup.learn_frames = config.learn_frames;
  if (!config.scene.empty()) {
    auto scene = OpenScene(config.scene, setup.rig);
    if (!scene) return tl::unexpected(scene.error());
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

}  // namespace

Status CheckShow(const StudioConfig& config) {
  auto studio = OpenStudio(config);
  if (!studio) return tl::unexpected(studio.error());
  auto broadcast = Broadcast::Create({config.color, config.depth}, studio->rig().color.width,
                                     studio->rig().color.height, config.name, nullptr);
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
  cv::setNumThreads(1);  // the stages are spread over threads of ours already

  auto studio = OpenStudio(config);
  if (!studio) return tl::unexpected(studio.error());
  auto link = LcmLink::Create(config.lcm_url);
  if (!link) return tl::unexpected(link.error());
  auto tested = (*link)->SelfTest();
  if (!tested) return tl::unexpected(tested.error());
  for (const std::string& warning : *tested) spdlog::warn("lcm {}", warning);

  // The gateway asks for metrics from its own thread, and outlives the show.
  std::atomic<const LiveShow*> show_for_metrics = nullptr;
  GatewayConfig gateway_config;
  gateway_config.listen = config.listen;
  gateway_config.page_folder = FindPage(config);
  if (gateway_config.page_folder.empty())
    spdlog::warn("page not found: build it, or set \"page:\"; /watch works");
  if (studio->scene())
    gateway_config.edits = std::make_shared<EditQueue>(kMaxWaitingEdits, WhenFull::kDropOldest);
  Gateway gateway(gateway_config, [&] {
    const LiveShow* show = show_for_metrics.load();
    return show != nullptr ? show->MetricsText() : std::string();
  });
  if (auto ok = gateway.Start(); !ok) return ok;
  auto broadcast = Broadcast::Create({config.color, config.depth}, studio->rig().color.width,
                                     studio->rig().color.height, config.name, &gateway);
  if (!broadcast) return tl::unexpected(broadcast.error());
  gateway.SetHello({.name = config.name, .server_us = 0, .streams = {}});
  std::optional<Director> director;
  if (studio->scene()) {
    director.emplace(
        Director::Setup{.scene = *studio->scene(),
                        .file = config.scene,
                        .color = studio->rig().color,
                        .edits = gateway_config.edits,
                        .load = [](const fs::path& model,
                                   const std::stop_token& stop) { return LoadModelApart(model, {}, stop); }},
        gateway);
  }
  {
    LiveShow show(std::move(*link), std::move(*studio), std::move(*broadcast), gateway,
                  director ? &*director : nullptr);
    show_for_metrics = &show;
    const std::string host = config.listen.substr(0, config.listen.rfind(':'));
    std::printf("http://%s:%d/\n", host.c_str(), gateway.port());
    std::fflush(stdout);
    spdlog::info("show name={} url=http://{}:{}/ lcm={}", config.name, host, gateway.port(), config.lcm_url);
    int received = 0;
    sigwait(&signals, &received);
    spdlog::info("show end signal={}", received);
    show_for_metrics = nullptr;
    gateway.Stop();
  }
  return {};
}

}  // namespace mixstage
