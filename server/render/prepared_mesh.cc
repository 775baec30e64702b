// SPDX-License-Identifier: Apache-2.0
#include "server/render/prepared_mesh.h"

namespace mixstage {
namespace {

// A masked material that is nowhere opaque enough shows nothing.
bool IsInvisible(const Material& material) {
  return material.alpha_mask && material.base_alpha < material.alpha_cutoff;
}

}  // namespace

PreparedMesh::PreparedMesh(std::shared_ptr<const Mesh> source) : mesh(std::move(source)) {
  for (const Texture& texture : mesh->textures) textures.emplace_back(texture);
  for (const bool double_sided : {false, true}) {
    for (const MeshPart& part : mesh->parts) {
      const Material& material = mesh->materials[static_cast<std::size_t>(part.material)];
      if (material.double_sided != double_sided || IsInvisible(material)) continue;
      for (std::size_t i = part.first_index; i < part.first_index + part.index_count; i += 3) {
        const std::uint32_t* corner = &mesh->indices[i];
        const Eigen::Vector3f normal =
            (mesh->normals[corner[0]] + mesh->normals[corner[1]] + mesh->normals[corner[2]]).normalized();
        surface_keys.emplace_back(normal, static_cast<std::uint32_t>(part.material));
        triangles.push_back({{corner[0], corner[1], corner[2]}, static_cast<std::uint32_t>(part.material)});
        indices.insert(indices.end(), corner, corner + 3);
      }
    }
    if (!double_sided) one_sided = triangles.size();
  }
}

std::shared_ptr<const PreparedMesh> PreparedMeshes::Get(const std::shared_ptr<const Mesh>& mesh) {
  std::erase_if(known_, [](const auto& entry) { return entry.second.expired(); });
  std::weak_ptr<const PreparedMesh>& known = known_[mesh.get()];
  std::shared_ptr<const PreparedMesh> prepared = known.lock();
  if (!prepared) known = prepared = std::make_shared<const PreparedMesh>(mesh);
  return prepared;
}

}  // namespace mixstage
