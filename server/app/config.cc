// SPDX-License-Identifier: Apache-2.0
#include "server/app/config.h"

#include <cstdio>
#include <sstream>

#include "proto/base/file_bytes.h"
#include "server/scene/yaml_fields.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kMaxConfigBytes = 1 << 20;

Status ReadPath(YamlFields& f, const char* key, const fs::path& folder, fs::path& path) {
  std::string text;
  if (auto ok = f.Text(key, text); !ok || text.empty()) return ok;
  path = fs::path(text).is_absolute() ? fs::path(text) : (folder / text).lexically_normal();
  // What is written out again must be read again.
  if (path.native().size() > YamlFields::kLongestText)
    return f.Bad(key, "is with its folder over " + std::to_string(YamlFields::kLongestText) + " characters");
  return {};
}

Status ReadTexts(YamlFields& f, const char* key, std::vector<std::string>& texts) {
  const YAML::Node node = f.Raw(key);
  if (!node.IsDefined() || node.IsNull()) return {};
  if (!node.IsSequence() || node.size() > 100) return f.Bad(key, "is not a list of at most 100 texts");
  for (const YAML::Node& item : node) {
    if (!item.IsScalar() || item.Scalar().empty() || item.Scalar().size() > 300) {
      return f.Bad(key, "holds something else than texts of 1 to 300 characters");
    }
    texts.push_back(item.Scalar());
  }
  return {};
}

// The fields of the mapping under `key`; nothing when it is not there.
template <typename Read>
Status ReadSection(YamlFields& f, const char* key, const std::string& place, Read read) {
  const YAML::Node node = f.Raw(key);
  if (!node.IsDefined() || node.IsNull()) return {};
  YamlFields section(node, place, key);
  if (auto ok = section.CheckShape(); !ok) return ok;
  if (Status ok = read(section); !ok) return ok;
  return section.CheckAllKnown();
}

Status ReadEncoder(YamlFields& f, VideoEncoderConfig& encoder) {
  std::string preset;
  if (auto ok = f.Text("preset", preset); !ok) return ok;
  if (!preset.empty()) {
    auto parsed = ParseEncoderPreset(preset);
    if (!parsed) return f.Bad("preset", parsed.error().message);
    encoder.preset = *parsed;
  }
  double bitrate_mbps = encoder.bitrate_bps * 1e-6;
  if (auto ok = f.NumberIn("bitrate_mbps", 0.1, 100, bitrate_mbps); !ok) return ok;
  encoder.bitrate_bps = static_cast<int>(bitrate_mbps * 1e6);
  return f.NumberIn("key_frame_interval_s", 0.1, 60, encoder.key_frame_interval_s);
}

Status ReadAll(YamlFields& f, const std::string& place, const fs::path& folder, StudioConfig& c) {
  double version = 1;
  if (auto ok = f.NumberIn("version", 1, 1, version); !ok) return ok;
  if (auto ok = f.Text("name", c.name); !ok) return ok;
  if (auto ok = f.Text("lcm", c.lcm_url); !ok) return ok;
  if (f.Has("parity")) {
    double parity = 0;
    if (auto ok = f.NumberIn("parity", 0, 1, parity); !ok) return ok;
    c.parity = parity;
  }
  if (auto ok = ReadPath(f, "rig", folder, c.rig); !ok) return ok;
  if (auto ok = ReadPath(f, "environment", folder, c.environment); !ok) return ok;
  if (auto ok = ReadPath(f, "scene", folder, c.scene); !ok) return ok;
  if (auto ok = ReadPath(f, "regions", folder, c.regions); !ok) return ok;
  auto background = [&](YamlFields& b) -> Status {
    if (auto ok = ReadPath(b, "clean_plate", folder, c.clean_plate); !ok) return ok;
    double frames = c.learn_frames;
    if (auto ok = b.NumberIn("learn_frames", 5, 120, frames); !ok) return ok;
    c.learn_frames = static_cast<int>(frames);
    return {};
  };
  if (auto ok = ReadSection(f, "background", place, background); !ok) return ok;
  std::string renderer;
  if (auto ok = f.Text("renderer", renderer); !ok) return ok;
  if (!renderer.empty()) {
    auto parsed = ParseRenderer(renderer);
    if (!parsed) return f.Bad("renderer", parsed.error().message);
    c.renderer = *parsed;
  }
  if (auto ok = f.Text("listen", c.listen); !ok) return ok;
  if (auto ok = ReadPath(f, "page", folder, c.page); !ok) return ok;
  if (auto ok = ReadPath(f, "tokens", folder, c.tokens); !ok) return ok;
  if (auto ok = f.Text("osc", c.osc); !ok) return ok;
  if (auto ok = ReadPath(f, "audit", folder, c.audit); !ok) return ok;
  auto tls = [&](YamlFields& t) -> Status {
    if (auto ok = ReadPath(t, "certificate", folder, c.tls.certificate); !ok) return ok;
    return ReadPath(t, "key", folder, c.tls.key);
  };
  if (auto ok = ReadSection(f, "tls", place, tls); !ok) return ok;
  if (auto ok = ReadTexts(f, "origins", c.origins); !ok) return ok;
  if (auto ok = ReadTexts(f, "hosts", c.hosts); !ok) return ok;
  if (auto ok = ReadSection(f, "color", place, [&](YamlFields& s) { return ReadEncoder(s, c.color); }); !ok)
    return ok;
  if (auto ok = ReadSection(f, "depth", place, [&](YamlFields& s) { return ReadEncoder(s, c.depth); }); !ok)
    return ok;
  return f.CheckAllKnown();
}

}  // namespace

