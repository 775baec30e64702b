// SPDX-License-Identifier: Apache-2.0
#include "server/render/cg_objects.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace mixstage {

void CameraScene::Place(const Scene& scene, const RigidTransform& T_camera_scene) {
  std::erase_if(prepared_, [&](const auto& entry) {
    return std::none_of(scene.objects.begin(), scene.objects.end(),
                        [&](const SceneObject& object) { return object.mesh.get() == entry.first; });
  });
  objects_.clear();
  vertices_.clear();
  std::size_t triangles = 0;
  for (std::size_t i = 0; i < scene.objects.size(); ++i) {
    const SceneObject& source = scene.objects[i];
    if (source.hidden) continue;
    std::shared_ptr<const PreparedMesh>& prepared = prepared_[source.mesh.get()];
    if (!prepared) prepared = meshes_->Get(source.mesh);
    const Eigen::Affine3d T_camera_object = T_camera_scene * source.T_scene_object;
    const double determinant = T_camera_object.linear().determinant();
    CameraObject object;
    object.mesh = prepared.get();
    object.first_vertex = vertices_.size();
    object.first_triangle = triangles;
    object.index = static_cast<int>(i);
    object.mirrored = determinant < 0;
    objects_.push_back(object);
    triangles += prepared->triangles.size();

    const Mesh& mesh = *source.mesh;
    const std::vector<Eigen::Vector3f>& positions = source.positions();
    const std::vector<Eigen::Vector3f>& facing = source.normals();
    const Eigen::Matrix3f linear = T_camera_object.linear().cast<float>();
    const Eigen::Vector3f shift = T_camera_object.translation().cast<float>();
    const Eigen::Matrix3f normals = T_camera_object.linear().inverse().transpose().cast<float>();
    vertices_.resize(vertices_.size() + mesh.positions.size());
    CameraVertex* out = vertices_.data() + object.first_vertex;
    const bool has_uvs = !mesh.uvs.empty();
    for (std::size_t k = 0; k < mesh.positions.size(); ++k) {
      const Eigen::Vector3f p = linear * positions[k] + shift;
      const Eigen::Vector3f n = normals * facing[k];
      const Eigen::Vector2f uv = has_uvs ? mesh.uvs[k] : Eigen::Vector2f::Zero().eval();
      out[k].position_u = Eigen::Array4f(p.x(), p.y(), p.z(), uv.x());
      out[k].normal_v = Eigen::Array4f(n.x(), n.y(), n.z(), uv.y());
    }
  }
}

cv::Rect CameraScene::Region(const PinholeCamera& camera, double near_m) const {
  const cv::Rect picture(0, 0, camera.width, camera.height);
  Eigen::Array2f low = Eigen::Array2f::Constant(std::numeric_limits<float>::infinity());
  Eigen::Array2f high = -low;
  bool crosses_near = false;
  for (const CameraVertex& vertex : vertices_) {
    if (vertex.position_u.z() < static_cast<float>(near_m)) {
      crosses_near = true;
      continue;
    }
    const Eigen::Array2f at = vertex.position_u.head<2>() / vertex.position_u.z();
    low = low.min(at);
    high = high.max(at);
  }
  if (!(low.x() <= high.x())) return {};
  if (crosses_near) return picture;
  // Outline of that window through the lens; beyond the fold the picture's edge is the limit.
  constexpr int kSteps = 32;
  Eigen::Array2d first = Eigen::Array2d::Constant(std::numeric_limits<double>::infinity());
  Eigen::Array2d last = -first;
  for (int i = 0; i <= kSteps; ++i) {
    const double t = static_cast<double>(i) / kSteps;
    const double x = low.x() + t * (high.x() - low.x());
    const double y = low.y() + t * (high.y() - low.y());
    for (const Eigen::Vector3d& ray : {Eigen::Vector3d(x, low.y(), 1), Eigen::Vector3d(x, high.y(), 1),
                                       Eigen::Vector3d(low.x(), y, 1), Eigen::Vector3d(high.x(), y, 1)}) {
      const auto pixel = camera.Project(ray);
      if (!pixel) return picture;
      first = first.min(pixel->array());
      last = last.max(pixel->array());
    }
  }
  // Between the outline's samples the lens bends by less than this.
  constexpr double kMargin = 3;
  first = (first - kMargin).max(Eigen::Array2d::Zero());
  last = (last + kMargin).min(Eigen::Array2d(camera.width - 1, camera.height - 1));
  if (!(first.x() <= last.x() && first.y() <= last.y())) return {};
  const int x = static_cast<int>(first.x()) & ~1;
  const int y = static_cast<int>(first.y()) & ~1;
  const int right = (static_cast<int>(last.x()) + 2) & ~1;
  const int bottom = (static_cast<int>(last.y()) + 2) & ~1;
  return cv::Rect(x, y, right - x, bottom - y) & picture;
}

void CameraScene::Draw(const Scene& scene, const RigidTransform& T_camera_scene,
                       Rasteriser& rasteriser) const {
  for (const CameraObject& object : objects_) {
    const SceneObject& source = scene.objects[static_cast<std::size_t>(object.index)];
    const Eigen::Affine3d T_camera_object = T_camera_scene * source.T_scene_object;
    const std::span<const std::uint32_t> indices(object.mesh->indices);
    const std::size_t one_sided = 3 * object.mesh->one_sided;
    const int first = static_cast<int>(object.first_triangle);
    if (one_sided > 0) {
      rasteriser.Draw({source.positions(), indices.first(one_sided)}, T_camera_object, first,
                      Faces::kFrontOnly);
    }
    if (one_sided < indices.size()) {
      rasteriser.Draw({source.positions(), indices.subspan(one_sided)}, T_camera_object,
                      first + static_cast<int>(object.mesh->one_sided), Faces::kBoth);
    }
  }
}

const CameraObject& CameraScene::ObjectOf(std::size_t triangle) const {
  auto after =
      std::upper_bound(objects_.begin(), objects_.end(), triangle,
                       [](std::size_t id, const CameraObject& object) { return id < object.first_triangle; });
  return *std::prev(after);
}

}  // namespace mixstage
