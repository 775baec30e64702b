// SPDX-License-Identifier: Apache-2.0
#include "server/physics/body_shape.h"

#include <LinearMath/btConvexHullComputer.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <numbers>
#include <numeric>
#include <string>
#include <tuple>

namespace mixstage {
namespace {

using Points = std::vector<Eigen::Vector3d>;

constexpr std::size_t kMostParts = 32;
constexpr std::size_t kMostHullVertices = 256;
constexpr double kMarginM = 0.002;
constexpr double kRoundTolerance = 0.01;  // of a ball's radius
constexpr double kFlatM = 0.001;          // half of the thickness that a sheet of paper is given

btVector3 ToBullet(const Eigen::Vector3d& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}

Eigen::AlignedBox3d BoundsOf(const Points& points) {
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& p : points) box.extend(p);
  return box;
}

// The pieces of a model that hang together: triangles that share a position.
std::vector<Points> Pieces(const Mesh& mesh, const Eigen::Matrix3d& stretch) {
  const std::size_t n = mesh.positions.size();
  std::vector<std::uint32_t> order(n);
  std::iota(order.begin(), order.end(), 0u);
  const auto key = [&](std::uint32_t i) {
    const Eigen::Vector3f& p = mesh.positions[i];
    return std::tuple(p.x(), p.y(), p.z());
  };
  std::ranges::sort(order, [&](std::uint32_t a, std::uint32_t b) {
    return std::tuple_cat(key(a), std::tuple(a)) < std::tuple_cat(key(b), std::tuple(b));
  });
  std::vector<std::uint32_t> root(n);  // union-find, the smallest index is the root
  std::iota(root.begin(), root.end(), 0u);
  const auto find = [&](std::uint32_t i) {
    while (root[i] != i) i = root[i] = root[root[i]];
    return i;
  };
  const auto join = [&](std::uint32_t a, std::uint32_t b) {
    a = find(a), b = find(b);
    root[std::max(a, b)] = std::min(a, b);
  };
  for (std::size_t k = 1; k < n; ++k) {
    if (key(order[k]) == key(order[k - 1])) join(order[k], order[k - 1]);
  }
  std::vector<bool> used(n, false);
  for (std::size_t t = 0; t + 2 < mesh.indices.size(); t += 3) {
    join(mesh.indices[t], mesh.indices[t + 1]);
    join(mesh.indices[t], mesh.indices[t + 2]);
    for (std::size_t k = 0; k < 3; ++k) used[mesh.indices[t + k]] = true;
  }
  std::map<std::uint32_t, Points> pieces;
  for (std::size_t k = 0; k < n; ++k) {
    const std::uint32_t i = order[k];
    if (!used[i] || (k > 0 && used[order[k - 1]] && key(i) == key(order[k - 1]))) continue;
    pieces[find(i)].push_back(stretch * mesh.positions[i].cast<double>());
  }
  std::vector<Points> list;
  for (auto& [first, points] : pieces) list.push_back(std::move(points));
  return list;
}

// What lies within another's box is part of it: rivets, eyes, the wine in the glass.
std::vector<Points> Merge(std::vector<Points> pieces) {
  std::ranges::stable_sort(pieces, std::greater(),
                           [](const Points& p) { return BoundsOf(p).sizes().norm(); });
  std::vector<Points> merged;
  std::vector<Eigen::AlignedBox3d> boxes;
  for (Points& piece : pieces) {
    const Eigen::AlignedBox3d box = BoundsOf(piece);
    const auto around = std::ranges::find_if(boxes, [&](const Eigen::AlignedBox3d& other) {
      const Eigen::Vector3d slack = Eigen::Vector3d::Constant(0.01 * other.sizes().norm());
      return Eigen::AlignedBox3d(other.min() - slack, other.max() + slack).contains(box);
    });
    if (around != boxes.end()) {
      Points& into = merged[static_cast<std::size_t>(around - boxes.begin())];
      into.insert(into.end(), piece.begin(), piece.end());
    } else {
      merged.push_back(std::move(piece));
      boxes.push_back(box);
    }
    if (merged.size() > kMostParts) break;
  }
  if (merged.size() <= kMostParts) return merged;
  // A cloud of splinters is one thing.
  Points all;
  for (const Points& piece : merged) all.insert(all.end(), piece.begin(), piece.end());
  for (const Points& piece : pieces) all.insert(all.end(), piece.begin(), piece.end());
  return {all};
}

// The points that reach farthest in evenly spread directions.
Points Farthest(const Points& points) {
  std::vector<std::size_t> chosen;
  constexpr double kGoldenRad = 2.399963229728653;
  for (std::size_t k = 0; k < kMostHullVertices; ++k) {
    const double z = 1 - (2 * static_cast<double>(k) + 1) / static_cast<double>(kMostHullVertices);
    const double r = std::sqrt(1 - z * z);
    const double angle = kGoldenRad * static_cast<double>(k);
    const Eigen::Vector3d direction(r * std::cos(angle), r * std::sin(angle), z);
    std::size_t best = 0;
    double farthest = -std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < points.size(); ++i) {
      const double along = direction.dot(points[i]);
      if (along > farthest) farthest = along, best = i;
    }
    chosen.push_back(best);
  }
  std::ranges::sort(chosen);
  chosen.erase(std::unique(chosen.begin(), chosen.end()), chosen.end());
  Points kept;
  for (const std::size_t i : chosen) kept.push_back(points[i]);
  return kept;
}

