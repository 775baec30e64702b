// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/hand_eye_start.h"

#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

namespace mixstage {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180;
// Two rotations agree within what skewed axes, an encoder's scale and a board's pose by itself leave open.
constexpr double kAgreeRad = 1.5 * kRadPerDeg, kAgreeShare = 0.05;
constexpr int kDraws = 300;
constexpr double kGuessWeight = 1e-3;  // of the guess against a pair's rotation vector of 1 rad

struct Pair {
  std::size_t first, second;            // views
  std::size_t seen_first, seen_second;  // of `seen`
  Eigen::Vector3d hand, eye;            // rotation vectors of A and B: A X = X B
};

Eigen::Vector3d RotationVector(const Eigen::Matrix3d& R) {
  const Eigen::AngleAxisd turn(R);
  return turn.angle() * turn.axis();
}

double AngleOf(const Eigen::Matrix3d& R) { return Eigen::AngleAxisd(R).angle(); }

// R with R eye = hand over the pairs, the guess's axes as weak further pairs.
Eigen::Matrix3d SolveRotation(const std::vector<Pair>& pairs, const std::vector<bool>& good,
                              const Eigen::Matrix3d& guess) {
  Eigen::Matrix3d M = kGuessWeight * guess;
  for (const Pair& pair : pairs)
    if (good[pair.first] && good[pair.second]) M += pair.hand * pair.eye.transpose();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(M, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const double sign = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1;
  return svd.matrixU() * Eigen::Vector3d(1, 1, sign).asDiagonal() * svd.matrixV().transpose();
}

double Disagreement(const Pair& pair, const Eigen::Matrix3d& R) {
  auto turn = [](const Eigen::Vector3d& v) {
    const double angle = v.norm();
    return Eigen::AngleAxisd(angle, angle > 0 ? Eigen::Vector3d(v / angle) : Eigen::Vector3d::UnitX())
        .toRotationMatrix();
  };
  return AngleOf(turn(pair.hand).transpose() * turn(R * pair.eye)) /
         (kAgreeRad + kAgreeShare * pair.hand.norm());
}

}  // namespace

std::vector<bool> AgreeOnFirstCorner(const std::vector<RigidTransform>& T_base_hand,
                                     const std::vector<Board>& boards, std::vector<BoardInView>& seen) {
  std::vector<bool> turned(seen.size(), false);
  for (std::size_t b = 0; b < boards.size(); ++b) {
    const Board& board = boards[b];
    if (!board.LooksTheSameUpsideDown()) continue;
    const RigidTransform turn = Eigen::Translation3d(board.Corner(board.corners() - 1)) *
                                Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitZ());
    const BoardInView* reference = nullptr;
    for (std::size_t i = 0; i < seen.size(); ++i) {
      if (seen[i].board != b) continue;
      if (!reference) {
        reference = &seen[i];
        continue;
      }
      const double hand =
          AngleOf(T_base_hand[reference->view].linear().transpose() * T_base_hand[seen[i].view].linear());
      auto off = [&](const RigidTransform& T_color_board) {
        const Eigen::Matrix3d eye = reference->T_color_board.linear() * T_color_board.linear().transpose();
        return std::abs(AngleOf(eye) - hand);
      };
      const RigidTransform other = seen[i].T_color_board * turn;
      if (off(other) < off(seen[i].T_color_board)) {
        seen[i].T_color_board = other;
        turned[i] = true;
      }
    }
  }
  return turned;
}

