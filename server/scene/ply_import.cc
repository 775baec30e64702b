// SPDX-License-Identifier: Apache-2.0
//
// PLY, ascii and binary little endian: vertices (x y z, nx ny nz, red green blue, s t or u v) and faces (a
// list of vertex indices, cut as fans). Other elements and properties are skipped.
#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <string_view>

#include "proto/base/srgb.h"
#include "server/scene/model_file.h"

namespace mixstage {
namespace {

static_assert(std::endian::native == std::endian::little);

auto Bad(const std::string& what) { return Fail(ErrorCode::kBadInput, what); }

enum class NumberType { kInvalid = 0, kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat, kDouble };

constexpr std::array<std::pair<std::string_view, NumberType>, 16> kTypeNames = {{
    {"char", NumberType::kInt8},
    {"int8", NumberType::kInt8},
    {"uchar", NumberType::kUint8},
    {"uint8", NumberType::kUint8},
    {"short", NumberType::kInt16},
    {"int16", NumberType::kInt16},
    {"ushort", NumberType::kUint16},
    {"uint16", NumberType::kUint16},
    {"int", NumberType::kInt32},
    {"int32", NumberType::kInt32},
    {"uint", NumberType::kUint32},
    {"uint32", NumberType::kUint32},
    {"float", NumberType::kFloat},
    {"float32", NumberType::kFloat},
    {"double", NumberType::kDouble},
    {"float64", NumberType::kDouble},
}};

NumberType TypeOf(std::string_view name) {
  for (const auto& [known, type] : kTypeNames) {
    if (known == name) return type;
  }
  return NumberType::kInvalid;
}

struct Property {
  std::string name;
  NumberType type = NumberType::kInvalid;
  NumberType count_type = NumberType::kInvalid;  // of a list; kInvalid = a single number
};
struct Element {
  std::string name;
  std::size_t count = 0;
  std::vector<Property> properties;
};
struct Header {
  bool ascii = false;
  std::vector<Element> elements;
  std::size_t bytes = 0;  // where the data begins
};

std::vector<std::string> Words(std::string_view line) {
  std::vector<std::string> words;
  std::size_t at = 0;
  while ((at = line.find_first_not_of(" \t\r", at)) != std::string_view::npos) {
    const std::size_t end = std::min(line.find_first_of(" \t\r", at), line.size());
    words.emplace_back(line.substr(at, end - at));
    at = end;
  }
  return words;
}

Status ReadHeaderLine(const std::vector<std::string>& words, Header& header) {
  if (words.empty() || words[0] == "comment" || words[0] == "obj_info" || words[0] == "ply") return {};
  if (words[0] == "format" && words.size() == 3) {
    if (words[1] != "ascii" && words[1] != "binary_little_endian") {
      return Bad("its format " + words[1].substr(0, 40) +
                 " is not known (ascii and binary_little_endian are)");
    }
    header.ascii = words[1] == "ascii";
    return {};
  }
  if (words[0] == "element" && words.size() == 3) {
    Element element;
    element.name = words[1];
    const auto [end, error] =
        std::from_chars(words[2].data(), words[2].data() + words[2].size(), element.count);
    if (error != std::errc() || *end != 0 || element.count > ModelLimits::kTriangles) {
      return Bad("element " + element.name.substr(0, 40) + ": its count is not a number up to 10 million");
    }
    if (header.elements.size() >= 64) return Bad("has more than 64 elements");
    header.elements.push_back(std::move(element));
    return {};
  }
  if (words[0] == "property" && !header.elements.empty() &&
      (words.size() == 3 || (words.size() == 5 && words[1] == "list"))) {
    Property property{words.back(), TypeOf(words[words.size() - 2]), NumberType::kInvalid};
    if (words.size() == 5) property.count_type = TypeOf(words[2]);
    if (property.type == NumberType::kInvalid ||
        (words.size() == 5 && property.count_type == NumberType::kInvalid)) {
      return Bad("property " + property.name.substr(0, 40) + " has an unknown type");
    }
    if (header.elements.back().properties.size() >= 256) return Bad("has more than 256 properties");
    header.elements.back().properties.push_back(std::move(property));
    return {};
  }
  return Bad("has a header line that is not known: " + words[0].substr(0, 40));
}

Result<Header> ReadHeader(std::string_view text) {
  Header header;
  bool has_format = false;
  if (text.substr(0, 3) != "ply") return Bad("does not begin with \"ply\"");
  while (header.bytes < std::min<std::size_t>(text.size(), 1u << 20)) {
    const std::size_t end = text.find('\n', header.bytes);
    if (end == std::string_view::npos) break;
    const auto words = Words(text.substr(header.bytes, end - header.bytes));
    header.bytes = end + 1;
    if (!words.empty() && words[0] == "end_header") {
      if (!has_format) return Bad("its header names no format");
      return header;
    }
    has_format |= !words.empty() && words[0] == "format";
    if (auto ok = ReadHeaderLine(words, header); !ok) return tl::unexpected(ok.error());
  }
  return Bad("its header has no end_header");
}

// The numbers of the data part, one after another, whatever their encoding.
class Numbers {
 public:
  Numbers(std::string_view data, bool ascii) : data_(data), ascii_(ascii) {}

