// SPDX-License-Identifier: Apache-2.0
#include "server/scene/gltf_accessor.h"

#include <algorithm>
#include <cstring>
#include <string>

#include "server/scene/mesh.h"

namespace mixstage {
namespace {

constexpr std::size_t kMostElements = 3 * ModelLimits::kTriangles;

auto Bad(const std::string& what) { return Fail(ErrorCode::kBadInput, what); }

std::size_t ComponentBytes(int type) {
  switch (type) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      return 1;
    case TINYGLTF_COMPONENT_TYPE_SHORT:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      return 2;
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
    case TINYGLTF_COMPONENT_TYPE_FLOAT:
      return 4;
    default:
      return 0;
  }
}

template <typename T>
T ReadAs(const std::uint8_t* from) {
  T value;
  std::memcpy(&value, from, sizeof value);
  return value;
}

float Component(const std::uint8_t* from, int type, bool normalised) {
  switch (type) {
    case TINYGLTF_COMPONENT_TYPE_BYTE: {
      const float v = ReadAs<std::int8_t>(from);
      return normalised ? std::max(v / 127.0f, -1.0f) : v;
    }
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      return static_cast<float>(*from) * (normalised ? 1.0f / 255.0f : 1.0f);
    case TINYGLTF_COMPONENT_TYPE_SHORT: {
      const float v = ReadAs<std::int16_t>(from);
      return normalised ? std::max(v / 32767.0f, -1.0f) : v;
    }
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      return static_cast<float>(ReadAs<std::uint16_t>(from)) * (normalised ? 1.0f / 65535.0f : 1.0f);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
      return static_cast<float>(ReadAs<std::uint32_t>(from));
    default:
      return ReadAs<float>(from);
  }
}

std::uint32_t Index(const std::uint8_t* from, int type) {
  if (type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE) return *from;
  if (type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT) return ReadAs<std::uint16_t>(from);
  return ReadAs<std::uint32_t>(from);
}

bool IsIndexType(int type) {
  return type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE || type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT ||
         type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT;
}

// count elements of element_bytes, stride apart, from offset: all inside a view, or an error.
struct Elements {
  const std::uint8_t* first = nullptr;
  std::size_t stride = 0;
};
Result<Elements> Locate(const tinygltf::Model& model, int buffer_view, std::size_t offset, std::size_t count,
                        std::size_t element_bytes, const std::string& place) {
  auto bytes = GltfViewBytes(model, buffer_view);
  if (!bytes) return Within(place, bytes.error());
  std::size_t stride = model.bufferViews[static_cast<std::size_t>(buffer_view)].byteStride;
  if (stride == 0) stride = element_bytes;
  if (stride < element_bytes || stride > 252)
    return Bad(place + ": its bufferView's byteStride does not fit");
  // count and stride are small by now: the product cannot overflow.
  if (count == 0 || offset > bytes->size() || (count - 1) * stride + element_bytes > bytes->size() - offset) {
    return Bad(place + " reaches beyond its bufferView");
  }
  return Elements{bytes->data() + offset, stride};
}

Result<const tinygltf::Accessor*> Find(const tinygltf::Model& model, int index) {
  if (index < 0 || static_cast<std::size_t>(index) >= model.accessors.size()) {
    return Bad("accessors[" + std::to_string(index) + "] does not exist");
  }
  const tinygltf::Accessor& accessor = model.accessors[static_cast<std::size_t>(index)];
  const std::string place = "accessors[" + std::to_string(index) + "]";
  if (ComponentBytes(accessor.componentType) == 0) return Bad(place + ".componentType is unknown");
  if (accessor.count == 0 || accessor.count > kMostElements)
    return Bad(place + ".count is outside 1..30000000");
  return &accessor;
}

// The elements that a sparse accessor replaces.
Status FillSparse(const tinygltf::Model& model, const tinygltf::Accessor& accessor, const std::string& place,
                  GltfNumbers& numbers) {
  const auto& sparse = accessor.sparse;
  const auto components = static_cast<std::size_t>(numbers.components);
  const std::size_t component_bytes = ComponentBytes(accessor.componentType);
  if (sparse.count < 1 || static_cast<std::size_t>(sparse.count) > accessor.count ||
      !IsIndexType(sparse.indices.componentType) || sparse.indices.byteOffset < 0 ||
      sparse.values.byteOffset < 0) {
    return Bad(place + ".sparse is damaged");
  }
  const auto count = static_cast<std::size_t>(sparse.count);
  auto indices = Locate(model, sparse.indices.bufferView, static_cast<std::size_t>(sparse.indices.byteOffset),
                        count, ComponentBytes(sparse.indices.componentType), place + ".sparse.indices");
  if (!indices) return tl::unexpected(indices.error());
  auto values = Locate(model, sparse.values.bufferView, static_cast<std::size_t>(sparse.values.byteOffset),
                       count, component_bytes * components, place + ".sparse.values");
  if (!values) return tl::unexpected(values.error());
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t target = Index(indices->first + i * indices->stride, sparse.indices.componentType);
    if (target >= accessor.count) return Bad(place + ".sparse.indices names an element that does not exist");
    for (std::size_t c = 0; c < components; ++c) {
      numbers.values[target * components + c] =
          Component(values->first + i * values->stride + c * component_bytes, accessor.componentType,
                    accessor.normalized);
    }
  }
  return {};
}

}  // namespace

