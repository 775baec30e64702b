// SPDX-License-Identifier: Apache-2.0
#include "proto/geometry/rig.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "proto/base/file_bytes.h"
#include "proto/geometry/json_fields.h"

namespace mixstage {
namespace {

using Json = nlohmann::json;
using Fields = JsonFields;

constexpr std::uintmax_t kMaxRigBytes = 16 << 20;  // three lists of 100,000 numbers each, written out

template <typename Camera>
Status Checked(const Camera& camera, const Fields& fields) {
  if (auto ok = camera.Validate(); !ok) {
    return Fail(ErrorCode::kBadInput, fields.path() + "." + ok.error().message);
  }
  return {};
}

Status ReadModelName(Fields& f, const char* expected) {
  if (!f.Has("model")) return {};
  if (!f.Raw("model").is_string() || f.Raw("model").get<std::string>() != expected) {
    return f.Bad("model", std::string("is not \"") + expected + "\"");
  }
  return {};
}

Status ReadPinhole(Fields& f, PinholeCamera& c) {
  return All({ReadModelName(f, "pinhole"), f.Integer("width", c.width), f.Integer("height", c.height),
              f.Number("fx", c.fx), f.Number("fy", c.fy), f.Number("cx", c.cx), f.Number("cy", c.cy),
              f.Number("k1", c.k1), f.Number("k2", c.k2), f.Number("p1", c.p1), f.Number("p2", c.p2),
              f.Number("k3", c.k3), f.Number("k4", c.k4), f.Number("k5", c.k5), f.Number("k6", c.k6)});
}

Status ReadColor(Fields& f, Rig& rig) {
  std::array<double, 2> vignetting{};
  bool present = false;
  if (auto ok = All({ReadPinhole(f, rig.color), f.Numbers("vignetting", vignetting, present)}); !ok)
    return ok;
  rig.vignetting_a = vignetting[0];
  rig.vignetting_b = vignetting[1];
  return Checked(rig.color, f);
}

Status ReadCurve(Fields& f, const char* key, std::vector<double>& values) {
  if (!f.Has(key)) return {};
  const Json& j = f.Raw(key);
  if (!j.is_array() || j.size() > 100'000) return f.Bad(key, "is not a list of at most 100000 numbers");
  for (const Json& v : j) {
    if (!v.is_number() || !std::isfinite(v.get<double>()))
      return f.Bad(key, "has a number that is not finite");
    values.push_back(v.get<double>());
  }
  return {};
}

// Linear between points, constant outside; 0 without any.
double Between(const std::vector<double>& at, const std::vector<double>& values, double x) {
  if (values.empty()) return 0;
  const auto above = std::upper_bound(at.begin(), at.end(), x);
  if (above == at.begin()) return values.front();
  if (above == at.end()) return values.back();
  const auto i = static_cast<std::size_t>(above - at.begin());
  const double t = (x - at[i - 1]) / (at[i] - at[i - 1]);
  return values[i - 1] + t * (values[i] - values[i - 1]);
}

Status ReadRangeError(Fields& f, RangeError& curve) {
  if (auto ok = All({ReadCurve(f, "range_m", curve.range_m), ReadCurve(f, "error_m", curve.error_m),
                     ReadCurve(f, "std_m", curve.std_m)});
      !ok)
    return ok;
  if (curve.range_m.size() != curve.error_m.size())
    return f.Bad("error_m", "has not as many numbers as range_m");
  if (!curve.std_m.empty() && curve.std_m.size() != curve.range_m.size())
    return f.Bad("std_m", "has not as many numbers as range_m");
  for (const double s : curve.std_m)
    if (s < 0) return f.Bad("std_m", "has a number below 0");
  for (std::size_t i = 1; i < curve.range_m.size(); ++i) {
    if (!(curve.range_m[i] > curve.range_m[i - 1])) return f.Bad("range_m", "does not rise");
    if (!(std::abs(curve.error_m[i] - curve.error_m[i - 1]) <
          0.9 * (curve.range_m[i] - curve.range_m[i - 1]))) {
      return f.Bad("error_m", "changes so fast that a reported range has no single true range");
    }
  }
  return {};
}

Status ReadDepth(Fields& f, Rig& rig) {
  DepthCamera depth;
  if (auto ok = ReadPinhole(f, depth.camera); !ok) return ok;
  if (f.Has("measures")) {
    const Json& j = f.Raw("measures");
    const std::string measures = j.is_string() ? j.get<std::string>() : "";
    if (measures != "range" && measures != "z") return f.Bad("measures", "is neither \"range\" nor \"z\"");
    depth.measures = measures == "range" ? DepthMeasure::kRange : DepthMeasure::kZ;
  }
  if (auto ok = f.Number("unit_m", depth.unit_m); !ok) return ok;
  if (!(depth.unit_m > 0 && depth.unit_m <= 1)) return f.Bad("unit_m", "is outside 0..1 m per count");
  if (f.Has("unambiguous_range_m") && !f.Raw("unambiguous_range_m").is_null()) {
    double wrap = 0;
    if (auto ok = f.Number("unambiguous_range_m", wrap); !ok) return ok;
    if (!(wrap > 0)) return f.Bad("unambiguous_range_m", "must be > 0 m");
    depth.unambiguous_range_m = wrap;
  }
  if (auto ok =
          f.Object("range_error", [&](Fields& inner) { return ReadRangeError(inner, depth.range_error); });
      !ok) {
    return ok;
  }
  // A registered rig needs only depth.unit_m: its depth picture has the colour camera's geometry.
  const bool geometry_given = depth.camera.width != 0 || depth.camera.fx != 0;
  if (!geometry_given && rig.registered) {
    depth.camera = rig.color;
    depth.measures = DepthMeasure::kZ;
  }
  if (auto ok = Checked(depth.camera, f); !ok) return ok;
  rig.depth = std::move(depth);
  return {};
}

Status ReadFisheye(Fields& f, Rig& rig) {
  FisheyeCamera c;
  double max_angle_deg = 95;
  if (auto ok = All({ReadModelName(f, "kannala_brandt"), f.Integer("width", c.width),
                     f.Integer("height", c.height), f.Number("fx", c.fx), f.Number("fy", c.fy),
                     f.Number("cx", c.cx), f.Number("cy", c.cy), f.Number("k1", c.k1), f.Number("k2", c.k2),
                     f.Number("k3", c.k3), f.Number("k4", c.k4), f.Number("max_angle_deg", max_angle_deg)});
      !ok) {
    return ok;
  }
  c.max_angle_rad = max_angle_deg * std::numbers::pi / 180.0;
  if (auto ok = Checked(c, f); !ok) return ok;
  rig.fisheye = c;
  return {};
}

Status ReadAxis(Fields& f, PanTilt::Axis& axis) {
  std::array<double, 3> direction{0, 0, 1};
  std::array<double, 3> point{};
  bool has_direction = false;
  bool has_point = false;
  if (auto ok = All({f.Numbers("direction", direction, has_direction), f.Numbers("point", point, has_point)});
      !ok) {
    return ok;
  }
  const Eigen::Vector3d d(direction[0], direction[1], direction[2]);
  if (!(d.norm() > 1e-6)) return f.Bad("direction", "has length 0");
  axis.direction = d.normalized();
  axis.point = Eigen::Vector3d(point[0], point[1], point[2]);
  return {};
}

Status ReadPtu(Fields& f, Rig& rig) {
  PanTilt ptu;
  double encoder_noise_deg = 0;
  auto encoder = [&](Fields& e) {
    return All({e.Number("pan_scale", ptu.pan_scale), e.Number("pan_offset_deg", ptu.pan_offset_deg),
                e.Number("tilt_scale", ptu.tilt_scale), e.Number("tilt_offset_deg", ptu.tilt_offset_deg)});
  };
  ptu.tilt_axis.direction = -Eigen::Vector3d::UnitY();
  if (auto ok = All({f.Object("pan_axis", [&](Fields& a) { return ReadAxis(a, ptu.pan_axis); }),
                     f.Object("tilt_axis", [&](Fields& a) { return ReadAxis(a, ptu.tilt_axis); }),
                     f.Rigid("T_tilt_color", ptu.T_tilt_color), f.Rigid("T_world_base", ptu.T_world_base),
                     f.Object("encoder", encoder), f.Number("encoder_noise_deg", encoder_noise_deg)});
      !ok) {
    return ok;
  }
  rig.ptu = ptu;
  return {};
}

}  // namespace

double RangeError::At(double range) const { return Between(range_m, error_m, range); }
double RangeError::StdAt(double range) const { return Between(range_m, std_m, range); }

double RangeError::TrueRange(double reported) const {
  // |error'| < 0.9 is checked on reading, so this contracts.
  double range = reported;
  for (int i = 0; i < 60; ++i) {
    const double next = reported - At(range);
    if (std::abs(next - range) < 1e-7) return next;
    range = next;
  }
  return range;
}

RigidTransform PanTilt::TWorldColor(double pan_deg, double tilt_deg) const {
  auto about = [](const Axis& axis, double angle_rad) {
    RigidTransform T = RigidTransform::Identity();
    T.linear() = Eigen::AngleAxisd(angle_rad, axis.direction).toRotationMatrix();
    T.translation() = axis.point - T.linear() * axis.point;
    return T;
  };
  constexpr double kRadPerDeg = std::numbers::pi / 180.0;
  return T_world_base * about(pan_axis, (pan_scale * pan_deg + pan_offset_deg) * kRadPerDeg) *
         about(tilt_axis, (tilt_scale * tilt_deg + tilt_offset_deg) * kRadPerDeg) * T_tilt_color;
}

Result<LoadedRig> ParseRig(const std::string& text) {
  const Json root = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (root.is_discarded() || !root.is_object()) return Fail(ErrorCode::kBadInput, "is not a JSON object");
  LoadedRig loaded;
  Rig& rig = loaded.rig;
  Fields f(root, "", loaded.warnings);
  int version = 1;
  if (auto ok = f.Integer("version", version); !ok) return tl::unexpected(ok.error());
  if (version != 1) return Fail(ErrorCode::kBadInput, "version " + std::to_string(version) + " is not 1");
  if (f.Has("registered")) {
    if (!f.Raw("registered").is_boolean())
      return Fail(ErrorCode::kBadInput, "registered is not true or false");
    rig.registered = f.Raw("registered").get<bool>();
  }
  (void)f.Has("note");
  (void)f.Has("rates_hz");
  if (!f.Has("cameras") || !root.at("cameras").is_object() || !root.at("cameras").contains("color")) {
    return Fail(ErrorCode::kBadInput, "cameras.color is missing");
  }
  auto cameras = [&](Fields& c) {
    return All({c.Object("color", [&](Fields& i) { return ReadColor(i, rig); }),
                c.Object("depth", [&](Fields& i) { return ReadDepth(i, rig); }),
                c.Object("fisheye", [&](Fields& i) { return ReadFisheye(i, rig); })});
  };
  auto offsets = [&](Fields& o) {
    return All({o.Number("depth", rig.depth_time_offset_s), o.Number("fisheye", rig.fisheye_time_offset_s)});
  };
  if (auto ok = All({f.Object("cameras", cameras), f.Rigid("T_color_depth", rig.T_color_depth),
                     f.Rigid("T_color_fisheye", rig.T_color_fisheye), f.Object("time_offset_s", offsets),
                     f.Object("ptu", [&](Fields& p) { return ReadPtu(p, rig); })});
      !ok) {
    return tl::unexpected(ok.error());
  }
  f.WarnOfUnknown();
  return loaded;
}

Result<LoadedRig> LoadRig(const std::filesystem::path& file) {
  auto bytes = ReadFileBytes(file, kMaxRigBytes);
  if (!bytes) return Within(file.string(), bytes.error());
  auto rig = ParseRig(std::string(bytes->begin(), bytes->end()));
  if (!rig) return Within(file.string(), rig.error());
  return rig;
}

Rig AssumedRig(int width, int height, double depth_unit_m) {
  Rig rig;
  rig.color.width = width;
  rig.color.height = height;
  rig.color.fx = rig.color.fy = 0.9 * width;
  rig.color.cx = 0.5 * (width - 1);
  rig.color.cy = 0.5 * (height - 1);
  rig.registered = true;
  DepthCamera depth;
  depth.camera = rig.color;
  depth.measures = DepthMeasure::kZ;
  depth.unit_m = depth_unit_m;
  rig.depth = depth;
  return rig;
}

}  // namespace mixstage
