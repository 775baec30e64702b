// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/actor_mesh.h"

#include <algorithm>
#include <cmath>

#include "proto/base/check.h"
#include "server/segmentation/half_picture.h"

namespace mixstage {
namespace {

constexpr int kHalfCovered = 128;
constexpr int kFinest_px = 2;      // the actor's depth has one value for 2 x 2 pixels
constexpr int kMargin_px = 4;      // of the crop: a texture is filtered
constexpr float kSteepest = 5.7f;  // tangent of 80 degrees: surfaces turned further away are steps
// Nearer than this to its node an edge's end would make a triangle that is none.
constexpr float kNearestEnd_px = 0.25f;
// Room for the vertices on the outline beside those of the grid.
constexpr float kGridShare = 0.9f;

struct Step {
  int x, y;
};
constexpr std::array<Step, 4> kSteps = {Step{1, 0}, {0, 1}, {-1, 0}, {0, -1}};  // by Way

}  // namespace

Result<ActorMesher> ActorMesher::Create(const ActorMesherConfig& config, const PinholeCamera& color) {
  if (auto ok = color.Validate(); !ok) return Within("actor mesh: camera", ok.error());
  if (config.max_vertices < 100 || config.max_vertices > 1'000'000 || !(config.step_m > 0)) {
    return Fail(ErrorCode::kInvalidConfig,
                "actor mesh: max_vertices must lie in 100..1,000,000 and step_m above 0");
  }
  return ActorMesher(config, color);
}

ActorMesher::ActorMesher(const ActorMesherConfig& config, const PinholeCamera& color)
    : config_(config),
      width_(color.width),
      height_(color.height),
      metres_per_px_(static_cast<float>(1 / std::min(color.fx, color.fy))),
      rays_(UnprojectionTable(color)) {}

const PictureMesh& ActorMesher::Run(ImageView<const std::uint8_t> alpha, ImageView<const float> actor_depth_m,
                                    const RigidTransform& T_scene_color) {
  MIX_CHECK(alpha.width() == width_ && alpha.height() == height_);
  MIX_CHECK(actor_depth_m.width() == Half(width_) && actor_depth_m.height() == Half(height_));
  alpha_ = alpha;
  depth_m_ = actor_depth_m;
  T_scene_color_ = T_scene_color.matrix().topRows<3>().cast<float>();
  mesh_.crop = {};
  const Extent actor = FindActor(alpha);
  const float cell =
      static_cast<float>(actor.pixels) / (kGridShare * static_cast<float>(config_.max_vertices));
  spacing_ = std::max(kFinest_px, static_cast<int>(std::ceil(std::sqrt(cell))));
  Build(actor.box);
  // A matte with a long outline (fingers, lace) needs a coarser grid than its area says.
  while (mesh_.positions.size() > static_cast<std::size_t>(config_.max_vertices)) {
    ++spacing_;
    Build(actor.box);
  }
  alpha_ = {};
  depth_m_ = {};
  return mesh_;
}

void ActorMesher::Build(const cv::Rect& box) {
  mesh_.positions.clear();
  mesh_.uvs.clear();
  mesh_.indices.clear();
  if (box.empty()) return;
  LayGrid(box);
  PlaceNodes();
  for (int row = 0; row + 1 < static_cast<int>(rows_.size()); ++row) {
    for (int column = 0; column + 1 < static_cast<int>(columns_.size()); ++column) AddCell(column, row);
  }
}

ActorMesher::Extent ActorMesher::FindActor(ImageView<const std::uint8_t> alpha) const {
  Extent extent;
  int left = width_, right = -1, top = -1, bottom = -1;
  for (int y = 0; y < height_; ++y) {
    const std::uint8_t* row = alpha.row(y);
    int covered = 0;
    for (int x = 0; x < width_; ++x) covered += row[x] >> 7;  // >= 128
    if (covered == 0) continue;
    extent.pixels += covered;
    if (top < 0) top = y;
    bottom = y;
    int x = 0;
    while (x < left && row[x] < kHalfCovered) ++x;
    left = std::min(left, x);
    x = width_ - 1;
    while (x > right && row[x] < kHalfCovered) --x;
    right = std::max(right, x);
  }
  if (top >= 0) extent.box = cv::Rect(left, top, right - left + 1, bottom - top + 1);
  return extent;
}

// Lines at multiples of the spacing, wherever the actor is: a grid that moved with his outline would make his
// still parts tremble. One line lies outside him on each side, or is the picture's last.
void ActorMesher::LayGrid(const cv::Rect& box) {
  const auto lay = [this](int first, int last, int size, std::vector<int>& lines) {
    lines.clear();
    for (int line = (std::max(first - 1, 0) / spacing_) * spacing_; line < size; line += spacing_) {
      lines.push_back(line);
      if (line > last) return;
    }
    if (lines.back() != size - 1) lines.push_back(size - 1);
  };
  lay(box.x, box.br().x - 1, width_, columns_);
  lay(box.y, box.br().y - 1, height_, rows_);
  const cv::Rect wide(box.x - kMargin_px, box.y - kMargin_px, box.width + 2 * kMargin_px,
                      box.height + 2 * kMargin_px);
  mesh_.crop = wide & cv::Rect(0, 0, width_, height_);
  mesh_.crop.width += mesh_.crop.x & 1;  // chroma's corners are even
  mesh_.crop.height += mesh_.crop.y & 1;
  mesh_.crop.x &= ~1;
  mesh_.crop.y &= ~1;
}

void ActorMesher::PlaceNodes() {
  nodes_.assign(rows_.size() * columns_.size(), Node());
  Node* node = nodes_.data();
  for (const int y : rows_) {
    const std::uint8_t* alpha = alpha_.row(y);
    const cv::Vec2f* rays = rays_[y];
    for (const int x : columns_) {
      if (alpha[x] >= kHalfCovered && !std::isnan(rays[x][0])) node->z = SharpDepthAt(x, y);
      ++node;
    }
  }
}

// Bilinear among what is known; where nothing is, the nearest within four pixels: the matte's outline may lie
// a little outside of the mask that the depth was made for. 0 = not known.
float ActorMesher::DepthAt(int x, int y) const {
  const int right = depth_m_.width() - 1, bottom = depth_m_.height() - 1;
  // Half pixel X covers pixels 2 X and 2 X + 1: pixel x lies a quarter to the left or right of X's middle.
  const int X = x / 2, Y = y / 2;
  const int other_X = std::clamp(X + ((x & 1) != 0 ? 1 : -1), 0, right);
  const int other_Y = std::clamp(Y + ((y & 1) != 0 ? 1 : -1), 0, bottom);
  float sum = 0, weights = 0;
  const auto add = [&](int u, int v, float weight) {
    const float z = depth_m_.at(u, v);
    if (z <= 0) return;
    sum += weight * z;
    weights += weight;
  };
  add(X, Y, 0.5625f);
  add(other_X, Y, 0.1875f);
  add(X, other_Y, 0.1875f);
  add(other_X, other_Y, 0.0625f);
  if (weights > 0) return sum / weights;
  int nearest = 9;
  for (int v = std::max(Y - 2, 0); v <= std::min(Y + 2, bottom); ++v) {
    for (int u = std::max(X - 2, 0); u <= std::min(X + 2, right); ++u) {
      const int distance = (u - X) * (u - X) + (v - Y) * (v - Y);
      if (depth_m_.at(u, v) <= 0 || distance >= nearest) continue;
      nearest = distance;
      sum = depth_m_.at(u, v);
    }
  }
  return sum;
}

// The depth was enlarged linearly, which hangs a slope between an arm and the body behind it. A pixel of the
// slope goes to the nearer of both.
float ActorMesher::SharpDepthAt(int x, int y) const {
  const float z = DepthAt(x, y);
  if (z <= 0) return 0;
  float nearest = z, farthest = z;
  const int X = x / 2, Y = y / 2;
  for (int v = std::max(Y - 2, 0); v <= std::min(Y + 2, depth_m_.height() - 1); v += 2) {
    for (int u = std::max(X - 2, 0); u <= std::min(X + 2, depth_m_.width() - 1); u += 2) {
      const float other = depth_m_.at(u, v);
      if (other <= 0) continue;
      nearest = std::min(nearest, other);
      farthest = std::max(farthest, other);
    }
  }
  const float step = farthest - nearest;
  if (step <= StepLimit(z, 8)) return z;
  const float place = (z - nearest) / step;  // on either side of the slope the surface's own relief stays
  if (place <= 0.1f || place >= 0.9f) return z;
  return place < 0.5f ? nearest : farthest;
}

float ActorMesher::StepLimit(float z, int distance_px) const {
  return std::max(config_.step_m, kSteepest * z * metres_per_px_ * static_cast<float>(distance_px));
}

bool ActorMesher::Joined(const Node& a, const Node& b, int distance_px) const {
  return a.z > 0 && b.z > 0 && std::abs(a.z - b.z) <= StepLimit(std::min(a.z, b.z), distance_px);
}

// A cell's corners go round against the clock, as triangles do; corner k is joined with its next one or its
// surface ends between them.
void ActorMesher::AddCell(int column, int row) {
  const std::size_t stride = columns_.size();
  const std::size_t first = static_cast<std::size_t>(row) * stride + static_cast<std::size_t>(column);
  const std::array<Node*, 4> nodes = {&nodes_[first], &nodes_[first + stride], &nodes_[first + stride + 1],
                                      &nodes_[first + 1]};
  if (nodes[0]->z <= 0 && nodes[1]->z <= 0 && nodes[2]->z <= 0 && nodes[3]->z <= 0) return;
  const auto c = static_cast<std::size_t>(column), r = static_cast<std::size_t>(row);
  const int left = columns_[c], right = columns_[c + 1], top = rows_[r], bottom = rows_[r + 1];
  const std::array<cv::Point, 4> places = {
      cv::Point(left, top), {left, bottom}, {right, bottom}, {right, top}};
  const std::array<bool, 4> joined = {
      Joined(*nodes[0], *nodes[1], bottom - top), Joined(*nodes[1], *nodes[2], right - left),
      Joined(*nodes[2], *nodes[3], bottom - top), Joined(*nodes[3], *nodes[0], right - left)};
  AddRing(nodes, places, joined);
}

void ActorMesher::AddRing(const std::array<Node*, 4>& nodes, const std::array<cv::Point, 4>& places,
                          const std::array<bool, 4>& joined) {
  constexpr std::array<Way, 4> kOnward = {kDown, kRight, kUp, kLeft}, kBack = {kRight, kUp, kLeft, kDown};
  const auto vertex = [&](std::size_t k) { return VertexOf(*nodes[k % 4], places[k % 4]); };
  const auto distance = [&](std::size_t a, std::size_t b) {
    const cv::Point d = places[b % 4] - places[a % 4];
    return std::abs(d.x + d.y);
  };
  const auto end_onward = [&](std::size_t k) {
    return EndOf(*nodes[k % 4], places[k % 4], kOnward[k % 4], *nodes[(k + 1) % 4], distance(k, k + 1));
  };
  const auto end_back = [&](std::size_t k) {
    return EndOf(*nodes[k % 4], places[k % 4], kBack[k % 4], *nodes[(k + 3) % 4], distance(k, k + 3));
  };
  const auto step = [&](std::size_t a, std::size_t b) { return std::abs(nodes[a % 4]->z - nodes[b % 4]->z); };

  const int joints = joined[0] + joined[1] + joined[2] + joined[3];
  if (joints == 4) {  // the diagonal along which the surface bends less
    const std::size_t k = step(0, 2) <= step(1, 3) ? 0 : 1;
    AddTriangle(vertex(k), vertex(k + 1), vertex(k + 2));
    AddTriangle(vertex(k), vertex(k + 2), vertex(k + 3));
    return;
  }
  const bool all_inside = nodes[0]->z > 0 && nodes[1]->z > 0 && nodes[2]->z > 0 && nodes[3]->z > 0;
  if (joints == 3 && all_inside) {
    // A step runs out inside this cell: joined the long way round, apart on the short one. One triangle of
    // the two that do not have the torn edge.
    const auto torn =
        static_cast<std::size_t>(std::find(joined.begin(), joined.end(), false) - joined.begin());
    const std::size_t k = step(torn + 1, torn + 3) <= step(torn, torn + 2) ? torn + 1 : torn + 2;
    AddTriangle(vertex(k), vertex(k + 1), vertex(k + 2));
    return;
  }
  // Chains of joined corners; each ends on the edges before its first and after its last corner.
  for (std::size_t first = 0; first < 4; ++first) {
    if (nodes[first]->z <= 0 || joined[(first + 3) % 4]) continue;
    std::size_t last = first;
    while (joined[last % 4]) ++last;
    const std::uint32_t begin = end_back(first), end = end_onward(last);
    if (last == first) {
      AddTriangle(begin, vertex(first), end);
    } else if (last == first + 1) {
      AddTriangle(begin, vertex(first), vertex(last));
      AddTriangle(begin, vertex(last), end);
    } else {
      const std::uint32_t middle = vertex(first + 1);
      AddTriangle(middle, vertex(last), end);
      AddTriangle(middle, end, begin);
      AddTriangle(middle, begin, vertex(first));
    }
  }
}

void ActorMesher::AddTriangle(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
  mesh_.indices.push_back(a);
  mesh_.indices.push_back(b);
  mesh_.indices.push_back(c);
}

std::uint32_t ActorMesher::VertexOf(Node& node, cv::Point place) {
  if (node.vertex == kNone) {
    node.vertex = AddVertex(static_cast<float>(place.x), static_cast<float>(place.y), node.z);
  }
  return node.vertex;
}

// Where the surface of a node ends on its way to a neighbour that does not belong to it: at the matte's
// outline, or where depth comes closer to the neighbour's.
std::uint32_t ActorMesher::EndOf(Node& node, cv::Point place, Way way, const Node& neighbor,
                                 int distance_px) {
  std::uint32_t& end = node.ends[way];
  if (end != kNone) return end;
  const cv::Point direction(kSteps[way].x, kSteps[way].y);
  float along = 0.5f * static_cast<float>(distance_px);  // where neither tells: his depth is not known there
  float z = node.z;
  for (int s = 1; s <= distance_px; ++s) {
    const cv::Point before = place + (s - 1) * direction, here = place + s * direction;
    if (neighbor.z > 0) {
      const float depth = DepthAt(here.x, here.y);
      if (std::abs(depth - neighbor.z) > std::abs(depth - node.z)) continue;
      along = static_cast<float>(s) - 0.5f;
      break;
    }
    const int inside = alpha_.at(before.x, before.y), outside = alpha_.at(here.x, here.y);
    if (outside >= kHalfCovered) continue;
    const float share = (static_cast<float>(inside) - 127.5f) / static_cast<float>(inside - outside);
    along = static_cast<float>(s - 1) + share;
    const float depth = SharpDepthAt(before.x, before.y);
    if (depth > 0 && std::abs(depth - node.z) <= StepLimit(node.z, s)) z = depth;
    break;
  }
  along = std::max(along, kNearestEnd_px);
  end = AddVertex(static_cast<float>(place.x) + along * static_cast<float>(direction.x),
                  static_cast<float>(place.y) + along * static_cast<float>(direction.y), z);
  return end;
}

// x, y: pixel, at most one of them between pixel centres.
std::uint32_t ActorMesher::AddVertex(float x, float y, float z) {
  const int left = static_cast<int>(x), top = static_cast<int>(y);
  const int right = std::min(left + 1, width_ - 1), bottom = std::min(top + 1, height_ - 1);
  const float part_x = x - static_cast<float>(left), part_y = y - static_cast<float>(top);
  const cv::Vec2f& here = rays_(top, left);
  const cv::Vec2f& next = part_x > 0 ? rays_(top, right) : rays_(bottom, left);
  const float part = std::isnan(next[0]) ? 0 : std::max(part_x, part_y);
  const Eigen::Vector4f p_color((here[0] + part * (next[0] - here[0])) * z,
                                (here[1] + part * (next[1] - here[1])) * z, z, 1);
  mesh_.positions.emplace_back(T_scene_color_ * p_color);
  mesh_.uvs.emplace_back(
      (x + 0.5f - static_cast<float>(mesh_.crop.x)) / static_cast<float>(mesh_.crop.width),
      (y + 0.5f - static_cast<float>(mesh_.crop.y)) / static_cast<float>(mesh_.crop.height));
  return static_cast<std::uint32_t>(mesh_.positions.size() - 1);
}

}  // namespace mixstage
