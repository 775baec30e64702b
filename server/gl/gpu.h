// SPDX-License-Identifier: Apache-2.0
//
// What passes share: a context that is made anew when it was lost (a driver's reset, a laptop's sleep).
// Meanwhile Enter gives nothing and the pass draws its picture on the CPU.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>

#include "server/gl/context.h"

namespace mixstage::gl {

class Gpu {
 public:
  // As Context::Create.
  static Result<std::shared_ptr<Gpu>> Create(Devices devices = Devices::kAny);

  // Nothing while there is no context. Two threads may not enter at once (our bug: checked).
  std::optional<Current> Enter();
  // Rises with every new context: what was made in an older one is gone.
  [[nodiscard]] std::uint64_t generation() const { return generation_; }
  [[nodiscard]] const RendererInfo& info() const { return info_; }

  // As after a reset: what is being drawn is void, the next Enter makes a new context.
  void LoseForTest();

 private:
  Gpu(Context context, Devices devices);
  const Devices devices_;
  std::optional<Context> context_;
  RendererInfo info_;
  std::uint64_t generation_ = 1;
  std::int64_t retry_us_ = 0;  // no new attempt before
};

// A pass's GL objects, made when first wanted and again in every new context.
template <typename Objects>
class PerContext {
 public:
  // make: Result<Objects>(const Current&). Nothing when it fails: not before the next context is it tried
  // again; failure() says why.
  template <typename Make>
  Objects* In(const Gpu& gpu, const Current& current, Make make) {
    if (generation_ != gpu.generation()) {
      generation_ = gpu.generation();
      objects_.reset();
      auto made = make(current);
      if (made) {
        objects_.emplace(std::move(*made));
      } else {
        failure_ = made.error();
      }
    }
    return objects_ ? &*objects_ : nullptr;
  }
  [[nodiscard]] const Error& failure() const { return failure_; }

 private:
  std::uint64_t generation_ = 0;
  std::optional<Objects> objects_;
  Error failure_;
};

}  // namespace mixstage::gl
