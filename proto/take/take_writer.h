// SPDX-License-Identifier: Apache-2.0
//
// Writes a take (SPEC.md 5) that plays at any moment: a list names a picture only after its file is complete.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "proto/base/result.h"
#include "proto/codec/jpeg.h"
#include "proto/codec/yuv_image.h"

namespace mixstage {

enum class TakeList {
  kColor = 1,  // rgb.txt, rgb/0000000.jpg or .png
  kDepth,      // depth.txt, depth/0000000.png: 16-bit counts
  kAmplitude,  // amplitude.txt
  kFisheye,    // fisheye.txt
};

// JPEG bytes, written as they came; planes, to be encoded; or a 16-bit picture.
using TakeContent = std::variant<std::vector<std::uint8_t>, YuvImage, cv::Mat1w>;

enum class PlanesAs {
  kJpeg = 1,  // quality 90: what a camera would have given
  kPng,       // lossless
};

struct TakeWriterConfig {
  std::filesystem::path folder{};                   // made where it is missing
  std::optional<std::filesystem::path> rig_file{};  // copied to folder/rig.json, unless one lies there
  PlanesAs planes_as = PlanesAs::kJpeg;
};

// A file of the operating system, closed with its owner.
class FileDescriptor {
 public:
  explicit FileDescriptor(int fd = -1) : fd_(fd) {}
  FileDescriptor(FileDescriptor&& other) noexcept;
  FileDescriptor& operator=(FileDescriptor&& other) noexcept;
  ~FileDescriptor();
  [[nodiscard]] int get() const { return fd_; }
  [[nodiscard]] bool is_open() const { return fd_ >= 0; }

 private:
  int fd_;
};

enum class TakeWrite {
  kWritten = 1,
  kLeftOut,  // the time does not rise in its list (a take's must), or the picture cannot be encoded
};

// One thread, but for Sync. An error means that nothing more can be written (disk full, folder gone); what
// was listed before it stays a good take: half files and half lines are taken back.
class TakeWriter {
 public:
  // Fails (kInvalidConfig) where the folder holds a take already: nothing is ever overwritten.
  static Result<TakeWriter> Create(const TakeWriterConfig& config);

  // t_us: microseconds of the take's clock, 0 .. 4e15; written as seconds with six decimals.
  Result<TakeWrite> WritePicture(TakeList list, std::int64_t t_us, const TakeContent& content);
  Result<TakeWrite> WriteHead(std::int64_t t_us, double pan_deg, double tilt_deg);

  // Waits until all that was written before the call would outlive a power cut. Any thread, also beside a
  // write.
  [[nodiscard]] Status Sync() const;

  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }

 private:
  struct List {
    std::filesystem::path file;  // rgb.txt
    FileDescriptor fd;           // opened at the first line
    std::int64_t last_t_us = -1;
    std::int64_t lines = 0;
    std::int64_t bytes = 0;
  };
  explicit TakeWriter(const TakeWriterConfig& config);
  [[nodiscard]] static Status Open(List& list, const std::string& header);
  [[nodiscard]] static Status Append(List& list, std::int64_t t_us, const std::string& rest);
  // The content as the bytes of a file and its ending; false when it cannot be encoded.
  bool Encode(const TakeContent& content, std::vector<std::uint8_t>& bytes, const char*& ending);

  std::filesystem::path folder_;
  PlanesAs planes_as_;
  FileDescriptor folder_fd_;
  std::array<List, 4> pictures_;  // by TakeList
  List head_;
  JpegEncoder jpeg_;
  std::vector<std::uint8_t> encoded_;
};

}  // namespace mixstage
