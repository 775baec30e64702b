// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "proto/synthetic/room_plate.h"
#include "proto/synthetic/standing_board.h"

namespace mixstage {

// Draws boards into a picture of the empty room: up to 64 rays a pixel, each through the lens, so that
// a printed edge lies in the picture where its projection says. What stands before a board hides it. Board
// and figure do not know of each other.
void DrawBoards(const std::vector<StandingBoard>& boards, const Room& room, const RoomLight& light,
                RoomPlate& plate);

// A copy that shares nothing.
RoomPlate CopyOf(const RoomPlate& plate);

}  // namespace mixstage
