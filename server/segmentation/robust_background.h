// SPDX-License-Identifier: Apache-2.0
//
// The empty set out of frames in which actors walk: per-pixel modes instead of means (beyond piVE 3, whose
// statistics need empty frames).
#pragma once

#include <span>

#include "server/segmentation/background_estimator.h"

namespace mixstage {

// Fills depth_m, depth_sigma_m, depth_share. The room is the farthest depth that at least `far_share` of the
// samples (and three of them) agree on: actors only ever stand in front of it.
void FarthestDepth(std::span<const BackgroundEstimator::Sample> samples, float far_share,
                   RoomStatistics* statistics);

// Fills mean and sigma with the largest cluster of colours per pixel, after each sample's tone change is
// taken out. Samples whose depth lies in front of statistics->depth_m have no vote.
void MostFrequentColor(std::span<const BackgroundEstimator::Sample> samples, RoomStatistics* statistics);

}  // namespace mixstage