  // False at the end of the data or where it holds no number.
  bool Next(NumberType type, double& value) { return ascii_ ? NextText(value) : NextBytes(type, value); }

 private:
  bool NextText(double& value) {
    at_ = data_.find_first_not_of(" \t\r\n", at_);
    if (at_ == std::string_view::npos) return false;
    const auto [end, error] = std::from_chars(data_.data() + at_, data_.data() + data_.size(), value);
    if (error != std::errc()) return false;
    at_ = static_cast<std::size_t>(end - data_.data());
    return true;
  }
  template <typename T>
  bool Take(double& value) {
    if (data_.size() - at_ < sizeof(T)) return false;
    T number;
    std::memcpy(&number, data_.data() + at_, sizeof(T));
    at_ += sizeof(T);
    value = static_cast<double>(number);
    return true;
  }
  bool NextBytes(NumberType type, double& value) {
    switch (type) {
      case NumberType::kInt8:
        return Take<std::int8_t>(value);
      case NumberType::kUint8:
        return Take<std::uint8_t>(value);
      case NumberType::kInt16:
        return Take<std::int16_t>(value);
      case NumberType::kUint16:
        return Take<std::uint16_t>(value);
      case NumberType::kInt32:
        return Take<std::int32_t>(value);
      case NumberType::kUint32:
        return Take<std::uint32_t>(value);
      case NumberType::kFloat:
        return Take<float>(value);
      case NumberType::kDouble:
        return Take<double>(value);
      case NumberType::kInvalid:
        break;
    }
    return false;
  }

