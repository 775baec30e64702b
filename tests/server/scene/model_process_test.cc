// SPDX-License-Identifier: Apache-2.0
//
// Hostile files: whatever they do to the importer, the answer is a model or one line, in bounded time.
#include "server/scene/model_process.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <future>
#include <random>
#include <thread>

#include "server/scene/confine.h"
#include "server/scene/model_wire.h"
#include "tests/server/scene/test_models.h"

namespace mixstage {
namespace {

using test::Glb;
using test::Replaced;
using test::TriangleBinary;
using test::TriangleJson;
using testing::HasSubstr;

// A program in place of the importer: what a broken or taken over importer does.
std::filesystem::path Script(const test::TemporaryFolder& folder, const std::string& body) {
  const auto path = folder.Write("importer", "#!/bin/sh\n" + body + "\n");
  std::filesystem::permissions(path, std::filesystem::perms::owner_all);
  return path;
}

void ExpectSame(const LoadedModel& a, const LoadedModel& b) {
  EXPECT_EQ(a.up, b.up);
  EXPECT_EQ(a.warnings, b.warnings);
  EXPECT_EQ(a.mesh.positions, b.mesh.positions);
  EXPECT_EQ(a.mesh.normals, b.mesh.normals);
  EXPECT_EQ(a.mesh.uvs, b.mesh.uvs);
  EXPECT_EQ(a.mesh.colors, b.mesh.colors);
  EXPECT_EQ(a.mesh.indices, b.mesh.indices);
  ASSERT_EQ(a.mesh.parts.size(), b.mesh.parts.size());
  ASSERT_EQ(a.mesh.materials.size(), b.mesh.materials.size());
  for (std::size_t i = 0; i < a.mesh.materials.size(); ++i) {
    EXPECT_EQ(a.mesh.materials[i].name, b.mesh.materials[i].name);
    EXPECT_EQ(a.mesh.materials[i].base_color, b.mesh.materials[i].base_color);
    EXPECT_EQ(a.mesh.materials[i].texture, b.mesh.materials[i].texture);
    EXPECT_EQ(a.mesh.materials[i].double_sided, b.mesh.materials[i].double_sided);
  }
  ASSERT_EQ(a.mesh.textures.size(), b.mesh.textures.size());
  for (std::size_t i = 0; i < a.mesh.textures.size(); ++i) {
    ASSERT_EQ(a.mesh.textures[i].rgba.size(), b.mesh.textures[i].rgba.size());
    EXPECT_EQ(cv::norm(a.mesh.textures[i].rgba, b.mesh.textures[i].rgba, cv::NORM_INF), 0);
  }
}

TEST(ModelProcess, ModelsComeBackAsTheyWouldBeReadHere) {
  for (const char* name : {"sculpture.glb", "amphora.glb"}) {
    const std::filesystem::path file = std::filesystem::path(MIXSTAGE_SOURCE_DIR) / "deploy/demo" / name;
    const auto here = LoadModel(file);
    const auto apart = LoadModelApart(file);
    ASSERT_TRUE(here);
    ASSERT_TRUE(apart) << apart.error().message;
    ExpectSame(*here, *apart);
  }
}

TEST(ModelProcess, ARefusalIsTheImportersOwn) {
  const test::TemporaryFolder folder;
  for (const auto& file :
       {folder.path() / "gone.glb", folder.Write("a.txt", "x"), folder.Write("b.obj", "v 1\n")}) {
    const auto here = LoadModel(file);
    const auto apart = LoadModelApart(file);
    ASSERT_FALSE(here);
    ASSERT_FALSE(apart);
    EXPECT_EQ(apart.error().message, here.error().message);
    EXPECT_EQ(apart.error().code, here.error().code);
  }
}

TEST(ModelProcess, FoundFilesEndAsTheyDoHere) {
  const std::filesystem::path folder =
      std::filesystem::path(MIXSTAGE_SOURCE_DIR) / "../shared/data/real/cg_objects";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "the shared test data is not beside this checkout";
  int files = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (!entry.is_regular_file() || entry.path().extension() == ".md") continue;
    ++files;
    SCOPED_TRACE(entry.path().filename().string());
    const auto here = LoadModel(entry.path());
    const auto apart = LoadModelApart(entry.path());
    ASSERT_EQ(here.has_value(), apart.has_value()) << (apart ? here : apart).error().message;
    if (here) {
      ExpectSame(*here, *apart);
    } else {
      EXPECT_EQ(here.error().message, apart.error().message);
    }
  }
  EXPECT_GT(files, 40);
}

// A PNG that announces a size and holds no pixels.
std::string PngHeader(std::uint32_t width, std::uint32_t height) {
  std::string png = "\x89PNG\r\n\x1a\n";
  const auto big_endian = [&](std::uint32_t v) {
    for (int shift = 24; shift >= 0; shift -= 8) png += static_cast<char>(v >> shift);
  };
  big_endian(13);
  png += "IHDR";
  big_endian(width);
  big_endian(height);
  png += std::string("\x08\x06\0\0\0", 5);
  big_endian(0);
  return png;
}

TEST(ModelProcess, BombsAreOneLineOrHarmless) {
  const test::TemporaryFolder folder;
  const auto start = std::chrono::steady_clock::now();
  const std::string json = TriangleJson();
  const std::string bin = TriangleBinary();
  folder.Write("huge.png", PngHeader(2'000'000'000, 2'000'000'000));
  folder.Write("gigapixel.png", PngHeader(40'000, 40'000));
  std::string deep = json;
  deep.insert(deep.size() - 1, ",\"extras\":" + std::string(200'000, '[') + std::string(200'000, ']'));
  std::string many_nodes =
      "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0]}],\"nodes\":[";
  for (int i = 0; i < 40; ++i) {  // each holds the next one twice: 2^40 triangles
    many_nodes +=
        (i > 0 ? "," : "") + std::string("{\"mesh\":0") +
        (i < 39 ? ",\"children\":[" + std::to_string(i + 1) + "," + std::to_string(i + 1) + "]" : "") + "}";
  }
  many_nodes += "]," + json.substr(json.find("\"meshes\""));
  std::string ply_bomb =
      "ply\nformat ascii 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\n"
      "property float z\nelement face 4000000000\nproperty list uchar int vertex_indices\nend_header\n";
  std::string many_faces = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  many_faces += "f";
  for (int i = 0; i < 2'000'000; ++i) many_faces += " 1 2 3";
  const std::string texture = R"(,"images":[{"uri":"NAME"}],"textures":[{"source":0}],)"
                              R"("materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}])";
  const std::pair<const char*, std::string> bombs[] = {
      {"count.glb", Glb(Replaced(json, "\"count\":3", "\"count\":4294967295"), bin)},
      {"count2.glb", Glb(Replaced(json, "\"count\":3", "\"count\":1000000000000000"), bin)},
      {"negative.glb", Glb(Replaced(json, "\"count\":3", "\"count\":-3"), bin)},
      {"offset.glb", Glb(Replaced(json, "\"byteOffset\":36", "\"byteOffset\":18446744073709551610"), bin)},
      {"sparse.glb", Glb(Replaced(json, "\"bufferView\":0,\"componentType\":5126,\"count\":3",
                                  "\"componentType\":5126,\"count\":400000000"),
                         bin)},
      {"cycle.glb", Glb(TriangleJson(",\"children\":[0]"), bin)},
      {"tree.glb", Glb(many_nodes, bin)},
      {"deep.glb", Glb(deep, bin)},
      {"missing.gltf", Replaced(json, "\"byteLength\":78", "\"byteLength\":78,\"uri\":\"gone.bin\"")},
      {"outside.gltf",
       Replaced(json, "\"byteLength\":78", "\"byteLength\":78,\"uri\":\"../../../../etc/passwd\"")},
      {"absolute.gltf", Replaced(json, "\"byteLength\":78", "\"byteLength\":78,\"uri\":\"/etc/passwd\"")},
      {"device.gltf", Replaced(json, "\"byteLength\":78", "\"byteLength\":78,\"uri\":\"/dev/zero\"")},
      {"nan.glb", Glb(json, Replaced(bin, std::string("\0\0\x80\x3f", 4), std::string("\0\0\xc0\x7f", 4)))},
      {"buffer.glb", Glb(Replaced(json, "\"byteLength\":78", "\"byteLength\":99999999999"), bin)},
      {"png.glb", Glb(TriangleJson("", Replaced(texture, "NAME", "huge.png")), bin)},
      {"gigapixel.glb", Glb(TriangleJson("", Replaced(texture, "NAME", "gigapixel.png")), bin)},
      {"bomb.ply", ply_bomb},
      {"faces.obj", many_faces},
      {"index.obj", "v 0 0 0\nf 1 99999999999 -99999999999\n"},
      {"self.obj", "mtllib self.obj\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"},
  };
  for (const auto& [name, bytes] : bombs) {
    const auto model = LoadModelApart(folder.Write(name, bytes));
    if (model) continue;  // a broken texture is only left out
    EXPECT_THAT(model.error().message, HasSubstr(name));
    EXPECT_THAT(model.error().message, Not(HasSubstr("\n")));
    EXPECT_THAT(model.error().message, Not(HasSubstr("crashed"))) << "survived, but a fault of the importer";
  }
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(25));
}

