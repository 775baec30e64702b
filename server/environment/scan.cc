// SPDX-License-Identifier: Apache-2.0
#include "server/environment/scan.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "proto/base/clock.h"
#include "proto/base/text.h"
#include "proto/take/picture_files.h"
#include "server/environment/color_panorama.h"
#include "server/environment/dense_surface.h"
#include "server/environment/depth_fusion.h"
#include "server/environment/edge_placement.h"
#include "server/environment/lamps.h"
#include "server/environment/moved_things.h"
#include "server/environment/openings.h"
#include "server/environment/pose_order.h"
#include "server/environment/range_view.h"
#include "server/environment/registration.h"
#include "server/environment/room_planes.h"
#include "server/environment/surface_fit.h"
#include "server/environment/surface_mesh.h"
#include "server/environment/sweep_layout.h"

namespace mixstage {
namespace {

constexpr int kDepthShrink = 3;  // the surface's pixels are so many of the panorama's

// What was loaded of one position.
struct LoadedView {
  SweepView listed;
  cv::Mat3b bgr;
  RangeFrames frames;
  RangeView range;
};

Status LoadView(const SweepView& listed, const Rig& rig, const RangeCamera& camera, JpegDecoder& decoder,
                LoadedView& view) {
  view.listed = listed;
  YuvImage yuv;
  if (auto ok = LoadColor(listed.color, decoder, yuv); !ok) return ok;
  if (yuv.width() != rig.color.width || yuv.height() != rig.color.height)
    return Fail(ErrorCode::kBadInput, listed.color.string() + ": is not of the size the rig states");
  view.bgr = ToBgr(yuv);
  auto load = [&](const std::filesystem::path& file, std::vector<cv::Mat1w>& into) -> Status {
    cv::Mat1w picture;
    if (auto ok = LoadDepth16(file, picture); !ok) return ok;
    if (picture.size() != camera.ray.size())
      return Fail(ErrorCode::kBadInput, file.string() + ": is not of the size the rig states");
    into.push_back(picture);
    return {};
  };
  for (const auto& file : listed.depth)
    if (auto ok = load(file, view.frames.counts); !ok) return ok;
  for (const auto& file : listed.amplitude)
    if (auto ok = load(file, view.frames.amplitudes); !ok) return ok;
  return {};
}

// The surface that poses and ranges give.
struct Surface {
  PanoramaGrid grid;                   // of the surface
  std::vector<PanoramaPatch> patches;  // of the views
  FusedDepth fused;
  SurfaceNodes nodes;
  std::vector<GrownPlane> planes;
};

struct Layout {
  Layout(const PinholeCamera& color, const std::vector<RigidTransform>& poses, const RangeCamera& camera)
      : node_step(NodeStep(PanoramaGrid(Coarser(LayOutPanorama(color, poses, kDepthShrink), kDepthShrink)),
                           camera.pitch_rad)),
        // The sides are whole surface pixels and whole nodes.
        panorama(LayOutPanorama(color, poses, kDepthShrink * node_step)),
        grid(Coarser(panorama, kDepthShrink)) {}
  int node_step;
  Panorama panorama;
  PanoramaGrid grid;  // of the surface
};

// Turns listed poses whose world is not upright (that of a first camera, say) until their pictures are, in
// the mean.
void Upright(std::vector<RigidTransform>& poses) {
  Eigen::Vector3d up = Eigen::Vector3d::Zero();
  for (const RigidTransform& T : poses) up -= T.linear().col(1);
  constexpr double kUpright = 0.7;  // cosine: nobody scans a room with the camera lying on its side
  if (up.norm() < 1e-6 || up.normalized().z() > kUpright) return;
  const Eigen::Quaterniond turn = Eigen::Quaterniond::FromTwoVectors(up, Eigen::Vector3d::UnitZ());
  for (RigidTransform& T : poses) T = turn * T;
}

// The motion that makes the plane z = 0 and leaves x, y and heading of the pivot.
RigidTransform LevelOn(const GrownPlane& plane, const Eigen::Vector3d& center, const Eigen::Vector3d& pivot) {
  const Eigen::Vector3d up = -plane.m.normalized();
  RigidTransform T = RigidTransform::Identity();
  T.linear() = Eigen::Quaterniond::FromTwoVectors(up, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  T.translation() = pivot - T.linear() * pivot;
  const Eigen::Vector3d on_plane = center - up / plane.m.norm();
  T.translation().z() -= (T * on_plane).z();
  return T;
}

Surface BuildSurface(const std::vector<LoadedView>& views, const std::vector<RigidTransform>& poses,
                     const RangeCamera& camera, const Layout& layout) {
  const PanoramaGrid& grid = layout.grid;
  std::vector<PanoramaPatch> patches(views.size());
  cv::parallel_for_({0, static_cast<int>(views.size())}, [&](const cv::Range& range) {
    for (int k = range.start; k < range.end; ++k) {
      const auto i = static_cast<std::size_t>(k);
      patches[i] = SeeFromCenter(views[i].range, camera, poses[i] * camera.T_color_depth, grid);
    }
  });

  FusedDepth fused = Fuse(patches, grid);
  Surface s{grid, std::move(patches), std::move(fused), {}, {}};
  s.nodes = MakeNodes(s.fused, grid, layout.node_step);
  DropIslands(s.nodes);
  FitPlanes(s.nodes);
  s.planes = GrowPlanes(s.nodes, {});
  FitPlanes(s.nodes);
  return s;
}

// The surface by its nodes alone: good enough to carry patches from view to view.
SurfaceMesh DraftMesh(const SurfaceNodes& nodes, const Panorama& panorama) {
  const PanoramaGrid grid(Coarser(panorama, kDepthShrink * nodes.step));
  DenseSurface dense{cv::Mat1f(grid.height(), grid.width(), 0.f), cv::Mat1i(grid.height(), grid.width(), -1)};
  for (int y = 0; y < grid.height(); ++y) {
    for (int x = 0; x < grid.width(); ++x) {
      const int i = nodes.At(x, y);
      const float value = nodes.plane[static_cast<std::size_t>(i)].dot(grid.Ray(x, y));
      if (value <= 0) continue;
      dense.inverse_range(y, x) = value;
      dense.node(y, x) = i;
    }
  }
  return MakeSurfaceMesh(dense, nodes, grid, {.error = 0});
}

// Directions that a colour picture saw, by node, at the range of the sweep's middle.
std::vector<std::uint8_t> SweptNodes(const SurfaceNodes& nodes, const PanoramaGrid& grid,
                                     const PinholeCamera& camera, const std::vector<RigidTransform>& poses) {
  std::vector<float> ranges;
  for (const float v : nodes.inverse_range)
    if (v > 0) ranges.push_back(v);
  float typical = 0.3f;
  if (!ranges.empty()) {
    const auto middle = ranges.begin() + static_cast<std::ptrdiff_t>(ranges.size() / 2);
    std::nth_element(ranges.begin(), middle, ranges.end());
    typical = *middle;
  }
  std::vector<std::uint8_t> swept(nodes.ray.size(), 0);
  cv::parallel_for_({0, nodes.height}, [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      for (int x = 0; x < nodes.width; ++x) {
        const auto i = static_cast<std::size_t>(nodes.At(x, y));
        const Eigen::Vector3d p = grid.panorama().center + nodes.ray[i].cast<double>() / typical;
        for (const RigidTransform& T : poses) {
          const auto pixel = camera.Project(T.inverse() * p);
          if (!pixel || pixel->x() < 0 || pixel->y() < 0 || pixel->x() > camera.width - 1 ||
              pixel->y() > camera.height - 1)
            continue;
          swept[i] = 1;
          break;
        }
      }
    }
  });
  return swept;
}

// By pixel of the surface, before nodes are filled.
cv::Mat1b MeasuredBy(const Surface& surface, const std::vector<std::uint8_t>& swept) {
  cv::Mat1b by = surface.fused.views.clone();
  for (int y = 0; y < by.rows; ++y) {
    for (int x = 0; x < by.cols; ++x) {
      const auto node =
          static_cast<std::size_t>(surface.nodes.At(x / surface.nodes.step, y / surface.nodes.step));
      if (!swept[node])
        by(y, x) = ScanReport::kNotSwept;
      else if (surface.nodes.plane[node].isZero())
        by(y, x) = 0;
      else
        by(y, x) = std::clamp<std::uint8_t>(by(y, x), 1, ScanReport::kNotSwept - 1);
    }
  }
  return by;
}

// Typical error of the surface along its ray: two thirds of it are nearer. A node has what noise leaves of
// its plane; what patches of the room's flat surfaces stand off from flat, which is what poses and echoes do;
// and how well the rig knows its range error, which no number of frames averages away.
double TypicalSigma(const SurfaceNodes& nodes, const std::vector<GrownPlane>& planes,
                    const RangeError& range_error) {
  constexpr double kFittedWith = 20;
  constexpr int kPatch = 8, kLeastNodes = 32;  // nodes a side; of them on one plane
  constexpr double kShare = 0.68;
  auto at_share = [](std::vector<double>& values, double share) {
    if (values.empty()) return 0.0;
    const auto place =
        values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size()));
    std::nth_element(values.begin(), place, values.end());
    return *place;
  };
  struct Sums {
    double weight = 0, off = 0;
    int nodes = 0;
  };
  std::vector<double> noise, off, off_noise;
  for (int v = 0; v < nodes.height; v += kPatch) {
    for (int u = 0; u < nodes.width; u += kPatch) {
      std::vector<Sums> sums(planes.size());
      for (int y = v; y < std::min(v + kPatch, nodes.height); ++y) {
        for (int x = u; x < std::min(u + kPatch, nodes.width); ++x) {
          const auto i = static_cast<std::size_t>(nodes.At(x, y));
          if (nodes.inverse_range[i] <= 0) continue;
          const double range = 1.0 / static_cast<double>(nodes.inverse_range[i]);
          const double sigma_m = static_cast<double>(nodes.sigma[i]) * range * range;
          const int plane = nodes.room_plane[i];
          const double with = plane < 0 ? kFittedWith : planes[static_cast<std::size_t>(plane)].nodes;
          noise.push_back(std::hypot(sigma_m / std::sqrt(with), range_error.StdAt(range)));
          if (plane < 0 || sigma_m <= 0) continue;
          Sums& s = sums[static_cast<std::size_t>(plane)];
          const double weight = 1 / (sigma_m * sigma_m);
          s.weight += weight;
          s.off += weight * (range - 1 / static_cast<double>(nodes.plane[i].dot(nodes.ray[i])));
          ++s.nodes;
        }
      }
      for (const Sums& s : sums) {
        if (s.nodes < kLeastNodes) continue;
        off.push_back(std::abs(s.off / s.weight));
        off_noise.push_back(1 / s.weight);
      }
    }
  }
  if (noise.empty()) return 0;
  const double bent2 = std::max(0.0, std::pow(at_share(off, kShare), 2) - at_share(off_noise, 0.5));
  // The share of errors below it, of nodes that each have their own sigma, is kShare.
  double low = 0, high = 10;
  for (int i = 0; i < 40; ++i) {
    const double sigma = (low + high) / 2;
    double within = 0;
    for (const double n : noise) within += std::erf(sigma / std::sqrt(2 * (n * n + bent2) + 1e-18));
    (within < kShare * static_cast<double>(noise.size()) ? low : high) = sigma;
  }
  return (low + high) / 2;
}

