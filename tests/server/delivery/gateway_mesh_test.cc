// SPDX-License-Identifier: Apache-2.0
//
// Meshes over real sockets.
#include <gtest/gtest.h>

#include "server/delivery/gateway.h"
#include "tests/server/delivery/test_viewer.h"

namespace mixstage {
namespace {

std::shared_ptr<const WholeMessage> MeshOf(WatchStream stream, std::uint32_t id, std::uint64_t frame,
                                           std::size_t bytes = 100) {
  const std::vector<std::uint8_t> mesh(bytes, static_cast<std::uint8_t>(frame));
  return MakeMeshMessage({.stream = stream, .frame = frame, .id = id, .mesh = mesh});
}

WatchMesh Read(const std::optional<Received>& received) {
  EXPECT_TRUE(received);
  if (!received) return {};
  const auto mesh =
      ReadWatchMesh({reinterpret_cast<const std::uint8_t*>(received->bytes.data()), received->bytes.size()});
  EXPECT_TRUE(mesh);
  return mesh ? *mesh : WatchMesh{};
}

class GatewayMesh : public testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(gateway_.Start()); }
  void Subscribe(TestViewer& viewer) {
    ASSERT_TRUE(viewer.SendText(R"({"type":"subscribe","streams":["mesh"]})"));
    ASSERT_TRUE(Eventually([&] { return gateway_.WantsStream(WatchStream::kRoomMesh); }));
  }
  void ExpectNext(TestViewer& viewer, WatchStream stream, std::uint32_t id, std::uint64_t frame) {
    const auto received = viewer.ReadBinary();
    const WatchMesh mesh = Read(received);
    EXPECT_EQ(mesh.stream, stream);
    EXPECT_EQ(mesh.id, id);
    EXPECT_EQ(mesh.frame, frame);
  }
  Gateway gateway_{GatewayConfig{.listen = "127.0.0.1:0"}};
};

TEST_F(GatewayMesh, OnlyWhoSubscribedGetsThem) {
  TestViewer pictures(gateway_.port()), meshes(gateway_.port());
  ASSERT_TRUE(Eventually([&] { return gateway_.counters().viewers == 2; }));
  EXPECT_FALSE(gateway_.WantsStream(WatchStream::kActorMesh)) << "a new viewer gets pictures only";
  Subscribe(meshes);
  gateway_.PublishWhole(MeshOf(WatchStream::kActorMesh, 0, 1));
  ExpectNext(meshes, WatchStream::kActorMesh, 0, 1);
  gateway_.Publish(MakeWatchPicture({.stream = WatchStream::kColor, .key_frame = true, .frame = 2},
                                    std::vector<std::uint8_t>(10, 1)));
  const auto first = pictures.ReadBinary();
  ASSERT_TRUE(first);
  EXPECT_EQ(first->bytes[4], 1) << "no mesh before it";
  ASSERT_TRUE(meshes.SendText(R"({"type":"subscribe","streams":[]})"));
  EXPECT_TRUE(Eventually([&] { return !gateway_.WantsStream(WatchStream::kActorMesh); }));
}

TEST_F(GatewayMesh, StandingMeshesGoToEveryoneWhoSubscribesLater) {
  gateway_.PublishWhole(MeshOf(WatchStream::kRoomMesh, 0, 1));
  gateway_.PublishWhole(MeshOf(WatchStream::kObjectMesh, 1, 1));
  gateway_.PublishWhole(MeshOf(WatchStream::kObjectMesh, 2, 1));
  gateway_.RemoveMesh(WatchStream::kObjectMesh, 1);
  for (int i = 0; i < 2; ++i) {
    TestViewer viewer(gateway_.port());
    Subscribe(viewer);
    ExpectNext(viewer, WatchStream::kRoomMesh, 0, 1);
    ExpectNext(viewer, WatchStream::kObjectMesh, 2, 1);
  }
}

TEST_F(GatewayMesh, AReplacedOneGoesOutAgainAndOnlyThatOne) {
  gateway_.PublishWhole(MeshOf(WatchStream::kRoomMesh, 0, 1));
  gateway_.PublishWhole(MeshOf(WatchStream::kObjectMesh, 7, 1));
  TestViewer viewer(gateway_.port());
  Subscribe(viewer);
  ExpectNext(viewer, WatchStream::kRoomMesh, 0, 1);
  ExpectNext(viewer, WatchStream::kObjectMesh, 7, 1);
  gateway_.PublishWhole(MeshOf(WatchStream::kRoomMesh, 0, 2));
  ExpectNext(viewer, WatchStream::kRoomMesh, 0, 2);
  gateway_.PublishWhole(MeshOf(WatchStream::kActorMesh, 0, 3));
  ExpectNext(viewer, WatchStream::kActorMesh, 0, 3);
  // Who subscribes anew gets all that stands.
  ASSERT_TRUE(viewer.SendText(R"({"type":"subscribe","streams":[]})"));
  ASSERT_TRUE(viewer.SendText(R"({"type":"subscribe","streams":["mesh"]})"));
  ExpectNext(viewer, WatchStream::kObjectMesh, 7, 1);
  ExpectNext(viewer, WatchStream::kRoomMesh, 0, 2);
}

TEST_F(GatewayMesh, ASlowViewerMissesMeshesOfTheActorButGetsTheNewestAndAllThatStand) {
  TestViewer viewer(gateway_.port(), {.origin = "", .receive_buffer_bytes = 4096});
  Subscribe(viewer);
  constexpr std::uint64_t kLast = 200;
  for (std::uint64_t frame = 1; frame <= kLast; ++frame) {
    gateway_.PublishWhole(MeshOf(WatchStream::kActorMesh, 0, frame, 100'000));
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  gateway_.PublishWhole(MeshOf(WatchStream::kRoomMesh, 0, kLast + 1, 2'000'000));
  ASSERT_TRUE(Eventually([&] { return gateway_.counters().dropped_mesh_slow > 0; }));
  EXPECT_EQ(gateway_.counters().dropped_viewer_slow, 0u) << "no picture was lost";
  std::uint64_t actors = 0, newest = 0;
  while (true) {
    const auto received = viewer.ReadBinary();
    const WatchMesh mesh = Read(received);
    if (mesh.stream != WatchStream::kActorMesh) {
      EXPECT_EQ(mesh.stream, WatchStream::kRoomMesh);
      break;
    }
    EXPECT_GT(mesh.frame, newest) << "never backwards";
    newest = mesh.frame;
    ++actors;
  }
  EXPECT_LT(actors, kLast);
  EXPECT_EQ(newest, kLast);
}

}  // namespace
}  // namespace mixstage
