// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/figure.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "proto/base/check.h"

namespace mixstage {
namespace {

using Eigen::AngleAxisd;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::Vector3f;
constexpr double kPi = std::numbers::pi;

// Lengths of a man of 1.80 m.
constexpr double kThigh = 0.445, kShin = 0.43, kAnkle = 0.085, kHipHalf = 0.088, kPelvisZ = 0.965;
constexpr double kUpperArm = 0.285, kForearm = 0.25, kShoulderHalf = 0.178;
constexpr double kBall = 0.125, kHeel = 0.055;  // ankle to ball of the foot, to the heel's contact

struct Cloth {
  Vector3f albedo;
  float infrared;
};
const Cloth kShirt{{0.150f, 0.245f, 0.385f}, 0.62f};
const Cloth kCollar{{0.185f, 0.290f, 0.430f}, 0.62f};
const Cloth kTrousers{{0.082f, 0.076f, 0.072f}, 0.48f};
const Cloth kSkin{{0.520f, 0.300f, 0.205f}, 0.58f};
const Cloth kLips{{0.400f, 0.170f, 0.130f}, 0.55f};
const Cloth kHair{{0.040f, 0.023f, 0.014f}, 0.28f};
const Cloth kShoe{{0.580f, 0.560f, 0.530f}, 0.60f};
const Cloth kSole{{0.330f, 0.215f, 0.130f}, 0.45f};
const Cloth kEye{{0.020f, 0.016f, 0.014f}, 0.30f};

class Body {
 public:
  Body(const WalkState& state, Figure& figure) : s_(state), figure_(figure) { figure_.count = 0; }

  void Build() {
    const double stepping = std::cos(kPi * s_.phase) * s_.stride;
    const double breath = 0.004 * std::sin(2 * kPi * s_.phase) * s_.stride;
    const Matrix3d upright = AngleAxisd(s_.yaw_rad, Vector3d::UnitZ()).toRotationMatrix();
    const double sway = -0.024 * s_.stride * std::sin(kPi * s_.phase);
    const double rise = -0.020 * s_.stride * (1 + std::cos(2 * kPi * s_.phase)) * 0.5;
    const Vector3d middle(s_.body.x(), s_.body.y(), kPelvisZ + rise - 0.010 * s_.stride);
    pelvis_ = middle + upright * Vector3d(0, sway, 0);
    const double roll = 0.035 * s_.stride * std::sin(kPi * s_.phase);
    hips_ = upright * AngleAxisd(0.10 * stepping, Vector3d::UnitZ()) * AngleAxisd(roll, Vector3d::UnitX());
    chest_ = upright * AngleAxisd(-0.12 * stepping, Vector3d::UnitZ()) *
             AngleAxisd(0.035 * s_.stride + breath, Vector3d::UnitY()) *
             AngleAxisd(-0.6 * roll + 0.05 * s_.present - 0.03 * s_.wave, Vector3d::UnitX());
    Legs();
    Torso();
    Arms(stepping);
    Head(upright);
  }

 private:
  void Add(const RoundCone& cone, const Cloth& cloth, Shadowing shadowing = Shadowing::kNone) {
    MIX_CHECK(figure_.count < Figure::kMaxParts);
    BodyPart& part = figure_.parts[static_cast<std::size_t>(figure_.count++)];
    part.cone = cone;
    part.albedo = cloth.albedo;
    part.infrared = cloth.infrared;
    part.shadowing = shadowing;
  }

  // The joint between a and b with bones of the given lengths, bent towards `bend`; b is pulled in where the
  // bones do not reach.
  static Vector3d Joint(const Vector3d& a, Vector3d& b, double first, double second, const Vector3d& bend) {
    Vector3d along = b - a;
    const double reach = 0.999 * (first + second);
    if (along.norm() > reach) b = a + reach * along.normalized();
    along = b - a;
    const double d = along.norm();
    const Vector3d axis = along / d;
    const double x = (d * d + first * first - second * second) / (2 * d);
    const double h = std::sqrt(std::max(0.0, first * first - x * x));
    return a + x * axis + h * (bend - bend.dot(axis) * axis).normalized();
  }