TEST(ModelProcess, AModelBeyondItsMemoryIsRefusedByTheLimit) {
  if (!kLimitsAddressSpace) GTEST_SKIP() << "the sanitizer needs the address space";
  const test::TemporaryFolder folder;
  std::string obj;
  for (int i = 0; i < 600'000; ++i)
    obj += "v " + std::to_string(i % 97) + " " + std::to_string(i % 89) + " 1\n";
  for (int i = 1; i < 599'998; ++i)
    obj += "f " + std::to_string(i) + " " + std::to_string(i + 1) + " " + std::to_string(i + 2) + "\n";
  ModelProcessConfig small;
  small.memory_bytes = 250u << 20;
  const auto model = LoadModelApart(folder.Write("large.obj", obj), small);
  ASSERT_FALSE(model);
  EXPECT_THAT(model.error().message, HasSubstr("large.obj"));
  EXPECT_THAT(model.error().message, HasSubstr("needs more than 0.244 GiB of memory"));
}

TEST(ModelProcess, ALostImporterIsOneLine) {
  const test::TemporaryFolder folder;
  const auto file = folder.Write("a.glb", Glb(TriangleJson(), TriangleBinary()));
  const std::pair<const char*, const char*> cases[] = {
      {"kill -SEGV $$", "crashed the importer (signal 11)"},
      {"kill -XCPU $$", "took longer than 1 s"},
      {"exec sleep 30", "took longer than 1 s"},
      {"exit 0", "without an answer"},
      {"head -c 100000 /dev/zero", "broken off"},
      {"printf 'MXM1\\001\\000\\000\\000\\001\\000\\000\\000\\377\\377\\377\\377'", "broken off"},
  };
  for (const auto& [body, why] : cases) {
    ModelProcessConfig config;
    config.program = Script(folder, body);
    config.seconds = 1;
    const auto model = LoadModelApart(file, config);
    ASSERT_FALSE(model) << body;
    EXPECT_THAT(model.error().message, HasSubstr(why)) << body;
    EXPECT_THAT(model.error().message, HasSubstr("a.glb"));
  }
}

TEST(ModelProcess, WaitingIsGivenUpWhenAskedTo) {
  const test::TemporaryFolder folder;
  ModelProcessConfig config;
  config.program = Script(folder, "exec sleep 30");
  std::stop_source stop;
  auto answer = std::async(std::launch::async,
                           [&] { return LoadModelApart(folder.path() / "a.glb", config, stop.get_token()); });
  stop.request_stop();
  EXPECT_EQ(answer.get().error().code, ErrorCode::kUnavailable);
}

TEST(ModelProcess, AMissingImporterIsSaid) {
  ModelProcessConfig config;
  config.program = "/nowhere/mixstage-import";
  const auto model = LoadModelApart("a.glb", config);
  ASSERT_FALSE(model);
  EXPECT_THAT(model.error().message, HasSubstr("/nowhere/mixstage-import"));
}

TEST(ModelWire, ChangedBytesAreRefusedOrAGoodMesh) {
  const test::TemporaryFolder folder;
  const auto model = LoadModel(folder.Write("a.glb", Glb(TriangleJson(), TriangleBinary())));
  ASSERT_TRUE(model);
  std::string good;
  ASSERT_TRUE(WriteModel(model, [&](const void* bytes, std::size_t count) {
    good.append(static_cast<const char*>(bytes), count);
    return true;
  }));
  std::mt19937 random(1);
  int refused = 0;
  for (int i = 0; i < 3000; ++i) {
    std::string bytes = good;
    for (unsigned k = 0; k <= random() % 3; ++k)
      bytes[random() % bytes.size()] = static_cast<char>(random() % 4);
    if (i % 5 == 0) bytes.resize(random() % bytes.size());
    std::size_t next = 0;
    const auto read = ReadModel([&](void* out, std::size_t count) {
      if (bytes.size() - next < count) return false;
      std::copy_n(bytes.data() + next, count, static_cast<char*>(out));
      next += count;
      return true;
    });
    if (!read) {
      ++refused;
    } else {
      EXPECT_TRUE(CheckMesh(read->mesh));
    }
  }
  EXPECT_GT(refused, 500);
}

}  // namespace
}  // namespace mixstage
