// SPDX-License-Identifier: Apache-2.0
#include "server/scene/scene_write.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <system_error>

#include "server/scene/scene_file.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;

constexpr const char* kHead =
    "# Saved by mixstage-server from a show. Comments of the file before are not in it: they are in its "
    ".bak.\n";

// The shortest digits that read back as the same double.
std::string Number(double value) {
  std::array<char, 32> text{};
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr};
}
// The shortest that read back as the same float where a double is read first.
std::string Number(float value) {
  std::array<char, 32> text{};
  char* const end = std::to_chars(text.data(), text.data() + text.size(), value).ptr;
  double read = 0;
  std::from_chars(text.data(), end, read);
  return static_cast<float>(read) == value ? std::string(text.data(), end)
                                           : Number(static_cast<double>(value));
}

template <typename List>
std::string Numbers(const List& values) {
  std::string text = "[";
  for (const auto value : values) text += (text.size() > 1 ? ", " : "") + Number(value);
  return text + "]";
}

std::string Numbers(const Eigen::Affine3d& T) {
  std::array<double, 16> numbers{};
  Eigen::Map<Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(numbers.data()) = T.matrix();
  return Numbers(numbers);
}

std::string Quoted(const std::string& text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      quoted += {'\\', c};
    } else if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) {
      std::array<char, 8> code{};
      std::snprintf(code.data(), code.size(), "\\x%02x", static_cast<unsigned>(c));
      quoted += code.data();
    } else {
      quoted += c;
    }
  }
  return quoted + "\"";
}

std::string ObjectYaml(const SceneObject& object) {
  std::string text = "  - name: " + Quoted(object.name) + "\n    file: " + Quoted(object.file) + "\n";
  if (object.placing) {
    const Placing& placing = *object.placing;
    text += "    position: " + Numbers(placing.position) + "\n";
    text += "    rotation_deg: " + Numbers(placing.rotation_deg) + "\n";
    text += "    scale: " + Number(placing.scale) + "\n";
    if (placing.up) text += std::string("    up: ") + (*placing.up == UpAxis::kY ? "y" : "z") + "\n";
  } else {
    text += "    pose: " + Numbers(object.T_scene_object) + "\n";
  }
  if (object.drop) text += "    drop: true\n";
  if (object.hidden) text += "    hidden: true\n";
  if (object.clip != 0)
    text += "    animation: " + Quoted(ClipName(*object.mesh->motion, object.clip)) + "\n";
  constexpr const char* kBodies[] = {"isolated", "mutual", "actor"};
  text += std::string("    body: ") + kBodies[static_cast<int>(object.body) - 1] + "\n";
  return text + "    mass_kg: " + Number(object.mass_kg) + "\n    friction: " + Number(object.friction) +
         "\n    restitution: " + Number(object.restitution) + "\n";
}

std::string LightYaml(const Light& light) {
  std::string text = "  - {name: " + Quoted(light.name);
  if (const auto* point = std::get_if<PointLight>(&light.shape)) {
    text += ", kind: point, position: " + Numbers(point->position);
  } else if (const auto* area = std::get_if<AreaLight>(&light.shape)) {
    text += ", kind: area, center: " + Numbers(area->center) + ", edge_u: " + Numbers(area->edge_u) +
            ", edge_v: " + Numbers(area->edge_v);
  } else {
    const auto& sun = std::get<DirectionalLight>(light.shape);
    text += ", kind: directional, direction: " + Numbers(Eigen::Vector3d(-sun.toward_light));
  }
  return text + ", color: " + Numbers(light.color) + ", intensity: " + Number(light.intensity) + "}\n";
}

std::string ReflectorYaml(const Reflector& reflector) {
  std::string text = "  - {name: " + Quoted(reflector.name);
  text += reflector.surface.empty() ? ", plane: " + Numbers(reflector.plane)
                                    : ", surface: " + Quoted(reflector.surface);
  if (!reflector.polygon.empty()) {
    text += ", polygon: [";
    for (const Eigen::Vector3d& corner : reflector.polygon) {
      text += (&corner == reflector.polygon.data() ? "" : ", ") + Numbers(corner);
    }
    text += "]";
  }
  if (reflector.color) text += ", color: " + Numbers(*reflector.color);
  return text + ", reflectivity: " + Number(reflector.reflectivity) +
         ", roughness: " + Number(reflector.roughness) + "}\n";
}

std::string ReactionYaml(const Reaction& reaction) {
  std::string text = "  - {object: " + Quoted(reaction.object) + ", meets: " + Quoted(reaction.meets);
  if (reaction.least_impulse_ns > 0) text += ", least_impulse_ns: " + Number(reaction.least_impulse_ns);
  if (reaction.after_s > 0) text += ", after_s: " + Number(reaction.after_s);
  if (const auto* message = std::get_if<SendMessage>(&reaction.action)) {
    text += ", message: " + Quoted(message->text);
  } else if (const auto* dim = std::get_if<DimLight>(&reaction.action)) {
    text += ", light: " + Quoted(dim->light) + ", intensity: " + Number(dim->intensity);
  } else if (const auto* play = std::get_if<PlayAnimation>(&reaction.action)) {
    text += ", play: " + Quoted(play->clip) + ", of: " + Quoted(play->object);
  } else {
    text += ", put_back: " + Quoted(std::get<PutBack>(reaction.action).object);
  }
  return text + "}\n";
}