Result<std::span<const std::uint8_t>> GltfViewBytes(const tinygltf::Model& model, int buffer_view) {
  const std::string place = "bufferViews[" + std::to_string(buffer_view) + "]";
  if (buffer_view < 0 || static_cast<std::size_t>(buffer_view) >= model.bufferViews.size()) {
    return Bad(place + " does not exist");
  }
  const tinygltf::BufferView& view = model.bufferViews[static_cast<std::size_t>(buffer_view)];
  if (view.buffer < 0 || static_cast<std::size_t>(view.buffer) >= model.buffers.size()) {
    return Bad(place + ".buffer does not exist");
  }
  const std::vector<unsigned char>& data = model.buffers[static_cast<std::size_t>(view.buffer)].data;
  if (view.byteOffset > data.size() || view.byteLength > data.size() - view.byteOffset) {
    return Bad(place + " reaches beyond its buffer");
  }
  return std::span<const std::uint8_t>(data.data() + view.byteOffset, view.byteLength);
}

Result<GltfNumbers> ReadGltfNumbers(const tinygltf::Model& model, int index,
                                    std::initializer_list<int> allowed) {
  auto found = Find(model, index);
  if (!found) return tl::unexpected(found.error());
  const tinygltf::Accessor& accessor = **found;
  const std::string place = "accessors[" + std::to_string(index) + "]";
  GltfNumbers numbers;
  numbers.components = accessor.type == TINYGLTF_TYPE_SCALAR ? 1
                       : accessor.type >= TINYGLTF_TYPE_VEC2 && accessor.type <= TINYGLTF_TYPE_VEC4
                           ? accessor.type
                       : accessor.type == TINYGLTF_TYPE_MAT4 && ComponentBytes(accessor.componentType) == 4
                           ? 16  // of four-byte numbers its columns lie side by side
                           : 0;
  if (std::find(allowed.begin(), allowed.end(), numbers.components) == allowed.end()) {
    return Bad(place + ".type does not fit its use");
  }
  const auto components = static_cast<std::size_t>(numbers.components);
  const std::size_t component_bytes = ComponentBytes(accessor.componentType);
  if (accessor.bufferView < 0) {  // all zeros, by the specification
    if (accessor.count > ModelLimits::kVertices) return Bad(place + ".count is over the limit of vertices");
    numbers.values.assign(accessor.count * components, 0.0f);
  } else {
    auto elements = Locate(model, accessor.bufferView, accessor.byteOffset, accessor.count,
                           component_bytes * components, place);
    if (!elements) return tl::unexpected(elements.error());
    numbers.values.reserve(accessor.count * components);
    for (std::size_t i = 0; i < accessor.count; ++i) {
      for (std::size_t c = 0; c < components; ++c) {
        numbers.values.push_back(Component(elements->first + i * elements->stride + c * component_bytes,
                                           accessor.componentType, accessor.normalized));
      }
    }
  }
  if (accessor.sparse.isSparse) {
    if (auto ok = FillSparse(model, accessor, place, numbers); !ok) return tl::unexpected(ok.error());
  }
  return numbers;
}

Result<std::vector<std::uint32_t>> ReadGltfIndices(const tinygltf::Model& model, int index,
                                                   std::size_t vertex_count) {
  auto found = Find(model, index);
  if (!found) return tl::unexpected(found.error());
  const tinygltf::Accessor& accessor = **found;
  const std::string place = "accessors[" + std::to_string(index) + "]";
  if (accessor.type != TINYGLTF_TYPE_SCALAR || !IsIndexType(accessor.componentType) ||
      accessor.sparse.isSparse) {
    return Bad(place + " does not hold unsigned indices");
  }
  auto elements = Locate(model, accessor.bufferView, accessor.byteOffset, accessor.count,
                         ComponentBytes(accessor.componentType), place);
  if (!elements) return tl::unexpected(elements.error());
  std::vector<std::uint32_t> indices(accessor.count);
  for (std::size_t i = 0; i < indices.size(); ++i) {
    indices[i] = Index(elements->first + i * elements->stride, accessor.componentType);
    if (indices[i] >= vertex_count) {
      return Bad(place + "[" + std::to_string(i) + "] = " + std::to_string(indices[i]) + " is beyond its " +
                 std::to_string(vertex_count) + " vertices");
    }
  }
  return indices;
}

}  // namespace mixstage
