// SPDX-License-Identifier: Apache-2.0
#include "proto/link/open_picture.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "proto/base/check.h"
#include "proto/base/crc32c.h"

namespace mixstage {
namespace {

std::size_t Size(int value) { return static_cast<std::size_t>(value); }

}  // namespace

PictureKey KeyOf(const mixstage_lcm::frame_slice_t& s) {
  return {s.sequence, s.t_us,        s.frame_bytes,   s.frame_crc32c, s.width,
          s.height,   s.data_slices, s.parity_slices, s.slice_bytes,  s.encoding};
}

SlicesSeen::SlicesSeen(const PictureKey& key) : seen_(Size(key.data_slices + key.parity_slices), false) {}

bool SlicesSeen::Mark(std::int16_t slice) {
  if (seen_[Size(slice)]) return false;
  seen_[Size(slice)] = true;
  ++count_;
  return true;
}

OpenPicture::OpenPicture(const mixstage_lcm::frame_slice_t& first)
    : data_slices_(Size(first.data_slices)),
      slice_bytes_(Size(first.slice_bytes)),
      frame_bytes_(Size(first.frame_bytes)),
      crc32c_(static_cast<std::uint32_t>(first.frame_crc32c)),
      have_data_(data_slices_, false),
      have_parity_(Size(first.parity_slices), false),
      contradicted_(data_slices_ + have_parity_.size(), false),
      seen_(KeyOf(first)),
      short_by_(Size(ParityGroups(first.data_slices, first.parity_slices)), 0),
      missing_data_(first.data_slices) {
  frame_.epoch = first.epoch;
  frame_.t_us = first.t_us;
  frame_.sequence = first.sequence;
  frame_.stream = static_cast<Stream>(first.stream);
  frame_.encoding = static_cast<Encoding>(first.encoding);
  frame_.width = first.width;
  frame_.height = first.height;
  frame_.bytes.resize(data_slices_ * slice_bytes_);
  for (std::size_t i = 0; i < data_slices_; ++i) ++short_by_[i % short_by_.size()];
  groups_short_ =
      static_cast<int>(std::count_if(short_by_.begin(), short_by_.end(), [](int n) { return n > 0; }));
}

std::size_t OpenPicture::MemoryBytes(const PictureKey& key) {
  return sizeof(OpenPicture) + Size(key.data_slices + key.parity_slices) * (Size(key.slice_bytes) + 1);
}

std::uint8_t* OpenPicture::Place(std::size_t slice) {
  if (slice < data_slices_) return frame_.bytes.data() + slice * slice_bytes_;
  // Most pictures lose nothing: memory for parity only when parity comes before the picture is whole.
  if (parity_bytes_.empty()) parity_bytes_.resize(have_parity_.size() * slice_bytes_);
  return parity_bytes_.data() + (slice - data_slices_) * slice_bytes_;
}

void OpenPicture::Count(std::size_t slice, int came) {
  const bool data = slice < data_slices_;
  if (data) {
    have_data_[slice] = came > 0;
    missing_data_ -= came;
  } else {
    have_parity_[slice - data_slices_] = came > 0;
  }
  int& short_by = short_by_[(data ? slice : slice - data_slices_) % short_by_.size()];
  groups_short_ -= short_by > 0;
  short_by -= came;
  groups_short_ += short_by > 0;
}

OpenPicture::Brought OpenPicture::Add(const mixstage_lcm::frame_slice_t& s) {
  const auto slice = Size(s.slice);
  const bool first = seen_.Mark(s.slice);
  if (whole_) return first ? Brought::kSpare : Brought::kDuplicate;
  // Of the last data slice only the picture's own bytes count; behind them parity has seen zeros.
  std::size_t count = slice_bytes_;
  if (slice + 1 == data_slices_) count = frame_bytes_ - slice * slice_bytes_;
  if (first) {
    std::memcpy(Place(slice), s.payload, count);
    Count(slice, +1);
    return Brought::kNew;
  }
  if (contradicted_[slice]) return Brought::kDuplicate;
  if (std::memcmp(Place(slice), s.payload, count) == 0) return Brought::kDuplicate;
  if (!have_parity_.empty()) {
    contradicted_[slice] = true;
    Count(slice, -1);
  }
  return Brought::kContradiction;
}

bool OpenPicture::Fits() const { return Crc32c({frame_.bytes.data(), frame_bytes_}) == crc32c_; }

bool OpenPicture::TryFinish(ParityCoder& coder) {
  if (whole_ || groups_short_ > 0) return whole_;
  if (missing_data_ == 0) {
    ++attempts_;
    return whole_ = Fits();
  }
  std::vector<std::uint8_t*> data(data_slices_);
  std::vector<const std::uint8_t*> parity(have_parity_.size());
  for (std::size_t i = 0; i < data.size(); ++i) data[i] = Place(i);
  for (std::size_t j = 0; j < parity.size(); ++j) parity[j] = Place(data_slices_ + j);
  // A group that has parity to spare has as many choices as parity slices; without spare there is one.
  const int spare = -*std::min_element(short_by_.begin(), short_by_.end());
  const auto turns =
      spare == 0 ? 1 : static_cast<int>(std::count(have_parity_.begin(), have_parity_.end(), true));
  for (int turn = 0; turn < turns && attempts_ < kMaxAttempts; ++turn) {
    ++attempts_;
    coder.Repair(data, have_data_, parity, have_parity_, slice_bytes_, turn);
    // The last slice's filling must be zero again, or a wrong repair would spoil the next.
    std::fill(frame_.bytes.begin() + static_cast<std::ptrdiff_t>(frame_bytes_), frame_.bytes.end(),
              std::uint8_t{0});
    if (Fits()) return whole_ = true;
  }
  return false;
}

EncodedFrame OpenPicture::Take() {
  MIX_CHECK(whole_);
  frame_.bytes.resize(frame_bytes_);
  return std::move(frame_);
}

}  // namespace mixstage
