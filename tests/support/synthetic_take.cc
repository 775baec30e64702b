// SPDX-License-Identifier: Apache-2.0
#include "tests/support/synthetic_take.h"

#include <cmath>
#include <cstdio>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "proto/codec/jpeg.h"
#include "proto/synthetic/rig.h"
#include "proto/synthetic/scene.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;

constexpr double kColorPeriod_s = 1.0 / 30;
constexpr double kDepthPeriod_s = 0.08;
constexpr double kDepthPhase_s = 0.0073;
constexpr double kPlateFrom_s = 0.2;  // the set is empty then

std::string Stem(int number) {
  char text[16];
  std::snprintf(text, sizeof text, "%04d", number);
  return text;
}

struct Streams {
  Streams(const fs::path& folder) : root(folder) {
    for (const char* name : {"rgb", "depth", "amplitude"}) fs::create_directories(folder / name);
    rgb.open(folder / "rgb.txt");
    depth.open(folder / "depth.txt");
    amplitude.open(folder / "amplitude.txt");
    for (std::ofstream* list : {&rgb, &depth, &amplitude}) {
      *list << "# timestamp_seconds filename\n" << std::fixed;
      list->precision(6);
    }
  }
  fs::path root;
  std::ofstream rgb, depth, amplitude;
};

void WriteTof(SyntheticScene& scene, double t_s, int number, Streams& out) {
  cv::Mat1w range;
  cv::Mat1w amplitude;
  scene.RenderTof(t_s, range, amplitude);
  const std::string file = Stem(number) + ".png";
  cv::imwrite((out.root / "depth" / file).string(), range);
  cv::imwrite((out.root / "amplitude" / file).string(), amplitude);
  out.depth << t_s << " depth/" << file << "\n";
  out.amplitude << t_s << " amplitude/" << file << "\n";
}

Status WriteColor(SyntheticScene& scene, JpegEncoder& jpeg, double t_s, int number, Streams& out) {
  YuvImage image;
  scene.RenderColor(t_s, image);
  std::vector<std::uint8_t> bytes;
  if (auto ok = jpeg.Encode(image, 90, bytes); !ok) return ok;
  const std::string file = "rgb/" + Stem(number) + ".jpg";
  std::ofstream(out.root / file, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  out.rgb << t_s << " " << file << "\n";
  return {};
}

}  // namespace

Status WriteSyntheticTake(const fs::path& folder, const SyntheticTakeConfig& config) {
  auto scene = SyntheticScene::Create(config.rig.value_or(SyntheticRig()), {});
  if (!scene) return tl::unexpected(scene.error());
  JpegEncoder jpeg;
  Streams take(folder);
  int depths = 0;
  for (double t_s = config.begin_s + kDepthPhase_s; t_s < config.end_s; t_s += kDepthPeriod_s)
    WriteTof(*scene, t_s, depths++, take);
  fs::create_directories(folder / "truth" / "matte");
  fs::create_directories(folder / "truth" / "depth");
  std::ofstream poses(folder / "truth" / "groundtruth.txt");
  int colors = 0;
  for (double t_s = config.begin_s; t_s < config.end_s; t_s += kColorPeriod_s) {
    if (auto ok = WriteColor(*scene, jpeg, t_s, colors, take); !ok) return ok;
    if (colors % 10 == 0) {
      cv::Mat1w mm;
      scene->TruthDepth(SyntheticCamera::kColor, t_s).convertTo(mm, CV_16U, 1000);
      cv::imwrite((folder / "truth/depth" / (Stem(colors) + ".png")).string(), mm);
      cv::imwrite((folder / "truth/matte" / (Stem(colors) + ".png")).string(), scene->TruthMatte(t_s));
    }
    poses << TumLine(t_s, scene->TruthPose()) << "\n";
    ++colors;
  }
  if (config.clean_plate_frames > 0) {
    Streams plate(folder / "clean_plate");
    for (int i = 0; i < config.clean_plate_frames; ++i) {
      const double t_s = kPlateFrom_s + i * kColorPeriod_s;
      if (auto ok = WriteColor(*scene, jpeg, t_s, i, plate); !ok) return ok;
      WriteTof(*scene, kPlateFrom_s + i * kDepthPeriod_s, i, plate);
    }
  }
  return {};
}

}  // namespace mixstage