  void Legs() {
    for (const int i : {0, 1}) {
      const double side = i == 0 ? 1 : -1;
      const FootPose& foot = s_.foot[i];
      const Vector3d hip = pelvis_ + hips_ * Vector3d(0, side * kHipHalf, -0.03);
      const Matrix3d yaw = AngleAxisd(foot.yaw_rad, Vector3d::UnitZ()).toRotationMatrix();
      const Vector3d forward = yaw.col(0);
      // Positive pitch: heel up, about the ball of the foot; negative: toes up, about the heel.
      const double ahead = (pelvis_ - foot.ankle_rest).dot(forward);
      double pitch = 0;
      if (foot.swing > 0) {
        pitch = s_.stride * (0.62 * std::pow(1 - foot.swing, 1.5) - 0.24 * std::pow(foot.swing, 3.0));
      } else {
        pitch = s_.stride * (0.62 * Ramp(ahead, 0.06, 0.28) - 0.24 * Ramp(-ahead, 0.10, 0.26));
      }
      const double pivot = pitch > 0 ? kBall : -kHeel;
      const Matrix3d sole = yaw * AngleAxisd(pitch, Vector3d::UnitY()).toRotationMatrix();
      const Vector3d contact =
          foot.ankle_rest + pivot * forward + Vector3d(0, 0, foot.lift * (0.035 + 0.055 * s_.stride));
      Vector3d ankle = contact + sole * Vector3d(-pivot, 0, kAnkle);
      const Vector3d across = yaw.col(1);
      auto at = [&](double x, double y, double z) {
        return Vector3d(ankle + sole * Vector3d(x, y, z - kAnkle));
      };
      auto sole_now = [&] {
        return MakeRoundCone(at(-0.038, 0, 0.017), at(0.140, 0, 0.017), 0.046, 0.045, across, 1.0, 0.37);
      };
      // Toes of one piece do not bend: where they would sink in, the foot stands on their tip.
      ankle.z() += std::max(0.0, -sole_now().Bounds().min().z());
      const Vector3d bend = (hips_.col(0) + 0.6 * forward + 0.12 * side * hips_.col(1)).normalized();
      const Vector3d knee = Joint(hip, ankle, kThigh, kShin, bend);
      Add(MakeRoundCone(hip + Vector3d(0, 0, 0.01), knee, 0.094, 0.062, across, 0.96, 1.06), kTrousers,
          Shadowing::kCasts);
      Add(MakeRoundCone(knee, ankle + 0.03 * (knee - ankle).normalized(), 0.062, 0.052, across, 1.0, 1.05),
          kTrousers, Shadowing::kCasts);
      const Vector3d calf = knee + 0.30 * (ankle - knee) - 0.014 * forward;
      Add(MakeRoundCone(calf, knee + 0.62 * (ankle - knee) - 0.006 * forward, 0.060, 0.053), kTrousers);
      // Shoe and sole.
      Add(MakeRoundCone(at(-0.035, 0, 0.055), at(0.130, 0, 0.040), 0.047, 0.037, across, 1.0, 1.0), kShoe,
          Shadowing::kCasts);
      Add(MakeRoundCone(at(-0.025, 0, 0.075), at(0.035, 0, 0.07), 0.044, 0.036), kShoe);
      Add(sole_now(), kSole);
    }
  }

  static double Ramp(double x, double from, double to) {
    const double t = std::clamp((x - from) / (to - from), 0.0, 1.0);
    return t * t * (3 - 2 * t);
  }

