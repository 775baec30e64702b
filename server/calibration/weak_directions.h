// SPDX-License-Identifier: Apache-2.0
//
// What an adjustment leaves open, in words.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace mixstage {

// A number of a covariance.
struct Direction {
  std::string name;
  double unit;       // what counts as weak
  double per_unit;   // what is said, for one of what is stored
  const char* text;  // printf's, of a number: "%.1f mm"
};

// The directions of the covariance that are weak, each as what trades against what; the worst first.
std::vector<std::string> WeakDirections(const Eigen::MatrixXd& covariance, const std::vector<Direction>& of);

}  // namespace mixstage
