// SPDX-License-Identifier: Apache-2.0
#include "server/ingest/live_ingest.h"
#include "tests/fuzz/slice_records.h"

// Datagrams to decoded, paired frames: the whole way of a hostile rig network into the server.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  static const Rig rig = AssumedRig(16, 16, 0.001);
  CapturedFrames frames(2, WhenFull::kDropOldest);
  LiveIngest ingest(rig, frames);
  ForEachSlice({data, size}, [&](const mixstage_lcm::frame_slice_t& slice, std::int64_t now_us) {
    ingest.OnSlice(slice, now_us);
    // The same bytes as the other messages of the network.
    mixstage_lcm::head_angles_t angles{.epoch = slice.epoch, .t_us = slice.t_us, .pan_deg = 0, .tilt_deg = 0};
    std::memcpy(&angles.pan_deg, slice.payload, sizeof angles.pan_deg);
    ingest.OnHead(angles, now_us);
    mixstage_lcm::agent_health_t health{};
    health.epoch = slice.epoch;
    health.t_us = slice.t_us;
    std::memcpy(health.name, slice.payload, sizeof health.name);
    ingest.OnHealth(health, now_us);
    mixstage_lcm::scan_progress_t scan{};
    scan.epoch = slice.epoch;
    scan.sequence = slice.sequence;
    scan.state = slice.stream;
    scan.positions = scan.recorded = slice.width;
    scan.columns = slice.slice;
    scan.rows = slice.data_slices;
    std::memcpy(scan.cells, slice.payload, sizeof scan.cells);
    std::memcpy(scan.notes, slice.payload, sizeof scan.notes);
    ingest.OnScan(scan, now_us);
    while (frames.TryPop()) {
    }
  });
  (void)ingest.Status();
  return 0;
}