// The surface at every pixel of the panorama itself: each small pixel on the plane of the large one around
// it.
cv::Mat1f InverseRangeOf(const DenseSurface& dense, const SurfaceNodes& nodes, const PanoramaGrid& grid,
                         const PanoramaGrid& full) {
  cv::Mat1f out(full.height(), full.width(), 0.f);
  const int times = full.width() / grid.width();
  cv::parallel_for_({0, full.height()}, [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      for (int x = 0; x < full.width(); ++x) {
        const int u = x / times, v = y / times;
        const float value = dense.inverse_range(v, u);
        if (value <= 0) continue;
        const Eigen::Vector3f& plane = nodes.plane[static_cast<std::size_t>(dense.node(v, u))];
        out(y, x) =
            std::clamp(value + plane.dot(full.Ray(x, y) - grid.Ray(u, v)), 0.8f * value, 1.25f * value);
      }
    }
  });
  return out;
}

// What makes a scan no model of a room.
std::vector<std::string> FailedGates(const ScanReport& report, const Environment& environment) {
  constexpr double kLeastMeasured = 0.3, kMostApart_px = 3;
  std::vector<std::string> failed;
  if (report.left_out.size() > report.views.size()) {
    failed.push_back(Text("%zu of %zu views could not be used; the first: %s", report.left_out.size(),
                          report.left_out.size() + report.views.size(), report.left_out[0].reason.c_str()));
  }
  if (report.measured < kLeastMeasured) {
    failed.push_back(Text(
        "range was measured in %.0f %% of the swept directions only (limit %.0f %%): more frames at each "
        "position, or more light from the depth camera",
        100 * report.measured, 100 * kLeastMeasured));
  }
  if (environment.registration_px > kMostApart_px) {
    failed.push_back(Text(
        "points of two views lie %.1f px apart (limit %.0f px): the rig is not this head's, or the poses "
        "are not of these pictures",
        environment.registration_px, kMostApart_px));
  }
  const auto alone = std::count_if(report.views.begin(), report.views.end(),
                                   [](const ViewFit& v) { return v.matches == 0; });
  if (2 * static_cast<std::size_t>(alone) > report.views.size()) {
    failed.push_back(Text(
        "%td of %zu views share no point with another: they do not overlap, or the poses are not of these "
        "pictures",
        alone, report.views.size()));
  }
  return failed;
}

