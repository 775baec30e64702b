// SPDX-License-Identifier: Apache-2.0
#include "capture_agent/sources/synthetic_views.h"

#include <cstdio>
#include <fstream>
#include <random>
#include <string>

#include "proto/base/log.h"
#include "proto/synthetic/rig.h"
#include "proto/synthetic/scene.h"
#include "proto/take/take_writer.h"

namespace mixstage {
namespace {

constexpr std::int64_t kViewPeriodUs = 2'000'000;
constexpr std::int64_t kDepthPhaseUs = 7'300, kDepthPeriodUs = 80'000;
constexpr int kScanDepths = 3;
constexpr double kEncoderNoise_deg = 0.01;

std::string BoardsJson(const std::vector<Board>& boards) {
  std::string json = "[";
  for (const Board& b : boards) {
    char text[256];
    std::snprintf(text, sizeof text,
                  "%s\n {\"name\": \"%s\", \"pattern\": \"checkerboard\", \"inner_corners\": [%d, %d], "
                  "\"square_m\": %g, \"white_margin_m\": %g}",
                  json.size() == 1 ? "" : ",", b.name.c_str(), b.columns, b.rows, b.square_m,
                  b.white_margin_m);
    json += text;
  }
  return json + "\n]\n";
}

Status WriteText(const std::filesystem::path& file, const std::string& text) {
  std::ofstream out(file, std::ios::binary);
  out << text;
  out.close();
  if (!out) return Fail(ErrorCode::kUnavailable, file.string() + ": cannot be written");
  return {};
}

// A picture that the writer leaves out would make a folder with less than was said.
Status Written(const Result<TakeWrite>& written) {
  if (!written) return tl::unexpected(written.error());
  if (*written != TakeWrite::kWritten) return Fail(ErrorCode::kInternal, "a view was not written");
  return {};
}

class ViewRecorder {
 public:
  ViewRecorder(SyntheticScene& scene, TakeWriter& writer) : scene_(scene), writer_(writer) {}

  Status Record(const SyntheticView& view, std::int64_t t_us, int depths) {
    scene_.Arrange(view.pan_deg, view.tilt_deg, view.boards);
    const double t_s = static_cast<double>(t_us) * 1e-6;
    if (view.recorded_by != RecordedBy::kFisheye) {
      YuvImage color;
      scene_.RenderColor(t_s, color);
      if (auto ok = Written(writer_.WritePicture(TakeList::kColor, t_us, color)); !ok) return ok;
      for (int i = 0; i < depths && scene_.rig().depth; ++i) {
        const std::int64_t depth_us = t_us + kDepthPhaseUs + i * kDepthPeriodUs;
        cv::Mat1w range;
        cv::Mat1w amplitude;
        scene_.RenderTof(static_cast<double>(depth_us) * 1e-6, range, amplitude);
        if (auto ok = Written(writer_.WritePicture(TakeList::kDepth, depth_us, range)); !ok) return ok;
        if (auto ok = Written(writer_.WritePicture(TakeList::kAmplitude, depth_us, amplitude)); !ok)
          return ok;
      }
    }
    if (view.recorded_by != RecordedBy::kColorAndDepth && scene_.rig().fisheye) {
      YuvImage fisheye;
      scene_.RenderFisheye(t_s, fisheye);
      if (auto ok = Written(writer_.WritePicture(TakeList::kFisheye, t_us, fisheye)); !ok) return ok;
    }
    if (!scene_.rig().ptu) return {};
    std::normal_distribution<double> noise(0, kEncoderNoise_deg);
    const double pan_deg = view.pan_deg + noise(random_);
    return Written(writer_.WriteHead(t_us, pan_deg, view.tilt_deg + noise(random_)));
  }

 private:
  SyntheticScene& scene_;
  TakeWriter& writer_;
  std::mt19937 random_{1};
};

}  // namespace

Status WriteSyntheticViews(SyntheticViews views, const std::optional<Rig>& rig,
                           const std::filesystem::path& folder) {
  auto writer = TakeWriter::Create({.folder = folder});
  if (!writer) return tl::unexpected(writer.error());
  auto scene = SyntheticScene::Create(rig.value_or(SyntheticRig()), {.figure = false});
  if (!scene) return tl::unexpected(scene.error());
  const Rig known = rig.value_or(SyntheticNominalRig());
  if (auto ok = WriteText(folder / "rig.json", FormatRig(known)); !ok) return ok;
  if (const auto boards = BoardsOf(views); !boards.empty()) {
    if (auto ok = WriteText(folder / "board.json", BoardsJson(boards)); !ok) return ok;
  }
  const std::vector<SyntheticView> all = ViewsOf(views, scene->rig());
  ViewRecorder recorder(*scene, *writer);
  std::int64_t t_us = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    t_us += kViewPeriodUs;
    if (auto ok = recorder.Record(all[i], t_us, views == SyntheticViews::kScan ? kScanDepths : 1); !ok)
      return ok;
    spdlog::info("views folder={} view={} of={}", folder.string(), i + 1, all.size());
  }
  return writer->Sync();
}

}  // namespace mixstage