  std::string_view data_;
  bool ascii_;
  std::size_t at_ = 0;
};

enum Slot { kX, kY, kZ, kNx, kNy, kNz, kRed, kGreen, kBlue, kS, kT, kSlots };
int SlotOf(const std::string& name) {
  constexpr std::array<std::string_view, kSlots> kNames = {"x",   "y",     "z",    "nx", "ny", "nz",
                                                           "red", "green", "blue", "s",  "t"};
  if (name == "u" || name == "texture_u") return kS;
  if (name == "v" || name == "texture_v") return kT;
  const auto found = std::find(kNames.begin(), kNames.end(), name);
  return found == kNames.end() ? -1 : static_cast<int>(found - kNames.begin());
}

float LinearColor(double value, NumberType type) {
  const double srgb = std::clamp(type == NumberType::kUint8 ? value / 255.0 : value, 0.0, 1.0);
  return LinearOfSrgb(static_cast<float>(srgb));
}

auto CutShort(const Element& element, std::size_t i) {
  return Bad("its data ends or breaks at " + element.name.substr(0, 40) + " " + std::to_string(i));
}

constexpr double kLongestList = 1e6;

Status ReadVertices(const Element& element, Numbers& numbers, Mesh& mesh) {
  if (mesh.positions.size() + element.count > ModelLimits::kVertices)
    return Bad("has more than 5 million vertices");
  std::array<bool, kSlots> present{};
  std::vector<int> slots;
  for (const Property& p : element.properties) {
    slots.push_back(SlotOf(p.name));
    if (p.count_type != NumberType::kInvalid) return Bad("its vertices hold a list");
    if (slots.back() >= 0) present[static_cast<std::size_t>(slots.back())] = true;
  }
  if (!present[kX] || !present[kY] || !present[kZ]) return Bad("its vertices have no x, y, z");
  for (std::size_t i = 0; i < element.count; ++i) {
    std::array<double, kSlots> v{};
    for (std::size_t k = 0; k < slots.size(); ++k) {
      const Property& p = element.properties[k];
      double value = 0;
      if (!numbers.Next(p.type, value)) return CutShort(element, i);
      const int slot = slots[k];
      if (slot < 0) continue;
      v[static_cast<std::size_t>(slot)] =
          slot >= kRed && slot <= kBlue ? static_cast<double>(LinearColor(value, p.type)) : value;
    }
    auto triple = [&](Slot first) {
      return Eigen::Vector3f(static_cast<float>(v[first]), static_cast<float>(v[first + 1u]),
                             static_cast<float>(v[first + 2u]));
    };
    mesh.positions.push_back(triple(kX));
    if (present[kNx] && present[kNy] && present[kNz]) {
      const Eigen::Vector3f n = triple(kNx);
      const float length = n.norm();
      mesh.normals.push_back(std::isfinite(length) && length > 1e-20f ? Eigen::Vector3f(n / length)
                                                                      : Eigen::Vector3f::UnitZ());
    }
    if (present[kRed] && present[kGreen] && present[kBlue]) mesh.colors.push_back(triple(kRed));
    if (present[kS] && present[kT])
      mesh.uvs.emplace_back(static_cast<float>(v[kS]), static_cast<float>(1.0 - v[kT]));
  }
  return {};
}

Status ReadFaces(const Element& element, Numbers& numbers, Mesh& mesh) {
  std::vector<std::uint32_t> corners;
  for (std::size_t i = 0; i < element.count; ++i) {
    for (const Property& p : element.properties) {
      double count = 1;
      const bool is_list = p.count_type != NumberType::kInvalid;
      if (is_list && !numbers.Next(p.count_type, count)) return CutShort(element, i);
      if (!(count >= 0 && count <= kLongestList))
        return Bad("face " + std::to_string(i) + " has a list of a senseless length");
      const bool is_face = is_list && (p.name == "vertex_indices" || p.name == "vertex_index");
      corners.clear();
      for (double k = 0; k < count; ++k) {
        double value = 0;
        if (!numbers.Next(p.type, value)) return CutShort(element, i);
        if (!is_face) continue;
        if (!(value >= 0 && value < 4294967295.0) || value != std::floor(value)) {
          return Bad("face " + std::to_string(i) + " has an index that is no vertex");
        }
        corners.push_back(static_cast<std::uint32_t>(value));
      }
      for (std::size_t k = 2; k < corners.size(); ++k) {
        mesh.indices.insert(mesh.indices.end(), {corners[0], corners[k - 1], corners[k]});
      }
      if (mesh.triangle_count() > ModelLimits::kTriangles) return Bad("has more than 10 million triangles");
    }
  }
  return {};
}

Status Skip(const Element& element, Numbers& numbers) {
  for (std::size_t i = 0; i < element.count; ++i) {
    for (const Property& p : element.properties) {
      double count = 1;
      double value = 0;
      if (p.count_type != NumberType::kInvalid && !numbers.Next(p.count_type, count))
        return CutShort(element, i);
      if (!(count >= 0 && count <= kLongestList)) return CutShort(element, i);
      for (double k = 0; k < count; ++k) {
        if (!numbers.Next(p.type, value)) return CutShort(element, i);
      }
    }
  }
  return {};
}

}  // namespace

Result<LoadedModel> ImportPly(const std::vector<std::uint8_t>& bytes) {
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  auto header = ReadHeader(text);
  if (!header) return tl::unexpected(header.error());
  LoadedModel out;
  out.up = UpAxis::kZ;
  Numbers numbers(text.substr(header->bytes), header->ascii);
  for (const Element& element : header->elements) {
    const Status read = element.name == "vertex" ? ReadVertices(element, numbers, out.mesh)
                        : element.name == "face" ? ReadFaces(element, numbers, out.mesh)
                                                 : Skip(element, numbers);
    if (!read) return tl::unexpected(read.error());
  }
  for (const std::uint32_t i : out.mesh.indices) {
    if (i >= out.mesh.positions.size()) return Bad("index " + std::to_string(i) + " is beyond its vertices");
  }
  if (out.mesh.normals.size() != out.mesh.positions.size()) SmoothNormals(out.mesh, {});
  out.mesh.parts.push_back({0, static_cast<std::uint32_t>(out.mesh.indices.size()), 0});
  out.mesh.materials.emplace_back();
  return out;
}

}  // namespace mixstage
