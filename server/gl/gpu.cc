// SPDX-License-Identifier: Apache-2.0
#include "server/gl/gpu.h"

#include "proto/base/clock.h"
#include "proto/base/log.h"

namespace mixstage::gl {
namespace {

constexpr std::int64_t kRetryUs = 100'000;  // while the driver is still resetting

}  // namespace

Gpu::Gpu(Context context, Devices devices)
    : devices_(devices), context_(std::move(context)), info_(context_->info()) {}

Result<std::shared_ptr<Gpu>> Gpu::Create(Devices devices) {
  auto context = Context::Create(devices);
  if (!context) return tl::unexpected(context.error());
  return std::shared_ptr<Gpu>(new Gpu(std::move(*context), devices));
}

std::optional<Current> Gpu::Enter() {
  if (context_) {
    if (auto current = context_->Enter()) return std::move(*current);
    spdlog::warn("gl event=lost renderer=\"{}\"", info_.renderer);
    context_.reset();
  }
  const std::int64_t now_us = MonotonicMicros();
  if (now_us < retry_us_) return std::nullopt;
  retry_us_ = now_us + kRetryUs;
  auto context = Context::Create(devices_);
  if (!context) return std::nullopt;
  context_.emplace(std::move(*context));
  info_ = context_->info();
  ++generation_;
  spdlog::warn("gl event=recovered renderer=\"{}\" ms={}", info_.renderer,
               (MonotonicMicros() - now_us) / 1000);
  auto current = context_->Enter();
  if (!current) return std::nullopt;
  return std::move(*current);
}

void Gpu::LoseForTest() {
  if (context_) context_->LoseForTest();
}

}  // namespace mixstage::gl