  void Torso() {
    const Vector3d left = hips_.col(1);
    const Vector3d chest_left = chest_.col(1);
    const Vector3d waist = pelvis_ + hips_ * Vector3d(0.004, 0, 0.115);
    const Vector3d ribs = waist + chest_ * Vector3d(0.008, 0, 0.14);
    neck_ = waist + chest_ * Vector3d(-0.010, 0, 0.390);
    shoulders_ = waist + chest_ * Vector3d(-0.006, 0, 0.322);
    Add(MakeRoundCone(pelvis_ + hips_ * Vector3d(-0.010, 0, -0.030), waist, 0.110, 0.106, left, 1.36, 1.0),
        kTrousers, Shadowing::kCasts);
    // The shirt hangs over the trousers: hem, waist, chest, and the yoke from shoulder to shoulder.
    Add(MakeRoundCone(pelvis_ + hips_ * Vector3d(-0.006, 0, 0.020), waist, 0.122, 0.113, left, 1.36, 1.0),
        kShirt);
    Add(MakeRoundCone(waist, ribs, 0.113, 0.120, chest_left, 1.35, 0.97), kShirt, Shadowing::kCasts);
    Add(MakeRoundCone(ribs, ribs + chest_ * Vector3d(-0.004, 0, 0.135), 0.121, 0.096, chest_left, 1.42, 0.98),
        kShirt, Shadowing::kCasts);
    for (const double side : {1.0, -1.0}) {
      Add(MakeRoundCone(neck_ + chest_ * Vector3d(-0.004, 0.026 * side, -0.030),
                        shoulders_ + chest_ * Vector3d(0, (kShoulderHalf - 0.022) * side, 0.004), 0.056,
                        0.069),
          kShirt, Shadowing::kCasts);
      Add(MakeRoundCone(ribs + chest_ * Vector3d(0, 0.075 * side, 0.060),
                        shoulders_ + chest_ * Vector3d(0.004, (kShoulderHalf - 0.045) * side, -0.020), 0.098,
                        0.074),
          kShirt);
    }
    Add(MakeRoundCone(neck_ + chest_ * Vector3d(0.008, 0, -0.014), neck_ + chest_ * Vector3d(0.012, 0, 0.014),
                      0.070, 0.061),
        kCollar);
    Add(MakeRoundCone(neck_ + Vector3d(0, 0, -0.02), neck_ + chest_ * Vector3d(0.018, 0, 0.085), 0.057,
                      0.053),
        kSkin);
  }

  void Arms(double stepping) {
    for (const int i : {0, 1}) {
      const double side = i == 0 ? 1 : -1;
      const double swing = side * 0.40 * stepping;  // the arm goes with the other leg
      const double raised = i == 1 ? s_.wave : 0.0;
      const double offered = i == 0 ? s_.present : 0.0;
      const double rest = 1 - raised - offered;
      // Directions of the two bones in the chest's frame (x forward, y left, z up), blended and made unit
      // again.
      const Vector3d hang(std::sin(swing), 0.13 * side, -std::cos(swing));
      const double bend = 0.22 + 0.10 * s_.stride + 0.42 * std::max(0.0, swing);
      const Vector3d low(std::sin(swing + bend), 0.02 * side, -std::cos(swing + bend));
      const Vector3d up_wave(0.30, 0.72 * side, 0.05);
      const Vector3d low_wave(0.34, side * (0.30 + std::sin(s_.wave_angle)), 1.0);
      const Vector3d up_offer(0.42, 0.60 * side, -0.58);
      const Vector3d low_offer(0.48, 0.86 * side, 0.10);
      const Vector3d upper =
          (rest * hang.normalized() + raised * up_wave.normalized() + offered * up_offer.normalized());
      const Vector3d lower =
          (rest * low.normalized() + raised * low_wave.normalized() + offered * low_offer.normalized());
      const Vector3d shoulder = shoulders_ + chest_ * Vector3d(0, kShoulderHalf * side, 0.02 * raised);
      const Vector3d elbow = shoulder + kUpperArm * (chest_ * upper.normalized());
      const Vector3d along = chest_ * lower.normalized();
      const Vector3d wrist = elbow + kForearm * along;
      Add(MakeRoundCone(shoulder, elbow, 0.063, 0.047), kShirt, Shadowing::kCasts);
      Add(MakeRoundCone(elbow, elbow + 0.42 * (wrist - elbow), 0.0475, 0.045), kShirt, Shadowing::kCasts);
      Add(MakeRoundCone(elbow + 0.36 * (wrist - elbow), wrist, 0.041, 0.029), kSkin, Shadowing::kCasts);
      // Hand: palm towards the body, or to the camera while he waves.
      const Vector3d palm = (rest * chest_.col(1) * -side + (raised + 0.4 * offered) * chest_.col(0) +
                             0.9 * offered * Vector3d::UnitZ())
                                .normalized();
      const Vector3d across = along.cross(palm).normalized();
      Add(MakeRoundCone(wrist + 0.028 * along, wrist + 0.085 * along, 0.032, 0.028, across, 1.25, 0.55),
          kSkin);
      Add(MakeRoundCone(wrist + 0.09 * along, wrist + 0.150 * along, 0.026, 0.017, across, 1.45, 0.55),
          kSkin);
      const double thumb = i == 0 ? 1 : -1;
      Add(MakeRoundCone(wrist + 0.03 * along - 0.022 * thumb * across,
                        wrist + 0.085 * along - 0.05 * thumb * across, 0.014, 0.010),
          kSkin);
    }
  }

