// SPDX-License-Identifier: Apache-2.0
#include "proto/watch/text_message.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "proto/watch/json_field.h"
#include "proto/watch/scene_fields.h"

namespace mixstage {
namespace {

using Json = nlohmann::json;

constexpr double kLargestExactInteger = 9007199254740992.0;  // 2^53

std::string Dump(const Json& json) { return json.dump(-1, ' ', false, Json::error_handler_t::replace); }

double Finite(double value) { return std::isfinite(value) ? value : 0; }

// A whole number is written without a fraction, as JavaScript would have sent it.
Json Number(double value) {
  if (std::trunc(value) == value && std::abs(value) <= kLargestExactInteger) {
    return static_cast<std::int64_t>(value);
  }
  return Finite(value);
}

Json Stage(const WatchStage& stage) {
  return {{"name", stage.name},
          {"budget_ms", Finite(stage.budget_ms)},
          {"wall_ms", Finite(stage.wall_ms)},
          {"cpu_ms", Finite(stage.cpu_ms)}};
}

Json Agent(const WatchAgent& agent) {
  return {{"epoch", agent.epoch},
          {"name", agent.name},
          {"age_s", Finite(agent.age_s)},
          {"color_fps", Finite(agent.color_fps)},
          {"depth_fps", Finite(agent.depth_fps)},
          {"drops", agent.drops},
          {"queue", agent.queue},
          {"encode_ms", Finite(agent.encode_ms)},
          {"lost", agent.lost},
          {"repaired", agent.repaired},
          {"slice_loss", Finite(agent.slice_loss)},
          {"delay_ms", Finite(agent.delay_ms)},
          {"recording", agent.recording}};
}

constexpr std::array kScanStates = {"sweep", "compute", "done", "failed"};
constexpr int kMaxScanCells = 512;

Json Scan(const WatchScan& scan) {
  return {{"state", scan.state},
          {"age_s", Finite(scan.age_s)},
          {"positions", scan.positions},
          {"recorded", scan.recorded},
          {"left_out", scan.left_out},
          {"columns", scan.columns},
          {"rows", scan.rows},
          {"cells", scan.cells},
          {"pan_deg", {Finite(scan.pan_deg[0]), Finite(scan.pan_deg[1])}},
          {"tilt_deg", {Finite(scan.tilt_deg[0]), Finite(scan.tilt_deg[1])}},
          {"text", scan.text},
          {"notes", scan.notes},
          {"coverage", Finite(scan.coverage)},
          {"triangles", scan.triangles}};
}

Result<WatchScan> ParseScan(const JsonFields& fields) {
  WatchScan scan;
  JsonReader read(fields);
  scan.state = kScanStates[read.Choice("state", kScanStates)];
  read.Double("age_s", &scan.age_s);
  read.Count("positions", &scan.positions);
  read.Count("recorded", &scan.recorded);
  read.Count("left_out", &scan.left_out);
  read.Int("columns", 0, kMaxScanCells, &scan.columns);
  read.Int("rows", 0, kMaxScanCells, &scan.rows);
  read.Text("cells", &scan.cells);
  read.Numbers("pan_deg", scan.pan_deg);
  read.Numbers("tilt_deg", scan.tilt_deg);
  read.Text("text", &scan.text);
  read.Text("notes", &scan.notes);
  read.Double("coverage", &scan.coverage);
  read.Count("triangles", &scan.triangles);
  if (read.status() && (scan.cells.size() != static_cast<std::size_t>(scan.columns * scan.rows) ||
                        scan.cells.find_first_not_of("0123") != std::string::npos)) {
    read.Refuse("cells", "is not a digit 0 .. 3 for each cell");
  }
  if (!read.status()) return tl::unexpected(read.status().error());
  return scan;
}

Result<WatchStream> ParseStream(const std::string& name) {
  for (const WatchStream stream : {WatchStream::kColor, WatchStream::kDepth}) {
    if (name == StreamName(stream)) return stream;
  }
  return Fail(ErrorCode::kBadInput, "streams holds a name that is neither color nor depth");
}

Result<WatchCamera> ParseCamera(const JsonFields& fields) {
  WatchCamera camera;
  JsonReader read(fields);
  read.Int("width", 1, 16384, &camera.width);
  read.Int("height", 1, 16384, &camera.height);
  read.Double("fx", &camera.fx);
  read.Double("fy", &camera.fy);
  read.Double("cx", &camera.cx);
  read.Double("cy", &camera.cy);
  if (!read.status()) return tl::unexpected(read.status().error());
  if (!(camera.fx > 0 && camera.fy > 0)) return Fail(ErrorCode::kBadInput, "fx or fy is not above 0");
  return camera;
}

Result<ServerMessage> ParseHello(const JsonFields& fields) {
  WatchHello hello;
  int protocol = 0;
  std::string role;
  const Json* streams = nullptr;
  JsonReader read(fields);
  read.Int("protocol", 0, 1'000'000, &protocol);
  read.Text("name", &hello.name);
  read.Int64("server_us", &hello.server_us);
  read.Text("role", &role);
  read.List("streams", 8, &streams);
  if (!read.status()) return Within("hello", read.status().error());
  if (protocol != kWatchProtocol) {
    return Fail(ErrorCode::kBadInput, "hello: the server speaks protocol " + std::to_string(protocol) +
                                          ", this viewer " + std::to_string(kWatchProtocol));
  }
  const Result<WatchRole> known_role = ParseRole(role);
  if (!known_role) return Within("hello", known_role.error());
  hello.role = *known_role;
  for (const Json& item : *streams) {
    std::string name;
    WatchStreamInfo info;
    JsonReader read_item(item);
    read_item.Text("stream", &name);
    read_item.Text("codec", &info.codec);
    read_item.Int("width", 1, 16384, &info.width);
    read_item.Int("height", 1, 16384, &info.height);
    if (!read_item.status()) return Within("hello: streams", read_item.status().error());
    const Result<WatchStream> stream = ParseStream(name);
    if (!stream) continue;  // one that a later version added
    info.stream = *stream;
    hello.streams.push_back(std::move(info));
  }
  if (const auto camera = fields.find("camera"); camera != fields.end()) {
    auto parsed = ParseCamera(*camera);
    if (!parsed) return Within("hello: camera", parsed.error());
    hello.camera = *parsed;
  }
  return hello;
}

Result<ServerMessage> ParseStats(const JsonFields& fields) {
  WatchStats stats;
  const Json *latency = nullptr, *drops = nullptr, *stages = nullptr, *agents = nullptr, *recording = nullptr;
  JsonReader read(fields);
  read.Int64("server_us", &stats.server_us);
  read.Text("state", &stats.state);
  read.Text("message", &stats.message);
  read.Double("fps", &stats.fps);
  read.Count("frames", &stats.frames);
  read.Int("width", 0, 16384, &stats.width);
  read.Int("height", 0, 16384, &stats.height);
  read.Object("latency_ms", &latency);
  read.Double("bitrate_bps", &stats.bitrate_bps);
  read.Count("viewers", &stats.viewers);
  read.Object("drops", &drops);
  read.List("stages", 64, &stages);
  read.List("agents", 64, &agents);
  read.Double("depth_age_s", &stats.depth_age_s);
  if (read.Has("depth_clock_ms")) read.Double("depth_clock_ms", &stats.depth_clock_ms.emplace());
  read.Object("recording", &recording);
  const Json* contacts = nullptr;
  if (read.Has("contacts")) read.List("contacts", kMaxStatsContacts, &contacts);
  if (read.Has("T_scene_color")) read.Numbers("T_scene_color", stats.T_scene_color.emplace());
  if (!read.status()) return Within("stats", read.status().error());
  JsonReader read_recording(*recording);
  read_recording.Bool("active", &stats.recording.active);
  read_recording.Double("seconds", &stats.recording.seconds);
  read_recording.Count("dropped", &stats.recording.dropped);
  if (!read_recording.status()) return Within("stats: recording", read_recording.status().error());
  if (const auto item = fields.find("scan"); item != fields.end()) {
    auto scan = ParseScan(*item);
    if (!scan) return Within("stats: scan", scan.error());
    stats.scan = std::move(*scan);
  }
  if (contacts != nullptr) {
    for (const Json& item : *contacts) {
      WatchContact contact;
      JsonReader r(item);
      r.Double("age_s", &contact.age_s);
      r.Text("event", &contact.event);
      r.Text("object", &contact.object);
      r.Text("with", &contact.with);
      r.Double("impulse_ns", &contact.impulse_ns);
      r.Text("text", &contact.text);
      if (!r.status()) return Within("stats: contacts", r.status().error());
      stats.contacts.push_back(std::move(contact));
    }
  }
  JsonReader read_latency(*latency);
  read_latency.Double("p50", &stats.latency_p50_ms);
  read_latency.Double("p99", &stats.latency_p99_ms);
  if (!read_latency.status()) return Within("stats: latency_ms", read_latency.status().error());
  if (drops->size() > 64) return Fail(ErrorCode::kBadInput, "stats: drops has more than 64 reasons");
  JsonReader read_drops(*drops);
  for (const auto& [reason, count] : drops->items()) read_drops.Count(reason, &stats.drops[reason]);
  if (!read_drops.status()) return Within("stats: drops", read_drops.status().error());
  for (const Json& item : *stages) {
    WatchStage stage;
    JsonReader r(item);
    r.Text("name", &stage.name);
    r.Double("budget_ms", &stage.budget_ms);
    r.Double("wall_ms", &stage.wall_ms);
    r.Double("cpu_ms", &stage.cpu_ms);
    if (!r.status()) return Within("stats: stages", r.status().error());
    stats.stages.push_back(std::move(stage));
  }
  for (const Json& item : *agents) {
    WatchAgent agent;
    JsonReader r(item);
    r.Text("epoch", &agent.epoch);
    r.Text("name", &agent.name);
    r.Double("age_s", &agent.age_s);
    r.Double("color_fps", &agent.color_fps);
    r.Double("depth_fps", &agent.depth_fps);
    r.Count("drops", &agent.drops);
    r.Count("queue", &agent.queue);
    r.Double("encode_ms", &agent.encode_ms);
    r.Count("lost", &agent.lost);
    r.Count("repaired", &agent.repaired);
    r.Double("slice_loss", &agent.slice_loss);
    r.Double("delay_ms", &agent.delay_ms);
    r.Bool("recording", &agent.recording);
    if (!r.status()) return Within("stats: agents", r.status().error());
    stats.agents.push_back(std::move(agent));
  }
  return stats;
}

Result<ViewerMessage> ParseSubscribe(const JsonFields& fields) {
  const Json* streams = nullptr;
  JsonReader read(fields);
  read.List("streams", 4, &streams);
  if (!read.status()) return Within("subscribe", read.status().error());
  WatchSubscribe subscribe;
  for (const Json& item : *streams) {
    if (!item.is_string())
      return Fail(ErrorCode::kBadInput, "subscribe: streams holds something else than names");
    const auto& name = item.get_ref<const std::string&>();
    if (name == StreamName(WatchStream::kColor)) {
      subscribe.color = true;
    } else if (name == StreamName(WatchStream::kDepth)) {
      subscribe.depth = true;
    } else if (name == StreamName(WatchStream::kActorMesh)) {
      subscribe.mesh = true;
    } else if (name == StreamName(WatchStream::kLightMap)) {
      subscribe.light = true;
    } else {
      return Fail(ErrorCode::kBadInput,
                  "subscribe: streams holds a name that is none of color, depth, mesh, light");
    }
  }
  return subscribe;
}

struct TypedMessage {
  Json json;
  std::string type;
};

Result<TypedMessage> ParseTyped(std::string_view text, std::size_t max_bytes) {
  if (text.size() > max_bytes) {
    return Fail(ErrorCode::kBadInput, "message has " + std::to_string(text.size()) + " bytes, more than " +
                                          std::to_string(max_bytes));
  }
  TypedMessage message;
  message.json = ParseBoundedJson(text);
  JsonReader read(message.json);
  read.Text("type", &message.type);
  if (!read.status()) return Within("message", read.status().error());
  return message;
}

}  // namespace

std::string_view RoleName(WatchRole role) { return role == WatchRole::kDirector ? "director" : "viewer"; }

Result<WatchRole> ParseRole(std::string_view name) {
  for (const WatchRole role : {WatchRole::kViewer, WatchRole::kDirector}) {
    if (name == RoleName(role)) return role;
  }
  return Fail(ErrorCode::kBadInput, "role is neither viewer nor director");
}

std::string ToJson(const WatchHello& hello) {
  Json streams = Json::array();
  for (const WatchStreamInfo& info : hello.streams) {
    streams.push_back({{"stream", StreamName(info.stream)},
                       {"codec", info.codec},
                       {"width", info.width},
                       {"height", info.height}});
  }
  Json json = {{"type", "hello"},
               {"protocol", kWatchProtocol},
               {"name", hello.name},
               {"server_us", hello.server_us},
               {"role", RoleName(hello.role)},
               {"streams", std::move(streams)}};
  if (hello.camera) {
    const WatchCamera& c = *hello.camera;
    json["camera"] = {{"width", c.width},   {"height", c.height}, {"fx", Finite(c.fx)},
                      {"fy", Finite(c.fy)}, {"cx", Finite(c.cx)}, {"cy", Finite(c.cy)}};
  }
  return Dump(json);
}

std::string ToJson(const WatchStats& stats) {
  Json stages = Json::array();
  for (const WatchStage& stage : stats.stages) stages.push_back(Stage(stage));
  Json agents = Json::array();
  for (const WatchAgent& agent : stats.agents) agents.push_back(Agent(agent));
  Json drops = Json::object();
  for (const auto& [reason, count] : stats.drops) drops[reason] = count;
  Json json = {{"type", "stats"},
               {"server_us", stats.server_us},
               {"state", stats.state},
               {"message", stats.message},
               {"fps", Finite(stats.fps)},
               {"frames", stats.frames},
               {"width", stats.width},
               {"height", stats.height},
               {"latency_ms", {{"p50", Finite(stats.latency_p50_ms)}, {"p99", Finite(stats.latency_p99_ms)}}},
               {"bitrate_bps", Number(stats.bitrate_bps)},
               {"viewers", stats.viewers},
               {"drops", std::move(drops)},
               {"stages", std::move(stages)},
               {"agents", std::move(agents)},
               {"depth_age_s", Finite(stats.depth_age_s)},
               {"recording",
                {{"active", stats.recording.active},
                 {"seconds", Finite(stats.recording.seconds)},
                 {"dropped", stats.recording.dropped}}}};
  if (stats.depth_clock_ms) json["depth_clock_ms"] = Finite(*stats.depth_clock_ms);
  for (const WatchContact& contact : stats.contacts) {
    json["contacts"].push_back({{"age_s", Finite(contact.age_s)},
                                {"event", contact.event},
                                {"object", contact.object},
                                {"with", contact.with},
                                {"impulse_ns", Finite(contact.impulse_ns)},
                                {"text", contact.text}});
  }
  if (stats.scan) json["scan"] = Scan(*stats.scan);
  if (stats.T_scene_color) {
    Json& numbers = json["T_scene_color"] = Json::array();
    for (const double number : *stats.T_scene_color) numbers.push_back(Finite(number));
  }
  return Dump(json);
}

std::string ToJson(const WatchPong& pong) {
  return Dump({{"type", "pong"}, {"viewer_us", Number(pong.viewer_us)}, {"server_us", pong.server_us}});
}

std::string ToJson(const WatchPing& ping) {
  return Dump({{"type", "ping"}, {"viewer_us", Number(ping.viewer_us)}});
}

std::string ToJson(const WatchTicket& ticket) {
  return Dump({{"type", "ticket"}, {"ticket", ticket.ticket}});
}

std::string ToJson(const WatchSubscribe& subscribe) {
  Json streams = Json::array();
  if (subscribe.color) streams.push_back(StreamName(WatchStream::kColor));
  if (subscribe.depth) streams.push_back(StreamName(WatchStream::kDepth));
  if (subscribe.mesh) streams.push_back(StreamName(WatchStream::kActorMesh));
  if (subscribe.light) streams.push_back(StreamName(WatchStream::kLightMap));
  return Dump({{"type", "subscribe"}, {"streams", std::move(streams)}});
}

std::string ToJson(const WatchKeyFrameWish&) { return Dump({{"type", "keyframe"}}); }

Result<ServerMessage> ParseServerMessage(std::string_view text) {
  const Result<TypedMessage> message = ParseTyped(text, kMaxServerMessageBytes);
  if (!message) return tl::unexpected(message.error());
  if (message->type == "hello") return ParseHello(message->json);
  if (message->type == "stats") return ParseStats(message->json);
  if (message->type == "scene") return ReadScene(message->json);
  if (message->type == "refused") return ReadRefused(message->json);
  if (message->type == "pong") {
    WatchPong pong;
    JsonReader read(message->json);
    read.Double("viewer_us", &pong.viewer_us);
    read.Int64("server_us", &pong.server_us);
    if (!read.status()) return Within("pong", read.status().error());
    return pong;
  }
  return Fail(ErrorCode::kBadInput, "message: type is none of hello, stats, pong, scene, refused");
}

Result<ViewerMessage> ParseViewerMessage(std::string_view text) {
  const Result<TypedMessage> message = ParseTyped(text, kMaxViewerMessageBytes);
  if (!message) return tl::unexpected(message.error());
  if (message->type == "keyframe") return WatchKeyFrameWish{};
  if (message->type == "subscribe") return ParseSubscribe(message->json);
  if (message->type == "edit") return ReadEdit(message->json);
  if (message->type == "ping") {
    WatchPing ping;
    JsonReader read(message->json);
    read.Double("viewer_us", &ping.viewer_us);
    if (!read.status()) return Within("ping", read.status().error());
    return ping;
  }
  if (message->type == "ticket") {
    WatchTicket ticket;
    JsonReader read(message->json);
    read.Text("ticket", &ticket.ticket);
    if (!read.status()) return Within("ticket", read.status().error());
    return ticket;
  }
  return Fail(ErrorCode::kBadInput, "message: type is none of ping, ticket, subscribe, keyframe, edit");
}

}  // namespace mixstage