struct Hull {
  Points vertices;
  double volume = 0;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  double margin = 0;  // that was taken off its faces
};

Hull HullOf(const Points& points, double shrink) {
  std::vector<float> coords;
  for (const Eigen::Vector3d& p : points) {
    for (int k = 0; k < 3; ++k) coords.push_back(static_cast<float>(p[k]));
  }
  btConvexHullComputer computer;
  Hull hull;
  hull.margin = computer.compute(coords.data(), 3 * sizeof(float), static_cast<int>(points.size()),
                                 static_cast<float>(shrink), 0.2f);
  for (int i = 0; i < computer.vertices.size(); ++i) {
    const btVector3& v = computer.vertices[i];
    hull.vertices.emplace_back(v.x(), v.y(), v.z());
  }
  if (hull.vertices.empty()) return hull;
  const Eigen::Vector3d inside = hull.vertices.front();
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();
  for (int f = 0; f < computer.faces.size(); ++f) {
    const btConvexHullComputer::Edge* first = &computer.edges[computer.faces[f]];
    const auto at = [&](int i) -> const Eigen::Vector3d& {
      return hull.vertices[static_cast<std::size_t>(i)];
    };
    const Eigen::Vector3d a = at(first->getSourceVertex());
    for (const auto* edge = first->getNextEdgeOfFace(); edge->getTargetVertex() != first->getSourceVertex();
         edge = edge->getNextEdgeOfFace()) {
      const Eigen::Vector3d b = at(edge->getSourceVertex());
      const Eigen::Vector3d c = at(edge->getTargetVertex());
      const double v = std::abs((a - inside).dot((b - inside).cross(c - inside))) / 6;
      hull.volume += v;
      moment += v * (a + b + c + inside) / 4;
    }
  }
  hull.center = hull.volume > 0 ? Eigen::Vector3d(moment / hull.volume) : BoundsOf(points).center();
  return hull;
}

// A convex hull that knows for every direction which of its vertices can be the farthest: Bullet's own looks
// at all of them, some hundred times a contact.
class FastHull : public btConvexInternalShape {
 public:
  explicit FastHull(const Points& vertices, double margin) {
    m_shapeType = CUSTOM_CONVEX_SHAPE_TYPE;
    for (const Eigen::Vector3d& v : vertices) vertices_.push_back(ToBullet(v));
    for (int face = 0; face < 6; ++face) {
      for (int i = 0; i < kSide; ++i) {
        for (int k = 0; k < kSide; ++k) AddCell(face, i, k);
      }
    }
    starts_.push_back(candidates_.size());
    setMargin(static_cast<float>(margin));
    for (int axis = 0; axis < 3; ++axis) {
      btVector3 direction(0, 0, 0);
      direction[axis] = 1;
      high_[axis] = localGetSupportingVertexWithoutMargin(direction)[axis];
      low_[axis] = localGetSupportingVertexWithoutMargin(-direction)[axis];
    }
  }

