// SPDX-License-Identifier: Apache-2.0
#include "capture_agent/sources/take_source.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "proto/base/clock.h"
#include "proto/take/picture_files.h"

namespace mixstage {
namespace {

class TakeSource final : public Source {
 public:
  TakeSource(Take take, Pace pace, AtEnd at_end) : take_(std::move(take)), pace_(pace), at_end_(at_end) {
    auto add = [&](Stream stream, const std::vector<TakeEntry>& entries) {
      for (const TakeEntry& entry : entries) events_.push_back({entry.t_s, stream, &entry, nullptr});
    };
    add(Stream::kDepth, take_.depth);
    add(Stream::kAmplitude, take_.amplitude);
    add(Stream::kFisheye, take_.fisheye);
    for (const HeadSample& sample : take_.head)
      events_.push_back({sample.t_s, Stream::kColor, nullptr, &sample});
    add(Stream::kColor, take_.color);
    // Of one instant depth comes first: the colour picture that follows can use it.
    std::stable_sort(events_.begin(), events_.end(),
                     [](const Event& a, const Event& b) { return a.t_s < b.t_s; });
    first_s_ = events_.front().t_s;
    const std::size_t n = take_.color.size();
    const double interval_s =
        n > 1 ? (take_.color.back().t_s - take_.color.front().t_s) / static_cast<double>(n - 1) : 1.0 / 30;
    period_s_ = events_.back().t_s - first_s_ + interval_s;
  }

  Result<std::optional<Captured>> Next(std::stop_token stop) override {
    if (next_ == events_.size()) {
      if (at_end_ == AtEnd::kStop) return std::nullopt;
      next_ = 0;
      ++rounds_;
    }
    const Event& event = events_[next_++];
    if (start_us_ == 0) start_us_ = MonotonicMicros();
    const double since_start_s = event.t_s - first_s_ + static_cast<double>(rounds_) * period_s_;
    Captured captured;
    captured.t_us = start_us_ + std::llround(since_start_s * 1e6);
    // The picture is read before its time, so that it leaves on time.
    Status read = event.angles == nullptr ? ReadPicture(event, captured) : Status{};
    if (event.angles != nullptr)
      captured.what = CapturedAngles{event.angles->pan_deg, event.angles->tilt_deg};
    if (pace_ == Pace::kReal && !WaitUntil(captured.t_us, stop)) return std::nullopt;
    if (stop.stop_requested()) return std::nullopt;
    if (!read) return tl::unexpected(read.error());
    return captured;
  }

 private:
  struct Event {
    double t_s = 0;
    Stream stream = Stream::kColor;
    const TakeEntry* picture = nullptr;
    const HeadSample* angles = nullptr;
  };

  Status ReadPicture(const Event& event, Captured& captured) {
    CapturedPicture picture;
    picture.stream = event.stream;
    if (event.stream == Stream::kDepth || event.stream == Stream::kAmplitude) {
      cv::Mat1w content;
      if (auto ok = LoadDepth16(event.picture->file, content); !ok) return ok;
      picture.width = content.cols;
      picture.height = content.rows;
      picture.content = std::move(content);
    } else {
      auto bytes = ReadFileBytes(event.picture->file, static_cast<std::uintmax_t>(kMaxFrameBytes));
      if (!bytes) return Within(event.picture->file.string(), bytes.error());
      if (IsJpeg(*bytes)) {
        auto header = decoder_.ReadHeader(*bytes);
        if (!header) return Within(event.picture->file.string(), header.error());
        picture.width = header->width;
        picture.height = header->height;
        picture.content = std::move(*bytes);
      } else {
        YuvImage image;
        if (auto ok = LoadColor(event.picture->file, decoder_, image); !ok) return ok;
        picture.width = image.width();
        picture.height = image.height();
        picture.content = std::move(image);
      }
    }
    captured.what = std::move(picture);
    return {};
  }

  const Take take_;
  const Pace pace_;
  const AtEnd at_end_;
  std::vector<Event> events_;
  double first_s_ = 0, period_s_ = 0;
  std::size_t next_ = 0;
  std::int64_t rounds_ = 0;
  std::int64_t start_us_ = 0;
  JpegDecoder decoder_;
};

}  // namespace

std::unique_ptr<Source> MakeTakeSource(Take take, Pace pace, AtEnd at_end) {
  return std::make_unique<TakeSource>(std::move(take), pace, at_end);
}

}  // namespace mixstage
