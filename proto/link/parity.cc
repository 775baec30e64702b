// SPDX-License-Identifier: Apache-2.0
#include "proto/link/parity.h"

#include <isa-l/erasure_code.h>

#include <algorithm>
#include <cmath>

#include "proto/base/check.h"

namespace mixstage {
namespace {

// Data and parity are split evenly, each rounded up: a group has at most two slices more than this.
constexpr int kGroupSlices = 250;

// The code's coefficient of data column c in parity row r of a group of k data slices.
std::uint8_t Coefficient(int k, int r, int c) { return gf_inv(static_cast<std::uint8_t>((k + r) ^ c)); }

// Slices of `total` that fall into group g of `groups`.
int InGroup(int total, int g, int groups) { return (total - g + groups - 1) / groups; }

}  // namespace

int ParityGroups(int data_slices, int parity_slices) {
  return (data_slices + parity_slices + kGroupSlices - 1) / kGroupSlices;
}

int ParitySlices(int data_slices, double share) {
  if (share <= 0) return 0;
  // The small subtraction keeps 0.05 x 100 at 5: in binary the product is a hair more.
  int parity = static_cast<int>(std::ceil(std::min(share, 1.0) * data_slices - 1e-9));
  while (parity < ParityGroups(data_slices, parity)) ++parity;
  return parity;
}

void ParityCoder::Multiply(std::size_t slice_bytes) {
  const auto columns = static_cast<int>(sources_.size());
  const auto rows = static_cast<int>(outputs_.size());
  MIX_CHECK(coefficients_.size() == sources_.size() * outputs_.size());
  tables_.resize(32 * coefficients_.size());
  ec_init_tables(columns, rows, coefficients_.data(), tables_.data());
  // The library only reads its sources, though its signature is not const.
  ec_encode_data(static_cast<int>(slice_bytes), columns, rows, tables_.data(),
                 const_cast<std::uint8_t**>(sources_.data()), outputs_.data());
}

void ParityCoder::Encode(std::span<const std::uint8_t* const> data, std::span<std::uint8_t* const> parity,
                         std::size_t slice_bytes) {
  const auto data_slices = static_cast<int>(data.size());
  const auto parity_slices = static_cast<int>(parity.size());
  const int groups = ParityGroups(data_slices, parity_slices);
  for (int g = 0; g < groups; ++g) {
    sources_.clear();
    outputs_.clear();
    coefficients_.clear();
    for (int i = g; i < data_slices; i += groups) sources_.push_back(data[static_cast<std::size_t>(i)]);
    for (int j = g; j < parity_slices; j += groups) outputs_.push_back(parity[static_cast<std::size_t>(j)]);
    if (outputs_.empty()) continue;
    const auto k = static_cast<int>(sources_.size());
    for (int r = 0; r < static_cast<int>(outputs_.size()); ++r) {
      for (int c = 0; c < k; ++c) coefficients_.push_back(Coefficient(k, r, c));
    }
    Multiply(slice_bytes);
  }
}

void ParityCoder::Repair(std::span<std::uint8_t* const> data, const std::vector<bool>& have_data,
                         std::span<const std::uint8_t* const> parity, const std::vector<bool>& have_parity,
                         std::size_t slice_bytes, int turn) {
  MIX_CHECK(data.size() == have_data.size() && parity.size() == have_parity.size());
  const auto data_slices = static_cast<int>(data.size());
  const auto parity_slices = static_cast<int>(parity.size());
  const int groups = ParityGroups(data_slices, parity_slices);
  std::vector<int> missing, there, rows;
  for (int g = 0; g < groups; ++g) {
    missing.clear();
    there.clear();
    for (int i = g, c = 0; i < data_slices; i += groups, ++c) {
      if (!have_data[static_cast<std::size_t>(i)]) missing.push_back(c);
    }
    if (missing.empty()) continue;
    for (int j = g, r = 0; j < parity_slices; j += groups, ++r) {
      if (have_parity[static_cast<std::size_t>(j)]) there.push_back(r);
    }
    MIX_CHECK(there.size() >= missing.size());
    rows.clear();
    for (std::size_t n = 0; n < missing.size(); ++n) {
      rows.push_back(there[(static_cast<std::size_t>(turn) + n) % there.size()]);
    }

    // What the parity rows hold beyond the data that is there: their part of the missing data.
    const int k = InGroup(data_slices, g, groups);
    sources_.clear();
    outputs_.clear();
    coefficients_.clear();
    for (int c = 0; c < k; ++c) {
      const auto i = static_cast<std::size_t>(g + c * groups);
      if (have_data[i]) sources_.push_back(data[i]);
    }
    syndromes_.assign(missing.size() * slice_bytes, 0);
    for (std::size_t n = 0; n < missing.size(); ++n) {
      outputs_.push_back(syndromes_.data() + n * slice_bytes);
      for (int c = 0; c < k; ++c) {
        if (have_data[static_cast<std::size_t>(g + c * groups)])
          coefficients_.push_back(Coefficient(k, rows[n], c));
      }
    }
    if (!sources_.empty()) Multiply(slice_bytes);
    for (std::size_t n = 0; n < missing.size(); ++n) {
      const std::uint8_t* from = parity[static_cast<std::size_t>(g + rows[n] * groups)];
      std::uint8_t* syndrome = syndromes_.data() + n * slice_bytes;
      for (std::size_t b = 0; b < slice_bytes; ++b)
        syndrome[b] = static_cast<std::uint8_t>(syndrome[b] ^ from[b]);
    }
    outputs_.clear();
    for (const int c : missing) outputs_.push_back(data[static_cast<std::size_t>(g + c * groups)]);
    Solve(k, missing, rows, slice_bytes);
  }
}

// The missing columns see a square Cauchy matrix 1 / (x_i + y_j), x the parity rows and y the columns. Its
// inverse is known in closed form (Schechter 1959): inverse[j][i] = P_j Q_i / (x_i + y_j) with
//   P_j = prod_n (x_n + y_j) / prod_{n != j} (y_n + y_j),  Q_i the same with x and y exchanged.
// That is quadratic in the erasures: inverting the code's whole matrix costs a hundred times the repair.
void ParityCoder::Solve(int k, std::span<const int> missing, std::span<const int> rows,
                        std::size_t slice_bytes) {
  const std::size_t n = missing.size();
  auto x = [&](std::size_t i) { return static_cast<std::uint8_t>(k + rows[i]); };
  auto y = [&](std::size_t j) { return static_cast<std::uint8_t>(missing[j]); };
  auto add = [](std::uint8_t a, std::uint8_t b) { return static_cast<std::uint8_t>(a ^ b); };
  std::vector<std::uint8_t> P(n, 1), Q(n, 1);
  for (std::size_t j = 0; j < n; ++j) {
    std::uint8_t below_P = 1, below_Q = 1;
    for (std::size_t i = 0; i < n; ++i) {
      P[j] = gf_mul(P[j], add(x(i), y(j)));
      Q[j] = gf_mul(Q[j], add(x(j), y(i)));
      if (i == j) continue;
      below_P = gf_mul(below_P, add(y(i), y(j)));
      below_Q = gf_mul(below_Q, add(x(i), x(j)));
    }
    P[j] = gf_mul(P[j], gf_inv(below_P));
    Q[j] = gf_mul(Q[j], gf_inv(below_Q));
  }
  sources_.clear();
  coefficients_.clear();
  for (std::size_t i = 0; i < n; ++i) sources_.push_back(syndromes_.data() + i * slice_bytes);
  for (std::size_t j = 0; j < n; ++j) {
    for (std::size_t i = 0; i < n; ++i)
      coefficients_.push_back(gf_mul(gf_mul(P[j], Q[i]), gf_inv(add(x(i), y(j)))));
  }
  Multiply(slice_bytes);
}

}  // namespace mixstage
