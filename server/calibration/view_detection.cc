// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/view_detection.h"

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <mutex>
#include <thread>

#include "proto/base/file_bytes.h"
#include "proto/take/picture_files.h"
#include "server/calibration/lens_start.h"

namespace mixstage {
namespace {

struct Picture {
  std::size_t camera = 0, view = 0, folder = 0;
  std::filesystem::path file;
  std::vector<BoardSighting> found;  // boards of its folder
  std::string error;                 // why it could not be read
};

Lens NominalLens(const std::string& camera, const NominalRig& nominal, int width, int height) {
  if (camera == kColorName) {
    return nominal.given ? LensOf(nominal.rig.color) : AssumedLens(LensKind::kPinhole, width, height);
  }
  if (camera == kDepthName) {
    return nominal.given && nominal.rig.depth ? LensOf(nominal.rig.depth->camera)
                                              : AssumedLens(LensKind::kPinhole, width, height);
  }
  return nominal.given && nominal.rig.fisheye ? LensOf(*nominal.rig.fisheye)
                                              : AssumedLens(LensKind::kFisheye, width, height);
}

void Search(Picture& picture, const Lens& lens, const std::vector<Board>& boards) {
  auto grey = LoadGrey(picture.file);
  if (!grey) {
    picture.error = grey.error().message;
    return;
  }
  if (grey->cols != lens.width || grey->rows != lens.height) {
    picture.error = "is " + std::to_string(grey->cols) + " x " + std::to_string(grey->rows) + ", not " +
                    std::to_string(lens.width) + " x " + std::to_string(lens.height);
    return;
  }
  const cv::Mat1b search = ForDetection(*grey);
  picture.found = lens.kind == LensKind::kFisheye ? FindBoardsInFisheye(search, boards, FisheyeOf(lens))
                                                  : FindBoards(search, boards, EnlargeFor(lens.width));
}

// The scene's number of a folder's board: the same counts and squares are the same board.
std::size_t SceneBoard(BoardScene& scene, const Board& board) {
  const auto same = std::find_if(scene.boards.begin(), scene.boards.end(), [&](const Board& b) {
    return b.columns == board.columns && b.rows == board.rows && b.square_m == board.square_m;
  });
  if (same == scene.boards.end()) {
    scene.boards.push_back(board);
    return scene.boards.size() - 1;
  }
  same->white_margin_m = std::max(same->white_margin_m, board.white_margin_m);
  return static_cast<std::size_t>(same - scene.boards.begin());
}

std::size_t PlacementOf(BoardScene& scene, const std::string& view, std::size_t view_index,
                        std::size_t board) {
  for (std::size_t i = 0; i < scene.placements.size(); ++i) {
    if (scene.placements[i].view_index == view_index && scene.placements[i].board == board) return i;
  }
  scene.placements.push_back({view, view_index, board, std::nullopt, false});
  return scene.placements.size() - 1;
}

// A picture that is twice as soft as its camera's median, and softer than 3 px, moved or was out of focus.
void LeaveOutBlurred(BoardScene& scene, std::vector<PictureNote>& notes) {
  for (std::size_t c = 0; c < scene.cameras.size(); ++c) {
    std::vector<double> rises;
    for (const SceneSighting& s : scene.sightings) {
      if (s.camera == c && s.corners.rise_px > 0) rises.push_back(s.corners.rise_px);
    }
    if (rises.size() < 3) continue;
    std::nth_element(rises.begin(), rises.begin() + static_cast<std::ptrdiff_t>(rises.size() / 2),
                     rises.end());
    const double median = rises[rises.size() / 2];
    for (SceneSighting& s : scene.sightings) {
      if (s.camera != c || s.corners.rise_px <= std::max(3.0, 2 * median)) continue;
      char text[120];
      std::snprintf(text, sizeof(text), "is blurred: edges are %.1f px wide, %.1f px in this camera's others",
                    s.corners.rise_px, median);
      s.left_out = text;
      notes.push_back({s.file, text});
    }
  }
}

}  // namespace

Result<cv::Mat> LoadGrey(const std::filesystem::path& file) {
  auto bytes = ReadFileBytes(file, kMaxPictureFileBytes);
  if (!bytes) return Within(file.string(), bytes.error());
  cv::Mat1w counts;
  if (!IsJpeg(*bytes) && LoadDepth16(file, counts)) return counts;
  JpegDecoder decoder;
  YuvImage image;
  if (auto ok = LoadColor(file, decoder, image); !ok) return tl::unexpected(ok.error());
  return image.y;
}

const std::optional<std::filesystem::path>& PictureOf(const BoardView& view, const std::string& camera) {
  return camera == kColorName ? view.color : camera == kDepthName ? view.amplitude : view.fisheye;
}

std::optional<std::size_t> CameraNamed(const BoardScene& scene, const std::string& name) {
  for (std::size_t c = 0; c < scene.cameras.size(); ++c) {
    if (scene.cameras[c].name == name) return c;
  }
  return std::nullopt;
}

Result<DetectedViews> DetectViews(const std::vector<ViewFolder>& folders, const NominalRig& nominal,
                                  const std::function<void(std::size_t, std::size_t)>& progress) {
  DetectedViews detected;
  std::vector<Picture> pictures;
  std::vector<std::size_t> folder_of_view;
  for (std::size_t f = 0; f < folders.size(); ++f) {
    detected.views.insert(detected.views.end(), folders[f].views.begin(), folders[f].views.end());
    folder_of_view.resize(detected.views.size(), f);
  }
  for (const char* name : {kColorName, kDepthName, kFisheyeName}) {
    // A registered depth camera is the colour camera.
    if (std::string(name) == kDepthName && nominal.given && nominal.rig.registered) continue;
    const std::size_t camera = detected.scene.cameras.size();
    bool known = false;
    for (std::size_t v = 0; v < detected.views.size(); ++v) {
      const auto& file = PictureOf(detected.views[v], name);
      if (!file) continue;
      if (!known) {
        auto size = ReadColorSize(*file);
        if (!size) {
          detected.notes.push_back({file->string(), size.error().message});
          continue;
        }
        known = true;
        SceneCamera c;
        c.name = name;
        c.lens = NominalLens(name, nominal, size->width, size->height);
        detected.scene.cameras.push_back(std::move(c));
      }
      pictures.push_back({camera, v, folder_of_view[v], *file, {}, {}});
    }
  }
  if (pictures.empty()) return Fail(ErrorCode::kBadInput, "no picture of any view can be read");

  std::atomic<std::size_t> next = 0;
  std::size_t done = 0;
  std::mutex one_at_a_time;
  auto work = [&] {
    for (std::size_t i = next++; i < pictures.size(); i = next++) {
      Search(pictures[i], detected.scene.cameras[pictures[i].camera].lens,
             folders[pictures[i].folder].boards);
      const std::lock_guard lock(one_at_a_time);
      progress(++done, pictures.size());
    }
  };
  {
    std::vector<std::jthread> threads;
    for (unsigned t = 0; t < std::max(1u, std::thread::hardware_concurrency()); ++t)
      threads.emplace_back(work);
  }
  for (const Picture& p : pictures) {
    if (!p.error.empty()) {
      detected.notes.push_back({p.file.string(), p.error});
      continue;
    }
    if (p.found.empty()) detected.notes.push_back({p.file.string(), "no whole board found"});
    for (BoardSighting s : p.found) {
      s.board = SceneBoard(detected.scene, folders[p.folder].boards[s.board]);
      const std::size_t placement = PlacementOf(detected.scene, detected.views[p.view].name, p.view, s.board);
      detected.scene.sightings.push_back({p.camera, placement, std::move(s), p.file.string(), "", 0});
    }
  }
  if (std::all_of(pictures.begin(), pictures.end(), [](const Picture& p) { return !p.error.empty(); }))
    return Fail(ErrorCode::kBadInput, pictures.front().file.string() + ": " + pictures.front().error +
                                          " (no picture of any view can be used)");
  LeaveOutBlurred(detected.scene, detected.notes);
  return detected;
}

}  // namespace mixstage
