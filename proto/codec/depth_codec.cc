// SPDX-License-Identifier: Apache-2.0
#include "proto/codec/depth_codec.h"

#include <zstd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <string>

#include "proto/codec/depth_rows.h"

namespace mixstage {
namespace {

constexpr std::array<std::uint8_t, 4> kMagic = {'M', 'X', 'D', '1'};
constexpr std::size_t kHeaderBytes = 8;
// zstd's fastest matcher with long matches and a small table: on residuals of real depth pictures it is both
// a tenth faster and a little denser than plain level 1 (short matches there are chance).
constexpr int kZstdLevel = 1;
constexpr int kZstdMinMatch = 7;
constexpr int kZstdHashLog = 13;
constexpr std::uint16_t kFirstRowStart = 1;

// A row starts from the first measured pixel of the row above, which is nearer than the last one at its far
// end.
std::uint16_t FirstMeasured(const std::uint16_t* row, int width, std::uint16_t otherwise) {
  const std::uint16_t* first = std::find_if(row, row + width, [](std::uint16_t v) { return v != 0; });
  return first == row + width ? otherwise : *first;
}

}  // namespace

struct DepthEncoder::State {
  ZSTD_CCtx* context = ZSTD_createCCtx();
  std::vector<std::uint8_t> planes, packed;
  ~State() { ZSTD_freeCCtx(context); }
};

DepthEncoder::DepthEncoder() : state_(std::make_unique<State>()) {
  MIX_CHECK(state_->context != nullptr);
  MIX_CHECK(!ZSTD_isError(ZSTD_CCtx_setParameter(state_->context, ZSTD_c_compressionLevel, kZstdLevel)));
  MIX_CHECK(!ZSTD_isError(ZSTD_CCtx_setParameter(state_->context, ZSTD_c_minMatch, kZstdMinMatch)));
  MIX_CHECK(!ZSTD_isError(ZSTD_CCtx_setParameter(state_->context, ZSTD_c_hashLog, kZstdHashLog)));
}
DepthEncoder::~DepthEncoder() = default;

void DepthEncoder::Encode(ImageView<const std::uint16_t> picture, std::vector<std::uint8_t>& bytes) {
  const int w = picture.width();
  const int h = picture.height();
  MIX_CHECK(w >= 1 && h >= 1 && w <= kDepthCodecMaxSide && h <= kDepthCodecMaxSide);
  const std::size_t pixels = static_cast<std::size_t>(w) * static_cast<std::size_t>(h);
  MIX_CHECK(static_cast<std::int64_t>(pixels) <= kDepthCodecMaxPixels);
  state_->planes.resize(2 * pixels);
  std::uint8_t* low = state_->planes.data();
  std::uint8_t* high = low + pixels;
  std::uint16_t start = kFirstRowStart;
  for (int y = 0; y < h; ++y) {
    const std::uint16_t* row = picture.row(y);
    const std::size_t at = static_cast<std::size_t>(y) * static_cast<std::size_t>(w);
    EncodeRow(row, w, start, low + at, high + at);
    start = FirstMeasured(row, w, start);
  }
  // Packed into memory of ours, which keeps its size: growing `bytes` to the worst case would fill it with
  // zeros first.
  const std::size_t worst = ZSTD_compressBound(2 * pixels);
  if (state_->packed.size() < worst) state_->packed.resize(worst);
  const std::size_t size = ZSTD_compress2(state_->context, state_->packed.data(), state_->packed.size(),
                                          state_->planes.data(), 2 * pixels);
  MIX_CHECK(!ZSTD_isError(size));
  const std::uint8_t header[] = {kMagic[0],
                                 kMagic[1],
                                 kMagic[2],
                                 kMagic[3],
                                 static_cast<std::uint8_t>(w),
                                 static_cast<std::uint8_t>(w >> 8),
                                 static_cast<std::uint8_t>(h),
                                 static_cast<std::uint8_t>(h >> 8)};
  static_assert(sizeof header == kHeaderBytes);
  bytes.assign(header, header + kHeaderBytes);
  bytes.insert(bytes.end(), state_->packed.data(), state_->packed.data() + size);
}

struct DepthDecoder::State {
  ZSTD_DCtx* context = ZSTD_createDCtx();
  std::vector<std::uint8_t> planes;
  ~State() { ZSTD_freeDCtx(context); }
};

DepthDecoder::DepthDecoder() : state_(std::make_unique<State>()) { MIX_CHECK(state_->context != nullptr); }
DepthDecoder::~DepthDecoder() = default;

Status DepthDecoder::Decode(std::span<const std::uint8_t> bytes, cv::Mat1w& picture) {
  if (bytes.size() <= kHeaderBytes || std::memcmp(bytes.data(), kMagic.data(), kMagic.size()) != 0) {
    return Fail(ErrorCode::kBadInput, "not a depth picture (MXD1 expected)");
  }
  const int w = bytes[4] | (bytes[5] << 8);
  const int h = bytes[6] | (bytes[7] << 8);
  if (w < 1 || h < 1 || w > kDepthCodecMaxSide || h > kDepthCodecMaxSide ||
      std::int64_t{w} * h > kDepthCodecMaxPixels) {
    return Fail(ErrorCode::kBadInput, "depth picture of " + std::to_string(w) + " x " + std::to_string(h) +
                                          " pixels is over the limit");
  }
  const std::size_t pixels = static_cast<std::size_t>(w) * static_cast<std::size_t>(h);
  const std::span<const std::uint8_t> packed = bytes.subspan(kHeaderBytes);
  if (ZSTD_getFrameContentSize(packed.data(), packed.size()) != 2 * pixels ||
      ZSTD_findFrameCompressedSize(packed.data(), packed.size()) != packed.size()) {
    return Fail(ErrorCode::kBadInput, "depth picture's packed size does not fit its header");
  }
  state_->planes.resize(2 * pixels);
  const std::size_t size =
      ZSTD_decompressDCtx(state_->context, state_->planes.data(), 2 * pixels, packed.data(), packed.size());
  if (ZSTD_isError(size) || size != 2 * pixels) {
    return Fail(ErrorCode::kBadInput, std::string("damaged depth picture: ") +
                                          (ZSTD_isError(size) ? ZSTD_getErrorName(size) : "too short"));
  }
  picture.create(h, w);
  const std::uint8_t* low = state_->planes.data();
  const std::uint8_t* high = low + pixels;
  std::uint16_t start = kFirstRowStart;
  for (int y = 0; y < h; ++y) {
    const std::size_t at = static_cast<std::size_t>(y) * static_cast<std::size_t>(w);
    DecodeRow(low + at, high + at, w, start, picture[y]);
    start = FirstMeasured(picture[y], w, start);
  }
  return {};
}

}  // namespace mixstage
