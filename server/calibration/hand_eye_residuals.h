// SPDX-License-Identifier: Apache-2.0
//
// Residuals of the hand-eye adjustment, for Ceres to differentiate: corners seen by a camera on a head or a
// hand, and what is expected of each number. Private to hand_eye_adjustment.cc.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <vector>

#include "server/calibration/hand_eye_adjustment.h"

namespace mixstage::hand_eye {

template <typename T>
struct Rigid {
  Eigen::Quaternion<T> q;
  Eigen::Matrix<T, 3, 1> t;

  Rigid operator*(const Rigid& b) const { return {q * b.q, q * b.t + t}; }
  Eigen::Matrix<T, 3, 1> operator*(const Eigen::Matrix<T, 3, 1>& p) const { return q * p + t; }
  [[nodiscard]] Rigid Inverse() const { return {q.conjugate(), -(q.conjugate() * t)}; }
};

template <typename T>
Rigid<T> Constant(const RigidTransform& transform) {
  return {Eigen::Quaterniond(transform.linear()).cast<T>(), transform.translation().cast<T>()};
}

// How a pan-tilt head and a robot's hand stand in a view.
struct PanTiltMotion {
  static constexpr int kMechanism = 4, kCorrection = 2;
  double pan_rad, tilt_rad;

  template <typename T>
  Rigid<T> operator()(const T* mechanism, const T* correction) const {
    const T pan = mechanism[2] * pan_rad + correction[0], tilt = mechanism[3] * tilt_rad + correction[1];
    const Eigen::Matrix<T, 3, 1> axis(T(0), -cos(mechanism[1]), sin(mechanism[1])),
        point(mechanism[0], T(0), T(0));
    const T half_pan = 0.5 * pan, half_tilt = 0.5 * tilt, s = sin(half_tilt);
    const Eigen::Quaternion<T> turn(cos(half_tilt), s * axis[0], s * axis[1], s * axis[2]);
    const Rigid<T> about_pan{{cos(half_pan), T(0), T(0), sin(half_pan)}, Eigen::Matrix<T, 3, 1>::Zero()};
    return about_pan * Rigid<T>{turn, point - turn * point};
  }
};

struct RobotMotion {
  static constexpr int kMechanism = 1, kCorrection = 6;  // no mechanism: a constant
  RigidTransform T_base_hand;

  template <typename T>
  Rigid<T> operator()(const T*, const T* correction) const {
    Eigen::Quaternion<T> turn(T(1), 0.5 * correction[0], 0.5 * correction[1], 0.5 * correction[2]);
    turn.normalize();
    return Constant<T>(T_base_hand) * Rigid<T>{turn, {correction[3], correction[4], correction[5]}};
  }
};

template <typename T>
Eigen::Matrix<T, 2, 1> Pixel(LensKind kind, const T* numbers, const Eigen::Matrix<T, 3, 1>& p) {
  Eigen::Matrix<T, 2, 1> pixel;
  ProjectThrough(kind, numbers, p.data(), pixel.data());
  return pixel;
}

// All corners of a board in a picture: the chain of transforms is walked once for them.
template <typename Motion>
struct SightingResidual {
  Motion motion;
  const HandEyeAdjustment::Camera* camera;
  const HandEyeAdjustment::Sighting* sighting;
  const std::vector<double>* weights;  // of the corners

  template <typename T>
  bool operator()(const T* mechanism, const T* correction, const T* mount_q, const T* mount_t,
                  const T* board_q, const T* board_t, const T* lens, T* residual) const {
    using Turn = Eigen::Map<const Eigen::Quaternion<T>>;
    using Move = Eigen::Map<const Eigen::Matrix<T, 3, 1>>;
    const Rigid<T> T_hand_color{Turn(mount_q), Move(mount_t)}, T_base_board{Turn(board_q), Move(board_t)};
    const Rigid<T> T_camera_board = Constant<T>(camera->T_camera_color) *
                                    (motion(mechanism, correction) * T_hand_color).Inverse() * T_base_board;
    const Eigen::Matrix<T, 3, 3> R = T_camera_board.q.toRotationMatrix();
    for (std::size_t i = 0; i < sighting->pixels.size(); ++i) {
      const Eigen::Vector3d& c = sighting->p_board[i];  // z = 0
      const Eigen::Matrix<T, 3, 1> p = R.col(0) * c.x() + R.col(1) * c.y() + T_camera_board.t;
      if (camera->lens.kind == LensKind::kPinhole && p[2] < 1e-3) return false;
      const Eigen::Matrix<T, 2, 1> off =
          Pixel<T>(camera->lens.kind, lens, p) - sighting->pixels[i].template cast<T>();
      residual[2 * i] = off[0] * ((*weights)[i] / camera->noise_px);
      residual[2 * i + 1] = off[1] * ((*weights)[i] / camera->noise_px);
    }
    return true;
  }
};

// What is expected of a block, a number at a time.
struct Expectation {
  Eigen::VectorXd mean, sd;

  template <typename T>
  bool operator()(T const* const* block, T* residual) const {
    for (Eigen::Index i = 0; i < mean.size(); ++i) residual[i] = (block[0][i] - mean[i]) / sd[i];
    return true;
  }
};

struct RotationExpectation {
  Eigen::Quaterniond mean;
  double sd;

  template <typename T>
  bool operator()(const T* q, T* residual) const {
    const Eigen::Quaternion<T> off = Eigen::Map<const Eigen::Quaternion<T>>(q) * mean.conjugate().cast<T>();
    Eigen::Map<Eigen::Matrix<T, 3, 1>> r(residual);
    r = off.vec() * (2.0 * (off.w() < 0.0 ? -1.0 : 1.0) / sd);
    return true;
  }
};

// The calibration's word on the numbers that it estimated.
struct LensExpectation {
  std::array<double, kLensNumbers> mean;
  std::vector<int> known;
  Eigen::MatrixXd L;  // of the covariance, L L^T

  template <typename T>
  bool operator()(T const* const* lens, T* residual) const {
    for (std::size_t i = 0; i < known.size(); ++i) {
      const auto number = static_cast<std::size_t>(known[i]);
      residual[i] = lens[0][number] - mean[number];
      for (std::size_t k = 0; k < i; ++k)
        residual[i] -= L(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) * residual[k];
      residual[i] /= L(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(i));
    }
    return true;
  }
};

}  // namespace mixstage::hand_eye