  [[nodiscard]] btVector3 localGetSupportingVertexWithoutMargin(const btVector3& direction) const override {
    const std::size_t cell = CellOf(direction);
    std::uint16_t best = candidates_[starts_[cell]];
    float farthest = direction.dot(vertices_[best]);
    for (std::size_t i = starts_[cell] + 1; i < starts_[cell + 1]; ++i) {
      const float along = direction.dot(vertices_[candidates_[i]]);
      if (along > farthest) farthest = along, best = candidates_[i];
    }
    return vertices_[best];
  }
  void batchedUnitVectorGetSupportingVertexWithoutMargin(const btVector3* directions, btVector3* supports,
                                                         int count) const override {
    for (int i = 0; i < count; ++i) supports[i] = localGetSupportingVertexWithoutMargin(directions[i]);
  }
  void getAabb(const btTransform& T, btVector3& low, btVector3& high) const override {
    btTransformAabb(low_, high_, getMargin(), T, low, high);
  }
  // As of its box.
  void calculateLocalInertia(btScalar mass, btVector3& inertia) const override {
    const btVector3 s = high_ - low_;
    inertia = mass / 12 *
              btVector3(s.y() * s.y() + s.z() * s.z(), s.x() * s.x() + s.z() * s.z(),
                        s.x() * s.x() + s.y() * s.y());
  }
  [[nodiscard]] const char* getName() const override { return "hull"; }

 private:
  static constexpr int kSide = 8;     // cells along the edge of a cube about the hull
  static constexpr int kSamples = 6;  // directions along a cell's edge, beyond its borders by a little

  // Of a cube's face a cell's place, -1..1.
  static std::size_t CellOf(const btVector3& d) {
    const int axis = d.absolute().maxAxis();
    const float along = std::abs(d[axis]);
    const int face = 2 * axis + (d[axis] < 0 ? 1 : 0);
    const auto cell = [&](float across) {
      const float place = along > 0 ? across / along : 0;
      return std::clamp(static_cast<int>((place + 1) * (kSide / 2)), 0, kSide - 1);
    };
    return static_cast<std::size_t>((face * kSide + cell(d[(axis + 1) % 3])) * kSide +
                                    cell(d[(axis + 2) % 3]));
  }

  void AddCell(int face, int i, int k) {
    starts_.push_back(candidates_.size());
    const int axis = face / 2;
    const auto place = [](int cell, int sample) {
      return (static_cast<float>(cell) - 0.1f + 1.2f * static_cast<float>(sample) / (kSamples - 1)) * 2 /
                 kSide -
             1;
    };
    const std::size_t first = candidates_.size();
    for (int a = 0; a < kSamples; ++a) {
      for (int b = 0; b < kSamples; ++b) {
        btVector3 direction;
        direction[axis] = face % 2 == 0 ? 1.0f : -1.0f;
        direction[(axis + 1) % 3] = place(i, a);
        direction[(axis + 2) % 3] = place(k, b);
        std::uint16_t best = 0;
        for (std::size_t v = 1; v < vertices_.size(); ++v) {
          if (direction.dot(vertices_[v]) > direction.dot(vertices_[best]))
            best = static_cast<std::uint16_t>(v);
        }
        if (std::find(candidates_.begin() + static_cast<std::ptrdiff_t>(first), candidates_.end(), best) ==
            candidates_.end())
          candidates_.push_back(best);
      }
    }
  }

  std::vector<btVector3> vertices_;
  std::vector<std::size_t> starts_;  // of each cell in candidates_
  std::vector<std::uint16_t> candidates_;
  btVector3 low_{0, 0, 0}, high_{0, 0, 0};
};

struct Part {
  std::unique_ptr<btCollisionShape> shape;  // about `center`
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  double volume = 0;
  double inner_radius_m = 0;
};

bool IsBall(const Points& points, const Eigen::AlignedBox3d& box) {
  const Eigen::Vector3d center = box.center();
  const double radius = box.sizes().maxCoeff() / 2;
  return points.size() >= 20 && box.sizes().minCoeff() > 1.9 * radius &&
         std::ranges::all_of(points, [&](const Eigen::Vector3d& p) {
           return std::abs((p - center).norm() - radius) < kRoundTolerance * radius;
         });
}

bool IsBox(const Points& vertices, const Eigen::AlignedBox3d& box) {
  const double slack = 1e-4 * box.sizes().maxCoeff();
  return vertices.size() == 8 && std::ranges::all_of(vertices, [&](const Eigen::Vector3d& p) {
           return ((p - box.min()).cwiseAbs().cwiseMin((p - box.max()).cwiseAbs()).array() < slack).all();
         });
}

Part BoxPart(const Eigen::AlignedBox3d& box) {
  const Eigen::Vector3d half = (box.sizes() / 2).cwiseMax(kFlatM);
  auto shape = std::make_unique<btBoxShape>(ToBullet(half));
  shape->setMargin(static_cast<float>(std::min(kMarginM, 0.2 * half.minCoeff())));
  return {std::move(shape), box.center(), 8 * half.prod(), half.minCoeff()};
}

