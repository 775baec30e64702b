// SPDX-License-Identifier: Apache-2.0
#include "proto/link/parity.h"

#include <gtest/gtest.h>
#include <isa-l/erasure_code.h>

#include <algorithm>
#include <random>

namespace mixstage {
namespace {

// Data and parity slices of a picture with random content.
struct Coded {
  Coded(int data_slices, int parity_slices, std::size_t bytes, unsigned seed) : slice_bytes(bytes) {
    std::mt19937 random(seed);
    auto fill = [&](int count, auto& slices, auto& pointers) {
      slices.assign(static_cast<std::size_t>(count), std::vector<std::uint8_t>(bytes));
      for (auto& slice : slices) {
        for (auto& byte : slice) byte = static_cast<std::uint8_t>(random());
        pointers.push_back(slice.data());
      }
    };
    fill(data_slices, data, data_at);
    fill(parity_slices, parity, parity_at);
    coder.Encode(DataConst(), parity_at, bytes);
    have_data.assign(data.size(), true);
    have_parity.assign(parity.size(), true);
  }
  std::vector<const std::uint8_t*> DataConst() const { return {data_at.begin(), data_at.end()}; }
  std::vector<const std::uint8_t*> ParityConst() const { return {parity_at.begin(), parity_at.end()}; }
  void LoseData(std::size_t i) {
    have_data[i] = false;
    std::fill(data[i].begin(), data[i].end(), std::uint8_t{0xEE});
  }
  void Repair(int turn = 0) {
    coder.Repair(data_at, have_data, ParityConst(), have_parity, slice_bytes, turn);
  }

  std::size_t slice_bytes;
  std::vector<std::vector<std::uint8_t>> data, parity;
  std::vector<std::uint8_t*> data_at, parity_at;
  std::vector<bool> have_data, have_parity;
  ParityCoder coder;
};

TEST(Parity, IsTheCauchyCodeOfTheLibrary) {
  constexpr int kData = 20, kParity = 4;
  constexpr std::size_t kBytes = 64;
  Coded coded(kData, kParity, kBytes, 1);
  std::vector<std::uint8_t> matrix(static_cast<std::size_t>((kData + kParity) * kData));
  gf_gen_cauchy1_matrix(matrix.data(), kData + kParity, kData);
  for (std::size_t r = 0; r < kParity; ++r) {
    for (std::size_t b = 0; b < kBytes; ++b) {
      std::uint8_t sum = 0;
      for (std::size_t c = 0; c < kData; ++c) {
        sum = static_cast<std::uint8_t>(sum ^ gf_mul(matrix[(kData + r) * kData + c], coded.data[c][b]));
      }
      ASSERT_EQ(coded.parity[r][b], sum);
    }
  }
}

TEST(Parity, OfOneSliceIsItsCopy) {
  Coded coded(1, 1, 100, 2);
  EXPECT_EQ(coded.parity[0], coded.data[0]);
}

TEST(Parity, RestoresAnyLossUpToItsCount) {
  std::mt19937 random(3);
  for (int round = 0; round < 300; ++round) {
    const int k = 1 + static_cast<int>(random() % 300),
              m = 1 + static_cast<int>(random() % static_cast<unsigned>(k));
    const std::size_t bytes = round % 3 == 0 ? 1280 : 1 + random() % 200;
    Coded coded(k, m, bytes, static_cast<unsigned>(round));
    const auto truth = coded.data;
    // A group's own count is what it can lose; parity may be among the lost.
    const int groups = ParityGroups(k, m);
    for (int g = 0; g < groups; ++g) {
      std::vector<std::pair<bool, std::size_t>> of_group;
      int parity = 0;
      for (int i = g; i < k; i += groups) of_group.emplace_back(true, i);
      for (int j = g; j < m; j += groups, ++parity) of_group.emplace_back(false, j);
      std::shuffle(of_group.begin(), of_group.end(), random);
      for (int n = 0; n < parity; ++n) {
        const auto [is_data, index] = of_group[static_cast<std::size_t>(n)];
        if (is_data) {
          coded.LoseData(index);
        } else {
          coded.have_parity[index] = false;
        }
      }
    }
    coded.Repair();
    ASSERT_EQ(coded.data, truth) << k << " + " << m << " of " << bytes;
  }
}

TEST(Parity, AnotherTurnAvoidsALyingSlice) {
  Coded coded(50, 5, 200, 4);
  const auto truth = coded.data;
  coded.LoseData(7);
  coded.LoseData(30);
  coded.parity[0][3] ^= 1;
  coded.Repair(0);
  EXPECT_NE(coded.data, truth);
  coded.Repair(1);
  EXPECT_EQ(coded.data, truth);
}

TEST(Parity, EveryGroupFitsTheCodeAndIsProtected) {
  for (int data = 1; data <= 6554; data += 1 + data / 50) {
    for (const double share : {0.001, 0.05, 0.14, 0.5, 1.0}) {
      const int parity = ParitySlices(data, share);
      const int groups = ParityGroups(data, parity);
      EXPECT_GE(parity, groups);
      EXPECT_LE(parity, data);
      EXPECT_GE(parity, share * data - 1e-6);
      EXPECT_LE((data + groups - 1) / groups + (parity + groups - 1) / groups, 255);
    }
    EXPECT_EQ(ParitySlices(data, 0), 0);
  }
  EXPECT_EQ(ParitySlices(100, 0.05), 5);
  EXPECT_EQ(ParitySlices(157, 0.05), 8);
}

}  // namespace
}  // namespace mixstage