std::string AvatarYaml(const Avatar& avatar) {
  std::string text = "avatar:\n";
  for (const auto& [key, name] :
       {std::pair("room", &avatar.room), {"video", &avatar.video}, {"poses", &avatar.poses}}) {
    if (!name->empty()) text += std::string("  ") + key + ": " + Quoted(*name) + "\n";
  }
  text += "  anchor: " + Numbers(avatar.anchor) + "\n  position: " + Numbers(avatar.position) +
          "\n  turn_deg: " + Number(avatar.turn_deg) + "\n";
  if (const auto& camera = avatar.camera) {
    text += "  camera: {position: " + Numbers(camera->position) + ", look_at: " + Numbers(camera->look_at);
    if (camera->view_deg) text += ", view_deg: " + Number(*camera->view_deg);
    text += "}\n";
  }
  return text;
}

Status Failed(const fs::path& file, const char* what, int error) {
  return Fail(ErrorCode::kUnavailable, file.string() + ": " + what + " (" + std::strerror(error) + ")");
}

// A file that goes again unless it is kept.
class NewFile {
 public:
  NewFile(const fs::path& folder, const std::string& name)
      : path_((folder / ("." + name + ".XXXXXX")).string()) {
    fd_ = mkostemp(path_.data(), O_CLOEXEC);
  }
  ~NewFile() {
    if (fd_ < 0) return;
    close(fd_);
    if (!kept_) unlink(path_.c_str());
  }
  NewFile(const NewFile&) = delete;
  NewFile& operator=(const NewFile&) = delete;

  [[nodiscard]] bool open() const { return fd_ >= 0; }
  [[nodiscard]] bool Write(const std::string& text, mode_t mode) const {
    for (std::size_t done = 0; done < text.size();) {
      const ssize_t n = write(fd_, text.data() + done, text.size() - done);
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) return false;
      done += static_cast<std::size_t>(n);
    }
    return fchmod(fd_, mode) == 0 && fsync(fd_) == 0;
  }
  [[nodiscard]] bool RenameTo(const fs::path& file) {
    kept_ = rename(path_.c_str(), file.c_str()) == 0;
    return kept_;
  }

 private:
  std::string path_;
  int fd_ = -1;
  bool kept_ = false;
};

// The folder's entry of a renamed file lasts through a power cut too; where that cannot be had the file is
// still good.
void SyncFolder(const fs::path& folder) {
  const int fd = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return;
  fsync(fd);
  close(fd);
}

// FILE.bak holds what FILE holds, at every moment a whole file.
Status KeepAsBak(const fs::path& file, const std::string& bytes, mode_t mode) {
  NewFile copy(file.parent_path(), file.filename().string() + ".bak");
  fs::path bak = file;
  bak += ".bak";
  if (!copy.open() || !copy.Write(bytes, mode) || !copy.RenameTo(bak)) {
    return Failed(bak, "the scene before cannot be kept", errno);
  }
  return {};
}

}  // namespace

std::string ToYaml(const Scene& scene) {
  std::string text = kHead;
  text +=
      std::string("version: 1\nframe: ") + (scene.frame == SceneFrame::kWorld ? "world" : "camera") + "\n";
  if (scene.ambient) {
    text += "ambient: " + Numbers(std::array<float, 2>{scene.ambient->above, scene.ambient->below}) + "\n";
  }
  text += scene.objects.empty() ? "objects: []\n" : "objects:\n";
  for (const SceneObject& object : scene.objects) text += ObjectYaml(object);
  text += scene.lights.empty() ? "lights: []\n" : "lights:\n";
  for (const Light& light : scene.lights) text += LightYaml(light);
  if (!scene.reflectors.empty()) text += "reflectors:\n";
  for (const Reflector& reflector : scene.reflectors) text += ReflectorYaml(reflector);
  if (!scene.reactions.empty()) text += "reactions:\n";
  for (const Reaction& reaction : scene.reactions) text += ReactionYaml(reaction);
  if (scene.avatar) text += AvatarYaml(*scene.avatar);
  return text;
}

Status WriteScene(const Scene& scene, const fs::path& named) {
  std::error_code error;
  fs::path file = fs::weakly_canonical(named, error);  // through links: a linked scene stays linked
  if (error) file = named;
  const std::string text = ToYaml(scene);
  if (text.size() > kSceneFileBytes) {
    return Fail(ErrorCode::kUnavailable, file.string() + ": the scene would have more than 1 MB");
  }
  if (auto read = ParseScene(text, file.string()); !read) {
    return Fail(ErrorCode::kInternal,
                "the scene cannot be written so that it reads back: " + read.error().message);
  }
  struct stat before {};
  const bool exists = stat(file.c_str(), &before) == 0;
  const mode_t mode = exists ? before.st_mode & 07777 : 0644;
  NewFile fresh(file.parent_path(), file.filename().string());
  if (!fresh.open() || !fresh.Write(text, mode)) return Failed(file, "cannot be written", errno);
  if (exists) {
    const auto bytes = ReadFileBytes(file, kSceneFileBytes);
    if (!bytes) return Fail(ErrorCode::kUnavailable, file.string() + " " + bytes.error().message);
    if (auto kept = KeepAsBak(file, {bytes->begin(), bytes->end()}, mode); !kept) return kept;
  }
  if (!fresh.RenameTo(file)) return Failed(file, "cannot be written", errno);
  SyncFolder(file.parent_path());
  return {};
}

}  // namespace mixstage
