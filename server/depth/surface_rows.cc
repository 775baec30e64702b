// SPDX-License-Identifier: Apache-2.0
#include "server/depth/surface_rows.h"

#include <algorithm>

namespace mixstage::depth {

void MedianRowScalar(const float* above, const float* row, const float* below, int width, float* median) {
  for (int x = 0; x < width; ++x) {
    const float centre = row[x];
    auto of = [centre](float v) { return v > 0 ? v : centre; };
    float a = of(above[x - 1]), b = of(above[x]), c = of(above[x + 1]);
    float d = of(row[x - 1]), e = centre, f = of(row[x + 1]);
    float g = of(below[x - 1]), h = of(below[x]), i = of(below[x + 1]);
    auto sort = [](float& p, float& q) {
      const float low = std::min(p, q);
      q = std::max(p, q);
      p = low;
    };
    // The middle of nine by 19 exchanges, of which only what reaches e is kept.
    sort(b, c), sort(e, f), sort(h, i), sort(a, b), sort(d, e), sort(g, h), sort(b, c), sort(e, f),
        sort(h, i);
    d = std::max(a, d);
    f = std::min(f, i);
    sort(e, h);
    e = std::max(b, e);
    g = std::max(d, g);
    c = std::min(c, f);
    e = std::min(e, h);
    sort(e, c);
    e = std::max(g, e);
    median[x] = centre > 0 ? std::min(e, c) : 0.0f;
  }
}

void CutRowScalar(const float* z, const float* limit, std::ptrdiff_t next, float pitch, int width,
                  std::uint8_t* cut) {
  for (int x = 0; x < width; ++x) {
    const float p = z[x];
    const float q = z[x + next];
    const float step = q - p;
    // Beyond a hole the slope is unknown: it explains nothing. Slopes are taken in the step's direction.
    const float sign = step < 0 ? -1.0f : 1.0f;
    const float before_p = z[x - next];
    const float beyond_q = z[x + 2 * next];
    const float before = before_p > 0 ? std::max(0.0f, sign * (p - before_p)) : 0.0f;
    const float beyond = beyond_q > 0 ? std::max(0.0f, sign * (beyond_q - q)) : 0.0f;
    const float lateral = pitch * std::min(p, q);
    const float explained = std::max(std::min(std::min(before, beyond), kSlopeOfBothSides * lateral),
                                     std::min(std::max(before, beyond), kSlopeOfOneSide * lateral));
    const float excess = sign * step - explained;
    cut[x] = excess > std::max(limit[x], limit[x + next]) ? 255 : 0;
  }
}

}  // namespace mixstage::depth