Result<StudioConfig> ParseStudioConfig(const std::string& text, const fs::path& file) {
  const std::string place = file.string();
  StudioConfig config;
  auto fields = ParseYaml(text, place);
  Status ok = fields ? fields->CheckShape() : Status(tl::unexpected(fields.error()));
  if (ok) ok = ReadAll(*fields, place, file.parent_path(), config);
  if (!ok) {
    // A configuration is a person's own file: whatever is wrong in it is wrong usage.
    ok.error().code = ErrorCode::kInvalidConfig;
    return tl::unexpected(ok.error());
  }
  return config;
}

Result<StudioConfig> LoadStudioConfig(const fs::path& file) {
  auto bytes = ReadFileBytes(file, kMaxConfigBytes);
  if (!bytes) return Fail(ErrorCode::kInvalidConfig, file.string() + ": " + bytes.error().message);
  return ParseStudioConfig(std::string(bytes->begin(), bytes->end()), file);
}

std::string ToYaml(const StudioConfig& c) {
  std::ostringstream out;
  auto quoted = [](const std::string& text) {
    std::string safe;
    for (const char ch : text) {
      if (static_cast<unsigned char>(ch) < ' ' || ch == '\x7F') {  // a line's end would become a space
        char escape[8];
        std::snprintf(escape, sizeof escape, "\\x%02X", static_cast<unsigned>(ch));
        safe += escape;
        continue;
      }
      if (ch == '"' || ch == '\\') safe += '\\';
      safe += ch;
    }
    return '"' + safe + '"';
  };
  auto path = [&](const char* key, const fs::path& value) {
    if (!value.empty()) out << key << ": " << quoted(fs::absolute(value).string()) << "\n";
  };
  auto encoder = [&](const char* key, const VideoEncoderConfig& e) {
    out << key << ": {preset: " << PresetName(e.preset) << ", bitrate_mbps: " << e.bitrate_bps * 1e-6
        << ", key_frame_interval_s: " << e.key_frame_interval_s << "}\n";
  };
  out << "version: 1\nname: " << quoted(c.name) << "\nlcm: " << quoted(c.lcm_url) << "\n";
  if (c.parity) out << "parity: " << *c.parity << "\n";
  path("rig", c.rig);
  path("environment", c.environment);
  path("scene", c.scene);
  path("regions", c.regions);
  out << "background:\n";
  path("  clean_plate", c.clean_plate);
  out << "  learn_frames: " << c.learn_frames << "\n";
  out << "renderer: " << RendererName(c.renderer) << "\n";
  out << "listen: " << quoted(c.listen) << "\n";
  path("page", c.page);
  path("tokens", c.tokens);
  if (!c.tls.empty()) {
    out << "tls:\n";
    path("  certificate", c.tls.certificate);
    path("  key", c.tls.key);
  }
  out << "osc: " << quoted(c.osc) << "\n";
  path("audit", c.audit);
  auto texts = [&](const char* key, const std::vector<std::string>& values) {
    if (!values.empty()) out << key << ":\n";
    for (const std::string& value : values) out << "  - " << quoted(value) << "\n";
  };
  texts("origins", c.origins);
  texts("hosts", c.hosts);
  encoder("color", c.color);
  encoder("depth", c.depth);
  return out.str();
}

}  // namespace mixstage
