// SPDX-License-Identifier: Apache-2.0
#include "proto/take/take.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <sstream>

#include "proto/take/picture_files.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxLines = 10'000'000;
constexpr std::size_t kMaxLineBytes = 8192;
constexpr double kTumBenchmarkUnitM = 0.0002;

// std::getline that does not take a whole disk for one line: of a longer line kMaxLineBytes + 1 bytes come.
bool GetLine(std::istream& in, std::string& line) {
  line.clear();
  char c = 0;
  while (line.size() <= kMaxLineBytes && in.get(c)) {
    if (c == '\n') return true;
    line += c;
  }
  return !line.empty();
}

// fs::exists that throws for nobody (a link to itself, a folder that may not be entered).
bool Exists(const fs::path& file) {
  std::error_code ignored;
  return fs::exists(file, ignored);
}

enum class LineEnd {
  kNewline = 1,
  kTorn,  // the file ends inside this line: a recording that lost its power, or an editor's habit
};

// Calls read(stream of one line, its end) for every line that is neither empty nor a comment.
template <typename Read>
Status ForEachLine(const fs::path& file, Read read) {
  std::ifstream in(file);
  if (!in) return Fail(ErrorCode::kBadInput, file.string() + ": cannot be read");
  std::string line;
  for (std::size_t number = 1; GetLine(in, line); ++number) {
    if (number > kMaxLines) return Fail(ErrorCode::kBadInput, file.string() + ": has too many lines");
    if (line.size() > kMaxLineBytes) {
      return Fail(ErrorCode::kBadInput,
                  file.string() + ":" + std::to_string(number) + ": is a line of more than 8192 bytes");
    }
    const std::size_t start = line.find_first_not_of(" \t\r");
    if (start == std::string::npos || line[start] == '#') continue;
    std::istringstream fields(line);
    const LineEnd end = in.eof() ? LineEnd::kTorn : LineEnd::kNewline;
    if (auto ok = read(fields, end); !ok)
      return Within(file.string() + ":" + std::to_string(number), ok.error());
  }
  return {};
}

template <typename Entry>
Status AppendRising(std::vector<Entry>& entries, Entry entry) {
  if (!std::isfinite(entry.t_s)) return Fail(ErrorCode::kBadInput, "the timestamp is not a finite number");
  if (!entries.empty() && entry.t_s <= entries.back().t_s) {
    return Fail(ErrorCode::kBadInput, "the timestamp does not rise");
  }
  entries.push_back(std::move(entry));
  return {};
}

// The pictures of a take lie inside its folder; those of its clean plate may also be the take's own.
bool LeavesTheTake(const fs::path& folder, const fs::path& relative) {
  // The system would open what stands before a zero byte.
  if (relative.native().find('\0') != std::string::npos) return true;
  const bool plate = folder.filename() == "clean_plate" && Exists(folder.parent_path() / "rgb.txt");
  const fs::path root = plate ? folder.parent_path() : folder;
  const fs::path inside = (folder / relative).lexically_normal().lexically_relative(root.lexically_normal());
  return relative.is_absolute() || inside.empty() || *inside.begin() == "..";
}

Status LeaveTornTailOut(Take& take, const fs::path& list) {
  take.warnings.push_back(list.string() + ": ends in the middle of a line, which is left out");
  return {};
}

Status ReadPictureList(Take& take, const char* name, std::vector<TakeEntry>& entries) {
  const fs::path list = take.folder / name;
  if (!Exists(list)) return {};
  int missing = 0;
  std::string first_missing;
  auto read = [&](std::istringstream& fields, LineEnd end) -> Status {
    TakeEntry entry;
    std::string relative;
    if (!(fields >> entry.t_s >> relative)) {
      if (end == LineEnd::kTorn) return LeaveTornTailOut(take, list);
      return Fail(ErrorCode::kBadInput, "is not \"timestamp file\"");
    }
    if (LeavesTheTake(take.folder, relative)) {
      if (end == LineEnd::kTorn) return LeaveTornTailOut(take, list);
      return Fail(ErrorCode::kBadInput, relative + " leads out of the take's folder");
    }
    entry.file = take.folder / relative;
    std::error_code ignored;
    // Empty: named in the list before a power cut, but never written to the disk.
    if (!fs::is_regular_file(entry.file, ignored) || fs::file_size(entry.file, ignored) == 0) {
      if (missing++ == 0) first_missing = entry.file.string();
      return {};
    }
    return AppendRising(entries, std::move(entry));
  };
  if (auto ok = ForEachLine(list, read); !ok) return ok;
  if (missing > 0) {
    take.warnings.push_back(list.string() + ": " + std::to_string(missing) +
                            " listed files are missing or empty, the first is " + first_missing);
  }
  return {};
}

Status ReadHead(Take& take) {
  const fs::path file = take.folder / "ptu.txt";
  if (!Exists(file)) return {};
  return ForEachLine(file, [&](std::istringstream& fields, LineEnd end) -> Status {
    // Half an angle is a number, too.
    if (end == LineEnd::kTorn) return LeaveTornTailOut(take, file);
    HeadSample sample;
    if (!(fields >> sample.t_s >> sample.pan_deg >> sample.tilt_deg) || !std::isfinite(sample.pan_deg) ||
        !std::isfinite(sample.tilt_deg)) {
      return Fail(ErrorCode::kBadInput, "is not \"timestamp pan_deg tilt_deg\"");
    }
    return AppendRising(take.head, sample);
  });
}

