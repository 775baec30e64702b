// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/scene_start.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "server/calibration/board_order.h"
#include "server/calibration/board_pose.h"

namespace mixstage {
namespace {

// T_camera_board of every sighting by itself.
using OwnPoses = std::vector<std::optional<RigidTransform>>;

RigidTransform TurnedUpsideDown(const RigidTransform& T_camera_board, const Board& board) {
  RigidTransform half_turn = RigidTransform::Identity();
  half_turn.linear() = Eigen::Vector3d(-1, -1, 1).asDiagonal();
  half_turn.translation() = board.Corner(board.corners() - 1);
  return T_camera_board * half_turn;
}

// Median distance, px, of a sighting's corners from where T_camera_board puts them.
double MedianDistance(const BoardScene& scene, const SceneSighting& s, const RigidTransform& T_camera_board) {
  const Board& board = scene.boards[scene.placements[s.placement].board];
  std::vector<double> distances;
  for (std::size_t i = 0; i < s.corners.corners.size(); ++i) {
    const auto p = scene.cameras[s.camera].lens.Project(T_camera_board * board.Corner(s.corners.corners[i]));
    distances.push_back(p ? (*p - s.corners.pixels[i]).norm() : 1e6);
  }
  std::nth_element(distances.begin(), distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2),
                   distances.end());
  return distances[distances.size() / 2];
}

// A board's sighting by an unposed camera beside its pose in the first camera's frame.
struct Link {
  std::size_t sighting = 0;
  RigidTransform T_first_board;
  RigidTransform T_camera_board;  // as the unposed camera sees it
};

// How well T_first_camera explains the links: the sum of their distances, each capped.
double Disagreement(const BoardScene& scene, const std::vector<Link>& links,
                    const RigidTransform& T_first_camera) {
  double sum = 0;
  for (const Link& link : links) {
    const SceneSighting& s = scene.sightings[link.sighting];
    const Board& board = scene.boards[scene.placements[s.placement].board];
    const RigidTransform T = T_first_camera.inverse() * link.T_first_board;
    double d = MedianDistance(scene, s, T);
    if (board.LooksTheSameUpsideDown()) d = std::min(d, MedianDistance(scene, s, TurnedUpsideDown(T, board)));
    sum += std::min(d, 0.05 * scene.cameras[s.camera].lens.width);
  }
  return sum;
}

// Where a posed camera has seen a placement, the placement gets its pose from the sharpest look at it.
void PosePlacements(BoardScene& scene, const OwnPoses& own) {
  for (std::size_t p = 0; p < scene.placements.size(); ++p) {
    if (scene.placements[p].T_first_board) continue;
    double best = -1;
    for (std::size_t i = 0; i < scene.sightings.size(); ++i) {
      const SceneSighting& s = scene.sightings[i];
      const auto& T_first_camera = scene.cameras[s.camera].T_first_camera;
      if (s.placement != p || !s.left_out.empty() || !own[i] || !T_first_camera) continue;
      const double weight = s.corners.square_px * std::sqrt(static_cast<double>(s.corners.corners.size()));
      if (weight <= best) continue;
      best = weight;
      scene.placements[p].T_first_board = *T_first_camera * *own[i];
    }
  }
}

// Sightings of boards that look the same upside down follow the placement's pose.
void TurnToAgree(BoardScene& scene, std::size_t camera) {
  for (SceneSighting& s : scene.sightings) {
    const Placement& placement = scene.placements[s.placement];
    const Board& board = scene.boards[placement.board];
    if (s.camera != camera || !placement.T_first_board || !board.LooksTheSameUpsideDown() ||
        static_cast<int>(s.corners.corners.size()) != board.corners()) {
      continue;
    }
    const RigidTransform T = scene.TCameraBoard(camera, s.placement);
    if (MedianDistance(scene, s, TurnedUpsideDown(T, board)) < MedianDistance(scene, s, T))
      TurnUpsideDown(s.corners.pixels);
  }
}

}  // namespace

std::vector<std::string> StartPoses(BoardScene& scene) {
  OwnPoses own;
  for (SceneSighting& s : scene.sightings) {
    own.push_back(PoseOfBoard(scene.cameras[s.camera].lens, scene.boards[scene.placements[s.placement].board],
                              s.corners));
    if (!own.back() && s.left_out.empty()) s.left_out = "no pose of the board explains its corners";
  }
  for (SceneCamera& c : scene.cameras) c.T_first_camera.reset();
  for (Placement& p : scene.placements) p.T_first_board.reset();
  scene.cameras[0].T_first_camera = RigidTransform::Identity();
  while (true) {
    PosePlacements(scene, own);
    // The unposed camera with the most boards whose place is known comes next.
    std::map<std::size_t, std::vector<Link>> links;
    for (std::size_t i = 0; i < scene.sightings.size(); ++i) {
      const SceneSighting& s = scene.sightings[i];
      const auto& T_first_board = scene.placements[s.placement].T_first_board;
      if (scene.cameras[s.camera].T_first_camera || !s.left_out.empty() || !own[i] || !T_first_board)
        continue;
      links[s.camera].push_back({i, *T_first_board, *own[i]});
    }
    if (links.empty()) break;
    const auto next = std::max_element(links.begin(), links.end(), [](const auto& a, const auto& b) {
      return a.second.size() < b.second.size();
    });
    double best = std::numeric_limits<double>::infinity();
    std::optional<RigidTransform> T_best;
    for (const Link& link : next->second) {
      const Board& board = scene.boards[scene.placements[scene.sightings[link.sighting].placement].board];
      std::vector<RigidTransform> candidates = {link.T_first_board * link.T_camera_board.inverse()};
      if (board.LooksTheSameUpsideDown())
        candidates.push_back(link.T_first_board * TurnedUpsideDown(link.T_camera_board, board).inverse());
      for (const RigidTransform& T : candidates) {
        const double d = Disagreement(scene, next->second, T);
        if (d < best) {
          best = d;
          T_best = T;
        }
      }
    }
    scene.cameras[next->first].T_first_camera = T_best;
    TurnToAgree(scene, next->first);
    // A turned sighting's own pose is not its placement's; it is no longer needed: the placement has one.
  }
  std::vector<std::string> alone;
  for (const SceneCamera& c : scene.cameras) {
    if (!c.T_first_camera) alone.push_back(c.name);
  }
  return alone;
}

}  // namespace mixstage
