// SPDX-License-Identifier: Apache-2.0
#include "proto/take/take_writer.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <opencv2/imgcodecs.hpp>
#include <span>
#include <utility>

#include "proto/base/file_bytes.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;

constexpr int kJpegQuality = 90;
constexpr int kLightPngCompression = 1;
constexpr std::int64_t kMaxTimeUs = 4'000'000'000'000'000;  // up to here seconds in a double tell every µs
constexpr std::uintmax_t kMaxRigBytes = std::uintmax_t{1} << 20;
constexpr std::array kListNames = {"rgb", "depth", "amplitude", "fisheye"};

tl::unexpected<Error> FailErrno(const fs::path& file, const char* what) {
  const int error = errno;
  std::string message = file.string() + ": " + what + ": " + std::strerror(error);
  if (error == ENOSPC || error == EDQUOT) message += " (make room, or record to another disk)";
  return Fail(ErrorCode::kUnavailable, std::move(message));
}

Status WriteAll(int fd, const fs::path& file, std::span<const std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t n = write(fd, bytes.data(), bytes.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return FailErrno(file, "cannot be written");
    bytes = bytes.subspan(static_cast<std::size_t>(n));
  }
  return {};
}

FileDescriptor Exclusive(const fs::path& file, int more_flags = 0) {
  return FileDescriptor(open(file.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC | more_flags, 0666));
}

// A whole new file or none.
Status WriteNewFile(const fs::path& file, std::span<const std::uint8_t> bytes) {
  const FileDescriptor fd = Exclusive(file);
  if (!fd.is_open()) return FailErrno(file, "cannot be made");
  Status written = WriteAll(fd.get(), file, bytes);
  if (!written) unlink(file.c_str());
  return written;
}

std::span<const std::uint8_t> Bytes(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

bool EncodePng(const cv::Mat& picture, std::vector<std::uint8_t>& bytes) {
  try {
    return cv::imencode(".png", picture, bytes, {cv::IMWRITE_PNG_COMPRESSION, kLightPngCompression});
  } catch (const cv::Exception&) {
    return false;
  }
}

}  // namespace

