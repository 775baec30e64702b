// SPDX-License-Identifier: Apache-2.0
#include "server/app/regions_file.h"

#include <array>
#include <cmath>
#include <numbers>
#include <set>

#include "proto/base/file_bytes.h"
#include "server/scene/yaml_fields.h"

namespace mixstage {
namespace {

constexpr std::uintmax_t kMostBytes = 1 << 20;
constexpr std::size_t kMostRegions = 16, kMostPlanes = 16;
constexpr double kFarthest_m = 1000;

// Six planes: about `up` turned by turn_deg.
std::vector<Eigen::Vector4d> BoxPlanes(const Eigen::Vector3d& center, const Eigen::Vector3d& size,
                                       double turn_deg, const Eigen::Vector3d& up) {
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(turn_deg * std::numbers::pi / 180, up).toRotationMatrix();
  std::vector<Eigen::Vector4d> planes;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double side : {1.0, -1.0}) {
      const Eigen::Vector3d inward = side * turn.col(axis);
      planes.emplace_back(inward.x(), inward.y(), inward.z(), size[axis] / 2 - inward.dot(center));
    }
  }
  return planes;
}

Status ReadBox(YamlFields& f, const Eigen::Vector3d& up, RoomRegion& region) {
  std::array<double, 3> center{}, size{};
  double turn_deg = 0;
  for (const char* key : {"center", "size"}) {
    if (!f.Has(key)) return f.Bad(key, "is missing: a box needs center and size");
  }
  if (auto ok = f.Numbers("center", center); !ok) return ok;
  if (auto ok = f.Numbers("size", size); !ok) return ok;
  if (auto ok = f.NumberIn("turn_deg", -360, 360, turn_deg); !ok) return ok;
  for (const double c : center) {
    if (std::abs(c) > kFarthest_m) return f.Bad("center", "has a number over 1000 m");
  }
  for (const double s : size) {
    if (!(s >= 0.001 && s <= kFarthest_m))
      return f.Bad("size", "has a side that is not 0.001 .. 1000 m long");
  }
  region.planes = BoxPlanes({center[0], center[1], center[2]}, {size[0], size[1], size[2]}, turn_deg, up);
  return f.CheckAllKnown();
}

Status ReadPlanes(YamlFields& f, RoomRegion& region) {
  const YAML::Node list = f.Raw("planes");
  if (!list.IsSequence() || list.size() < 1 || list.size() > kMostPlanes)
    return f.Bad("planes", "is not a list of 1 to 16 planes [nx, ny, nz, d]");
  for (const YAML::Node& item : list) {
    Eigen::Vector4d plane;
    bool good = item.IsSequence() && item.size() == 4;
    for (std::size_t k = 0; good && k < 4; ++k) good = YamlNumber(item[k], plane[static_cast<int>(k)]);
    if (!good) return f.Bad("planes", "has a plane that is not four finite numbers [nx, ny, nz, d]");
    const double length = plane.head<3>().norm();
    if (!(length > 1e-9 && length < 1e9)) return f.Bad("planes", "has a normal of length 0");
    plane /= length;
    if (!(std::abs(plane.w()) <= kFarthest_m)) return f.Bad("planes", "has a plane that is over 1000 m away");
    for (const Eigen::Vector4d& other : region.planes) {
      if (plane.head<3>().dot(other.head<3>()) < -1 + 1e-12 && plane.w() + other.w() <= 0)
        return f.Bad("planes", "leave nothing between them: inside is where n . x + d >= 0");
    }
    region.planes.push_back(plane);
  }
  return {};
}

Status ReadRegion(YamlFields& f, const Eigen::Vector3d& up, RoomRegion& region) {
  std::size_t kind = 0;
  for (const char* key : {"name", "kind"}) {
    if (!f.Has(key)) return f.Bad(key, "is missing");
  }
  if (auto ok = f.Text("name", region.name); !ok) return ok;
  if (auto ok = f.Choice("kind", {"garbage", "hold_out"}, kind); !ok) return ok;
  region.kind = kind == 0 ? RegionKind::kGarbage : RegionKind::kHoldOut;
  if (f.Has("box") == f.Has("planes")) return f.Bad("box", "or planes: give exactly one of them");
  if (f.Has("box")) {
    auto box = f.Map("box");
    if (!box) return tl::unexpected(box.error());
    if (auto ok = ReadBox(*box, up, region); !ok) return ok;
  } else if (auto ok = ReadPlanes(f, region); !ok) {
    return ok;
  }
  return f.CheckAllKnown();
}

Status ReadAll(YamlFields& f, RoomRegions& regions) {
  double version = 1;
  std::size_t frame = 0;
  if (auto ok = f.NumberIn("version", 1, 1, version); !ok) return ok;
  if (auto ok = f.Choice("frame", {"world", "camera"}, frame); !ok) return ok;
  regions.frame = frame == 0 ? RegionFrame::kWorld : RegionFrame::kCamera;
  const Eigen::Vector3d up = frame == 0 ? Eigen::Vector3d(0, 0, 1) : Eigen::Vector3d(0, -1, 0);
  if (!f.Has("regions")) return f.Bad("regions", "is missing");
  auto list = f.List("regions", kMostRegions);
  if (!list) return tl::unexpected(list.error());
  std::set<std::string> names;
  for (YamlFields& fields : *list) {
    RoomRegion region;
    if (auto ok = ReadRegion(fields, up, region); !ok) return ok;
    if (!names.insert(region.name).second) return fields.Bad("name", "is another region's name too");
    regions.regions.push_back(std::move(region));
  }
  return f.CheckAllKnown();
}

}  // namespace

Result<RoomRegions> ParseRegions(const std::string& text, const std::filesystem::path& file) {
  RoomRegions regions;
  auto fields = ParseYaml(text, file.string());
  Status ok = fields ? fields->CheckShape() : Status(tl::unexpected(fields.error()));
  if (ok) ok = ReadAll(*fields, regions);
  if (!ok) {
    ok.error().code = ErrorCode::kInvalidConfig;  // a person's own file
    return tl::unexpected(ok.error());
  }
  return regions;
}

Result<RoomRegions> LoadRegions(const std::filesystem::path& file) {
  auto bytes = ReadFileBytes(file, kMostBytes);
  if (!bytes) return Fail(ErrorCode::kInvalidConfig, file.string() + ": " + bytes.error().message);
  return ParseRegions(std::string(bytes->begin(), bytes->end()), file);
}

}  // namespace mixstage
