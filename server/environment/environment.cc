// SPDX-License-Identifier: Apache-2.0
#include "server/environment/environment.h"

#include <array>
#include <cmath>
#include <utility>

#include "proto/geometry/json_fields.h"

namespace mixstage {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMostFrames = 10'000, kMostPlanes = 256, kMostCorners = 1024, kMostLamps = 256;
constexpr double kFarthest_m = 1e4;

constexpr std::array<std::pair<PlaneKind, const char*>, 5> kPlaneKinds = {{{PlaneKind::kFloor, "floor"},
                                                                           {PlaneKind::kCeiling, "ceiling"},
                                                                           {PlaneKind::kWall, "wall"},
                                                                           {PlaneKind::kTable, "table"},
                                                                           {PlaneKind::kOther, "other"}}};

Status InRange(const JsonFields& f, const char* key, double value, double least, double most) {
  if (value >= least && value <= most) return {};
  return f.Bad(key, "is not in " + std::to_string(least) + ".." + std::to_string(most));
}

Status ReadPlace(JsonFields& f, const char* key, Eigen::Vector3d& value) {
  if (auto ok = f.Vector(key, value); !ok) return ok;
  if (value.cwiseAbs().maxCoeff() > kFarthest_m) return f.Bad(key, "is not within 10 km");
  return {};
}

Status ReadFrame(JsonFields& f, SweepFrame& frame) {
  if (auto ok = f.Text("name", frame.name); !ok) return ok;
  if (!f.Has("T_world_color")) return f.Bad("T_world_color", "is missing");
  return f.Rigid("T_world_color", frame.T_world_color);
}

Status ReadPanorama(JsonFields& f, Panorama& p) {
  std::string shape;
  if (auto ok = f.Text("projection", shape); !ok) return ok;
  if (shape != "spherical" && shape != "cylindrical")
    return f.Bad("projection", "is neither \"spherical\" nor \"cylindrical\"");
  p.shape = shape == "spherical" ? PanoramaShape::kSpherical : PanoramaShape::kCylindrical;
  for (auto& [key, value] : {std::pair<const char*, int&>{"width", p.width}, {"height", p.height}}) {
    if (auto ok = f.Integer(key, value); !ok) return ok;
  }
  if (auto ok = f.Vector("center", p.center); !ok) return ok;
  for (auto& [key, value] : {std::pair<const char*, double&>{"azimuth_left_deg", p.azimuth_left_deg},
                             {"azimuth_right_deg", p.azimuth_right_deg},
                             {"elevation_top_deg", p.elevation_top_deg},
                             {"elevation_bottom_deg", p.elevation_bottom_deg}}) {
    if (auto ok = f.Number(key, value); !ok) return ok;
  }
  if (auto ok = p.Validate(); !ok) return Fail(ErrorCode::kBadInput, f.path() + "." + ok.error().message);
  return {};
}

Status ReadPolygon(JsonFields& f, std::vector<Eigen::Vector3d>& polygon) {
  if (!f.Has("polygon")) return {};
  const nlohmann::json& list = f.Raw("polygon");
  if (!list.is_array() || list.size() > kMostCorners)
    return f.Bad("polygon", "is not a list of at most 1024 corners");
  for (const nlohmann::json& corner : list) {
    Eigen::Vector3d point;
    bool good = corner.is_array() && corner.size() == 3;
    for (std::size_t i = 0; good && i < 3; ++i) {
      good = corner[i].is_number() && std::abs(corner[i].get<double>()) <= kFarthest_m;
      if (good) point[static_cast<Eigen::Index>(i)] = corner[i].get<double>();
    }
    if (!good) return f.Bad("polygon", "has a corner that is not three numbers within 10 km");
    polygon.push_back(point);
  }
  return {};
}

Status ReadPlane(JsonFields& f, RoomPlane& plane) {
  std::string kind = "other";
  for (auto& [key, text] : {std::pair<const char*, std::string&>{"name", plane.name}, {"kind", kind}}) {
    if (auto ok = f.Text(key, text); !ok) return ok;
  }
  bool known = false;
  for (const auto& [value, name] : kPlaneKinds) {
    if (kind == name) plane.kind = value, known = true;
  }
  if (!known) return f.Bad("kind", "is none of floor, ceiling, wall, table, other");
  if (auto ok = f.Vector("n", plane.normal); !ok) return ok;
  if (!(std::abs(plane.normal.norm() - 1) < 1e-3)) return f.Bad("n", "is not of length 1");
  if (auto ok = f.Number("d", plane.d); !ok) return ok;
  if (auto ok = InRange(f, "d", plane.d, -kFarthest_m, kFarthest_m); !ok) return ok;
  return ReadPolygon(f, plane.polygon);
}

Status ReadLamp(JsonFields& f, RoomLamp& lamp) {
  if (auto ok = f.Text("name", lamp.name); !ok) return ok;
  for (auto& [key, value] : {std::pair<const char*, Eigen::Vector3d&>{"center", lamp.center},
                             {"edge_u", lamp.edge_u},
                             {"edge_v", lamp.edge_v},
                             {"color", lamp.color}}) {
    if (auto ok = ReadPlace(f, key, value); !ok) return ok;
  }
  if (!(lamp.edge_u.cross(lamp.edge_v).norm() > 1e-9)) return f.Bad("edge_v", "spans no area with edge_u");
  if (!(lamp.color.minCoeff() >= 0)) return f.Bad("color", "has a number below 0");
  if (auto ok = f.Number("intensity", lamp.intensity); !ok) return ok;
  return InRange(f, "intensity", lamp.intensity, 0, 1e6);
}

Json Numbers(const Eigen::Vector3d& v) { return Json::array({v.x(), v.y(), v.z()}); }

}  // namespace