// A folder straight from the TUM RGB-D benchmark: its lists name the .bag they come from, or the
// accelerometer's record lies beside them.
bool IsTumBenchmarkFolder(const fs::path& folder) {
  if (Exists(folder / "accelerometer.txt")) return true;
  for (const char* name : {"rgb.txt", "depth.txt"}) {
    std::ifstream in(folder / name);
    std::string line;
    for (int i = 0; i < 5 && std::getline(in, line); ++i) {
      if (!line.empty() && line[0] == '#' && line.find(".bag") != std::string::npos) return true;
    }
  }
  return false;
}

// Everything of a take but what rests on its colour pictures.
Result<Take> ReadLists(const fs::path& folder) {
  Take take;
  // Without a trailing slash, so that its last part is its name.
  take.folder = folder.has_filename() ? folder : folder.parent_path();
  std::error_code ignored;
  if (!fs::is_directory(folder, ignored))
    return Fail(ErrorCode::kBadInput, folder.string() + ": is not a folder");
  for (auto [name, entries] :
       {std::pair{"rgb.txt", &take.color}, std::pair{"depth.txt", &take.depth},
        std::pair{"amplitude.txt", &take.amplitude}, std::pair{"fisheye.txt", &take.fisheye}}) {
    if (auto ok = ReadPictureList(take, name, *entries); !ok) return tl::unexpected(ok.error());
  }
  if (auto ok = ReadHead(take); !ok) return tl::unexpected(ok.error());
  return take;
}

}  // namespace

Result<Take> OpenTake(const fs::path& folder) {
  std::error_code ignored;
  if (fs::is_directory(folder, ignored) && !Exists(folder / "rgb.txt")) {
    return Fail(ErrorCode::kBadInput,
                (folder / "rgb.txt").string() + ": is missing (a take lists its colour pictures there)");
  }
  auto take = ReadLists(folder);
  if (!take) return take;
  if (take->color.empty()) {
    return Fail(ErrorCode::kBadInput,
                (folder / "rgb.txt").string() + ": lists no colour picture that exists");
  }
  if (Exists(folder / "clean_plate" / "rgb.txt")) take->clean_plate = folder / "clean_plate";
  if (IsTumBenchmarkFolder(folder)) take->assumed_depth_unit_m = kTumBenchmarkUnitM;
  return take;
}

Result<Take> OpenPictureLists(const fs::path& folder) {
  auto take = ReadLists(folder);
  if (!take) return take;
  if (take->color.empty() && take->depth.empty() && take->amplitude.empty() && take->fisheye.empty()) {
    return Fail(ErrorCode::kBadInput,
                folder.string() + ": no rgb.txt, depth.txt, amplitude.txt or fisheye.txt lists a picture");
  }
  return take;
}

Result<std::vector<PoseSample>> ReadPoses(const fs::path& file) {
  std::vector<PoseSample> poses;
  auto read = [&](std::istringstream& fields, LineEnd) -> Status {
    PoseSample sample;
    std::array<double, 7> numbers{};
    fields >> sample.t_s;
    for (double& n : numbers) fields >> n;
    if (!fields) return Fail(ErrorCode::kBadInput, "is not \"timestamp tx ty tz qx qy qz qw\"");
    auto T = RigidFromTum(numbers);
    if (!T) return tl::unexpected(T.error());
    sample.T_world_color = *T;
    return AppendRising(poses, sample);
  };
  if (auto ok = ForEachLine(file, read); !ok) return tl::unexpected(ok.error());
  if (poses.empty()) return Fail(ErrorCode::kBadInput, file.string() + ": holds no pose");
  return poses;
}

std::optional<fs::path> RigFileOf(const fs::path& folder) {
  const fs::path beside = folder / "rig.json";
  if (Exists(beside)) return beside;
  const fs::path up = (fs::absolute(folder).lexically_normal() / ".." / "rig.json").lexically_normal();
  if (Exists(up)) return up;
  return std::nullopt;
}

Result<LoadedRig> RigOfTake(const Take& take, const RigChoice& choice) {
  auto size = ReadColorSize(take.color.front().file);
  if (!size) return tl::unexpected(size.error());
  const auto found = choice.rig_file ? choice.rig_file : RigFileOf(take.folder);
  const fs::path file = found.value_or(fs::path());
  LoadedRig loaded;
  if (file.empty()) {
    const double unit_m = choice.depth_unit_m.value_or(take.assumed_depth_unit_m);
    loaded.rig = AssumedRig(size->width, size->height, unit_m);
    std::ostringstream text;
    text << "no rig.json: assuming depth registered to colour, " << unit_m
         << " m per count, fx = fy = " << loaded.rig.color.fx
         << " px, principal point in the picture's centre";
    loaded.warnings.push_back(text.str());
  } else {
    auto read = LoadRig(file);
    if (!read) return read;
    loaded = std::move(*read);
    for (std::string& warning : loaded.warnings) warning = file.string() + ": " + warning;
    if (choice.depth_unit_m && loaded.rig.depth) loaded.rig.depth->unit_m = *choice.depth_unit_m;
  }
  if (loaded.rig.color.width != size->width || loaded.rig.color.height != size->height) {
    return Fail(ErrorCode::kBadInput,
                file.string() + ": cameras.color is " + std::to_string(loaded.rig.color.width) + " x " +
                    std::to_string(loaded.rig.color.height) + ", the take's pictures are " +
                    std::to_string(size->width) + " x " + std::to_string(size->height));
  }
  return loaded;
}

}  // namespace mixstage
