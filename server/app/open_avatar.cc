// SPDX-License-Identifier: Apache-2.0
#include "server/app/open_avatar.h"

#include <utility>

#include "server/app/open_environment.h"

namespace mixstage {
namespace {

Result<AvatarVideo> OpenVideo(const std::filesystem::path& folder, const std::filesystem::path& poses,
                              std::vector<std::string>& warnings) {
  AvatarVideo video;
  auto take = OpenTake(folder);
  if (!take) return Within("avatar.video", take.error());
  auto rig = RigOfTake(*take, {});
  if (!rig) return Within("avatar.video", rig.error());
  warnings.insert(warnings.end(), take->warnings.begin(), take->warnings.end());
  warnings.insert(warnings.end(), rig->warnings.begin(), rig->warnings.end());
  video.take = std::move(*take);
  video.rig = std::move(rig->rig);
  if (poses.empty()) return video;
  auto read = ReadPoses(poses);
  if (!read) return Within("avatar.poses", read.error());
  video.poses = std::move(*read);
  return video;
}

}  // namespace

Result<OpenedAvatar> OpenAvatar(const Scene& scene, const std::filesystem::path& scene_file) {
  OpenedAvatar opened;
  if (!scene.avatar) return opened;
  const std::filesystem::path beside = scene_file.parent_path();
  if (!scene.avatar->room.empty()) {
    auto room = OpenEnvironment(beside / scene.avatar->room);
    if (!room) return Within("avatar.room", room.error());
    opened.warnings = std::move(room->warnings);
    opened.setup.room = std::move(room->room);
  } else if (!scene.avatar->video.empty()) {
    const std::filesystem::path poses =
        scene.avatar->poses.empty() ? std::filesystem::path() : beside / scene.avatar->poses;
    auto video = OpenVideo(beside / scene.avatar->video, poses, opened.warnings);
    if (!video) return tl::unexpected(video.error());
    opened.setup.video = std::move(*video);
  }
  return opened;
}

}  // namespace mixstage
