// SPDX-License-Identifier: Apache-2.0
#include "server/environment/panorama_texture.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <unordered_map>
#include <utility>
#include <vector>

namespace mixstage {
namespace {

constexpr double kMostOff_texels = 0.5;
constexpr double kSamePlace_texels = 2;  // a vertex's own coordinates against the panorama's
constexpr int kMostRounds = 6;           // each halves

class Splitter {
 public:
  Splitter(const Panorama& panorama, RoomModel& room)
      : panorama_(panorama), room_(room), scale_(room.texture_bgr.cols, room.texture_bgr.rows) {}

  // The vertex in the middle of an edge that must be split; nothing for one that lies straight.
  std::optional<std::uint32_t> Middle(std::uint32_t a, std::uint32_t b) {
    const std::uint64_t key = std::uint64_t{std::min(a, b)} << 32 | std::max(a, b);
    const auto [found, is_new] = middles_.try_emplace(key, std::nullopt);
    if (is_new) found->second = Decide(a, b);
    return found->second;
  }
  void NextRound() { middles_.clear(); }

 private:
  // In texels of the texture.
  [[nodiscard]] std::optional<Eigen::Vector2d> PlaceOf(const Eigen::Vector3f& position) const {
    const auto pixel = panorama_.Pixel(position.cast<double>() - panorama_.center);
    if (!pixel) return std::nullopt;
    return Eigen::Vector2d((pixel->x() + 0.5) / panorama_.width * scale_.x(),
                           (pixel->y() + 0.5) / panorama_.height * scale_.y());
  }
  [[nodiscard]] bool IsThePanoramas(std::uint32_t vertex) const {
    const auto place = PlaceOf(room_.positions[vertex]);
    return place &&
           (*place - room_.uvs[vertex].cast<double>().cwiseProduct(scale_)).norm() < kSamePlace_texels;
  }
  // How far the panorama's place is from the one between a and b, texels; nothing outside the panorama.
  [[nodiscard]] std::optional<double> OffAt(std::uint32_t a, std::uint32_t b, float share) const {
    const auto place = PlaceOf(room_.positions[a] + share * (room_.positions[b] - room_.positions[a]));
    if (!place) return std::nullopt;
    const Eigen::Vector2f linear = room_.uvs[a] + share * (room_.uvs[b] - room_.uvs[a]);
    return (*place - linear.cast<double>().cwiseProduct(scale_)).norm();
  }
  std::optional<std::uint32_t> Decide(std::uint32_t a, std::uint32_t b) {
    if (!IsThePanoramas(a) || !IsThePanoramas(b)) return std::nullopt;
    double off = 0;
    for (const float share : {0.25f, 0.5f, 0.75f}) {  // a curve may cross its chord in the middle
      const auto here = OffAt(a, b, share);
      if (!here) return std::nullopt;
      off = std::max(off, *here);
    }
    if (off <= kMostOff_texels) return std::nullopt;
    const Eigen::Vector3f position = 0.5f * (room_.positions[a] + room_.positions[b]);
    room_.positions.push_back(position);
    room_.uvs.push_back(PlaceOf(position)->cwiseQuotient(scale_).cast<float>());
    return static_cast<std::uint32_t>(room_.positions.size() - 1);
  }

  const Panorama& panorama_;
  RoomModel& room_;
  const Eigen::Vector2d scale_;
  std::unordered_map<std::uint64_t, std::optional<std::uint32_t>> middles_;
};

}  // namespace

void SplitForPanorama(const Panorama& panorama, RoomModel& room) {
  Splitter splitter(panorama, room);
  for (int round = 0; round < kMostRounds && room.triangle_count() < kMostSplitTriangles; ++round) {
    splitter.NextRound();
    std::vector<std::uint32_t> out;
    out.reserve(room.indices.size());
    for (std::size_t i = 0; i < room.indices.size(); i += 3) {
      const std::array<std::uint32_t, 3> corner = {room.indices[i], room.indices[i + 1], room.indices[i + 2]};
      std::array<std::optional<std::uint32_t>, 3> middle;  // of the edge from corner k to the next
      int split = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        middle[k] = splitter.Middle(corner[k], corner[(k + 1) % 3]);
        split += middle[k] ? 1 : 0;
      }
      auto add = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) { out.insert(out.end(), {a, b, c}); };
      if (split == 0) {
        add(corner[0], corner[1], corner[2]);
      } else if (split == 3) {
        add(corner[0], *middle[0], *middle[2]);
        add(*middle[0], corner[1], *middle[1]);
        add(*middle[2], *middle[1], corner[2]);
        add(*middle[0], *middle[1], *middle[2]);
      } else {
        // Turned so that edge 0 is split and, of two, edge 1 too.
        std::size_t k = 0;
        while (!(middle[k] && (split == 1 || middle[(k + 1) % 3]))) ++k;
        const std::uint32_t a = corner[k], b = corner[(k + 1) % 3], c = corner[(k + 2) % 3];
        const std::uint32_t ab = *middle[k];
        if (split == 1) {
          add(a, ab, c);
          add(ab, b, c);
        } else {
          const std::uint32_t bc = *middle[(k + 1) % 3];
          add(ab, b, bc);
          add(a, ab, bc);
          add(a, bc, c);
        }
      }
    }
    if (out.size() == room.indices.size()) return;
    room.indices = std::move(out);
  }
}

}  // namespace mixstage
