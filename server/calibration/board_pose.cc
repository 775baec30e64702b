// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/board_pose.h"

#include <cmath>
#include <opencv2/calib3d.hpp>

namespace mixstage {

std::optional<RigidTransform> PoseOfBoard(const Lens& lens, const Board& board,
                                          const BoardSighting& sighting) {
  if (sighting.corners.size() < 6) return std::nullopt;
  std::vector<Eigen::Vector3d> rays;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector2d& p : sighting.pixels) {
    const auto ray = lens.Unproject(p);
    if (!ray) return std::nullopt;
    rays.push_back(*ray);
    mean += *ray;
  }
  if (!(mean.norm() > 1e-6)) return std::nullopt;
  const Eigen::Matrix3d turn =
      Eigen::Quaterniond::FromTwoVectors(mean.normalized(), Eigen::Vector3d::UnitZ()).toRotationMatrix();
  std::vector<cv::Point3d> points;
  std::vector<cv::Point2d> normalised;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const Eigen::Vector3d r = turn * rays[i];
    if (r.z() < std::cos(75 * CV_PI / 180)) return std::nullopt;
    const Eigen::Vector3d corner = board.Corner(sighting.corners[i]);
    points.emplace_back(corner.x(), corner.y(), 0);
    normalised.emplace_back(r.x() / r.z(), r.y() / r.z());
  }
  cv::Mat rotation_vector;
  cv::Mat translation;
  cv::Matx33d rotation;
  try {
    if (!cv::solvePnP(points, normalised, cv::Matx33d::eye(), cv::noArray(), rotation_vector, translation,
                      false, cv::SOLVEPNP_IPPE) ||
        !cv::solvePnP(points, normalised, cv::Matx33d::eye(), cv::noArray(), rotation_vector, translation,
                      true, cv::SOLVEPNP_ITERATIVE)) {
      return std::nullopt;
    }
    cv::Rodrigues(rotation_vector, rotation);
  } catch (const cv::Exception&) {
    return std::nullopt;  // degenerate corners
  }
  RigidTransform T = RigidTransform::Identity();
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) T.linear()(r, c) = rotation(r, c);
    T.translation()(r) = translation.at<double>(r);
  }
  if (!T.matrix().allFinite() || T.translation().z() <= 0) return std::nullopt;
  RigidTransform back = RigidTransform::Identity();
  back.linear() = turn.transpose();
  return back * T;
}

}  // namespace mixstage
