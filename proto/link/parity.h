// SPDX-License-Identifier: Apache-2.0
//
// Parity over the slices of a picture (SPEC.md 2.6): a systematic Reed-Solomon code, Cauchy over GF(2^8). Any
// data_slices of a group's slices restore it, whichever were lost: what counts is how many, not which.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace mixstage {

inline constexpr double kDefaultParity = 0.05;  // share of the data slices: pictures whole at 1 % loss

// Parity slices for a strength of 0 .. 1 (share of the data slices): rounded up, at least one a group; 0 for
// 0.
[[nodiscard]] int ParitySlices(int data_slices, double share);
// Interleaved groups: slice i of the data belongs to group i mod groups, and so does slice i of the parity. A
// burst of neighbours is so spread over all groups. No group has more than 255 slices, the code's limit.
[[nodiscard]] int ParityGroups(int data_slices, int parity_slices);

// The code. Keeps scratch memory between calls: one thread. All slices of a call have `slice_bytes` bytes.
class ParityCoder {
 public:
  // Fills every parity slice from all data slices.
  void Encode(std::span<const std::uint8_t* const> data, std::span<std::uint8_t* const> parity,
              std::size_t slice_bytes);

  // Fills the data slices that are missing (have_data false) from the others and the parity that is there.
  // Where more parity is there than needed, `turn` chooses which: another turn is another choice, for when
  // one of them lies. A group with more missing than parity is a caller's bug (checked).
  void Repair(std::span<std::uint8_t* const> data, const std::vector<bool>& have_data,
              std::span<const std::uint8_t* const> parity, const std::vector<bool>& have_parity,
              std::size_t slice_bytes, int turn);

 private:
  // outputs[r] = sum over c of coefficients_[r * sources_.size() + c] * sources_[c], in GF(2^8).
  void Multiply(std::size_t slice_bytes);
  // Solves the missing columns of one group (counted inside the group) by as many parity rows.
  void Solve(int k, std::span<const int> missing, std::span<const int> rows, std::size_t slice_bytes);

  std::vector<const std::uint8_t*> sources_;
  std::vector<std::uint8_t*> outputs_;
  std::vector<std::uint8_t> coefficients_, tables_, syndromes_;
};

}  // namespace mixstage