Part MakePart(const Points& all) {
  const Points points = all.size() > 8 * kMostHullVertices ? Farthest(all) : all;
  const Eigen::AlignedBox3d box = BoundsOf(points);
  if (IsBall(all, box)) {
    const double radius = box.sizes().maxCoeff() / 2;
    return {std::make_unique<btSphereShape>(static_cast<float>(radius)), box.center(),
            4.0 / 3.0 * std::numbers::pi * radius * radius * radius, radius};
  }
  Hull hull = HullOf(points, 0);
  const double least = box.sizes().minCoeff();
  if (IsBox(hull.vertices, box) || least < 2 * kFlatM || hull.volume < 1e-4 * box.volume()) {
    return BoxPart(box);
  }
  const Eigen::Vector3d center = hull.center;
  const double volume = hull.volume;
  const Points outline = hull.vertices.size() > kMostHullVertices ? Farthest(hull.vertices) : hull.vertices;
  hull = HullOf(outline, std::min(kMarginM, 0.05 * least));
  if (hull.vertices.size() < 4) return BoxPart(box);
  for (Eigen::Vector3d& v : hull.vertices) v -= center;
  auto shape = std::make_unique<FastHull>(hull.vertices, std::max(hull.margin, 1e-5));
  return {std::move(shape), center, volume, least / 2};
}

std::string Size(double m) {
  char text[40];
  std::snprintf(text, sizeof text, "%g m", m);
  return text;
}

}  // namespace

SplitPose Split(const Eigen::Affine3d& T_scene_object) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(T_scene_object.linear(),
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d R = svd.matrixU() * svd.matrixV().transpose();
  if (R.determinant() < 0) R = -R;
  SplitPose split;
  split.T_scene_stretched.linear() = R;
  split.T_scene_stretched.translation() = T_scene_object.translation();
  split.stretch = R.transpose() * T_scene_object.linear();
  return split;
}

Result<BodyShape> MakeBodyShape(const Mesh& mesh, const Eigen::Matrix3d& stretch) {
  const std::vector<Points> pieces = Merge(Pieces(mesh, stretch));
  Eigen::AlignedBox3d box;
  for (const Points& piece : pieces) box.extend(BoundsOf(piece));
  const double size = box.isEmpty() ? 0 : box.sizes().maxCoeff();
  if (!(size >= kLeastBodyM && size <= kLargestBodyM)) {
    return Fail(ErrorCode::kBadInput, "is " + Size(size) + " large: what falls is from " + Size(kLeastBodyM) +
                                          " to " + Size(kLargestBodyM) + " (is its scale right?)");
  }
  std::vector<Part> parts;
  double volume = 0;
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();
  for (const Points& piece : pieces) {
    parts.push_back(MakePart(piece));
    volume += parts.back().volume;
    moment += parts.back().volume * parts.back().center;
  }
  const Eigen::Vector3d center = moment / volume;
  BodyShape body;
  body.T_body_object = Eigen::Translation3d(-center) * Eigen::Affine3d(stretch);
  body.inner_radius_m = std::numeric_limits<double>::infinity();
  for (const Part& part : parts) body.inner_radius_m = std::min(body.inner_radius_m, part.inner_radius_m);
  if (parts.size() == 1) {
    body.shape = parts.front().shape.get();
    body.shape->calculateLocalInertia(1.0f, body.inertia_per_kg);
    body.owned.push_back(std::move(parts.front().shape));
    return body;
  }
  auto compound = std::make_unique<btCompoundShape>();
  Eigen::Vector3d inertia = Eigen::Vector3d::Zero();
  for (Part& part : parts) {
    btTransform at = btTransform::getIdentity();
    const Eigen::Vector3d arm = part.center - center;
    at.setOrigin(ToBullet(arm));
    compound->addChildShape(at, part.shape.get());
    // Steiner's theorem along the body's axes; what is not diagonal is left out.
    btVector3 own;
    part.shape->calculateLocalInertia(1.0f, own);
    inertia += part.volume / volume *
               (Eigen::Vector3d(own.x(), own.y(), own.z()) +
                (Eigen::Vector3d::Constant(arm.squaredNorm()) - arm.cwiseProduct(arm)));
    body.owned.push_back(std::move(part.shape));
  }
  body.inertia_per_kg = ToBullet(inertia);
  body.shape = compound.get();
  body.owned.push_back(std::move(compound));
  return body;
}

}  // namespace mixstage
