// SPDX-License-Identifier: Apache-2.0
#include "server/render/cg_renderer.h"

#include <algorithm>
#include <chrono>
#include <vector>

#include "proto/base/log.h"
#include "server/raster/egl_rasteriser.h"
#include "server/raster/rasteriser.h"
#include "server/render/cg_fragments.h"
#include "server/render/cg_objects.h"
#include "server/render/egl_shading.h"

namespace mixstage {
namespace {

double MillisecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

// Everything that the layer depends on. The meshes are held, so that a new one never has an old one's
// address.
struct Drawn {
  std::uint64_t revision = 0;
  RigidTransform T_camera_scene = RigidTransform::Identity();
  Illumination light;
  CgPart part;
  std::vector<std::shared_ptr<const Mesh>> meshes;
  std::vector<std::shared_ptr<const PosedVertices>> posed;
  std::vector<Eigen::Matrix4d> poses;

  [[nodiscard]] bool Is(const Scene& scene, const RigidTransform& T, const Illumination& now,
                        const CgPart& of) const {
    if (revision != scene.revision || T_camera_scene.matrix() != T.matrix() || !SameLight(light, now) ||
        part != of)
      return false;
    if (meshes.size() != scene.objects.size()) return false;
    for (std::size_t i = 0; i < meshes.size(); ++i) {
      if (meshes[i] != scene.objects[i].mesh || posed[i] != scene.objects[i].posed ||
          poses[i] != scene.objects[i].T_scene_object.matrix())
        return false;
    }
    return true;
  }
  void Keep(const Scene& scene, const RigidTransform& T, const Illumination& now, const CgPart& of) {
    revision = scene.revision;
    T_camera_scene = T;
    light = now;
    part = of;
    meshes.clear();
    posed.clear();
    poses.clear();
    for (const SceneObject& object : scene.objects) {
      meshes.push_back(object.mesh);
      posed.push_back(object.posed);
      poses.push_back(object.T_scene_object.matrix());
    }
  }
};

}  // namespace

struct CgRenderer::State {
  explicit State(std::shared_ptr<PreparedMeshes> meshes) : scene(std::move(meshes)) {}

  CgRendererConfig config;
  PinholeCamera camera;
  cv::Mat2f rays;
  std::unique_ptr<Rasteriser> rasteriser;
  // With a GPU: rasteriser is this one, and its samples are shaded where they are.
  raster::EglRasteriser* egl = nullptr;
  std::shared_ptr<gl::Gpu> gpu;
  std::optional<EglShading> egl_shading;
  bool reported = false;
  CameraScene scene;
  FragmentShader shader;
  // Pictures as large as any layer so far; the layer's are their corners.
  cv::Mat4f color;
  cv::Mat1f depth_m;
  cv::Mat1b object_id;
  CgLayer layer;
  Drawn drawn;
  CgTiming timing;

  void Cover(const cv::Rect& bounds) {
    layer.bounds = bounds;
    if (color.rows < bounds.height || color.cols < bounds.width) {
      const cv::Size size(std::max(color.cols, bounds.width), std::max(color.rows, bounds.height));
      color.create(size);
      depth_m.create(size);
      object_id.create(size);
    }
    const cv::Rect corner(0, 0, bounds.width, bounds.height);
    layer.color = color(corner);
    layer.depth_m = depth_m(corner);
    layer.object_id = object_id(corner);
  }

  // Width of a pixel as an angle, at the picture's centre.
  [[nodiscard]] float PixelRad() const { return static_cast<float>(2.0 / (camera.fx + camera.fy)); }

  // Picture pixels, even-aligned, of the samples inside touched.
  static cv::Rect PixelsOf(const cv::Rect& touched, const cv::Rect& region) {
    const int x = (region.x + touched.x / kSampleScale) & ~1;
    const int y = (region.y + touched.y / kSampleScale) & ~1;
    const int right = (region.x + (touched.br().x - 1) / kSampleScale + 2) & ~1;
    const int bottom = (region.y + (touched.br().y - 1) / kSampleScale + 2) & ~1;
    return cv::Rect(x, y, right - x, bottom - y) & region;
  }

