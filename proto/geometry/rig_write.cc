// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <nlohmann/json.hpp>
#include <numbers>

#include "proto/geometry/rig.h"

namespace mixstage {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kDegPerRad = 180.0 / std::numbers::pi;

Json RowMajor(const RigidTransform& T) {
  Json numbers = Json::array();
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) numbers.push_back(T.matrix()(row, column));
  }
  return numbers;
}

Json Numbers(const Eigen::Vector3d& v) { return Json::array({v.x(), v.y(), v.z()}); }

Json Pinhole(const PinholeCamera& c) {
  return {{"model", "pinhole"}, {"width", c.width}, {"height", c.height}, {"fx", c.fx}, {"fy", c.fy},
          {"cx", c.cx},         {"cy", c.cy},       {"k1", c.k1},         {"k2", c.k2}, {"p1", c.p1},
          {"p2", c.p2},         {"k3", c.k3},       {"k4", c.k4},         {"k5", c.k5}, {"k6", c.k6}};
}

Json Depth(const DepthCamera& depth) {
  Json json = Pinhole(depth.camera);
  json["measures"] = depth.measures == DepthMeasure::kRange ? "range" : "z";
  json["unit_m"] = depth.unit_m;
  if (depth.unambiguous_range_m) json["unambiguous_range_m"] = *depth.unambiguous_range_m;
  if (!depth.range_error.range_m.empty()) {
    json["range_error"] = {{"range_m", depth.range_error.range_m}, {"error_m", depth.range_error.error_m}};
    if (!depth.range_error.std_m.empty()) json["range_error"]["std_m"] = depth.range_error.std_m;
  }
  return json;
}

Json Fisheye(const FisheyeCamera& c) {
  return {{"model", "kannala_brandt"},
          {"width", c.width},
          {"height", c.height},
          {"fx", c.fx},
          {"fy", c.fy},
          {"cx", c.cx},
          {"cy", c.cy},
          {"k1", c.k1},
          {"k2", c.k2},
          {"k3", c.k3},
          {"k4", c.k4},
          {"max_angle_deg", c.max_angle_rad * kDegPerRad}};
}

Json Ptu(const PanTilt& ptu) {
  auto axis = [](const PanTilt::Axis& a) -> Json {
    return {{"direction", Numbers(a.direction)}, {"point", Numbers(a.point)}};
  };
  return {{"pan_axis", axis(ptu.pan_axis)},
          {"tilt_axis", axis(ptu.tilt_axis)},
          {"T_tilt_color", RowMajor(ptu.T_tilt_color)},
          {"T_world_base", RowMajor(ptu.T_world_base)},
          {"encoder",
           {{"pan_scale", ptu.pan_scale},
            {"pan_offset_deg", ptu.pan_offset_deg},
            {"tilt_scale", ptu.tilt_scale},
            {"tilt_offset_deg", ptu.tilt_offset_deg}}}};
}

}  // namespace

std::string FormatRig(const Rig& rig) {
  Json json = {{"version", 1}};
  Json& color = json["cameras"]["color"] = Pinhole(rig.color);
  color["vignetting"] = {rig.vignetting_a, rig.vignetting_b};
  if (rig.depth) {
    json["cameras"]["depth"] = Depth(*rig.depth);
    json["T_color_depth"] = RowMajor(rig.T_color_depth);
  }
  if (rig.fisheye) {
    json["cameras"]["fisheye"] = Fisheye(*rig.fisheye);
    json["T_color_fisheye"] = RowMajor(rig.T_color_fisheye);
  }
  json["registered"] = rig.registered;
  json["time_offset_s"] = {{"depth", rig.depth_time_offset_s}, {"fisheye", rig.fisheye_time_offset_s}};
  if (rig.ptu) json["ptu"] = Ptu(*rig.ptu);
  return json.dump(1) + "\n";
}

}  // namespace mixstage