FileDescriptor::FileDescriptor(FileDescriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
FileDescriptor& FileDescriptor::operator=(FileDescriptor&& other) noexcept {
  std::swap(fd_, other.fd_);
  return *this;
}
FileDescriptor::~FileDescriptor() {
  if (is_open()) close(fd_);
}

TakeWriter::TakeWriter(const TakeWriterConfig& config)
    : folder_(config.folder), planes_as_(config.planes_as) {}

Result<TakeWriter> TakeWriter::Create(const TakeWriterConfig& config) {
  TakeWriter writer(config);
  const fs::path& folder = writer.folder_;
  const auto refuse = [](const Error& error) { return Fail(ErrorCode::kInvalidConfig, error.message); };
  std::error_code error;
  fs::create_directories(folder, error);
  if (!fs::is_directory(folder)) {
    return Fail(ErrorCode::kInvalidConfig, folder.string() + ": cannot be made: " + error.message());
  }
  for (std::size_t i = 0; i < kListNames.size(); ++i)
    writer.pictures_[i].file = folder / (std::string(kListNames[i]) + ".txt");
  writer.head_.file = folder / "ptu.txt";
  List& color = writer.pictures_.front();
  if (fs::exists(color.file)) {
    return Fail(
        ErrorCode::kInvalidConfig,
        folder.string() + ": holds a take already (rgb.txt), which is not overwritten: give another folder");
  }
  writer.folder_fd_ = FileDescriptor(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!writer.folder_fd_.is_open()) return refuse(FailErrno(folder, "cannot be opened").value());
  if (config.rig_file && !fs::exists(folder / "rig.json")) {
    auto rig = ReadFileBytes(*config.rig_file, kMaxRigBytes);
    if (!rig) return refuse(Within(config.rig_file->string(), rig.error()).value());
    if (auto ok = WriteNewFile(folder / "rig.json", *rig); !ok) return refuse(ok.error());
  }
  if (auto ok = Open(color, "# timestamp_s file\n"); !ok) return refuse(ok.error());
  return writer;
}

Status TakeWriter::Open(List& list, const std::string& header) {
  list.fd = Exclusive(list.file, O_APPEND);
  if (!list.fd.is_open()) return FailErrno(list.file, "cannot be made");
  list.bytes = static_cast<std::int64_t>(header.size());
  return WriteAll(list.fd.get(), list.file, Bytes(header));
}

Status TakeWriter::Append(List& list, std::int64_t t_us, const std::string& rest) {
  char time[32];
  std::snprintf(time, sizeof time, "%lld.%06lld ", static_cast<long long>(t_us / 1'000'000),
                static_cast<long long>(t_us % 1'000'000));
  const std::string line = time + rest + "\n";
  if (auto ok = WriteAll(list.fd.get(), list.file, Bytes(line)); !ok) {
    // Half a line: without it the list ends as it should. If even that fails, readers leave the tail out.
    [[maybe_unused]] const int failed = ftruncate(list.fd.get(), list.bytes);
    return ok;
  }
  list.bytes += static_cast<std::int64_t>(line.size());
  list.last_t_us = t_us;
  ++list.lines;
  return {};
}

bool TakeWriter::Encode(const TakeContent& content, std::vector<std::uint8_t>& bytes, const char*& ending) {
  ending = ".png";
  if (const auto* counts = std::get_if<cv::Mat1w>(&content)) return EncodePng(*counts, bytes);
  const YuvImage& planes = std::get<YuvImage>(content);
  if (planes_as_ == PlanesAs::kPng) return EncodePng(ToBgr(planes), bytes);
  ending = ".jpg";
  return jpeg_.Encode(planes, kJpegQuality, bytes).has_value();
}

Result<TakeWrite> TakeWriter::WritePicture(TakeList list_name, std::int64_t t_us,
                                           const TakeContent& content) {
  const std::size_t index = static_cast<std::size_t>(list_name) - 1;
  List& list = pictures_[index];
  if (t_us < 0 || t_us > kMaxTimeUs || t_us <= list.last_t_us) return TakeWrite::kLeftOut;
  const char* ending = ".jpg";
  const auto* bytes = std::get_if<std::vector<std::uint8_t>>(&content);
  if (bytes == nullptr) {
    if (!Encode(content, encoded_, ending)) return TakeWrite::kLeftOut;
    bytes = &encoded_;
  }
  const fs::path subfolder = folder_ / kListNames[index];
  if (list.lines == 0) {
    std::error_code error;
    fs::create_directory(subfolder, error);
    if (error)
      return Fail(ErrorCode::kUnavailable, subfolder.string() + ": cannot be made: " + error.message());
    if (!list.fd.is_open()) {
      if (auto ok = Open(list, "# timestamp_s file\n"); !ok) return tl::unexpected(ok.error());
    }
  }
  char name[32];
  std::snprintf(name, sizeof name, "%07lld%s", static_cast<long long>(list.lines), ending);
  if (auto ok = WriteNewFile(subfolder / name, *bytes); !ok) return tl::unexpected(ok.error());
  if (auto ok = Append(list, t_us, std::string(kListNames[index]) + "/" + name); !ok) {
    unlink((subfolder / name).c_str());
    return tl::unexpected(ok.error());
  }
  return TakeWrite::kWritten;
}

Result<TakeWrite> TakeWriter::WriteHead(std::int64_t t_us, double pan_deg, double tilt_deg) {
  if (t_us < 0 || t_us > kMaxTimeUs || t_us <= head_.last_t_us || !std::isfinite(pan_deg) ||
      !std::isfinite(tilt_deg)) {
    return TakeWrite::kLeftOut;
  }
  if (!head_.fd.is_open()) {
    if (auto ok = Open(head_, "# timestamp_s pan_deg tilt_deg\n"); !ok) return tl::unexpected(ok.error());
  }
  char angles[64];
  std::snprintf(angles, sizeof angles, "%.9g %.9g", pan_deg, tilt_deg);
  if (auto ok = Append(head_, t_us, angles); !ok) return tl::unexpected(ok.error());
  return TakeWrite::kWritten;
}

Status TakeWriter::Sync() const {
  // The whole file system at once: pictures, lists and the folders that name them. One call for half a second
  // of files costs a disk far less than one for each.
  if (syncfs(folder_fd_.get()) != 0) return FailErrno(folder_, "cannot be written to the disk");
  return {};
}

}  // namespace mixstage
