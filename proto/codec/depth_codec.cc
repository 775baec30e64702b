// SPDX-License-Identifier: Apache-2.0
#include "proto/codec/depth_codec.h"

#include <zstd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <string>

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

// A hole (0) is the symbol 0 and leaves the prediction alone: the surface beyond it goes on from the last
// measured pixel. A measured value v = 1..65535 is the symbol 1 + zigzag(v - last), differences taken modulo
// 65,535 so that every value has one symbol: 0, -1, 1, -2, ... become 1, 2, 3, 4, ...
inline std::uint16_t Symbol(std::uint16_t value, std::uint16_t last) {
  int difference = int{value} - int{last};
  difference += (difference < -32767) ? 65535 : (difference > 32767) ? -65535 : 0;
  const auto zigzag = static_cast<std::uint32_t>((difference << 1) ^ (difference >> 31));
  return value == 0 ? std::uint16_t{0} : static_cast<std::uint16_t>(zigzag + 1);
}
inline std::uint16_t Value(std::uint16_t symbol, std::uint16_t last) {
  const int zigzag = symbol - 1;
  int value = int{last} + ((zigzag >> 1) ^ -(zigzag & 1));
  value += value < 1 ? 65535 : value > 65535 ? -65535 : 0;
  return symbol == 0 ? std::uint16_t{0} : static_cast<std::uint16_t>(value);
}

std::uint16_t FirstMeasured(const std::uint16_t* row, int width, std::uint16_t otherwise) {
  const std::uint16_t* first = std::find_if(row, row + width, [](std::uint16_t v) { return v != 0; });
  return first == row + width ? otherwise : *first;
}

// Blocks of this many pixels without a hole, or nothing but holes, are the rule; they need no branch per
// pixel.
constexpr int kBlock = 16;

enum class BlockKind { kMeasured = 1, kHoles, kMixed };

// kMeasured: every value is in 1..32767, so that no difference leaves 16 bits and the modulus never acts.
BlockKind Classify(const std::uint16_t* values, std::uint16_t last) {
  std::uint16_t any = 0;
  std::uint16_t outside = static_cast<std::uint16_t>(last | (last - 1));
  for (int i = 0; i < kBlock; ++i) {
    any = static_cast<std::uint16_t>(any | values[i]);
    outside = static_cast<std::uint16_t>(outside | values[i] | (values[i] - 1));
  }
  return any == 0 ? BlockKind::kHoles : (outside & 0x8000) == 0 ? BlockKind::kMeasured : BlockKind::kMixed;
}

// Symbol() for a block of kind kMeasured; plain loops that the compiler turns into vector code.
void EncodeMeasured(const std::uint16_t* values, std::uint16_t last, std::uint8_t* low, std::uint8_t* high) {
  std::uint16_t before[kBlock];
  before[0] = last;
  std::memcpy(before + 1, values, (kBlock - 1) * sizeof *values);
  std::uint16_t symbols[kBlock];
  for (int i = 0; i < kBlock; ++i) {
    const auto difference = static_cast<std::int16_t>(values[i] - before[i]);
    symbols[i] = static_cast<std::uint16_t>(((difference << 1) ^ (difference >> 15)) + 1);
  }
  for (int i = 0; i < kBlock; ++i) low[i] = static_cast<std::uint8_t>(symbols[i]);
  for (int i = 0; i < kBlock; ++i) high[i] = static_cast<std::uint8_t>(symbols[i] >> 8);
}

// Symbols of one row, low and high bytes apart. A row starts from the first measured pixel of the row above,
// which is nearer than the last one at its far end: `start` is that value; returned is the one for the next
// row.
std::uint16_t EncodeRow(const std::uint16_t* row, int width, std::uint16_t start, std::uint8_t* low,
                        std::uint8_t* high) {
  std::uint16_t last = start;
  for (int x = 0; x < width;) {
    const BlockKind kind = x + kBlock <= width ? Classify(row + x, last) : BlockKind::kMixed;
    const int end = std::min(x + kBlock, width);
    if (kind == BlockKind::kMeasured) {
      EncodeMeasured(row + x, last, low + x, high + x);
      last = row[end - 1];
    } else if (kind == BlockKind::kHoles) {
      std::memset(low + x, 0, kBlock);
      std::memset(high + x, 0, kBlock);
    } else {
      for (int i = x; i < end; ++i) {
        const std::uint16_t symbol = Symbol(row[i], last);
        low[i] = static_cast<std::uint8_t>(symbol);
        high[i] = static_cast<std::uint8_t>(symbol >> 8);
        last = row[i] == 0 ? last : row[i];
      }
    }
    x = end;
  }
  return FirstMeasured(row, width, start);
}

std::uint16_t DecodeRow(const std::uint8_t* low, const std::uint8_t* high, int width, std::uint16_t start,
                        std::uint16_t* row) {
  std::uint16_t last = start;
  for (int x = 0; x < width; ++x) {
    row[x] = Value(static_cast<std::uint16_t>(low[x] | (high[x] << 8)), last);
    last = row[x] == 0 ? last : row[x];
  }
  return FirstMeasured(row, width, start);
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
    start = EncodeRow(row, w, start, low + at, high + at);
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
    start = DecodeRow(low + at, high + at, w, start, picture[y]);
  }
  return {};
}

}  // namespace mixstage
