// SPDX-License-Identifier: Apache-2.0
#include "server/raster/split_triangle.h"

#include <algorithm>
#include <cmath>

namespace mixstage::raster {
namespace {

// An edge's ends are at most 1e6 m / near apart in x/z; halving it this often makes it shorter than any
// max_edge.
constexpr int kMaxHalvings = 48;

class Splitter {
 public:
  Splitter(const RasterLens& lens, std::int32_t id, const ScanTarget& clip, SplitTriangles& out)
      : lens_(lens), id_(id), clip_(clip), out_(out) {}

  void Clip(const CameraCorner& a, const CameraCorner& b, const CameraCorner& c) {
    const Polygon whole = {3, {a, b, c}};
    const Polygon seen =
        CutBy(kNear, whole, [this](const Eigen::Vector3f& p) { return p.z() - lens_.near_m; });
    const Polygon kept = CutBy(kCutOff, seen, [this](const Eigen::Vector3f& p) { return lens_.Height(p); });
    for (int i = 2; i < kept.size; ++i) Divide(kept.corners[0], kept.corners[i - 1], kept.corners[i], 0);
  }

 private:
  struct Polygon {
    int size = 0;
    CameraCorner corners[5];
  };

  // What a plane leaves of the polygon: corners on its far side have the outcode, height is over it. A cut is
  // always reckoned from the corner that goes, so that both triangles of an edge find the same point.
  template <typename Height>
  [[nodiscard]] Polygon CutBy(Outcode gone, const Polygon& of, const Height& height) const {
    Polygon left;
    for (int i = 0; i < of.size; ++i) {
      const CameraCorner& from = of.corners[i];
      const CameraCorner& to = of.corners[(i + 1) % of.size];
      const bool from_goes = (from.projected.outcode & gone) != 0;
      const bool to_goes = (to.projected.outcode & gone) != 0;
      if (!from_goes) left.corners[left.size++] = from;
      if (from_goes == to_goes) continue;
      const Eigen::Vector3f& p = (from_goes ? from : to).p_camera;
      const Eigen::Vector3f& q = (from_goes ? to : from).p_camera;
      Eigen::Vector3f cut = p + height(p) / (height(p) - height(q)) * (q - p);
      if (gone == kNear) cut.z() = lens_.near_m;
      CameraCorner& corner = left.corners[left.size++];
      corner = At(cut);
      // The other plane has not had its turn.
      if (gone == kNear && lens_.cuts() && !(lens_.Height(cut) >= 0)) corner.projected.outcode |= kCutOff;
    }
    return left;
  }

  [[nodiscard]] CameraCorner At(const Eigen::Vector3f& p) const { return {p, lens_.Project(p)}; }

  // The point of the edge that an undistorted picture shows half way; the same for both orders of the ends.
  [[nodiscard]] CameraCorner Middle(const CameraCorner& a, const CameraCorner& b) const {
    const float za = a.p_camera.z();
    const float zb = b.p_camera.z();
    return At((a.p_camera * zb + b.p_camera * za) / (za + zb));
  }

  [[nodiscard]] bool IsLong(const CameraCorner& a, const CameraCorner& b) const {
    if (((a.projected.outcode | b.projected.outcode) & kNoPixel) == 0) {
      return std::max(std::abs(a.projected.x - b.projected.x), std::abs(a.projected.y - b.projected.y)) >
             lens_.max_edge;
    }
    // Without pixels the undistorted length stands in.
    const Eigen::Vector2f d = a.p_camera.head<2>() / a.p_camera.z() - b.p_camera.head<2>() / b.p_camera.z();
    return std::max(std::abs(d.x()) * lens_.fx, std::abs(d.y()) * lens_.fy) * kSubPixels >
           static_cast<float>(lens_.max_edge);
  }

  // Only for corners with pixels; grown by half, for the curves that the edges really are.
  [[nodiscard]] bool OutsideClip(const ProjectedVertex& a, const ProjectedVertex& b,
                                 const ProjectedVertex& c) const {
    const auto [x0, x1] = std::minmax({a.x, b.x, c.x});
    const auto [y0, y1] = std::minmax({a.y, b.y, c.y});
    const int grow = std::max(x1 - x0, y1 - y0) / 2;
    return x1 + grow < clip_.x0 * kSubPixels || x0 - grow > clip_.x1 * kSubPixels ||
           y1 + grow < clip_.y0 * kSubPixels || y0 - grow > clip_.y1 * kSubPixels;
  }

  void Emit(const CameraCorner& a, const CameraCorner& b, const CameraCorner& c) {
    for (const CameraCorner* corner : {&a, &b, &c}) {
      out_.indices.push_back(static_cast<std::uint32_t>(out_.vertices.size()));
      out_.vertices.push_back(corner->projected);
    }
    out_.ids.push_back(id_);
  }

  void Divide(const CameraCorner& a, const CameraCorner& b, const CameraCorner& c, int halvings) {
    const std::uint32_t any = a.projected.outcode | b.projected.outcode | c.projected.outcode;
    if ((any & kNotFinite) != 0 || halvings > kMaxHalvings ||
        (a.projected.outcode & b.projected.outcode & c.projected.outcode & kOutsideMask) != 0) {
      return;
    }
    if ((any & kNoPixel) == 0 && OutsideClip(a.projected, b.projected, c.projected)) return;
    const bool ab = IsLong(a, b);
    const bool bc = IsLong(b, c);
    const bool ca = IsLong(c, a);
    const int next = halvings + 1;
    switch (ab + bc + ca) {
      case 0:
        if ((any & kNoPixel) == 0) Emit(a, b, c);
        return;
      case 1:
        if (ab) return Bisect(a, b, c, next);
        if (bc) return Bisect(b, c, a, next);
        return Bisect(c, a, b, next);
      case 2:
        if (!ca) return Trisect(a, b, c, next);
        if (!ab) return Trisect(b, c, a, next);
        return Trisect(c, a, b, next);
      default:
        break;
    }
    const CameraCorner m_ab = Middle(a, b);
    const CameraCorner m_bc = Middle(b, c);
    const CameraCorner m_ca = Middle(c, a);
    Divide(a, m_ab, m_ca, next);
    Divide(m_ab, b, m_bc, next);
    Divide(m_ca, m_bc, c, next);
    Divide(m_ab, m_bc, m_ca, next);
  }
  // a b is long.
  void Bisect(const CameraCorner& a, const CameraCorner& b, const CameraCorner& c, int next) {
    const CameraCorner middle = Middle(a, b);
    Divide(a, middle, c, next);
    Divide(middle, b, c, next);
  }
  // a b and b c are long.
  void Trisect(const CameraCorner& a, const CameraCorner& b, const CameraCorner& c, int next) {
    const CameraCorner m_ab = Middle(a, b);
    const CameraCorner m_bc = Middle(b, c);
    Divide(m_ab, b, m_bc, next);
    Divide(a, m_ab, m_bc, next);
    Divide(a, m_bc, c, next);
  }

  const RasterLens& lens_;
  const std::int32_t id_;
  const ScanTarget& clip_;
  SplitTriangles& out_;
};

}  // namespace

void SplitTriangle(const RasterLens& lens, const CameraCorner& a, const CameraCorner& b,
                   const CameraCorner& c, std::int32_t id, const ScanTarget& clip, SplitTriangles& out) {
  Splitter(lens, id, clip, out).Clip(a, b, c);
}

}  // namespace mixstage::raster