  void Head(const Matrix3d& upright) {
    const double nod = 0.03 + 0.012 * s_.stride * std::cos(2 * kPi * s_.phase);
    const Matrix3d turn = upright * AngleAxisd(s_.look_yaw_rad, Vector3d::UnitZ()) *
                          AngleAxisd(nod, Vector3d::UnitY()) * AngleAxisd(-0.06 * s_.wave, Vector3d::UnitX());
    const Vector3d base = neck_ + chest_ * Vector3d(0.022, 0, 0.082);
    auto at = [&](double x, double y, double z) { return Vector3d(base + turn * Vector3d(x, y, z)); };
    const Vector3d left = turn.col(1);
    auto ellipsoid = [&](const Vector3d& center, double x, double y, double z, const Cloth& cloth,
                         Shadowing shadowing = Shadowing::kNone) {
      Add(MakeEllipsoid(center, turn, {x, y, z}), cloth, shadowing);
    };
    ellipsoid(at(0.000, 0, 0.105), 0.098, 0.079, 0.108, kSkin, Shadowing::kCasts);
    Add(MakeRoundCone(at(0.022, 0, 0.075), at(0.052, 0, 0.012), 0.066, 0.036, left, 0.98, 1.0),
        kSkin);  // jaw
    // Hair: a cap, fuller behind and on top, with a parting's quiff.
    ellipsoid(at(-0.020, 0, 0.130), 0.097, 0.087, 0.100, kHair);
    ellipsoid(at(-0.040, 0, 0.085), 0.072, 0.082, 0.085, kHair);
    ellipsoid(at(0.030, -0.012, 0.196), 0.066, 0.066, 0.030, kHair);
    for (const double side : {1.0, -1.0}) {
      ellipsoid(at(0.002, 0.079 * side, 0.088), 0.018, 0.010, 0.028, kSkin);  // ear
      ellipsoid(at(0.086, 0.033 * side, 0.112), 0.010, 0.012, 0.0075, kEye);  // eye
      Add(MakeRoundCone(at(0.088, 0.018 * side, 0.133), at(0.078, 0.048 * side, 0.134), 0.0065, 0.0050),
          kHair);  // brow
    }
    Add(MakeRoundCone(at(0.094, 0, 0.112), at(0.112, 0, 0.078), 0.009, 0.014), kSkin);  // nose
    Add(MakeRoundCone(at(0.081, 0.021, 0.046), at(0.081, -0.021, 0.046), 0.0075, 0.0075), kLips);
  }

  const WalkState& s_;
  Figure& figure_;
  Vector3d pelvis_, shoulders_, neck_;
  Matrix3d hips_, chest_;
};

}  // namespace

void PoseFigure(const WalkState& state, Figure& figure) { Body(state, figure).Build(); }

}  // namespace mixstage