  // Samples and layer without a way through this processor. False when the GPU cannot: both are then to be
  // drawn here.
  bool DrawOnGpu(const CameraIllumination& light, const cv::Rect& region) {
    const auto current = gpu->Enter();
    if (!current) return false;
    const gl::Texture* samples = egl->FinishOnGpu(*current);
    if (samples == nullptr) return false;
    const cv::Rect touched = egl->touched();
    Cover(touched.empty() ? cv::Rect() : PixelsOf(touched, region));
    if (touched.empty()) return true;
    const Status ok = egl_shading->Shade(*current, scene, light, *samples, region, layer);
    // A lost context is reported by Gpu; what a driver refuses once it will refuse again.
    if (!ok && !reported && ok.error().code != ErrorCode::kUnavailable) {
      reported = true;
      spdlog::warn("render_scene event=drawn_on_cpu reason=\"{}\"", ok.error().message);
    }
    return ok.has_value();
  }

  void Draw(const Scene& now, const RigidTransform& T_camera_scene, const Illumination& light,
            const CgPart& part) {
    const auto start = std::chrono::steady_clock::now();
    timing = {};
    ++layer.drawing;
    scene.Place(now, T_camera_scene);
    cv::Rect region = scene.Region(camera, config.near_m);
    if (!part.window_px.empty()) region &= part.window_px;
    if (region.empty()) return Cover({});
    // n . p + d of the scene's frame, written for points of the camera's.
    const Eigen::Vector3d normal = T_camera_scene.linear() * part.half_space.head<3>();
    Eigen::Vector4f half_space;
    half_space << normal.cast<float>(),
        static_cast<float>(part.half_space.w() - normal.dot(T_camera_scene.translation()));
    rasteriser->Begin({kSampleScale, region, half_space});
    scene.Draw(now, T_camera_scene, *rasteriser);
    const CameraIllumination camera_light = InCamera(light, T_camera_scene);
    if (egl != nullptr && DrawOnGpu(camera_light, region)) {
      timing.shading_ms = MillisecondsSince(start);
      return;
    }
    const VisibilityBuffer& samples = rasteriser->Finish();
    timing.visibility_ms = MillisecondsSince(start);
    if (samples.touched.empty()) return Cover({});

    const auto shading_start = std::chrono::steady_clock::now();
    Cover(PixelsOf(samples.touched, region));
    const FragmentSource source{scene, camera_light, samples, region, rays, PixelRad()};
    for (int v = layer.bounds.y; v < layer.bounds.br().y; ++v) shader.ShadeRow(source, v, layer);
    timing.shading_ms = MillisecondsSince(shading_start);
  }
};

CgRenderer::CgRenderer(std::unique_ptr<State> state) : state_(std::move(state)) {}
CgRenderer::CgRenderer(CgRenderer&&) noexcept = default;
CgRenderer& CgRenderer::operator=(CgRenderer&&) noexcept = default;
CgRenderer::~CgRenderer() = default;

Result<CgRenderer> CgRenderer::Create(const CgRendererConfig& config, const PinholeCamera& color,
                                      const RenderDevice& device, std::shared_ptr<PreparedMeshes> meshes) {
  auto rasteriser = CreateRasteriser(device.backend, color, {config.near_m}, device.gpu);
  if (!rasteriser) return tl::unexpected(rasteriser.error());
  auto state = std::make_unique<State>(meshes ? std::move(meshes) : std::make_shared<PreparedMeshes>());
  state->config = config;
  state->camera = color;
  state->rays = UnprojectionTable(color);
  state->rasteriser = std::move(*rasteriser);
  if (device.backend == RasterBackend::kEgl) {
    state->egl = static_cast<raster::EglRasteriser*>(state->rasteriser.get());
    state->gpu = device.gpu;
    auto shading = EglShading::Create(device.gpu, state->rays, state->PixelRad());
    if (!shading) return tl::unexpected(shading.error());
    state->egl_shading.emplace(std::move(*shading));
  }
  return CgRenderer(std::move(state));
}

const CgLayer& CgRenderer::Run(const Scene& scene, const RigidTransform& T_camera_scene,
                               const Illumination& light, const CgPart& part) {
  State& state = *state_;
  if (state.layer.drawing == 0 || !state.drawn.Is(scene, T_camera_scene, light, part)) {
    state.Draw(scene, T_camera_scene, light, part);
    state.drawn.Keep(scene, T_camera_scene, light, part);
  }
  return state.layer;
}

const CgTiming& CgRenderer::timing() const { return state_->timing; }

}  // namespace mixstage