const char* PlaneKindName(PlaneKind kind) {
  for (const auto& [value, name] : kPlaneKinds) {
    if (kind == value) return name;
  }
  return "other";
}

Result<ParsedEnvironment> ParseEnvironment(const std::string& text) {
  const auto root = nlohmann::json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (root.is_discarded() || !root.is_object()) return Fail(ErrorCode::kBadInput, "is not a JSON object");
  ParsedEnvironment parsed;
  Environment& e = parsed.environment;
  JsonFields f(root, "", parsed.warnings);
  int version = 0;
  if (auto ok = f.Integer("version", version); !ok) return tl::unexpected(ok.error());
  if (version != 1) return Fail(ErrorCode::kBadInput, "version is not 1");
  if (!f.Has("rig")) return Fail(ErrorCode::kBadInput, "rig is missing");
  auto rig = ParseRig(f.Raw("rig").dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
  if (!rig) return Within("rig", rig.error());
  for (const std::string& warning : rig->warnings) parsed.warnings.push_back("rig: " + warning);
  e.rig = std::move(rig->rig);
  auto add = [](auto& list, auto read) {
    return [&list, read](JsonFields& inner) { return read(inner, list.emplace_back()); };
  };
  if (!f.Has("panorama")) return Fail(ErrorCode::kBadInput, "panorama is missing");
  for (const Status& ok :
       {f.List("frames", kMostFrames, add(e.frames, ReadFrame)),
        f.Object("panorama", [&](JsonFields& inner) { return ReadPanorama(inner, e.panorama); }),
        f.List("planes", kMostPlanes, add(e.planes, ReadPlane)),
        f.List("lamps", kMostLamps, add(e.lamps, ReadLamp)), f.Number("coverage", e.coverage),
        InRange(f, "coverage", e.coverage, 0, 1), f.Number("depth_sigma_m", e.depth_sigma_m),
        InRange(f, "depth_sigma_m", e.depth_sigma_m, 0, 10), f.Number("registration_px", e.registration_px),
        InRange(f, "registration_px", e.registration_px, 0, 100)}) {
    if (!ok) return tl::unexpected(ok.error());
  }
  (void)f.Has("note");
  f.WarnOfUnknown();
  return parsed;
}

std::string FormatEnvironment(const Environment& e) {
  Json frames = Json::array(), planes = Json::array(), lamps = Json::array();
  for (const SweepFrame& frame : e.frames) {
    Json T = Json::array();
    for (int i = 0; i < 16; ++i) T.push_back(frame.T_world_color.matrix()(i / 4, i % 4));
    frames.push_back({{"name", frame.name}, {"T_world_color", std::move(T)}});
  }
  for (const RoomPlane& plane : e.planes) {
    Json polygon = Json::array();
    for (const Eigen::Vector3d& corner : plane.polygon) polygon.push_back(Numbers(corner));
    planes.push_back({{"name", plane.name},
                      {"kind", PlaneKindName(plane.kind)},
                      {"n", Numbers(plane.normal)},
                      {"d", plane.d},
                      {"polygon", std::move(polygon)}});
  }
  for (const RoomLamp& lamp : e.lamps) {
    lamps.push_back({{"name", lamp.name},
                     {"center", Numbers(lamp.center)},
                     {"edge_u", Numbers(lamp.edge_u)},
                     {"edge_v", Numbers(lamp.edge_v)},
                     {"color", Numbers(lamp.color)},
                     {"intensity", lamp.intensity}});
  }
  const Panorama& p = e.panorama;
  const Json panorama = {{"projection", p.shape == PanoramaShape::kSpherical ? "spherical" : "cylindrical"},
                         {"width", p.width},
                         {"height", p.height},
                         {"center", Numbers(p.center)},
                         {"azimuth_left_deg", p.azimuth_left_deg},
                         {"azimuth_right_deg", p.azimuth_right_deg},
                         {"elevation_top_deg", p.elevation_top_deg},
                         {"elevation_bottom_deg", p.elevation_bottom_deg}};
  const Json root = {{"version", 1},
                     {"coverage", e.coverage},
                     {"depth_sigma_m", e.depth_sigma_m},
                     {"registration_px", e.registration_px},
                     {"panorama", panorama},
                     {"planes", std::move(planes)},
                     {"lamps", std::move(lamps)},
                     {"frames", std::move(frames)},
                     {"rig", Json::parse(FormatRig(e.rig))}};
  return root.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace mixstage
