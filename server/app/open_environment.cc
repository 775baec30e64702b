// SPDX-License-Identifier: Apache-2.0
#include "server/app/open_environment.h"

#include <algorithm>
#include <utility>

#include "server/app/room_file.h"
#include "server/environment/panorama_texture.h"
#include "server/ingest/take_ingest.h"

namespace mixstage {
Result<OpenedEnvironment> OpenEnvironment(const std::filesystem::path& folder) {
  auto parsed = ReadEnvironment(folder);
  if (!parsed) return tl::unexpected(parsed.error());
  auto model = ReadRoom(folder);
  if (!model) return tl::unexpected(model.error());
  OpenedEnvironment opened;
  opened.environment = std::move(parsed->environment);
  for (const std::string& warning : parsed->warnings)
    opened.warnings.push_back((folder / "environment.json").string() + ": " + warning);
  std::vector<Eigen::Vector3f> surface_positions = model->positions;
  std::vector<std::uint32_t> surface_indices = model->indices;
  SplitForPanorama(opened.environment.panorama, *model);
  opened.how = "environment, " + std::to_string(model->triangle_count()) + " triangles";
  opened.room = {.model = std::move(*model),
                 .doubt = {.registration_px = static_cast<float>(opened.environment.registration_px),
                           .depth_sigma_m = static_cast<float>(opened.environment.depth_sigma_m)},
                 .surface_positions = std::move(surface_positions),
                 .surface_indices = std::move(surface_indices),
                 .planes = opened.environment.planes,
                 .lamps = opened.environment.lamps};
  return opened;
}

Rig RigIn(const Environment& environment, const Rig* given) {
  Rig rig = given != nullptr ? *given : environment.rig;
  if (environment.rig.ptu) rig.ptu = environment.rig.ptu;
  return rig;
}

void LearnPredictionFromTake(const Take& take, Studio& studio, std::vector<std::string>& warnings) {
  TakeIngest ingest(take, studio.rig());
  auto spread = [&](int wanted, auto see) {
    const int samples = std::min(wanted, ingest.frames());
    for (int i = 0; i < samples; ++i) {
      std::string warning;
      auto captured = ingest.Load(static_cast<int>(std::int64_t{i} * ingest.frames() / samples), warning);
      if (!captured) warning = captured.error().message;
      if (!warning.empty()) warnings.push_back(warning);
      if (captured && !see(**captured)) return;
    }
  };
  spread(PredictionNoise::kMostFrames, [&](const CapturedFrame& captured) {
    studio.LearnNoise(captured);
    return true;
  });
  spread(RefinedBackground::kMostSamples,
         [&](const CapturedFrame& captured) { return studio.LearnStanding(captured); });
}

}  // namespace mixstage