std::optional<HandEyeStart> StartHandEye(const std::vector<RigidTransform>& T_base_hand,
                                         const std::vector<BoardInView>& seen, std::size_t board_count,
                                         const Eigen::Matrix3d& R_hand_color_guess) {
  std::vector<Pair> pairs;
  for (std::size_t i = 0; i < seen.size(); ++i)
    for (std::size_t k = i + 1; k < seen.size(); ++k) {
      if (seen[i].board != seen[k].board || seen[i].view == seen[k].view) continue;
      const Eigen::Matrix3d A =
          T_base_hand[seen[i].view].linear().transpose() * T_base_hand[seen[k].view].linear();
      const Eigen::Matrix3d B = seen[i].T_color_board.linear() * seen[k].T_color_board.linear().transpose();
      pairs.push_back({seen[i].view, seen[k].view, i, k, RotationVector(A), RotationVector(B)});
    }
  if (pairs.empty()) return std::nullopt;

  // Three views draw a rotation, all pairs vote on it.
  const std::size_t n = T_base_hand.size();
  std::mt19937 random(20);
  Eigen::Matrix3d R = R_hand_color_guess;
  double lowest = std::numeric_limits<double>::infinity();
  for (int draw = 0; draw < kDraws; ++draw) {
    std::vector<bool> drawn(n, draw == 0);     // the first: all views
    for (int k = 0; draw > 0 && k < 2; ++k) {  // two pairs, three or four views
      const Pair& pair = pairs[random() % pairs.size()];
      drawn[pair.first] = drawn[pair.second] = true;
    }
    const Eigen::Matrix3d candidate = SolveRotation(pairs, drawn, R_hand_color_guess);
    double cost = 0;
    for (const Pair& pair : pairs) cost += std::min(1.0, Disagreement(pair, candidate));
    if (cost < lowest) {
      lowest = cost;
      R = candidate;
    }
  }

  HandEyeStart start;
  for (int round = 0; round < 3; ++round) {
    std::vector<int> agreeing(n, 0), all(n, 0);
    int agree = 0;
    for (const Pair& pair : pairs) {
      const int fits = Disagreement(pair, R) < 1 ? 1 : 0;
      agree += fits;
      for (const std::size_t view : {pair.first, pair.second}) {
        agreeing[view] += fits;
        ++all[view];
      }
    }
    start.agreement = static_cast<double>(agree) / static_cast<double>(pairs.size());
    start.good.assign(n, false);
    for (std::size_t v = 0; v < n; ++v) start.good[v] = all[v] > 0 && 2 * agreeing[v] >= all[v];
    R = SolveRotation(pairs, start.good, R_hand_color_guess);
  }
  if (std::count(start.good.begin(), start.good.end(), true) < 3) return std::nullopt;

  // (R_A - I) t = R t_B - t_A; a weak 0 where the pairs leave t open.
  Eigen::Matrix3d normal = 1e-6 * Eigen::Matrix3d::Identity();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const Pair& pair : pairs) {
    if (!start.good[pair.first] || !start.good[pair.second]) continue;
    const RigidTransform A = T_base_hand[pair.first].inverse() * T_base_hand[pair.second];
    const RigidTransform B =
        seen[pair.seen_first].T_color_board * seen[pair.seen_second].T_color_board.inverse();
    const Eigen::Matrix3d J = A.linear() - Eigen::Matrix3d::Identity();
    normal += J.transpose() * J;
    right += J.transpose() * (R * B.translation() - A.translation());
  }
  start.T_hand_color.linear() = R;
  start.T_hand_color.translation() = normal.ldlt().solve(right);

  start.T_base_board.resize(board_count);
  for (std::size_t b = 0; b < board_count; ++b) {
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    Eigen::Vector3d place = Eigen::Vector3d::Zero();
    int count = 0;
    for (const BoardInView& one : seen) {
      if (one.board != b || !start.good[one.view]) continue;
      const RigidTransform T = T_base_hand[one.view] * start.T_hand_color * one.T_color_board;
      sum += T.linear();
      place += T.translation();
      ++count;
    }
    if (count == 0) continue;
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
    RigidTransform T = RigidTransform::Identity();
    T.linear() = svd.matrixU() * svd.matrixV().transpose();
    if (T.linear().determinant() < 0) continue;
    T.translation() = place / count;
    start.T_base_board[b] = T;
  }
  return start;
}

}  // namespace mixstage
