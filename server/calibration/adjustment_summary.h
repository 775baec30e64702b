// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace mixstage {

struct AdjustmentSummary {
  double cost = 0;  // half the robust sum of squares
  int iterations = 0;
  bool converged = false;
};

}  // namespace mixstage