std::string Described(const MovedThing& m) {
  return Text(
      "something moved during the sweep: %.2f m2 at %.2f, %.2f, %.2f m stand %.2f m %s than in other views; "
      "nothing of it is used",
      m.area_m2, m.at.x(), m.at.y(), m.at.z(), std::abs(m.nearer_m), m.nearer_m > 0 ? "nearer" : "farther");
}

}  // namespace

Result<ScanResult> ScanRoom(const Take& take, const Rig& rig, const std::vector<PoseSample>& listed,
                            const std::function<void(const std::string&)>& progress) {
  ScanResult result;
  ScanReport& report = result.report;
  double began_ms = 0, began_cpu_ms = 0;
  auto step = [&](const std::string& name) {
    const double now_ms = static_cast<double>(MonotonicMicros()) / 1000;
    const double cpu_ms = static_cast<double>(ProcessCpuMicros()) / 1000;
    if (!report.steps.empty()) {
      report.steps.back().wall_ms = now_ms - began_ms;
      report.steps.back().cpu_ms = cpu_ms - began_cpu_ms;
    }
    began_ms = now_ms;
    began_cpu_ms = cpu_ms;
    if (name.empty()) return;
    report.steps.push_back({name, 0, 0});
    if (progress) progress(name);
  };

  step("load");
  auto sweep = ListSweep(take, rig, listed);
  if (!sweep) return tl::unexpected(sweep.error());
  report.left_out = sweep->left_out;
  report.warnings = take.warnings;
  const RangeCamera range_camera = RangeCamera::Of(rig);
  std::vector<LoadedView> views;
  {
    JpegDecoder decoder;
    for (const SweepView& v : sweep->views) {
      LoadedView view;
      if (auto ok = LoadView(v, rig, range_camera, decoder, view); !ok) {
        report.left_out.push_back({v.name, ok.error().message});
        continue;
      }
      views.push_back(std::move(view));
    }
  }
  if (views.size() < 2) {
    return Fail(ErrorCode::kBadInput,
                take.folder.string() + ": fewer than two views can be used" +
                    (report.left_out.empty() ? "" : "; the first left out: " + report.left_out[0].reason));
  }

  step("range");
  std::vector<RangeFrames> frames;
  for (const LoadedView& v : views) frames.push_back(v.frames);
  const RangeNoise noise = RangeNoise::Measure(frames, range_camera);
  const double typical_return = noise.by_amplitude ? TypicalReturn(frames, range_camera) : 0;
  cv::parallel_for_({0, static_cast<int>(views.size())}, [&](const cv::Range& r) {
    for (int k = r.start; k < r.end; ++k) {
      LoadedView& v = views[static_cast<std::size_t>(k)];
      v.range = MakeRangeView(v.frames, range_camera, noise, typical_return);
    }
  });
  for (const LoadedView& v : views) {
    const auto total = static_cast<double>(v.range.range_m.total());
    if (v.range.moved_px > 0.01 * total)
      report.notes.push_back({v.listed.name, "something moved during its depth frames"});
  }

  step("surface");
  std::vector<RigidTransform> poses;
  for (const LoadedView& v : views) poses.push_back(v.listed.T_world_color);
  const bool pan_tilt = sweep->poses == Sweep::Poses::kPanTilt;
  if (!pan_tilt) Upright(poses);
  std::vector<OrderedView> ordered;
  for (std::size_t i = 0; i < views.size(); ++i) ordered.push_back({views[i].bgr, &views[i].range, poses[i]});
  if (const int late = PosesLate(ordered, range_camera, rig.color); late != 0) {
    return Fail(
        ErrorCode::kQualityGate,
        Text("%s: the %s are out of step with the pictures, %d view%s too %s: with the pose of view %s "
             "for view %s, and so on, the views agree",
             take.folder.string().c_str(), pan_tilt ? "head's angles (ptu.txt)" : "poses", std::abs(late),
             std::abs(late) == 1 ? "" : "s", late > 0 ? "late" : "early",
             views[static_cast<std::size_t>(std::max(late, 0))].listed.name.c_str(),
             views[static_cast<std::size_t>(std::max(-late, 0))].listed.name.c_str()));
  }
  const Layout draft_layout(rig.color, poses, range_camera);
  Surface surface = BuildSurface(views, poses, range_camera, draft_layout);
  if (std::none_of(surface.nodes.plane.begin(), surface.nodes.plane.end(),
                   [](const Eigen::Vector3f& m) { return !m.isZero(); })) {
    return Fail(ErrorCode::kBadInput, take.folder.string() + ": no depth picture holds a surface");
  }
  step("register");
  Registration registration;
  std::optional<PanTilt> ptu = pan_tilt ? rig.ptu : std::nullopt;
  {
    const std::vector<RigidTransform> listed_poses = poses;  // before anything moved
    std::vector<ViewAngles> angles;
    for (const LoadedView& v : views) angles.push_back({v.listed.pan_deg, v.listed.tilt_deg});
    const SurfaceMesh draft = DraftMesh(surface.nodes, draft_layout.panorama);
    for (const int shrink : {8, 2, 1}) {
      std::vector<PosedPicture> pictures;
      for (std::size_t i = 0; i < views.size(); ++i) pictures.push_back({views[i].bgr, poses[i]});
      auto matches = MatchViews(draft, rig.color, pictures, shrink);
      if (!matches) return tl::unexpected(matches.error());
      RegistrationConfig config;
      config.match_px *= shrink;
      const Registration r = RefinePoses(*matches, rig.color, poses, listed_poses,
                                         pan_tilt ? rig.ptu : std::nullopt, angles, config);
      poses = r.T_world_color;
      ptu = r.ptu;
      if (shrink == 1) registration = r;
    }
    surface = BuildSurface(views, poses, range_camera, draft_layout);
    // The floor is the world's z = 0, whatever the unit's base or a trajectory's origin say.
    const int floor = FindFloor(surface.planes);
    if (floor >= 0) {
      const Eigen::Vector3d pivot = ptu ? Eigen::Vector3d(ptu->T_world_base.translation())
                                        : Eigen::Vector3d(draft_layout.panorama.center);
      const RigidTransform T_new_old =
          LevelOn(surface.planes[static_cast<std::size_t>(floor)], draft_layout.panorama.center, pivot);
      for (RigidTransform& T : poses) T = T_new_old * T;
      if (ptu) ptu->T_world_base = T_new_old * ptu->T_world_base;
    } else {
      report.warnings.emplace_back("no floor was seen: height, roll and pitch of the world are as they were");
    }
  }
  step("surface_again");
  const Layout layout(rig.color, poses, range_camera);
  const Panorama& panorama = layout.panorama;
  const PanoramaGrid &grid = layout.grid, full(panorama);
  surface = BuildSurface(views, poses, range_camera, layout);
  const std::vector<std::uint8_t> swept = SweptNodes(surface.nodes, grid, rig.color, poses);
  std::size_t wanted = 0, have = 0;
  for (std::size_t i = 0; i < swept.size(); ++i) {
    wanted += swept[i];
    have += swept[i] && !surface.nodes.plane[i].isZero();
  }
  report.measured = wanted == 0 ? 0 : static_cast<double>(have) / static_cast<double>(wanted);
  report.measured_by = MeasuredBy(surface, swept);
  std::vector<RoomPlane>& described = result.scanned.environment.planes;
  described = DescribePlanes(surface.planes, surface.nodes, panorama.center);
  for (const Opening& o : FindOpenings(surface.nodes, surface.planes, described, swept, grid))
    report.warnings.push_back(Described(o));
  FillNodes(surface.nodes, swept);

  step("edges");
  std::vector<PosedPicture> color_views;
  for (std::size_t i = 0; i < views.size(); ++i) color_views.push_back({views[i].bgr, poses[i]});
  DenseSurface dense = MakeDense(surface.nodes, surface.fused, grid);
  if (auto ok = PlaceEdges(MakeSurfaceMesh(dense, surface.nodes, grid, {}), rig.color, color_views,
                           surface.nodes, grid, dense);
      !ok)
    return tl::unexpected(ok.error());

  step("color");
  const SurfaceMesh mesh = MakeSurfaceMesh(dense, surface.nodes, grid, {});
  auto occlusions = FindOcclusions(mesh, rig.color, color_views);
  if (!occlusions) return tl::unexpected(occlusions.error());
  const std::vector<MovedThing> moved =
      FindMovedThings(surface.patches, surface.fused, grid, range_camera.pitch_rad);
  HideMovedThings(moved, rig.color, color_views, range_camera.pitch_rad, *occlusions);
  for (const MovedThing& m : moved) report.notes.push_back({views[m.view].listed.name, Described(m)});
  const Photometry photometry = SolvePhotometry(color_views, *occlusions, rig, grid, dense.inverse_range);
  report.photometric_rms_levels = photometry.rms_levels;

  step("blend");

  const cv::Mat1f inverse_range = InverseRangeOf(dense, surface.nodes, grid, full);
  result.scanned.pictures.color_bgra =
      BlendColor(color_views, *occlusions, rig.color, photometry, full, inverse_range);
  result.scanned.pictures.range_mm = cv::Mat1w(full.height(), full.width(), std::uint16_t{0});
  std::size_t covered = 0, seen = 0;
  for (int y = 0; y < full.height(); ++y) {
    for (int x = 0; x < full.width(); ++x) {
      const float value = inverse_range(y, x);
      const bool colored = result.scanned.pictures.color_bgra(y, x)[3] > 0;
      seen += swept[static_cast<std::size_t>(
          surface.nodes.At(x / kDepthShrink / surface.nodes.step, y / kDepthShrink / surface.nodes.step))];
      covered += colored;
      if (value > 0 && colored)
        result.scanned.pictures.range_mm(y, x) = cv::saturate_cast<std::uint16_t>(1000 / value);
    }
  }

  step("lamps");
  cv::Mat4b small_color;
  cv::resize(result.scanned.pictures.color_bgra, small_color, {grid.width(), grid.height()}, 0, 0,
             cv::INTER_AREA);
  result.scanned.environment.lamps = FindLamps(small_color, dense, surface.nodes, surface.planes, grid, {});

  step("mesh");
  result.scanned.room.positions = mesh.positions;
  result.scanned.room.uvs = mesh.uvs;
  result.scanned.room.indices = mesh.indices;
  cv::cvtColor(result.scanned.pictures.color_bgra, result.scanned.room.texture_bgr, cv::COLOR_BGRA2BGR);

  Environment& environment = result.scanned.environment;
  environment.rig = rig;
  environment.rig.vignetting_a = photometry.vignetting_a;
  environment.rig.vignetting_b = photometry.vignetting_b;
  environment.rig.ptu = ptu;
  std::vector<double> misses;
  // More than an encoder's own noise and what its axes were off at the start: somebody should look at it.
  constexpr double kOff_deg = 0.2;
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (pan_tilt && registration.moved_deg[i] > kOff_deg) {
      report.notes.push_back(
          {views[i].listed.name,
           Text("its encoders are %.2f degrees off: placed by its pictures", registration.moved_deg[i])});
    }
    if (registration.matches[i] > 0) misses.push_back(registration.rms_px[i]);
    report.views.push_back({views[i].listed.name, photometry.exposure[i], registration.matches[i],
                            registration.rms_px[i], registration.moved_deg[i]});
  }
  if (!misses.empty()) {
    std::sort(misses.begin(), misses.end());
    environment.registration_px = misses[misses.size() / 2];
  }
  constexpr double kRangeUnit_m = 0.001;  // of the panorama: nothing below is claimed
  environment.depth_sigma_m =
      std::max(kRangeUnit_m, TypicalSigma(surface.nodes, surface.planes, rig.depth->range_error));
  environment.panorama = panorama;
  for (std::size_t i = 0; i < views.size(); ++i)
    environment.frames.push_back({views[i].listed.name, poses[i]});
  environment.coverage =
      seen == 0 ? 0 : std::min(1.0, static_cast<double>(covered) / static_cast<double>(seen));
  report.failed_gates = FailedGates(report, environment);
  step("");
  return result;
}

}  // namespace mixstage
